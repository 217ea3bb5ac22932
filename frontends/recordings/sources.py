# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Open a recording of any kind as a source of readings."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from slarm_graph.config import SimulationConfig, SourceConfig, Stage
from slarm_graph.errors import BadInput
from slarm_graph.frontends.recordings.formats import Sections, format_of
from slarm_graph.frontends.recordings.world_format import WorldFile
from slarm_graph.readings import Source

if TYPE_CHECKING:
    from slarm_graph.frontends.simulation.world_recording import SourceFromWorld


def open_source(
    paths: Sequence[Path | str] | Path | str,
    config: SourceConfig | None = None,
    simulation: SimulationConfig | None = None,
    *,
    seed: int = 0,
    section: Sections | None = None,
) -> Source:
    """Open one recording of any format, recognised by its content.

    Parameters
    ----------
    paths : path or sequence of paths
        A ROS 1 bag (or several), a ROS 2 folder, metadata.yaml, .mcap or .db3 file, a CARMEN
        log, plain or gzipped, or the YAML file of a world, for a simulated drive through it.
    config : SourceConfig, optional
    simulation : SimulationConfig, optional
        Of the robot that drives through a world.
    seed : int
        Seed of its noise.
    section : callable, optional
        Returns the settings of a format by its name, as `RunConfig.section` does.

    Raises
    ------
    BadInput
        With one line: what is wrong, where, and how to mend it.
    """
    files = existing_paths(paths)
    kind = format_of(files, section)
    if isinstance(kind, WorldFile):
        kind = WorldFile(Stage(), simulation, seed=seed)
    return kind.open(files, config or SourceConfig())


def existing_paths(paths: Sequence[Path | str] | Path | str) -> list[Path]:
    """Return the paths, or raise BadInput for one that is missing or unreadable."""
    given = [paths] if isinstance(paths, (str, Path)) else list(paths)
    if not given:
        raise BadInput("no recording given")
    files = [_world_or_path(path) for path in given]
    for file in files:
        if not file.exists():
            raise BadInput(f"no such file: {file}")
        try:
            if file.is_file() and file.stat().st_size == 0:
                raise BadInput(f"{file} is empty")
            if file.is_file():
                with file.open("rb"):
                    pass
        except OSError as error:
            raise BadInput(f"cannot read {file}: {error.strerror}") from None
    return files


def _world_or_path(given: Path | str) -> Path:
    """Return a path, or the file of the shipped world of that name."""
    from slarm_graph.files.worlds import shipped_worlds, world_path

    path = Path(given)
    return world_path(str(given)) if not path.exists() and str(given) in shipped_worlds() else path


def open_world(paths: Sequence[Path]) -> SourceFromWorld | None:
    """Open a world file as a drive through all of the world; None when it is something else."""
    kind = WorldFile(Stage())
    return kind.open(paths, SourceConfig()) if kind.sniff(paths) else None
