# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Records of the ROS 1 bag format 2.0: a header of `name=value` fields, then data.

Every length in a file is checked against the bytes that there are before it is used.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from slarm_graph.frontends.recordings.packed import Bytes, Ints, gather

MESSAGE, FILE, INDEX, CHUNK, CHUNK_INFO, CONNECTION = b"\2", b"\3", b"\4", b"\5", b"\6", b"\7"
KINDS = (MESSAGE, FILE, INDEX, CHUNK, CHUNK_INFO, CONNECTION)
WORD = struct.Struct("<I")
MAX_HEADER_BYTES = 4096
"""Longest header: it holds a few numbers and a topic's name, some hundred bytes."""
_OP = re.compile(rb"\x04\0\0\0op=([\2-\7])", re.DOTALL)
_LONGEST_BEFORE_OP = 1024
"""How far before its `op` field a header may begin; the field comes among the first few."""

Fields = dict[bytes, bytes]


class Data(Protocol):
    """Bytes in memory or in a mapped file."""

    def __len__(self) -> int: ...
    def __getitem__(self, part: slice, /) -> bytes: ...


@dataclass(frozen=True, slots=True)
class Record:
    """A record whose header is whole.

    Parameters
    ----------
    at, data_at, end : int
        Where the record, its data, and the next record begin; the end may lie behind the file's.
    fields : dict
    """

    at: int
    data_at: int
    end: int
    fields: Fields

    @property
    def kind(self) -> bytes:
        """The operation code."""
        return self.fields[b"op"]


def record_at(data: Data, at: int) -> Record | None:
    """Read the header of the record at an offset; None where there is no record."""
    head = data[at : at + 4]
    if len(head) < 4:
        return None
    size = WORD.unpack(head)[0]
    if size > MAX_HEADER_BYTES:
        return None
    header = data[at + 4 : at + 8 + size]
    if len(header) < size + 4:
        return None
    fields = fields_of(header[:size])
    if fields is None or fields.get(b"op") not in KINDS:
        return None
    data_at = at + 8 + size
    return Record(at, data_at, data_at + WORD.unpack(header[size:])[0], fields)


def fields_of(header: bytes) -> Fields | None:
    """Split a record header into its `name=value` fields; None when it is no such header."""
    fields: Fields = {}
    at = 0
    while at < len(header):
        if at + 4 > len(header):
            return None
        size = WORD.unpack_from(header, at)[0]
        name, equals, value = header[at + 4 : at + 4 + size].partition(b"=")
        at += 4 + size
        if not equals or at > len(header):
            return None
        fields[name] = value
    return fields


def number_of(fields: Fields, name: bytes) -> int | None:
    """Read a field of four bytes; None where it is missing or has another size."""
    value = fields.get(name, b"")
    return int(WORD.unpack(value)[0]) if len(value) == 4 else None


def next_record(data: Data, start: int, kinds: bytes) -> Record | None:
    """Find the first record of some kinds at an offset or later, to continue after damage."""
    for found in _OP.finditer(data, start):  # type: ignore[call-overload]
        if found[1] not in kinds:
            continue
        for at in range(found.start() - 4, max(start, found.start() - _LONGEST_BEFORE_OP) - 1, -1):
            size = WORD.unpack(data[at : at + 4])[0]
            if found.end() - at - 4 <= size <= MAX_HEADER_BYTES:
                record = record_at(data, at)
                if record is not None and record.kind == found[1]:
                    return record
    return None


def walk(data: bytes) -> Iterator[tuple[Record, bytes]]:
    """Yield every intact record of a decompressed chunk with its data; skip damaged ones."""
    at = 0
    while at + 8 <= len(data):
        record = record_at(data, at)
        if record is None or record.end > len(data):
            record = next_record(data, at + 1, MESSAGE + CONNECTION)
            if record is None:
                return
            at = record.at
            if record.end > len(data):
                at += 1
                continue
        yield record, data[record.data_at : record.end]
        at = record.end


def message_spans(
    buffer: Bytes, offsets: Ints, connection: int
) -> tuple[Ints, Ints, NDArray[np.bool_]]:
    """Find the serialized messages of a connection behind the offsets of an index.

    Parameters
    ----------
    buffer : (L,) uint8
        The chunk.
    offsets : (N,) int64
    connection : int

    Returns
    -------
    starts, ends : (N,) int64
    whole : (N,) bool
        False where there is no whole message of the connection.
    """
    starts, ends = np.zeros_like(offsets), np.zeros_like(offsets)
    whole = np.zeros(len(offsets), np.bool_)
    fast = _alike(buffer, offsets, connection)
    if fast is not None:
        data_at = offsets[fast] + 4 + _words(buffer, offsets[fast])
        starts[fast], sizes = data_at + 4, _words(buffer, data_at)
        ends[fast] = starts[fast] + sizes
        whole[fast] = ends[fast] <= len(buffer)
    slow = np.flatnonzero(~whole)
    raw = buffer.tobytes() if len(slow) else b""
    for row in slow.tolist():
        record = _message_at(raw, int(offsets[row]), connection)
        if record is not None:
            starts[row], ends[row], whole[row] = record.data_at, record.end, True
    return starts, ends, whole


def _alike(buffer: Bytes, offsets: Ints, connection: int) -> NDArray[np.bool_] | None:
    """Return which messages have headers of the first one's layout; None without a first."""
    first = record_at(_Window(buffer), int(offsets[0])) if len(offsets) else None
    if first is None or first.kind != MESSAGE:
        return None
    size = first.data_at - 4 - first.at
    header = buffer[first.at : first.at + size].tobytes()
    inside = (offsets >= 0) & (offsets + size + 4 <= len(buffer))
    rows = gather(buffer, np.where(inside, offsets, first.at), size)
    fixed = np.zeros(size, np.bool_)
    fixed[:4] = True
    for part in (b"op=" + MESSAGE, b"conn=" + WORD.pack(connection)):
        at = header.find(part)
        if at < 0:
            return None
        fixed[at : at + len(part)] = True
    pattern = np.frombuffer(header, np.uint8)
    return np.asarray(inside & (rows[:, fixed] == pattern[fixed]).all(axis=1))


class _Window:
    """A view of an array that slices to bytes, so that records are read without a copy of all."""

    def __init__(self, buffer: Bytes) -> None:
        self._buffer = buffer

    def __len__(self) -> int:
        return len(self._buffer)

    def __getitem__(self, part: slice) -> bytes:
        return self._buffer[part].tobytes()


def _message_at(data: bytes, offset: int, connection: int) -> Record | None:
    """Read one message; indices may point at connection records written just before it."""
    while 0 <= offset < len(data):
        record = record_at(data, offset)
        if record is None or record.end > len(data):
            return None
        if record.kind == MESSAGE:
            return record if number_of(record.fields, b"conn") == connection else None
        if record.kind != CONNECTION:
            return None
        offset = record.end
    return None


def _words(buffer: Bytes, at: Ints) -> Ints:
    return gather(buffer, at, 4).view("<u4").ravel().astype(np.int64)
