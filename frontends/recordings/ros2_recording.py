# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""ROS 2 recordings, sqlite3 and mcap, as topics of serialized messages."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from rosbags.interfaces import Connection
from rosbags.rosbag2.reader import DirectoryReader
from rosbags.rosbag2.storage_mcap import McapReader
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

from slarm_graph.errors import BadInput
from slarm_graph.frontends.recordings.mcap_salvage import MAGIC as MCAP_MAGIC
from slarm_graph.frontends.recordings.mcap_salvage import SalvagedMcap
from slarm_graph.frontends.recordings.packed import Packed, pack
from slarm_graph.frontends.recordings.recordings import Topic, first_bytes, rate_hz, reason_of

_BATCH = 4096


class Ros2Recording:
    """A ROS 2 recording: folders with metadata, or storage files alone."""

    cdr = True

    def __init__(self, paths: Sequence[Path], label: str, notices: Iterable[str] = ()) -> None:
        self.description = f"ROS 2 bag {label}"
        self._paths = paths
        self.notices = tuple(notices)
        found: dict[tuple[str, str], list[tuple[int, tuple[int, int]]]] = {}
        for path in paths:
            self.notices += tuple(_unmerged(path))
            with _opened(path) as reader:
                if isinstance(reader, SalvagedMcap):
                    told = f"{path.name} ends early; what could be read before that is used"
                    self.notices += (told,)
                span = (reader.metadata.start_time, reader.metadata.end_time)
                for connection in reader.connections:
                    entry = found.setdefault((connection.topic, connection.msgtype), [])
                    if connection.msgcount:
                        entry.append((connection.msgcount, span))
        self.topics = tuple(
            Topic(name, msgtype, sum(count for count, _ in parts), rate_hz(parts))
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


_StorageReader = DirectoryReader | McapReader | Sqlite3Reader | SalvagedMcap


@contextmanager
def _opened(path: Path) -> Iterator[_StorageReader]:
    """Open a folder with metadata or one storage file; rosbags' failures become bad input."""
    try:
        reader = _open(path)
        try:
            yield reader
        finally:
            reader.close()
    except BadInput:
        raise
    except Exception as error:  # rosbags lets struct, zstd, apsw and assertion errors through
        raise BadInput(_told(path, error)) from error


def _open(path: Path) -> _StorageReader:
    """Open a reader; an MCAP file that has lost its end gets one that does without."""
    if path.is_dir():
        reader: _StorageReader = DirectoryReader(path)
    elif first_bytes(path).startswith(MCAP_MAGIC):
        reader = McapReader(path)
    else:
        reader = Sqlite3Reader(path)
    try:
        reader.open()
    except Exception:
        salvaged = SalvagedMcap(path)
        if isinstance(reader, McapReader):
            salvaged.open()
        if not salvaged.connections:
            raise
        return salvaged
    return reader


def _told(path: Path, error: Exception) -> str:
    """Say what is wrong with a ROS 2 recording and how to mend it."""
    reason = reason_of(error)
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
