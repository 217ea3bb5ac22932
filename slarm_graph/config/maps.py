# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Rendering, recovery, radio maps that are predicted and such that are measured."""

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
    """Side of a cell of the occupancy map."""
    max_range_m: Reach = 30.0
    """Beams are cut here; what lies behind stays unseen."""
    occupied_at: float = Field(default=0.25, gt=0, le=1)
    """A cell is occupied when at least this share of its visits were hits."""
    large_image: LargeImage = "whole"
    """What becomes of map_server's image with more than 16,384 cells a side, which many programs do
    not read: it is written whole all the same, split, or in coarser cells."""
    max_cells: int = Field(default=1_000_000_000, gt=0, le=4_000_000_000)
    """Cells of the box around a map, mapped or not: 1.6 x 1.6 km at 0.05 m. Where there would be
    more, the map is drawn in coarser cells, and that is told."""


class RecoveryConfig(Stage):
    """Global geographic map recovery (GGMR)."""

    expansion_radius_m: float = Field(default=0.0, ge=0, le=100)
    """How far to keep from obstacles; where that leaves no path, what lies beyond is out of reach.

    The robot's radius gives what it can drive to.
    """
    default_height_m: float | None = Field(default=None, gt=0)
    """Height of obstacles with no better information; null means as `unknown_heights` says."""
    unknown_heights: Literal["prior", "infinite"] = "prior"
    """What to make of obstacles whose height nobody has said: `prior` takes it from a distribution
    per class of plan (from standards), so that links have a probability of line of sight and an
    expected gain; `infinite` lets nothing pass over them."""
    ceiling_m: float = Field(default=3.0, gt=0, le=100)
    """What no obstacle exceeds; 3 m is the room of 3GPP's indoor scenario (TR 38.901, 7.2-2)."""
    laser_height_m: float = Field(default=0.2, ge=0, le=10)
    """Every obstacle that the laser sees is at least so high."""
    known_sizes: tuple[tuple[float, ...], ...] = ()
    """Length, width and height [m] of obstacles that are known to stand around.

    A fourth number is the share of its bounding rectangle that an obstacle's plan fills: 1 when
    left out, 0.785 for what is round.
    """
    size_tolerance_m: float = Field(default=0.15, gt=0)
    """An obstacle has a known size when its sides, and that of a square as large, are this near."""
    robot_radius_m: float = Field(default=0.18, gt=0, le=10)
    """Where a robot of this radius fits, recovery leaves the free space alone."""
    speck_cells: int = Field(default=2, ge=0)
    """Groups of at most so many occupied cells are dropped."""
    hole_area_m2: float = Field(default=0.1, ge=0)
    """Unseen holes up to this size in free space are taken to be free."""
    straighten: bool = True
    """Whether walls are moved onto straight lines."""

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
    """The radio map."""

    propagation: Annotated[str, PartName("propagation model")] = "3gpp"
    """Model of path loss; `3gpp` is the row that `scenario` names."""
    scenario: Scenario = "InF-SH"
    """Propagation scenario of 3GPP TR 38.901, or free-space."""
    frequency_hz: float = Field(default=3.5e9, gt=0, le=1e12)
    """Carrier frequency of access points that say none of their own."""
    antenna_height_m: float = Field(default=0.5, gt=0)
    """Height of the robot's antenna above the floor."""
    rician_factor_db: float = 7.0
    """Power of the direct path over that of all others, for small-scale fading."""
    power_dbm: float = 20.0
    """Transmitted power of access points that say none of their own."""
    mount_radius_m: float = Field(default=0.25, ge=0, le=100)
    """Obstacles this near to an access point carry it and do not hide it."""
    csv_most_lines: int = Field(default=2_000_000, ge=0)
    """Above so many lines `radio_map.csv` is left out, which is told; 0 leaves it out always."""
    gain_tolerance_db: float = Field(default=1.0, gt=0)
    """Gains at most this wrong count as right in the accuracy."""


class MeasuredConfig(Stage):
    """Radio maps from measured signal strength."""

    node_side_m: float = Field(default=0.2, gt=0)
    """Side of the pieces of floor on which the field is kept; well below the shadowing's range."""
    most_nodes: int = Field(default=20_000, ge=10)
    """The pieces grow where there would be more of them: this bounds memory and time."""
    threshold_dbm: float | None = None
    """Signals weaker than this are not heard; null: the weakest that was."""
    saturation_dbm: float | None = None
    """The receiver tells nothing stronger; null: it has no such limit."""
    position_sd_m: float = Field(default=0.05, ge=0)
    """How sure the trajectory's positions are, along each axis."""
    least_readings: int = Field(default=10, ge=3)
    """Access points heard less often are left out, with a notice."""
    locate: bool = True
    """Whether access points of unknown position are sought by what was heard."""
    heights: bool = True
    """Whether heights that nobody has said are told by what is heard behind obstacles, of access
    points whose position is known."""
    search_readings: int = Field(default=3_000, ge=100)
    """Ranges and noises are searched on so many readings; all count for the map."""
    search_nodes: int = Field(default=2_500, ge=10)
    """And on so many pieces of floor."""
