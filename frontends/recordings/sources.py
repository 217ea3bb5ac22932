# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Open a recording of any kind as a source of readings."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from slarm_graph.config import SimulationConfig, SourceConfig
from slarm_graph.errors import BadInput
from slarm_graph.frontends.recordings.carmen import looks_like_carmen, read_carmen
from slarm_graph.frontends.recordings.carmen_lines import LASERS
from slarm_graph.frontends.recordings.clock import segment_rows, segments
from slarm_graph.frontends.recordings.formats import Sections, format_of
from slarm_graph.frontends.recordings.mounting import Mounting
from slarm_graph.frontends.recordings.odometry import sorted_path
from slarm_graph.frontends.recordings.packed import Ints
from slarm_graph.frontends.recordings.readings_from import RecordedSource
from slarm_graph.frontends.recordings.scan_table import ScanTable
from slarm_graph.geometry import Pose2
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
    """Open one recording; its kind is told from its content.

    Parameters
    ----------
    paths : path or sequence of paths
        A ROS 1 bag (or several), a ROS 2 folder, metadata.yaml, .mcap or .db3 file, a CARMEN
        log, plain or gzipped, or the YAML file of a world, through which a robot is then driven.
    config : SourceConfig, optional
    simulation : SimulationConfig, optional
        The robot that is driven through a world.
    seed : int
        Of its noise.
    section : callable, optional
        Gives the settings of a format by its name, as `RunConfig.section` does.

    Raises
    ------
    BadInput
        With one line: what is wrong, where, and how to mend it.
    """
    files, config = existing_paths(paths), config or SourceConfig()
    theirs = format_of(files, section)
    if theirs is not None:
        return theirs.open(files, config)
    logs = [file for file in files if is_carmen(file)]
    if logs and len(files) > 1:
        raise BadInput(f"{logs[0]} is a CARMEN log; only one at a time can be read")
    if logs:
        return open_carmen(logs[0], config)
    world = open_world(files, simulation, seed=seed)
    if world is not None:
        return world
    from slarm_graph.frontends.recordings.ros_source import open_ros

    return open_ros(files, config)


def existing_paths(paths: Sequence[Path | str] | Path | str) -> list[Path]:
    """Check that every path leads to something readable."""
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
    """Return a path, or the file of the world that comes along by that name."""
    from slarm_graph.files.worlds import shipped_worlds, world_path

    path = Path(given)
    return world_path(str(given)) if not path.exists() and str(given) in shipped_worlds() else path


def open_world(
    files: Sequence[Path], simulation: SimulationConfig | None = None, *, seed: int = 0
) -> SourceFromWorld | None:
    """Open a world file as a drive through all of the world; None when it is something else."""
    from slarm_graph.files.worlds import is_world_file, load_world

    if len(files) != 1 or not is_world_file(files[0]):
        return None
    from slarm_graph.frontends.simulation.world_recording import SourceFromWorld

    return SourceFromWorld(load_world(files[0]), simulation, seed=seed)


def is_carmen(path: Path) -> bool:
    """Whether a file is a CARMEN log, by its first lines."""
    return path.is_file() and path.name != "metadata.yaml" and looks_like_carmen(path)


def open_carmen(path: Path, config: SourceConfig) -> RecordedSource:
    """Open a CARMEN log: scans with the odometry logged beside them."""
    log = read_carmen(path)
    name = config.scan_topic or next(laser for laser in LASERS if laser in log.scans)
    if name not in log.scans:
        raise BadInput(f"{path} has no {name} lines; it has {', '.join(log.scans)}")
    notices = list(log.notices)
    if len(log.scans) > 1 and config.scan_topic is None:
        others = ", ".join(other for other in log.scans if other != name)
        notices.append(f"using {name}; choose another with --scan ({others})")
    mounting = Mounting(Pose2.from_array(log.robot_from_laser[name]))
    table, odometry = ScanTable(log.scans[name]), None
    if any(block.odom_from_robot is None for block in table.blocks) and config.odom != "none":
        rows = np.arange(len(log.odom_stamp_ns))
        if config.segment is not None:
            count = len(segments(table.stamp_ns))
            rows = segment_rows(log.odom_stamp_ns, config.segment, count)
        odometry = sorted_path(log.odom_stamp_ns[rows], log.odom_poses[rows])

    def mounting_at(frame: str, stamps_ns: Ints) -> list[Mounting | None]:
        """Give the log's one mounting, for CARMEN knows no other."""
        return [mounting] * len(stamps_ns)

    return RecordedSource(
        table,
        odometry,
        mounting_at,
        config=config,
        topic=f"{path.name} {name}",
        description=f"CARMEN log {path.name}",
        notices=notices,
    )
