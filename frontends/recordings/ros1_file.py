# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Read the ROS 1 bag container (format 2.0) front to back, in columns.

The `rosbags` reader hands out one message at a time and needs an intact index. This one hands out
whole chunks, decompresses them in parallel, and loses of a cut, damaged or unindexed bag no more
than the records that are damaged. Format: http://wiki.ros.org/Bags/Format/2.0.
"""

from __future__ import annotations

import mmap
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from slarm_graph.counts import count_of
from slarm_graph.errors import brief
from slarm_graph.frontends.recordings.packed import Bytes, Ints, Packed
from slarm_graph.frontends.recordings.ros1_chunks import Chunk, unpacked
from slarm_graph.frontends.recordings.ros1_records import (
    CHUNK,
    CONNECTION,
    FILE,
    INDEX,
    MESSAGE,
    Record,
    fields_of,
    message_spans,
    next_record,
    number_of,
    record_at,
    walk,
)

MAGIC = b"#ROSBAG V2.0\n"

MAX_CONNECTION_BYTES = 1 << 22
"""Longest description of a topic, 4 MB; the longest message definitions of ROS have some 10 kB."""
_INDEX_ENTRY = np.dtype([("sec", "<u4"), ("nsec", "<u4"), ("offset", "<u4")])


@dataclass(frozen=True, slots=True)
class Connection1:
    """One publisher on one topic, with ROS 2 spelling of the type (`pkg/msg/Type`)."""

    topic: str
    msgtype: str


@dataclass(frozen=True, slots=True)
class Loss:
    """Messages that could not be read.

    Parameters
    ----------
    messages : int
    seconds : float
        Recording time that they represent, by the usual time between the topic's messages.
    """

    messages: int
    seconds: float


class Ros1File:
    """The table of contents of a bag, and its messages by chunk.

    Attributes
    ----------
    connections : dict of int to Connection1
    cut : str
        Empty, or how the file ends early.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.connections: dict[int, Connection1] = {}
        self.cut = ""
        self._damaged_bytes = 0
        self._chunks: list[Chunk] = []
        self._lost: dict[tuple[int, int], int] = {}
        self._chunks_told = 0
        with path.open("rb") as file:
            self._data = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        self._scan()
        self._index_by_reading()
        self._find_connections()

    def counts(self) -> dict[int, int]:
        """Messages per connection, by the index."""
        totals = dict.fromkeys(self.connections, 0)
        for chunk in self._chunks:
            for number, (offsets, _) in chunk.index.items():
                totals[number] = totals.get(number, 0) + len(offsets)
        return totals

    def keys(self) -> set[tuple[str, str]]:
        """Topics with their types."""
        return {(c.topic, c.msgtype) for c in self.connections.values()}

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
        for chunk, buffer in unpacked(self._data, wanted):
            for number in numbers:
                if number in chunk.index:
                    offsets, record_ns = chunk.index[number]
                    starts, ends, whole = message_spans(buffer, offsets, number)
                    some = Packed(buffer, starts, ends, record_ns)
                    if not whole.all():
                        some = _without_index(buffer, number, some.subset(np.flatnonzero(whole)))
                    self._lost[chunk.position, number] = max(0, len(offsets) - len(some))
                    yield number, some

    def loss(self) -> Loss:
        """Return how many of the messages expected so far could not be read."""
        missing: dict[int, int] = {}
        for (_, number), count in self._lost.items():
            missing[number] = missing.get(number, 0) + count
        counts, seconds = self.counts(), 0.0
        for number, count in missing.items():
            span = self.span_ns([number])
            if span is not None and counts[number] > 1:
                period_s = (span[1] - span[0]) * 1e-9 / (counts[number] - 1)
                seconds = max(seconds, count * period_s)
        return Loss(sum(missing.values()), seconds)

    def notices(self) -> list[str]:
        """Return notices: how the file is damaged, and which messages are lost so far."""
        told = []
        if self.cut:
            told.append(f"warning: {self.path.name} {self.cut}{self._missing_tail()}")
        if self._damaged_bytes:
            told.append(
                f"warning: {self.path.name} is damaged: {self._damaged_bytes} bytes of it are no"
                " records and were passed over"
            )
        lost = self.loss()
        if lost.messages:
            told.append(
                f"warning: {self.path.name} is damaged: could not read"
                f" {count_of(lost.messages, 'message')}, about {lost.seconds:.1f} s"
            )
        problems = dict.fromkeys(chunk.problem() for chunk in self._chunks if chunk.problem())
        return told + [f"warning: {self.path.name}: {problem}; not read" for problem in problems]

    def _missing_tail(self) -> str:
        """Estimate the recording time lost by truncation, by the number of chunks expected.

        Chunks are of one size before they are compressed, hence take about the same time each.
        """
        span, count = self.span_ns(list(self.connections)), sum(self.counts().values())
        kept = sum(chunk.whole for chunk in self._chunks)
        if span is None or not 0 < kept < self._chunks_told:
            return f"; used: {count_of(count, 'message')} before that"
        missing = self._chunks_told - kept
        seconds = (span[1] - span[0]) * 1e-9 * missing / kept
        return (
            f"; used: {count_of(count, 'message')} before that; missing: {missing} of"
            f" {count_of(self._chunks_told, 'chunk')}, some {seconds:.0f} s"
        )

    def _scan(self) -> None:
        """Read the records of the file; after damage continue with the next intact one."""
        at, end = len(MAGIC), len(self._data)
        while at < end:
            record = record_at(self._data, at)
            if record is not None and record.kind == INDEX:
                # Some writers state a wrong size; the number of entries is right.
                count = number_of(record.fields, b"count") or 0
                size = _INDEX_ENTRY.itemsize * count
                record = Record(at, record.data_at, record.data_at + size, record.fields)
            if record is None or record.end > end:
                if record is not None and record.kind == CHUNK:
                    self._add_chunk(record, end)
                after = next_record(self._data, at + 1, CHUNK + CONNECTION + INDEX)
                if after is None:
                    self._mistrust(at, end)
                    self.cut = f"ends early: cut off inside the record at byte {at} of {end}"
                    return
                self._damaged_bytes += after.at - at
                self._mistrust(at, after.at)
                at = after.at
                continue
            self._visit(record)
            at = record.end

    def _mistrust(self, at: int, after: int) -> None:
        """Mark index and size of the chunk before damage (from `at` to `after`) as unreliable."""
        if self._chunks:
            chunk = self._chunks[-1]
            chunk.suspect = True
            if chunk.position + chunk.size == at:
                chunk.size = after - chunk.position

    def _visit(self, record: Record) -> None:
        if record.kind == CHUNK:
            self._add_chunk(record, record.end)
        elif record.kind == INDEX and self._chunks:
            self._add_index(record)
        elif record.kind == CONNECTION:
            self._add_connection(record, self._data[record.data_at : record.end])
        elif record.kind == FILE:
            self._chunks_told = number_of(record.fields, b"chunk_count") or 0

    def _add_chunk(self, record: Record, end: int) -> None:
        size = min(record.end, end) - record.data_at
        told = number_of(record.fields, b"size")
        compression = record.fields.get(b"compression", b"none")
        whole = record.end <= end
        self._chunks.append(Chunk(compression, record.data_at, size, told or size, whole=whole))

    def _add_index(self, record: Record) -> None:
        number = number_of(record.fields, b"conn")
        if number is None:
            return
        entries = np.frombuffer(self._data[record.data_at : record.end], _INDEX_ENTRY)
        in_file = np.argsort(entries["offset"], kind="stable")
        times = entries["sec"].astype(np.int64) * 1_000_000_000 + entries["nsec"]
        offsets = entries["offset"].astype(np.int64)
        self._chunks[-1].index[number] = (offsets[in_file], times[in_file])

    def _add_connection(self, record: Record, data: bytes) -> None:
        number = number_of(record.fields, b"conn")
        inner = fields_of(data) if len(data) <= MAX_CONNECTION_BYTES else None
        if number is None or inner is None or number in self.connections:
            return
        name = record.fields.get(b"topic", inner.get(b"topic", b"")).decode("utf-8", "replace")
        kind = inner.get(b"type", b"").decode("utf-8", "replace")
        topic = "/" * name.startswith("/") + "/".join(part for part in name.split("/") if part)
        msgtype = kind if "/msg/" in kind else kind.replace("/", "/msg/", 1)
        self.connections[number] = Connection1(brief(topic, 200), brief(msgtype, 200))

    def _index_by_reading(self) -> None:
        """Index chunks without a complete index by reading their records."""
        chunks = [chunk for chunk in self._chunks if not chunk.index or chunk.suspect]
        for chunk, buffer in unpacked(self._data, chunks):
            found: dict[int, list[tuple[int, int]]] = {}
            for record, data in walk(buffer.tobytes()):
                number = number_of(record.fields, b"conn")
                if record.kind == CONNECTION:
                    self._add_connection(record, data)
                elif record.kind == MESSAGE and number is not None:
                    found.setdefault(number, []).append((record.at, _time_ns(record)))
            chunk.index = {n: _columns(some) for n, some in found.items()} | chunk.index

    def _find_connections(self) -> None:
        """Search the chunks for connections that are missing at the file's end."""
        unknown = [c for c in self._chunks if not set(c.index) <= set(self.connections)]
        for chunk, buffer in unpacked(self._data, unknown):
            if not set(chunk.index) <= set(self.connections):
                for record, data in walk(buffer.tobytes()):
                    if record.kind == CONNECTION:
                        self._add_connection(record, data)


def _without_index(buffer: Bytes, connection: int, by_index: Packed) -> Packed:
    """Read a connection's messages front to back where its index is wrong, if that gives more."""
    records = [
        record
        for record, _ in walk(buffer.tobytes())
        if record.kind == MESSAGE and number_of(record.fields, b"conn") == connection
    ]
    if len(records) <= len(by_index):
        return by_index
    spans = np.array([(r.data_at, r.end, _time_ns(r)) for r in records], np.int64)
    return Packed(buffer, spans[:, 0], spans[:, 1], spans[:, 2])


def _time_ns(record: Record) -> int:
    time = record.fields.get(b"time", b"").ljust(8, b"\0")
    return int.from_bytes(time[:4], "little") * 1_000_000_000 + int.from_bytes(time[4:8], "little")


def _columns(pairs: list[tuple[int, int]]) -> tuple[Ints, Ints]:
    both = np.array(pairs, np.int64)
    return both[:, 0], both[:, 1]
