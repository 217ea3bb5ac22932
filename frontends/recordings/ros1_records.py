# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Records of the ROS 1 bag format 2.0: a header of `name=value` fields, then data."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import BinaryIO

import numpy as np

from slarm_graph.frontends.recordings.packed import Bytes, Ints, gather

MESSAGE, CONNECTION = b"\x02", b"\x07"
WORD = struct.Struct("<I")

Fields = dict[bytes, bytes]


def message_spans(buffer: Bytes, offsets: Ints) -> tuple[Ints, Ints]:
    """Find the serialized messages behind index offsets: starts and ends, (N,) each."""
    if len(offsets) == 0:
        return offsets, offsets
    header_sizes = _words(buffer, offsets)
    data_at = offsets + 4 + header_sizes
    same = header_sizes == header_sizes[0]
    first = buffer[offsets[0] + 4 : data_at[0]].tobytes()
    op_at = first.find(b"op=" + MESSAGE)
    ops = gather(buffer, offsets[same] + 4 + op_at, 4) if op_at >= 0 else np.zeros((0, 4), np.uint8)
    if op_at < 0 or not same.all() or np.any(ops != np.frombuffer(b"op=" + MESSAGE, np.uint8)):
        offsets = np.array([_skip_connections(buffer, at) for at in offsets.tolist()], np.int64)
        data_at = offsets + 4 + _words(buffer, offsets)
    return data_at + 4, data_at + 4 + _words(buffer, data_at)


def _skip_connections(buffer: Bytes, offset: int) -> int:
    """Index entries may point at connection records written just before the message."""
    while True:
        header_size = int(_words(buffer, np.array([offset]))[0])
        fields = fields_of(buffer[offset + 4 : offset + 4 + header_size].tobytes())
        if fields.get(b"op") != CONNECTION:
            return offset
        data_at = offset + 4 + header_size
        offset = data_at + 4 + int(_words(buffer, np.array([data_at]))[0])


def _words(buffer: Bytes, at: Ints) -> Ints:
    return gather(buffer, at, 4).view("<u4").ravel().astype(np.int64)


def walk(data: bytes) -> Iterator[tuple[int, Fields, bytes]]:
    """Yield (offset, header, data) of every whole record of a decompressed chunk."""
    at = 0
    while at + 8 <= len(data):
        header_end = at + 4 + WORD.unpack_from(data, at)[0]
        if header_end + 4 > len(data):
            return
        data_end = header_end + 4 + WORD.unpack_from(data, header_end)[0]
        if data_end > len(data):
            return
        yield at, fields_of(data[at + 4 : header_end]), data[header_end + 4 : data_end]
        at = data_end


def read_head(file: BinaryIO) -> tuple[Fields, int] | None:
    """Read a record's header and the size of its data; None when the file ends."""
    size = file.read(4)
    if len(size) < 4:
        return None
    length = WORD.unpack(size)[0]
    header = file.read(length + 4)
    if len(header) < length + 4:
        return None
    return fields_of(header[:length]), WORD.unpack(header[length:])[0]


def fields_of(header: bytes) -> Fields:
    """Split a record header into its `name=value` fields."""
    fields: Fields = {}
    at = 0
    while at + 4 <= len(header):
        size = WORD.unpack_from(header, at)[0]
        name, _, value = header[at + 4 : at + 4 + size].partition(b"=")
        fields[name] = value
        at += 4 + size
    return fields
