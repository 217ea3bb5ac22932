# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Recordings as topics of serialized messages, in one or several files; ROS 1 bags without ROS."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Protocol

from slarm_graph.counts import count_of
from slarm_graph.errors import BadInput
from slarm_graph.frontends.recordings.packed import Packed
from slarm_graph.frontends.recordings.ros1_file import Ros1File

LONGEST_PAUSE_S = 3600.0
"""Longest pause between the parts of one recording: rosbag splits without a pause; after more than
an hour the robot or its odometry has moved meanwhile."""
LONGEST_OVERLAP_S = 1.0
"""Longest overlap of parts: messages are written some moments after they were made."""
Key = tuple[str, str]
"""Topic and message type."""
Stored = tuple[Key, int, bytes]
"""Topic and type, record time [ns], serialized message."""
Part = tuple[int, tuple[int, int]]
"""Number of messages of a topic in a file, and the first and last record time [ns]."""
_SCAN_TYPES = ("sensor_msgs/msg/LaserScan", "sensor_msgs/msg/MultiEchoLaserScan")


@dataclass(frozen=True, slots=True)
class Topic:
    """A named stream of messages of one type.

    Parameters
    ----------
    name, msgtype : str
        The type spelled as in ROS 2, `pkg/msg/Type`.
    count : int
    rate_hz : float
        Mean rate over the time it was recorded; 0 when that is unknown.
    """

    name: str
    msgtype: str
    count: int
    rate_hz: float = 0.0


class Recording(Protocol):
    """A ROS recording of any kind."""

    description: str
    cdr: bool
    topics: tuple[Topic, ...]

    @property
    def notices(self) -> tuple[str, ...]:
        """Return notices on damaged files; complete once the messages have been read."""
        ...

    def read(self, topics: Iterable[Topic]) -> Iterator[tuple[Topic, Packed]]:
        """Yield the messages of the topics in batches, each topic's in recorded order."""
        ...


class Ros1Recording:
    """One or several ROS 1 bags, joined in the order of their record times."""

    cdr = False

    def __init__(self, paths: Sequence[Path]) -> None:
        self.description = f"ROS 1 bag {', '.join(path.name for path in paths)}"
        self._files = sorted((_open_ros1(path) for path in paths), key=_first_record_ns)
        check_parts_of_one(
            [
                (file.path.name, file.span_ns(list(file.connections)) or (0, 0), file.keys())
                for file in self._files
            ]
        )
        self.topics = self._merged_topics()

    @property
    def notices(self) -> tuple[str, ...]:
        """Return notices: how files are damaged, and which messages are lost so far."""
        return tuple(notice for file in self._files for notice in file.notices())

    def _merged_topics(self) -> tuple[Topic, ...]:
        found: dict[Key, list[Part]] = {}
        for file in self._files:
            counts = file.counts()
            for number, connection in file.connections.items():
                span = file.span_ns([number])
                entry = found.setdefault((connection.topic, connection.msgtype), [])
                if span is not None:
                    entry.append((counts[number], span))
        return topics_of(found)

    def read(self, topics: Iterable[Topic]) -> Iterator[tuple[Topic, Packed]]:
        """Yield the messages of the topics in batches, in file order."""
        wanted = {(topic.name, topic.msgtype): topic for topic in topics}
        for file in self._files:
            numbers = {
                number: wanted[c.topic, c.msgtype]
                for number, c in file.connections.items()
                if (c.topic, c.msgtype) in wanted
            }
            for number, packed in file.read(numbers):
                yield numbers[number], packed


def check_parts_of_one(files: Sequence[tuple[str, tuple[int, int], set[Key]]]) -> None:
    """Check that several files are parts of one recording.

    Parameters
    ----------
    files : sequence of (name, (first, last record time [ns]), topics with types)
        In order of time.

    Raises
    ------
    BadInput
        When they are far apart in time, or have the same scan topics at the same time.
    """
    for (name, span, topics), (other, later, others) in pairwise(files):
        gap_s = (later[0] - span[1]) * 1e-9
        shared = sorted(t for t, kind in topics & others if kind in _SCAN_TYPES)
        if gap_s > LONGEST_PAUSE_S:
            raise BadInput(
                f"{name} and {other} are {gap_s / 3600:.0f} h apart: recordings of their own, not"
                " parts of one; give one of them"
            )
        if shared and gap_s < -LONGEST_OVERLAP_S:
            raise BadInput(
                f"{name} and {other} both hold {shared[0]} at the same time: recordings of their"
                " own, not parts of one; give one of them"
            )


def topics_of(files: Mapping[Key, Sequence[Part]]) -> tuple[Topic, ...]:
    """Join the parts of every topic and type, sorted by name."""
    return tuple(
        Topic(name, msgtype, sum(count for count, _ in parts), rate_hz(parts))
        for (name, msgtype), parts in sorted(files.items())
    )


def rate_hz(parts: Sequence[Part]) -> float:
    """Return the mean rate from the first message of all parts to the last."""
    if not parts:
        return 0.0
    span_ns = max(last for _, (_, last) in parts) - min(first for _, (first, _) in parts)
    count = sum(count for count, _ in parts)
    return (count - 1) / (span_ns * 1e-9) if span_ns > 0 else 0.0


def _open_ros1(path: Path) -> Ros1File:
    file = Ros1File(path)
    if not file.connections or not sum(file.counts().values()):
        state = "; ".join(notice.removeprefix("warning: ") for notice in file.notices())
        raise BadInput(f"{path} holds no messages{f' ({state})' if state else ''}")
    return file


def _first_record_ns(file: Ros1File) -> int:
    span = file.span_ns(list(file.connections))
    return span[0] if span else 0


def first_bytes(path: Path, count: int = 16) -> bytes:
    """Return the beginning of a file."""
    with path.open("rb") as file:
        return file.read(count)


class Storage(Protocol):
    """One file with messages.

    Attributes
    ----------
    path : Path
    counts : dict of Key to int
    span_ns : (int, int)
        First and last record time [ns].
    """

    path: Path
    counts: dict[Key, int]
    span_ns: tuple[int, int]

    def messages(self, wanted: Collection[Key]) -> Iterator[Stored]:
        """Yield the messages of some topics in the order of the file."""
        ...

    def notices(self) -> list[str]:
        """Return notices: how the file is damaged, and which messages are lost so far."""
        ...


@dataclass(slots=True)
class Losses:
    """Messages that should be there and were not found, by topic."""

    missing: dict[Key, int] = field(default_factory=dict)
    seconds: dict[Key, float] = field(default_factory=dict)

    def note(
        self, found: Mapping[Key, int], counts: Mapping[Key, int], span_ns: tuple[int, int]
    ) -> None:
        """Compare the number of messages found with the number expected."""
        for key, count in found.items():
            expected = counts.get(key, 0)
            self.missing[key] = max(0, expected - count)
            span_s = (span_ns[1] - span_ns[0]) * 1e-9
            self.seconds[key] = self.missing[key] * span_s / max(expected, 1)

    def notices(self, name: str) -> list[str]:
        """Return one warning, or none."""
        count = sum(self.missing.values())
        if not count:
            return []
        seconds = max(self.seconds.values())
        told = f"could not read {count_of(count, 'message')}, about {seconds:.1f} s"
        return [f"warning: {name} is damaged: {told}"]
