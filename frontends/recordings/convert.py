# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Convert recordings between ROS 1 bags, ROS 2 bags and CARMEN logs."""

from __future__ import annotations

import contextlib
import gzip
import io
import math
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from slarm_graph.config import SimulationConfig, SourceConfig
from slarm_graph.errors import BadInput
from slarm_graph.frontends.recordings.carmen import CARMEN_ENDINGS
from slarm_graph.frontends.recordings.formats import Sections, format_of, format_written_as
from slarm_graph.frontends.recordings.ros_writing import (
    SIGNAL_OPTION,
    prepare_destination,
    remove,
    write_readings,
)
from slarm_graph.frontends.recordings.rosbag import open_recording, storage_files
from slarm_graph.frontends.recordings.sources import (
    existing_paths,
    is_carmen,
    open_source,
    open_world,
)
from slarm_graph.geometry import Pose2
from slarm_graph.readings import Reading

if TYPE_CHECKING:
    from slarm_graph.frontends.simulation.world_recording import SourceFromWorld

_HOST = "slarm"


def convert(
    sources: Sequence[Path | str] | Path | str,
    destination: Path,
    config: SourceConfig | None = None,
    *,
    overwrite: bool = False,
    section: Sections | None = None,
    simulation: SimulationConfig | None = None,
) -> str:
    """Convert a recording; the destination's ending says into what.

    ROS to ROS keeps every topic, message by message. To and from CARMEN, and from a damaged
    recording, goes through readings: scans with the odometry at their stamps. A world file becomes
    the recording of a drive through it, with the true poses on /ground_truth.

    Parameters
    ----------
    sources : path or sequence of paths
    destination : Path
        `.bag` ROS 1; `.mcap`, `.db3` one ROS 2 file; `.clf`, `.log` (also `.gz`) CARMEN; any other
        name a ROS 2 folder.
    config : SourceConfig, optional
        Choice of topics, where readings are made.
    overwrite : bool
    section : callable, optional
        As for `open_source`.
    simulation : SimulationConfig, optional
        Of the robot that drives through a world.

    Returns
    -------
    str
        What was done, in a line.

    Raises
    ------
    BadInput
        When the source cannot be read or the destination exists.
    """
    paths, destination = existing_paths(sources), Path(destination)
    prepare_destination(destination, overwrite=overwrite)
    theirs = format_written_as(destination, section)
    if theirs is not None:
        source = open_source(paths, config, section=section)
        count = theirs.write(destination, source)
        return f"{destination}: {count} scans of {source.info().description}"
    to_carmen = destination.name.endswith(CARMEN_ENDINGS)
    world = open_world(paths, simulation)
    if world is not None and not to_carmen:
        count = write_readings(destination, world, truth=_truth(world), overwrite=overwrite)
        told = f"{destination}: {count} scans of a {world.info().description}, with ground truth"
        heard = f" and signal strengths (--rss {SIGNAL_OPTION})"
        return told + (heard if world.config.signals.rate_hz > 0.0 else "")
    loss = ""
    has_messages = not is_carmen(paths[0]) and format_of(paths, section) is None
    if not to_carmen and has_messages:
        open_recording(paths)  # tells what is wrong with a file that is none
        loss = _convert_messages(paths, destination)
        if not loss:
            return f"{destination}: every message of {', '.join(path.name for path in paths)}"
    source = open_source(paths, config, section=section)
    if to_carmen:
        count = write_carmen(destination, source)
    else:
        count = write_readings(destination, source, overwrite=overwrite)
    others = f"; only scans and odometry, for {loss}" if loss else ""
    return f"{destination}: {count} scans of {source.info().description}{others}"


def _truth(world: SourceFromWorld) -> Iterator[tuple[int, Pose2]]:
    """Stamped true poses of a drive, once it is over."""
    path = world.truth()
    for stamp_ns, pose in zip(path.stamps_ns.tolist(), path.poses, strict=True):
        yield stamp_ns, Pose2.from_array(pose)


def _convert_messages(paths: Sequence[Path], destination: Path) -> str:
    """ROS to ROS by rosbags, to a place beside the destination first; return why it cannot."""
    from rosbags.convert.converter import ConverterError
    from rosbags.convert.converter import convert as convert_bags
    from rosbags.typesys import Stores, get_typestore

    folder = Path(tempfile.mkdtemp(dir=destination.parent, prefix=".converting-"))
    single = destination.suffix in (".mcap", ".db3")
    made = folder / (destination.stem if single else destination.name)
    storage = "sqlite3" if destination.suffix == ".db3" else "mcap"
    inputs = [path.parent if path.name == "metadata.yaml" else path for path in paths]
    if any(path.is_dir() and not (path / "metadata.yaml").exists() for path in inputs):
        inputs, _ = storage_files(paths)
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            convert_bags(
                inputs, made, storage, 9, None, "file", get_typestore(Stores.LATEST),
                None, (), (), (), (),
            )  # fmt: skip
        remove(destination)
        shutil.move(made / f"{made.name}{destination.suffix}" if single else made, destination)
    except (ConverterError, AssertionError, OSError) as error:
        return str(error) or "its index is damaged"
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    return ""


def write_carmen(destination: Path, readings: Iterable[Reading]) -> int:
    """Write readings as ROBOTLASER1 lines (RAWLASER1 where there is no odometry).

    Beams without a return are written just beyond the maximum range, as CARMEN's drivers do;
    whether the way was clear or the beam invalid is lost.
    """
    opener = gzip.open if destination.name.endswith(".gz") else open
    count, start_ns = 0, None
    with opener(destination, "wt", encoding="ascii") as file:
        file.write("# CARMEN Logfile\n# written by slarm-graph\n")
        for reading in readings:
            start_ns = reading.stamp_ns if start_ns is None else start_ns
            file.write(_line(reading, start_ns))
            count += 1
    return count


def _line(reading: Reading, start_ns: int) -> str:
    scan = reading.scan
    beams, step = len(scan.ranges_m), scan.angle_increment_rad
    ranges = np.where(scan.is_return(), scan.ranges_m, scan.range_max_m + 0.01)
    head = [0, repr(scan.angle_min_rad), repr(step * max(beams - 1, 0)), repr(step)]
    head += [repr(scan.range_max_m), 0.01, 0, beams]
    name, poses = "RAWLASER1", []
    if reading.odom_from_robot is not None:
        name = "ROBOTLASER1"
        laser = reading.odom_from_robot @ scan.robot_from_laser
        poses = [*_pose(laser), *_pose(reading.odom_from_robot), 0, 0, 0, 0, 0]
    told = [f"{value:.4f}".rstrip("0").rstrip(".") for value in ranges.tolist()]
    seconds, rest = divmod(reading.stamp_ns, 1_000_000_000)
    since = (reading.stamp_ns - start_ns) * 1e-9
    tail = [f"{seconds}.{rest:09d}", _HOST, f"{since:.6f}"]
    return " ".join(map(str, [name, *head, *told, 0, *poses, *tail])) + "\n"


def _pose(pose: Pose2) -> list[str]:
    if not all(map(math.isfinite, (pose.x, pose.y, pose.theta))):
        raise BadInput(f"a pose is not finite: {pose}")
    return [f"{value:.9f}" for value in (pose.x, pose.y, pose.theta)]
