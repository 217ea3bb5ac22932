# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""One frozen configuration model per stage; units in the names, unknown keys refused."""

from __future__ import annotations

from typing import Annotated, Any, Self

from pydantic import ConfigDict, Field, model_validator

from slarm_graph import parts
from slarm_graph.config.driving import DrivingConfig as DrivingConfig
from slarm_graph.config.driving import ExploreConfig as ExploreConfig
from slarm_graph.config.driving import LidarConfig as LidarConfig
from slarm_graph.config.driving import SignalConfig as SignalConfig
from slarm_graph.config.driving import SimulationConfig as SimulationConfig
from slarm_graph.config.driving import WheelConfig as WheelConfig
from slarm_graph.config.maps import MappingConfig as MappingConfig
from slarm_graph.config.maps import MeasuredConfig as MeasuredConfig
from slarm_graph.config.maps import RadioConfig as RadioConfig
from slarm_graph.config.maps import RecoveryConfig as RecoveryConfig
from slarm_graph.config.particles import GmappingConfig as GmappingConfig
from slarm_graph.config.particles import ParticleLikelihoodConfig as ParticleLikelihoodConfig
from slarm_graph.config.particles import ParticleMapsConfig as ParticleMapsConfig
from slarm_graph.config.particles import ParticleMotionConfig as ParticleMotionConfig
from slarm_graph.config.particles import ProposalConfig as ProposalConfig
from slarm_graph.config.particles import ResamplingConfig as ResamplingConfig
from slarm_graph.config.scans import FrontendConfig as FrontendConfig
from slarm_graph.config.scans import KeyframeConfig as KeyframeConfig
from slarm_graph.config.scans import LoopClosureConfig as LoopClosureConfig
from slarm_graph.config.scans import MatchingConfig as MatchingConfig
from slarm_graph.config.scans import PoseGraphConfig as PoseGraphConfig
from slarm_graph.config.scans import SourceConfig as SourceConfig
from slarm_graph.config.sections import PartName as PartName
from slarm_graph.config.sections import Section, UncheckedSection, chosen_parts
from slarm_graph.config.stage import Stage as Stage
from slarm_graph.errors import BadInput


class CheckpointConfig(Stage):
    """Checkpoints, from which an interrupted run is resumed."""

    every_s: float | None = Field(default=None, gt=0)
    """Time between two checkpoints [s]; null: by what one takes, so that a failure an hour costs
    least."""
    keep: bool = False
    """Whether the last checkpoint is kept when the run has finished."""


class LimitsConfig(Stage):
    """Limits at which a run stops early and writes its results so far."""

    max_time_s: float | None = Field(default=None, gt=0)
    """Wall time after which reading stops [s]; null: no limit."""
    max_memory_mb: float | None = Field(default=None, gt=0)
    """Memory that the process may use [MB, 10^6 bytes]; null: no limit."""


class RunConfig(Stage):
    """Everything a run needs besides its source.

    Every registered part has a section of its name besides these fields, with its own settings:
    `RunConfig(gmapping=GmappingConfig(particles=10))`; `section` gives them.
    """

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, Section]

    backend: Annotated[str, PartName("backend")] = "pose_graph"
    """The SLAM method."""
    seed: int = Field(default=0, ge=0)
    """Seed of all random numbers."""
    source: SourceConfig = SourceConfig()
    frontend: FrontendConfig = FrontendConfig()
    mapping: MappingConfig = MappingConfig()
    recovery: RecoveryConfig = RecoveryConfig()
    radio: RadioConfig = RadioConfig()
    measured: MeasuredConfig = MeasuredConfig()
    checkpoint: CheckpointConfig = CheckpointConfig()
    limits: LimitsConfig = LimitsConfig()
    simulation: SimulationConfig = SimulationConfig()
    explore: ExploreConfig = ExploreConfig()

    @model_validator(mode="before")
    @classmethod
    def _name_sections(cls, given: Any) -> Any:
        """Give every section of a part its name, by which the part is found."""
        if not isinstance(given, dict):
            return given
        known = cls.model_fields
        return {k: v if k in known else UncheckedSection(k, v) for k, v in given.items()}

    @model_validator(mode="after")
    def _keep_what_differs(self) -> Self:
        """Drop sections that equal the default, so that equal configurations compare equal."""
        for name, section in tuple(self.__pydantic_extra__.items()):
            if section == type(section)():
                del self.__pydantic_extra__[name]
        return self

    def section(self, name: str) -> Stage:
        """Return the settings of the part of that name, as given or by default.

        Raises
        ------
        BadInput
            When there is no such part, or it cannot be used.
        """
        given: Stage | None = self.__pydantic_extra__.get(name)
        if given is not None:
            return given
        model = parts.section_settings(name)
        if model is None:
            raise BadInput(f"no part '{name}'; there are {', '.join(parts.section_names())}")
        return model()

    def source_as_used(self) -> SourceConfig:
        """Return how to read the recording: without sweep times where `frontend.deskew` is off."""
        believed = self.source.sweep_times and self.frontend.deskew
        return self.source.model_copy(update={"sweep_times": believed})

    def sections(self) -> dict[str, Stage]:
        """Return the settings of all parts that are chosen or configured, by name."""
        chosen = {name: self.section(name) for _, name in chosen_parts(self)}
        return chosen | self.__pydantic_extra__
