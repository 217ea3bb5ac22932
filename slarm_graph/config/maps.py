# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Settings of rendering, recovery, and predicted and measured radio maps."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field, field_validator

from slarm_graph.config.sections import PartName
from slarm_graph.config.stage import Reach, Resolution, Stage

Scenario = Literal["InF-SL", "InF-DL", "InF-SH", "InF-DH", "InF-HH", "InH", "free-space"]
"""Rows of `slarm_graph.radio.path_loss.SCENARIOS`."""

LargeImage = Literal["whole", "split", "coarse"]


class MappingConfig(Stage):
    """Rendering scans into an occupancy grid."""

    resolution_m: Resolution = 0.05
    """Cell size of the occupancy map."""
    max_range_m: Reach = 30.0
    """Range at which beams are cut; cells beyond stay unseen."""
    occupied_at: float = Field(default=0.25, gt=0, le=1)
    """Minimum share of hits, among the beams that visit a cell, for it to be occupied."""
    large_image: LargeImage = "whole"
    """How to write a map image with more than 16,384 cells a side, which many programs do not read:
    as a whole all the same, split into several, or in coarser cells."""
    max_cells: int = Field(default=1_000_000_000, gt=0, le=4_000_000_000)
    """Maximum cells of the box around a map, mapped or not: 1.6 x 1.6 km at 0.05 m. A larger map is
    drawn in coarser cells, with a notice."""


class RecoveryConfig(Stage):
    """Global geographic map recovery (GGMR)."""

    expansion_radius_m: float = Field(default=0.0, ge=0, le=100)
    """Distance that the robot keeps from obstacles; cells without a path at that distance are not
    accessible. With the robot's radius the accessible cells are those it can drive to."""
    default_height_m: float | None = Field(default=None, gt=0)
    """Height of obstacles of unknown height; null: by `unknown_heights`."""
    unknown_heights: Literal["prior", "infinite"] = "prior"
    """Model of unknown obstacle heights: `prior` is a distribution per class of plan (from
    standards), so that links have a probability of line of sight and an expected gain; `infinite`
    lets nothing pass over them."""
    ceiling_m: float = Field(default=3.0, gt=0, le=100)
    """Height of the ceiling; 3 m is the room of 3GPP's indoor scenario (TR 38.901, 7.2-2)."""
    laser_height_m: float = Field(default=0.2, ge=0, le=10)
    """Height of the scan plane: obstacles in the map are at least this high."""
    known_sizes: tuple[tuple[float, ...], ...] = ()
    """Length, width and height [m] of obstacles that are known beforehand.

    An optional fourth number is the share of its bounding rectangle that an obstacle's plan fills:
    by default 1; 0.785 for a round one.
    """
    size_tolerance_m: float = Field(default=0.15, gt=0)
    """An obstacle has a known size when its sides, and that of a square as large, are this near."""
    robot_radius_m: float = Field(default=0.18, gt=0, le=10)
    """Free space in which a robot of this radius fits is not changed by recovery."""
    speck_cells: int = Field(default=2, ge=0)
    """Groups of at most this many occupied cells are removed."""
    hole_area_m2: float = Field(default=0.1, ge=0)
    """Unseen holes in free space up to this area become free."""
    straighten: bool = True
    """Whether walls are fitted to straight lines."""

    @field_validator("known_sizes")
    @classmethod
    def _whole_sizes(cls, sizes: tuple[tuple[float, ...], ...]) -> tuple[tuple[float, ...], ...]:
        for size in sizes:
            if len(size) not in (3, 4) or not all(0.0 < number < math.inf for number in size):
                raise ValueError(
                    f"{list(size)} is not a size: length, width and height in m, all positive,"
                    " and if it is not a box the share of its rectangle that it fills"
                )
            if size[3:] > (1.0,):
                raise ValueError(f"{list(size)}: the share of the rectangle is at most 1")
        return tuple((*size, 1.0) if len(size) == 3 else size for size in sizes)


class RadioConfig(Stage):
    """The predicted radio map."""

    propagation: Annotated[str, PartName("propagation model")] = "3gpp"
    """Path-loss model; `3gpp` uses the row of TR 38.901 that `scenario` names."""
    scenario: Scenario = "InF-SH"
    """Propagation scenario of 3GPP TR 38.901, or free-space."""
    frequency_hz: float = Field(default=3.5e9, gt=0, le=1e12)
    """Carrier frequency of access points that do not state their own."""
    antenna_height_m: float = Field(default=0.5, gt=0)
    """Height of the robot's antenna above the floor."""
    rician_factor_db: float = 7.0
    """Rician K factor of small-scale fading in line of sight."""
    power_dbm: float = 20.0
    """Transmit power of access points that do not state their own."""
    mount_radius_m: float = Field(default=0.25, ge=0, le=100)
    """Obstacles this near to an access point are its mount and do not shadow it."""
    csv_most_lines: int = Field(default=2_000_000, ge=0)
    """Maximum lines of `radio_map.csv`; with more it is left out, with a notice; 0: always."""
    gain_tolerance_db: float = Field(default=1.0, gt=0)
    """Largest error of a gain that counts as right in the accuracy."""


class MeasuredConfig(Stage):
    """The radio map from measured signal strength."""

    node_side_m: float = Field(default=0.2, gt=0)
    """Spacing of the nodes on which the field is estimated; well below the shadowing's range."""
    most_nodes: int = Field(default=20_000, ge=10)
    """Maximum number of nodes; with more the spacing grows. Bounds memory and time."""
    threshold_dbm: float | None = None
    """Sensitivity of the receiver: weaker signals are not heard; null: the weakest reading."""
    saturation_dbm: float | None = None
    """Strongest signal that the receiver reports; null: no limit."""
    position_sd_m: float = Field(default=0.05, ge=0)
    """Standard deviation of the trajectory's positions along each axis, where SLAM reports none."""
    least_readings: int = Field(default=10, ge=3)
    """Minimum number of readings of an access point; with fewer it is left out, with a notice."""
    locate: bool = True
    """Whether unknown positions of access points are estimated from the readings."""
    heights: bool = True
    """Whether unknown obstacle heights are estimated from readings behind them, of access points of
    known position."""
    search_readings: int = Field(default=3_000, ge=100)
    """Maximum readings for fitting ranges and noises; the map uses all."""
    search_nodes: int = Field(default=2_500, ge=10)
    """Maximum nodes for fitting ranges and noises."""
