# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The recording format `world`: a simulated drive through the world of a file."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from slarm_graph.config import SimulationConfig, SourceConfig, Stage
from slarm_graph.errors import BadInput
from slarm_graph.files.worlds import is_world_file, load_world
from slarm_graph.frontends.recordings.findings import Look
from slarm_graph.readings import Reading

if TYPE_CHECKING:
    from slarm_graph.frontends.simulation.world_recording import SourceFromWorld


class WorldFile:
    """World or map (YAML): readings come from a drive through all of it."""

    settings: ClassVar[type[Stage]] = Stage
    endings: tuple[str, ...] = ()

    def __init__(
        self, settings: Stage, simulation: SimulationConfig | None = None, *, seed: int = 0
    ) -> None:
        del settings
        self.simulation, self.seed = simulation or SimulationConfig(), seed

    def sniff(self, paths: Sequence[Path]) -> bool:
        """Whether it is one file that describes a world."""
        return len(paths) == 1 and is_world_file(paths[0])

    def open(self, paths: Sequence[Path], config: SourceConfig) -> SourceFromWorld:
        """Return the source that drives through the world."""
        from slarm_graph.frontends.simulation.world_recording import SourceFromWorld

        return SourceFromWorld(load_world(paths[0]), self.simulation, seed=self.seed)

    def check(self, paths: Sequence[Path], config: SourceConfig) -> Look:
        """Describe the drive; there are no messages to check."""
        return Look((), self.open(paths, config).info().description)

    def write(self, destination: Path, readings: Iterable[Reading]) -> int:
        """Refuse: a world is not made of readings."""
        raise BadInput(f"{destination}: worlds are read, not written")
