# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Read the ROS 1 bag container (format 2.0) front to back, in columns.

The `rosbags` reader hands out one message at a time and needs an intact index. This one hands out
whole chunks, decompresses them in parallel, and reads what is left of a recording that was cut off
before its index was written. Format: http://wiki.ros.org/Bags/Format/2.0.
"""

from __future__ import annotations

import bz2
import os
import struct
from collections import deque
from collections.abc import Collection, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

import lz4.frame
import numpy as np

from slarm_graph.frontends.recordings.packed import Bytes, Ints, Packed
from slarm_graph.frontends.recordings.ros1_records import (
    CONNECTION,
    MESSAGE,
    WORD,
    Fields,
    fields_of,
    message_spans,
    read_head,
    walk,
)

MAGIC = b"#ROSBAG V2.0\n"

_INDEX, _CHUNK = b"\x04", b"\x05"
_INDEX_ENTRY = np.dtype([("sec", "<u4"), ("nsec", "<u4"), ("offset", "<u4")])
_KINDS = (MESSAGE, b"\x03", _INDEX, _CHUNK, b"\x06", CONNECTION)
_MOST_WORKERS = 4
_TIME = struct.Struct("<II")


class UnreadableChunk(ValueError):
    """A chunk uses a compression nobody here knows."""


@dataclass(frozen=True, slots=True)
class Connection1:
    """One publisher on one topic, with ROS 2 spelling of the type (`pkg/msg/Type`)."""

    topic: str
    msgtype: str


@dataclass(slots=True)
class _Chunk:
    """Where a chunk's data lie, and per connection the offsets and record times of its messages."""

    compression: bytes
    position: int
    size: int
    index: dict[int, tuple[Ints, Ints]] = field(default_factory=dict)
    trusted: bool = True


class Ros1File:
    """The table of contents of a bag, and its messages by chunk.

    Attributes
    ----------
    connections : dict of int to Connection1
    damage : str
        Empty, or how the file ends early.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.connections: dict[int, Connection1] = {}
        self.damage = ""
        self._chunks: list[_Chunk] = []
        with path.open("rb") as file:
            file.seek(len(MAGIC))
            self._scan(file, path.stat().st_size)
        if any(not chunk.trusted or not chunk.index for chunk in self._chunks):
            self._index_by_reading()

    def counts(self) -> dict[int, int]:
        """Messages per connection."""
        totals = dict.fromkeys(self.connections, 0)
        for chunk in self._chunks:
            for number, (offsets, _) in chunk.index.items():
                totals[number] = totals.get(number, 0) + len(offsets)
        return totals

    def span_ns(self, numbers: Collection[int]) -> tuple[int, int] | None:
        """First and last record time of some connections [ns]."""
        times = [
            chunk.index[number][1]
            for chunk in self._chunks
            for number in numbers
            if number in chunk.index and len(chunk.index[number][1])
        ]
        if not times:
            return None
        return min(int(t.min()) for t in times), max(int(t.max()) for t in times)

    def read(self, numbers: Collection[int]) -> Iterator[tuple[int, Packed]]:
        """Yield (connection, its messages in one chunk), chunk after chunk."""
        wanted = [c for c in self._chunks if any(number in c.index for number in numbers)]
        for chunk, buffer in self._decompressed(wanted):
            for number in numbers:
                if number in chunk.index:
                    offsets, record_ns = chunk.index[number]
                    starts, ends = message_spans(buffer, offsets)
                    yield number, Packed(buffer, starts, ends, record_ns)

    def _scan(self, file: BinaryIO, end: int) -> None:
        while (at := file.tell()) < end:
            head = read_head(file)
            if head is None or file.tell() + head[1] > end:
                self.damage = f"ends early: cut off inside the record at byte {at} of {end}"
                if head is not None and head[0].get(b"op") == _CHUNK:
                    self._add_chunk(head[0], file.tell(), end - file.tell(), trusted=False)
                return
            fields, size = head
            if fields.get(b"op", b"") not in _KINDS:
                self.damage = f"is damaged at byte {at} of {end}"
                return
            position = file.tell()
            if fields[b"op"] == _INDEX:
                # Some writers state a wrong size; the number of entries is right.
                size = _INDEX_ENTRY.itemsize * WORD.unpack(fields[b"count"])[0]
            self._visit(file, fields, size)
            file.seek(position + size)

    def _visit(self, file: BinaryIO, fields: Fields, size: int) -> None:
        kind = fields[b"op"]
        if kind == _CHUNK:
            self._add_chunk(fields, file.tell(), size, trusted=True)
        elif kind == _INDEX and self._chunks:
            self._add_index(fields, file.read(size))
        elif kind == CONNECTION:
            self._add_connection(fields, file.read(size))

    def _add_chunk(self, fields: Fields, position: int, size: int, *, trusted: bool) -> None:
        compression = fields.get(b"compression", b"none")
        self._chunks.append(_Chunk(compression, position, size, trusted=trusted))

    def _add_index(self, fields: Fields, data: bytes) -> None:
        entries = np.frombuffer(data, _INDEX_ENTRY)
        times = entries["sec"].astype(np.int64) * 1_000_000_000 + entries["nsec"]
        in_file = np.argsort(entries["offset"], kind="stable")
        offsets = entries["offset"].astype(np.int64)
        number = WORD.unpack(fields[b"conn"])[0]
        self._chunks[-1].index[number] = (offsets[in_file], times[in_file])

    def _add_connection(self, fields: Fields, data: bytes) -> None:
        inner = fields_of(data)
        name = fields.get(b"topic", inner.get(b"topic", b"")).decode("utf-8", "replace")
        kind = inner.get(b"type", b"").decode("utf-8", "replace")
        topic = "/" * name.startswith("/") + "/".join(part for part in name.split("/") if part)
        msgtype = kind if "/msg/" in kind else kind.replace("/", "/msg/", 1)
        self.connections[WORD.unpack(fields[b"conn"])[0]] = Connection1(topic, msgtype)

    def _index_by_reading(self) -> None:
        """Walk the records of chunks whose index is missing or wrong."""
        broken = [chunk for chunk in self._chunks if not chunk.trusted or not chunk.index]
        for chunk, buffer in self._decompressed(broken):
            found: dict[int, list[tuple[int, int]]] = {}
            for offset, fields, data in walk(buffer.tobytes()):
                if fields.get(b"op") == MESSAGE:
                    seconds, nanoseconds = _TIME.unpack(fields[b"time"])
                    entry = (offset, seconds * 1_000_000_000 + nanoseconds)
                    found.setdefault(WORD.unpack(fields[b"conn"])[0], []).append(entry)
                elif fields.get(b"op") == CONNECTION:
                    self._add_connection(fields, data)
            chunk.index = {
                number: (np.array([e[0] for e in some]), np.array([e[1] for e in some]))
                for number, some in found.items()
            }

    def _decompressed(self, chunks: list[_Chunk]) -> Iterator[tuple[_Chunk, Bytes]]:
        """Read and decompress chunks in order, a few ahead of the consumer."""
        workers = min(_MOST_WORKERS, _usable_cores())
        pending: deque[tuple[_Chunk, Future[Bytes]]] = deque()
        with self.path.open("rb") as file, ThreadPoolExecutor(workers) as pool:
            for chunk in chunks:
                file.seek(chunk.position)
                data = file.read(chunk.size)
                pending.append((chunk, pool.submit(_decompress, data, chunk.compression)))
                if len(pending) > workers:
                    ready, future = pending.popleft()
                    yield ready, future.result()
            while pending:
                ready, future = pending.popleft()
                yield ready, future.result()


def _usable_cores() -> int:
    """Cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _decompress(data: bytes, compression: bytes) -> Bytes:
    """Decompress as much of a chunk as there is."""
    if compression == b"none":
        return np.frombuffer(data, np.uint8)
    if compression not in (b"bz2", b"lz4"):
        raise UnreadableChunk(f"compression {compression.decode(errors='replace')!r} is unknown")
    machine = bz2.BZ2Decompressor() if compression == b"bz2" else lz4.frame.LZ4FrameDecompressor()
    try:
        return np.frombuffer(machine.decompress(data), np.uint8)
    except (OSError, EOFError, RuntimeError):
        return np.zeros(0, np.uint8)
