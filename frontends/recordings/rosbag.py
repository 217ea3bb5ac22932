# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Opening of ROS recordings of every kind, recognised by their content."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from slarm_graph.errors import BadInput
from slarm_graph.frontends.recordings.db3_file import MAGIC as SQLITE_MAGIC
from slarm_graph.frontends.recordings.mcap_file import MAGIC as MCAP_MAGIC
from slarm_graph.frontends.recordings.recordings import (
    Recording,
    Ros1Recording,
    first_bytes,
)
from slarm_graph.frontends.recordings.ros1_file import MAGIC as ROS1_MAGIC
from slarm_graph.frontends.recordings.ros2_recording import METADATA, Ros2Recording, listed_files
from slarm_graph.frontends.recordings.unpacking import ZSTD_MAGIC

_ENDINGS = (".mcap", ".db3", ".mcap.zstd", ".db3.zstd")
"""Storage files of rosbag2, plain or compressed as a whole."""


def open_recording(paths: Sequence[Path]) -> Recording:
    """Open ROS 1 bags, or one ROS 2 recording, recognised by their content.

    Parameters
    ----------
    paths : sequence of Path
        Several ROS 1 bags or storage files are put together; a folder may lack its metadata.yaml.

    Raises
    ------
    BadInput
        When a file is no recording, is damaged, or kinds are mixed.
    """
    files, notices = storage_files(paths)
    kinds = {path: _kind(path) for path in files}
    if set(kinds.values()) == {"ROS 1"}:
        return Ros1Recording(files)
    if "ROS 1" in kinds.values():
        raise BadInput("ROS 1 and ROS 2 recordings cannot be read together; convert one first")
    label = ", ".join(_given_name(path) for path in paths)
    return Ros2Recording(files, label, notices)


def _given_name(path: Path) -> str:
    return path.parent.name if path.name == "metadata.yaml" else path.name


def _kind(path: Path) -> str:
    """Return a file's kind by its first bytes."""
    start = first_bytes(path)
    if start.startswith(ROS1_MAGIC):
        return "ROS 1"
    if start.startswith((SQLITE_MAGIC, MCAP_MAGIC, ZSTD_MAGIC)):
        return "ROS 2"
    if start.startswith((b"#ROSBAG V", b"#ROSRECORD V")):
        version = start.split(b"\n")[0].decode("ascii", "replace").lstrip("#")
        raise BadInput(
            f"{path} has the old format {version}; convert it with: rosbag fix {path.name} new.bag"
        )
    raise BadInput(
        f"{path} is not a ROS bag or CARMEN log (first bytes {start[:8].decode('latin-1')!a})"
    )


def storage_files(paths: Sequence[Path]) -> tuple[list[Path], list[str]]:
    """Replace folders by what lies inside, where rosbags would not find it."""
    files: list[Path] = []
    notices: list[str] = []
    for path in paths:
        folder = path.parent if path.name == "metadata.yaml" else path
        if not folder.is_dir():
            files.append(path)
            continue
        inside, notice = _inside(folder)
        files += inside
        notices += notice
    return files, notices


def _inside(folder: Path) -> tuple[list[Path], list[str]]:
    """Return the files of a recording in a folder, by its metadata.yaml where that is usable."""
    if (folder / METADATA).is_file() and (listed := listed_files(folder)):
        return listed, []
    found = sorted(
        (file for ending in _ENDINGS for file in folder.glob(f"*{ending}")), key=_natural
    )
    bags = sorted(folder.glob("*.bag"), key=_natural)
    if found or bags:
        names = ", ".join(file.name for file in found or bags)
        return found or bags, [f"{folder} has no usable metadata.yaml; reading {names}"]
    raise BadInput(f"{folder} is a folder without a recording (no .bag, .mcap or .db3 inside)")


def _natural(path: Path) -> list[tuple[int, str]]:
    """Sort name_2 before name_10."""
    parts = re.split(r"(\d+)", path.name)
    return [(int(part), "") if part.isdigit() else (-1, part) for part in parts]
