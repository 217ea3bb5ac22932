# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""ROS recordings of both generations as topics of serialized messages; no ROS needed."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from rosbags.interfaces import Connection
from rosbags.rosbag2.reader import DirectoryReader
from rosbags.rosbag2.storage_mcap import McapReader
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

from slarm_graph.errors import BadInput
from slarm_graph.frontends.packed import Packed, pack
from slarm_graph.frontends.ros1_file import Ros1File, UnreadableChunk

MCAP_MAGIC = b"\x89MCAP0\r\n"

_BATCH = 4096


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
    """What every kind of ROS recording offers."""

    description: str
    cdr: bool
    topics: tuple[Topic, ...]
    notices: tuple[str, ...]

    def read(self, topics: Iterable[Topic]) -> Iterator[tuple[Topic, Packed]]:
        """Yield the messages of the topics in batches, each topic's in recorded order."""
        ...


class Ros1Recording:
    """One or several ROS 1 bags, put together in the order of their record times."""

    cdr = False

    def __init__(self, paths: Sequence[Path]) -> None:
        self.description = f"ROS 1 bag {', '.join(path.name for path in paths)}"
        self._files = sorted((_open_ros1(path) for path in paths), key=_first_record_ns)
        self.notices = tuple(
            f"{file.path.name} {file.damage}; what could be read before that is used"
            for file in self._files
            if file.damage
        )
        self.topics = self._merged_topics()

    def _merged_topics(self) -> tuple[Topic, ...]:
        found: dict[tuple[str, str], list[tuple[int, tuple[int, int]]]] = {}
        for file in self._files:
            counts = file.counts()
            for number, connection in file.connections.items():
                span = file.span_ns([number])
                entry = found.setdefault((connection.topic, connection.msgtype), [])
                if span is not None:
                    entry.append((counts[number], span))
        return tuple(
            Topic(name, msgtype, sum(count for count, _ in parts), _rate_hz(parts))
            for (name, msgtype), parts in sorted(found.items())
        )

    def read(self, topics: Iterable[Topic]) -> Iterator[tuple[Topic, Packed]]:
        """Yield the messages of the topics in batches, in file order."""
        wanted = {(topic.name, topic.msgtype): topic for topic in topics}
        for file in self._files:
            numbers = {
                number: wanted[c.topic, c.msgtype]
                for number, c in file.connections.items()
                if (c.topic, c.msgtype) in wanted
            }
            try:
                for number, packed in file.read(numbers):
                    yield numbers[number], packed
            except UnreadableChunk as error:
                raise BadInput(f"{file.path}: {error}") from None


def _rate_hz(parts: list[tuple[int, tuple[int, int]]]) -> float:
    if not parts:
        return 0.0
    span_ns = max(last for _, (_, last) in parts) - min(first for _, (first, _) in parts)
    count = sum(count for count, _ in parts)
    return (count - 1) / (span_ns * 1e-9) if span_ns > 0 else 0.0


def _open_ros1(path: Path) -> Ros1File:
    try:
        file = Ros1File(path)
    except (KeyError, ValueError, IndexError, struct.error) as error:
        raise BadInput(f"{path} is damaged: {_reason(error)}") from error
    if not file.connections:
        state = f" ({file.damage})" if file.damage else ""
        raise BadInput(f"{path} holds no messages{state}")
    return file


def _first_record_ns(file: Ros1File) -> int:
    span = file.span_ns(list(file.connections))
    return span[0] if span else 0


class Ros2Recording:
    """A ROS 2 recording: folders with metadata, or storage files alone."""

    cdr = True

    def __init__(self, paths: Sequence[Path], label: str, notices: Iterable[str] = ()) -> None:
        self.description = f"ROS 2 bag {label}"
        self._paths = paths
        self.notices = (*notices, *(notice for path in paths for notice in _unmerged(path)))
        found: dict[tuple[str, str], list[tuple[int, tuple[int, int]]]] = {}
        for path in paths:
            with _opened(path) as reader:
                span = (reader.metadata.start_time, reader.metadata.end_time)
                for connection in reader.connections:
                    entry = found.setdefault((connection.topic, connection.msgtype), [])
                    if connection.msgcount:
                        entry.append((connection.msgcount, span))
        self.topics = tuple(
            Topic(name, msgtype, sum(count for count, _ in parts), _rate_hz(parts))
            for (name, msgtype), parts in sorted(found.items())
        )

    def read(self, topics: Iterable[Topic]) -> Iterator[tuple[Topic, Packed]]:
        """Yield the messages of the topics in batches, in order of record time."""
        wanted = {(topic.name, topic.msgtype): topic for topic in topics}
        for path in self._paths:
            with _opened(path) as reader:
                connections = [c for c in reader.connections if (c.topic, c.msgtype) in wanted]
                if connections:
                    yield from _batches(reader, connections, wanted)


def _batches(
    reader: _StorageReader, connections: list[Connection], wanted: dict[tuple[str, str], Topic]
) -> Iterator[tuple[Topic, Packed]]:
    held: dict[tuple[str, str], list[tuple[int, bytes]]] = {key: [] for key in wanted}
    for connection, record_ns, raw in reader.messages(connections):
        key = (connection.topic, connection.msgtype)
        held[key].append((record_ns, raw))
        if len(held[key]) == _BATCH:
            yield wanted[key], pack(held[key])
            held[key] = []
    for key, batch in held.items():
        if batch:
            yield wanted[key], pack(batch)


_StorageReader = DirectoryReader | McapReader | Sqlite3Reader


@contextmanager
def _opened(path: Path) -> Iterator[_StorageReader]:
    """Open a folder with metadata or one storage file; rosbags' failures become bad input."""
    if path.is_dir():
        reader: _StorageReader = DirectoryReader(path)
    elif first_bytes(path).startswith(MCAP_MAGIC):
        reader = McapReader(path)
    else:
        reader = Sqlite3Reader(path)
    try:
        reader.open()
        try:
            yield reader
        finally:
            reader.close()
    except BadInput:
        raise
    except Exception as error:  # rosbags lets struct, zstd, apsw and assertion errors through
        raise BadInput(_told(path, error)) from error


def _reason(error: Exception) -> str:
    return str(error).strip() or type(error).__name__


def _told(path: Path, error: Exception) -> str:
    """Say what is wrong with a ROS 2 recording and how to mend it."""
    reason = _reason(error)
    if "end magic" in reason or "Truncated" in reason:
        return f"{path} ends early; repair it with: mcap recover {path.name} -o repaired.mcap"
    if "malformed" in reason or "not a database" in reason:
        return (
            f"{path} is damaged ({reason}); repair it with: "
            f'sqlite3 {path.name} ".recover" | sqlite3 repaired.db3'
        )
    return f"cannot read {path}: {reason}"


def _unmerged(path: Path) -> Iterator[str]:
    """Warn about messages that SQLite has not yet moved into the database file."""
    files = path.glob("*.db3") if path.is_dir() else [path]
    for file in files:
        log = file.with_name(file.name + "-wal")
        if log.exists() and log.stat().st_size:
            yield (
                f"{log.name} holds messages not yet in {file.name}; they are not read. "
                f'Merge them with: sqlite3 {file.name} "pragma wal_checkpoint"'
            )


def first_bytes(path: Path, count: int = 16) -> bytes:
    """Return the beginning of a file."""
    with path.open("rb") as file:
        return file.read(count)
