# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""One frozen configuration model per stage; units in the names, unknown keys refused."""

from __future__ import annotations

from pydantic import Field

from slarm_graph.config.driving import (
    DrivingConfig,
    ExploreConfig,
    LidarConfig,
    SimulationConfig,
    WheelConfig,
)
from slarm_graph.config.maps import MappingConfig, RadioConfig, RecoveryConfig
from slarm_graph.config.particles import (
    GmappingConfig,
    ParticleLikelihoodConfig,
    ParticleMapsConfig,
    ParticleMotionConfig,
    ProposalConfig,
    ResamplingConfig,
)
from slarm_graph.config.scans import (
    FrontendConfig,
    KeyframeConfig,
    LoopClosureConfig,
    MatchingConfig,
    PoseGraphConfig,
    SourceConfig,
)
from slarm_graph.config.stage import Stage

__all__ = [
    "CheckpointConfig",
    "DrivingConfig",
    "ExploreConfig",
    "FrontendConfig",
    "GmappingConfig",
    "KeyframeConfig",
    "LidarConfig",
    "LoopClosureConfig",
    "MappingConfig",
    "MatchingConfig",
    "ParticleLikelihoodConfig",
    "ParticleMapsConfig",
    "ParticleMotionConfig",
    "PoseGraphConfig",
    "ProposalConfig",
    "RadioConfig",
    "RecoveryConfig",
    "ResamplingConfig",
    "RunConfig",
    "SimulationConfig",
    "SourceConfig",
    "Stage",
    "WheelConfig",
]


class CheckpointConfig(Stage):
    """Saving enough to resume."""

    every_s: float = Field(default=60.0, gt=0)


class RunConfig(Stage):
    """Everything a run needs besides its source."""

    backend: str = "pose_graph"
    seed: int = Field(default=0, ge=0)
    source: SourceConfig = SourceConfig()
    frontend: FrontendConfig = FrontendConfig()
    pose_graph: PoseGraphConfig = PoseGraphConfig()
    gmapping: GmappingConfig = GmappingConfig()
    mapping: MappingConfig = MappingConfig()
    recovery: RecoveryConfig = RecoveryConfig()
    radio: RadioConfig = RadioConfig()
    checkpoint: CheckpointConfig = CheckpointConfig()
    simulation: SimulationConfig = SimulationConfig()
    explore: ExploreConfig = ExploreConfig()
