# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Decode whole topics of ROS 1 and CDR messages into columns, without one object per message.

Layouts: sensor_msgs/LaserScan, sensor_msgs/MultiEchoLaserScan, nav_msgs/Odometry,
tf2_msgs/TFMessage and tf/tfMessage of common_interfaces and geometry2.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from slarm_graph.frontends.recordings.packed import Cursor, Ints, Malformed, Packed
from slarm_graph.geometry import Floats

LASER_SCAN = "sensor_msgs/msg/LaserScan"
MULTI_ECHO = "sensor_msgs/msg/MultiEchoLaserScan"
ODOMETRY = "nav_msgs/msg/Odometry"
TF_TYPES = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
SCAN_TYPES = (LASER_SCAN, MULTI_ECHO)

Columns = TypeVar("Columns")


@dataclass(frozen=True, slots=True)
class ScanBlock:
    """Scans of one beam count and one frame, in recorded order.

    Parameters
    ----------
    stamp_ns, record_ns : (N,) int64
        Header stamp and time of recording [ns].
    index : (N,) int64
        Position of each scan in its topic.
    limits : (N, 7) float64
        angle_min, angle_max, angle_increment [rad], time_increment, scan_time [s], range_min,
        range_max [m], as recorded.
    ranges_m : (N, B) float32
    frame : str
    odom_from_robot : (N, 3) float64 or None
        Odometry logged with the scans, where the format has it.
    """

    stamp_ns: Ints
    record_ns: Ints
    index: Ints
    limits: Floats
    ranges_m: NDArray[np.float32]
    frame: str
    odom_from_robot: Floats | None = None

    def __len__(self) -> int:
        return len(self.stamp_ns)


@dataclass(frozen=True, slots=True)
class StampedTransforms:
    """Rigid transforms `parent_from_child` over time, from tf or odometry.

    Parameters
    ----------
    stamp_ns, record_ns : (N,) int64
    edges : tuple of (parent, child)
        The distinct pairs of frames, without leading slashes.
    edge : (N,) int64
        Which pair each transform relates.
    translations_m : (N, 3)
    quaternions : (N, 4)
        x y z w, as recorded.
    """

    stamp_ns: Ints
    record_ns: Ints
    edges: tuple[tuple[str, str], ...]
    edge: Ints
    translations_m: Floats
    quaternions: Floats

    def __len__(self) -> int:
        return len(self.stamp_ns)

    def subset(self, rows: Ints | NDArray[np.bool_]) -> StampedTransforms:
        """Return the chosen rows."""
        return replace(
            self,
            stamp_ns=self.stamp_ns[rows],
            record_ns=self.record_ns[rows],
            edge=self.edge[rows],
            translations_m=self.translations_m[rows],
            quaternions=self.quaternions[rows],
        )


def decode(
    parts: Iterable[Packed], one: Callable[[Cursor], Columns], *, cdr: bool
) -> list[Columns]:
    """Apply a decoder to every part, one byte order at a time."""
    out = []
    for part in parts:
        if not cdr:
            out.append(one(Cursor(part, cdr=False)))
            continue
        if np.any(part.ends - part.starts < 4):
            raise Malformed("a message is shorter than its encapsulation header")
        little = (part.buffer[part.starts + 1] & 1).astype(bool) if len(part) else np.ones(0, bool)
        for is_little in (True, False):
            if np.any(little == is_little):
                subset = part.subset(np.flatnonzero(little == is_little))
                out.append(one(Cursor(subset, cdr=True, little_endian=is_little)))
    return out


def read_scans(cursor: Cursor) -> list[ScanBlock]:
    """Decode LaserScan messages, without intensities."""
    return _read_scans(cursor, lambda some, beams: some.column("f4", beams))


def read_multi_echo(cursor: Cursor, echo: str = "first") -> list[ScanBlock]:
    """Decode MultiEchoLaserScan messages, one echo per beam; a beam without echo is nan."""
    from slarm_graph.frontends.recordings.multi_echo import choose_echoes

    return _read_scans(cursor, lambda some, beams: choose_echoes(some, beams, echo))


def _read_scans(
    cursor: Cursor, read_ranges: Callable[[Cursor, int], NDArray[np.generic]]
) -> list[ScanBlock]:
    stamps, (frames, frame) = _header(cursor)
    limits = np.asarray(cursor.column("f4", 7), np.float64)
    beams = cursor.counts()
    blocks = []
    for rows in _groups(beams, frame):
        ranges = read_ranges(cursor.subset(rows), int(beams[rows[0]]))
        blocks.append(
            ScanBlock(
                stamps[rows],
                cursor.packed.record_ns[rows],
                rows,
                limits[rows],
                np.asarray(ranges, np.float32),
                frames[frame[rows[0]]],
            )
        )
    return blocks


def _groups(beams: Ints, frame: Ints) -> list[Ints]:
    """Group the rows of scans by beam count and frame."""
    if len(beams) == 0:
        return []
    if np.all(beams == beams[0]) and np.all(frame == frame[0]):
        return [np.arange(len(beams))]
    pairs = np.stack([beams, frame], axis=-1)
    _, inverse = np.unique(pairs, axis=0, return_inverse=True)
    inverse = inverse.ravel()
    return [np.flatnonzero(inverse == group) for group in range(int(inverse.max()) + 1)]


def read_odometry(cursor: Cursor) -> StampedTransforms:
    """Decode the poses of Odometry messages, without covariance and twist."""
    return _read_transform(cursor)


def read_transforms(cursor: Cursor) -> StampedTransforms:
    """Decode tf messages into single transforms."""
    counts = cursor.counts()
    active, parts, rows = np.arange(len(counts)), [], []
    for number in range(int(counts.max(initial=0))):
        more = counts[active] > number
        active, cursor = active[more], cursor.subset(more)
        parts.append(_read_transform(cursor))
        rows.append(active)
    joined = join_transforms(parts)
    if len(parts) < 2:
        return joined
    return joined.subset(np.argsort(np.concatenate(rows), kind="stable"))


def _read_transform(cursor: Cursor) -> StampedTransforms:
    """Header, child frame, position and quaternion: TransformStamped and Odometry begin alike."""
    stamps, (parents, parent) = _header(cursor)
    children, child = cursor.strings()
    pose = np.asarray(cursor.column("f8", 7), np.float64)
    pairs, edge = np.unique(parent * len(children) + child, return_inverse=True)
    edges = tuple(
        (parents[pair // len(children)], bare_frame(children[pair % len(children)]))
        for pair in pairs.tolist()
    )
    return StampedTransforms(
        stamps, cursor.packed.record_ns, edges, edge.ravel(), pose[:, :3], pose[:, 3:]
    )


def join_transforms(parts: list[StampedTransforms]) -> StampedTransforms:
    """Concatenate transforms."""
    number: dict[tuple[str, str], int] = {}
    for part in parts:
        for pair in part.edges:
            number.setdefault(pair, len(number))
    edge = [np.array([number[p] for p in part.edges], np.int64)[part.edge] for part in parts]
    none = np.zeros(0, np.int64)
    return StampedTransforms(
        np.concatenate([none, *(part.stamp_ns for part in parts)]),
        np.concatenate([none, *(part.record_ns for part in parts)]),
        tuple(number),
        np.concatenate([none, *edge]),
        np.concatenate([np.zeros((0, 3)), *(part.translations_m for part in parts)]),
        np.concatenate([np.zeros((0, 4)), *(part.quaternions for part in parts)]),
    )


def _header(cursor: Cursor) -> tuple[Ints, tuple[list[str], Ints]]:
    """Decode std_msgs/Header: stamps (N,) [ns], the distinct frames and which one each has."""
    if cursor.cdr:
        seconds = np.asarray(cursor.column("i4")[:, 0], np.int64)
        nanoseconds = np.asarray(cursor.column("u4")[:, 0], np.int64)
    else:
        words = np.asarray(cursor.column("u4", 3), np.int64)
        seconds, nanoseconds = words[:, 1], words[:, 2]
    frames, frame = cursor.strings()
    return seconds * 1_000_000_000 + nanoseconds, ([bare_frame(f) for f in frames], frame)


def bare_frame(frame: str) -> str:
    """Drop the leading slash that old ROS 1 recordings put before frame names."""
    return frame.lstrip("/")
