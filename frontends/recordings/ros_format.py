# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The recording format `ros`: opening, checking, writing and copying ROS 1 and ROS 2 bags."""

from __future__ import annotations

import contextlib
import io
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import ClassVar

from slarm_graph.config import SourceConfig, Stage
from slarm_graph.frontends.recordings.check_ros import check_topics
from slarm_graph.frontends.recordings.findings import Look
from slarm_graph.frontends.recordings.recorded_source import RecordedSource
from slarm_graph.frontends.recordings.ros_source import open_ros
from slarm_graph.frontends.recordings.ros_writing import remove, typestore_of, write_readings
from slarm_graph.frontends.recordings.rosbag import open_recording, storage_files
from slarm_graph.geometry import Pose2
from slarm_graph.readings import Reading


class Ros:
    """Bags of ROS 1 and 2; also takes files of no other format, to report what they are not."""

    settings: ClassVar[type[Stage]] = Stage
    endings = ("",)
    """`.bag` is ROS 1, `.mcap` and `.db3` are single ROS 2 files, any other name is a folder."""

    def __init__(self, settings: Stage) -> None:
        del settings

    def sniff(self, paths: Sequence[Path]) -> bool:
        """Accept everything: opening tells what it is."""
        return True

    def open(self, paths: Sequence[Path], config: SourceConfig) -> RecordedSource:
        """Open ROS 1 bags, or one ROS 2 recording."""
        return open_ros(paths, config)

    def check(self, paths: Sequence[Path], config: SourceConfig) -> Look:
        """Check every relevant topic."""
        return check_topics(paths, config)

    def write(self, destination: Path, readings: Iterable[Reading]) -> int:
        """Write /scan, /odom, /tf and /tf_static, and the true poses that a source knows."""
        return write_readings(destination, readings, truth=_truth(readings), overwrite=True)


def _truth(readings: Iterable[Reading]) -> Iterator[tuple[int, Pose2]]:
    """Yield the stamped true poses of a source that knows them, after it was read."""
    path = readings.info().truth if hasattr(readings, "info") else None
    for stamp_ns, pose in zip(path.stamps_ns.tolist(), path.poses, strict=True) if path else ():
        yield stamp_ns, Pose2.from_array(pose)


def _packing(destination: Path) -> tuple[str, str]:
    """Return a compression that other tools read, and whether it is of chunks or of messages."""
    if destination.suffix == ".bag":
        return "lz4", "none"
    return "zstd", "message" if destination.suffix == ".db3" else "storage"


def copy_messages(
    paths: Sequence[Path],
    destination: Path,
    distro: str | None = None,
    *,
    compress: bool = False,
) -> str:
    """Copy every message by rosbags, beside the destination first; return why it cannot.

    Parameters
    ----------
    paths : sequence of Path
    destination : Path
    distro : str, optional
        ROS 2 release whose message definitions to use where the bag has none.
    compress : bool
        lz4 in ROS 1 bags, zstd in ROS 2 bags.

    Raises
    ------
    BadInput
        When a file is no recording.
    """
    open_recording(paths)
    from rosbags.convert.converter import ConverterError
    from rosbags.convert.converter import convert as convert_bags

    folder = Path(tempfile.mkdtemp(dir=destination.parent, prefix=".converting-"))
    single = destination.suffix in (".mcap", ".db3")
    made = folder / (destination.stem if single else destination.name)
    packing, mode = _packing(destination) if compress else (None, "none")
    storage = "sqlite3" if destination.suffix == ".db3" else "mcap"
    inputs = [path.parent if path.name == "metadata.yaml" else path for path in paths]
    if any(path.is_dir() and not (path / "metadata.yaml").exists() for path in inputs):
        inputs, _ = storage_files(paths)
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            convert_bags(
                inputs, made, storage, 9, packing, mode, typestore_of(distro),
                None, (), (), (), (),
            )  # fmt: skip
        remove(destination)
        shutil.move(made / f"{made.name}{destination.suffix}" if single else made, destination)
    except (ConverterError, AssertionError, OSError) as error:
        return str(error) or "its index is damaged"
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    return ""
