# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""One frozen configuration model per stage; units in the names, unknown keys refused."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field


class Stage(BaseModel):
    """Base of all configuration models."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class SourceConfig(Stage):
    """What to read from a recording."""

    scan_topic: str | None = None
    odom: str | None = None
    """Odometry topic, `none` for scan matching only, or null to choose by itself."""
    robot_frame: str | None = None
    odom_frame: str | None = None
    static_tf: tuple[str, ...] = ()
    """Extra fixed transforms, each `parent child x y z yaw [pitch roll]` [m, rad]."""
    segment: int | None = Field(default=None, ge=1)
    """Which part to use when the clock jumps back, counted from 1."""
    max_odom_gap_s: float = Field(default=0.5, gt=0)
    stamp_at: Literal["first", "middle", "last"] = "first"
    range_min_m: float | None = None
    range_max_m: float | None = None
    echo: Literal["first", "last", "strongest"] = "first"
    clear_on_inf: bool = True
    """Whether +inf ranges clear the space along the beam (REP-117)."""


class FrontendConfig(Stage):
    """The shared scan frontend."""

    max_range_m: float = Field(default=30.0, gt=0)
    deskew: bool = True


class PoseGraphConfig(Stage):
    """The GTSAM pose graph."""


class GmappingConfig(Stage):
    """The Rao-Blackwellised particle filter, with gmapping's names where they mean the same."""

    particles: int = Field(default=30, ge=1)


class MappingConfig(Stage):
    """Rendering scans into an occupancy grid."""

    resolution_m: float = Field(default=0.05, gt=0)
    max_range_m: float = Field(default=30.0, gt=0)
    """Beams are cut here; what lies behind stays unseen."""
    occupied_at: float = Field(default=0.25, gt=0, le=1)
    """A cell is occupied when at least this share of its visits were hits."""
    max_cells: int = Field(default=400_000_000, gt=0)


class RecoveryConfig(Stage):
    """Global geographic map recovery (GGMR)."""

    expansion_radius_m: float = Field(default=0.0, ge=0)
    default_height_m: float | None = Field(default=None, gt=0)
    """Height of obstacles with no better information; null means infinitely high."""


class RadioConfig(Stage):
    """The radio map."""

    scenario: str = "InF-SH"
    frequency_hz: float = Field(default=3.5e9, gt=0)
    antenna_height_m: float = Field(default=0.5, gt=0)
    rician_factor_db: float = 7.0
    power_dbm: float = 20.0


class CheckpointConfig(Stage):
    """Saving enough to resume."""

    every_s: float = Field(default=60.0, gt=0)


class RunConfig(Stage):
    """Everything a run needs besides its source."""

    backend: str = "pose_graph"
    seed: int = 0
    source: SourceConfig = SourceConfig()
    frontend: FrontendConfig = FrontendConfig()
    pose_graph: PoseGraphConfig = PoseGraphConfig()
    gmapping: GmappingConfig = GmappingConfig()
    mapping: MappingConfig = MappingConfig()
    recovery: RecoveryConfig = RecoveryConfig()
    radio: RadioConfig = RadioConfig()
    checkpoint: CheckpointConfig = CheckpointConfig()
