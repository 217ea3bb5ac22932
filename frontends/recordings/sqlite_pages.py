# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Salvage of rows from the pages of a damaged SQLite file, without its B-tree.

Where an inner page is lost, SQLite reaches none of the leaves below it, though they are intact.
Format: https://www.sqlite.org/fileformat.html.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from mmap import mmap

from slarm_graph.frontends.recordings.unpacking import MAX_CHUNK_BYTES

_LEAF = 13
"""Kind of a page with rows of a table."""
_HEADER_BYTES = 100
"""In front of the first page."""
_WIDTHS = {1: 1, 2: 2, 3: 3, 4: 4, 5: 6, 6: 8}
"""Bytes of whole numbers by their serial type."""
_MESSAGE_COLUMNS = 4
"""id (stored as null), topic_id, timestamp, data."""


@dataclass(frozen=True, slots=True)
class TableRow:
    """A message as it is stored."""

    number: int
    topic: int
    stamp_ns: int
    data: bytes


def message_rows(raw: bytes | mmap) -> Iterator[TableRow]:
    """Yield the rows of all leaf pages that look like rosbag2's messages, page by page.

    A row whose overflow pages are missing is left out. Rows that were moved or deleted may come
    twice.
    """
    size = int.from_bytes(raw[16:18], "big")
    size = 65536 if size == 1 else size
    if size < 512 or len(raw) < _HEADER_BYTES:
        return
    usable = size - raw[20]
    for page in range(len(raw) // size):
        start = page * size
        head = start + (_HEADER_BYTES if page == 0 else 0)
        if raw[head] != _LEAF:
            continue
        count = int.from_bytes(raw[head + 3 : head + 5], "big")
        if 8 + 2 * count > size:
            continue
        for (at,) in struct.iter_unpack(">H", raw[head + 8 : head + 8 + 2 * count]):
            row = _row(raw, start, start + at, usable, size)
            if row is not None:
                yield row


def _row(raw: bytes | mmap, page: int, at: int, usable: int, size: int) -> TableRow | None:
    """Read one cell; None where it is no whole message."""
    length, at = _varint(raw, at)
    number, at = _varint(raw, at)
    if not 4 < length <= MAX_CHUNK_BYTES:
        return None
    payload = _payload(raw, at, length, page + usable, usable, size)
    if payload is None:
        return None
    header, column = _varint(payload, 0)
    kinds: list[int] = []
    while column < header and len(kinds) <= _MESSAGE_COLUMNS:
        kind, column = _varint(payload, column)
        kinds.append(kind)
    if len(kinds) != _MESSAGE_COLUMNS or column != header or kinds[3] < 12 or kinds[3] % 2:
        return None
    _, topic, at = _number(payload, kinds[0], header)
    _, topic, at = _number(payload, kinds[1], at)
    known, stamp_ns, at = _number(payload, kinds[2], at)
    data = payload[at:]
    if not known or len(data) != (kinds[3] - 12) // 2:
        return None
    return TableRow(number, topic, stamp_ns, data)


def _payload(
    raw: bytes | mmap, at: int, length: int, page_end: int, usable: int, size: int
) -> bytes | None:
    """Gather a cell's content from its page and the overflow pages behind it."""
    most = usable - 35
    local = length
    if length > most:
        least = (usable - 12) * 32 // 255 - 23
        local = least + (length - least) % (usable - 4)
        local = local if local <= most else least
    if at + local + (4 if local < length else 0) > page_end:
        return None
    parts, missing = [raw[at : at + local]], length - local
    following = int.from_bytes(raw[at + local : at + local + 4], "big") if missing else 0
    while missing > 0:
        start = (following - 1) * size
        if following < 1 or start + usable > len(raw):
            return None
        part = raw[start + 4 : start + min(usable, 4 + missing)]
        parts.append(part)
        missing -= len(part)
        following = int.from_bytes(raw[start : start + 4], "big")
    return b"".join(parts)


def _number(payload: bytes, kind: int, at: int) -> tuple[bool, int, int]:
    """Read a whole number: whether it is one, its value, where the next column begins."""
    if kind in (8, 9):
        return True, kind - 8, at
    width = _WIDTHS.get(kind, 0)
    value = int.from_bytes(payload[at : at + width], "big", signed=True)
    return width > 0, value, at + width


def _varint(raw: bytes | mmap, at: int) -> tuple[int, int]:
    """Read a number of one to nine bytes; also return where it ends."""
    value = 0
    for count in range(8):
        byte = raw[at + count] if at + count < len(raw) else 0
        value = (value << 7) | (byte & 0x7F)
        if byte < 0x80:
            return value, at + count + 1
    last = raw[at + 8] if at + 8 < len(raw) else 0
    return (value << 8) | last, at + 9
