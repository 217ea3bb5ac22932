# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Read MCAP files front to back; of a damaged file only the damaged records are lost.

The `mcap` and `rosbags` readers need the summary at the end of the file, and end at the first
damage. Format: https://mcap.dev/spec.
"""

from __future__ import annotations

import mmap
import re
import struct
from collections.abc import Collection, Iterator
from pathlib import Path

from slarm_graph.counts import count_of
from slarm_graph.errors import brief
from slarm_graph.frontends.recordings.recordings import Key, Losses, Stored
from slarm_graph.frontends.recordings.unpacking import unpack_partly

MAGIC = b"\x89MCAP0\r\n"

_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _STATISTICS, _CHUNK_INDEX, _DATA_END = (
    0x02, 0x03, 0x04, 0x05, 0x06, 0x0B, 0x08, 0x0F,
)  # fmt: skip
"""Opcodes of the MCAP specification, section Records."""
_HEAD = struct.Struct("<BQ")
_FOOTER_DATA = struct.Struct("<QQI")
_MESSAGE_HEAD = struct.Struct("<HIQQ")
_CHUNK_HEAD = struct.Struct("<QQQI")
_STATISTICS_HEAD = struct.Struct("<QHIIIIQQ")
_COUNT = struct.Struct("<HQ")
_STRING = struct.Struct("<I")
_CHUNK_START = re.compile(
    rb"\x06.{8}.{8}.{8}.{8}.{4}(?:\x04\0\0\0zstd|\x03\0\0\0lz4|\0\0\0\0)", re.DOTALL
)
MAX_TEXT_BYTES = 1 << 16
"""64 kB of a topic's or a type's name, of which some ten are usual."""


class McapFile:
    """The topics and messages of one file."""

    def __init__(self, path: Path) -> None:
        self.path = path
        with path.open("rb") as file:
            self._data = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        self._schemas: dict[int, str] = {}
        self._channels: dict[int, Key] = {}
        self._chunks: list[int] = []
        self._cut = ""
        self._passed_bytes = 0
        self.counts: dict[Key, int] = {}
        self.span_ns = (0, 0)
        self._losses = Losses()
        self._has_summary = self._read_summary()
        if not self._has_summary:
            self._count_by_reading()

    def messages(self, wanted: Collection[Key]) -> Iterator[Stored]:
        """Yield the messages of some topics in the order of the file."""
        found = dict.fromkeys(wanted, 0)
        for channel, record_ns, raw in self._walk():
            key = self._channels[channel]
            if key in found:
                found[key] += 1
                yield key, record_ns, raw
        if self._has_summary:
            self._losses.note(found, self.counts, self.span_ns)

    def notices(self) -> list[str]:
        """Return notices: how the file is damaged, and which messages are lost so far."""
        name = self.path.name
        told = []
        if self._cut:
            span_s = (self.span_ns[1] - self.span_ns[0]) * 1e-9
            told.append(
                f"warning: {name} {self._cut}; used:"
                f" {count_of(sum(self.counts.values()), 'message')} before that, {span_s:.0f} s"
            )
        if self._passed_bytes:
            told.append(
                f"warning: {name} is damaged: {self._passed_bytes} bytes of it are no records and"
                " were passed over"
            )
        return told + self._losses.notices(name)

    def _read_summary(self) -> bool:
        """Read topics and counts from the summary; False where it is missing or unusable."""
        size = len(self._data)
        at = size - len(MAGIC) - _HEAD.size - _FOOTER_DATA.size
        if at < 0 or self._data[size - len(MAGIC) :] != MAGIC or self._data[at] != _FOOTER:
            return False
        start = _FOOTER_DATA.unpack_from(self._data, at + _HEAD.size)[0]
        if not len(MAGIC) < start < at:
            return False
        counts: dict[int, int] = {}
        for kind, data in _records(self._data[start:at]):
            if kind == _CHUNK_INDEX and len(data) >= 24:
                self._chunks.append(int.from_bytes(data[16:24], "little"))
            elif kind == _STATISTICS and len(data) >= _STATISTICS_HEAD.size + 4:
                counts = self._statistics(data)
            else:
                self._define(kind, data)
        self._chunks.sort()
        for channel, count in counts.items():
            if channel in self._channels:
                key = self._channels[channel]
                self.counts[key] = self.counts.get(key, 0) + count
        return bool(self.counts)

    def _statistics(self, data: bytes) -> dict[int, int]:
        *_, first, last = _STATISTICS_HEAD.unpack_from(data)
        self.span_ns = (_within(first), _within(last))
        pairs = data[_STATISTICS_HEAD.size + 4 :]
        whole = len(pairs) - len(pairs) % _COUNT.size
        return dict(_COUNT.iter_unpack(pairs[:whole]))

    def _count_by_reading(self) -> None:
        """Read the whole file to find its topics and counts."""
        first, last = 2**63 - 1, 0
        for channel, record_ns, _ in self._walk():
            key = self._channels[channel]
            self.counts[key] = self.counts.get(key, 0) + 1
            first, last = min(first, record_ns), max(last, record_ns)
        self.span_ns = (min(first, last), last)

    def _walk(self) -> Iterator[tuple[int, int, bytes]]:
        """Yield (channel, record time [ns], message), by the list of chunks where there is one."""
        if self._chunks:
            for at in self._chunks:
                if at + _HEAD.size <= len(self._data) and self._data[at] == _CHUNK:
                    size = _HEAD.unpack_from(self._data, at)[1]
                    start = at + _HEAD.size
                    yield from self._in_chunk(self._data[start : start + size])
            return
        yield from self._front_to_back()

    def _front_to_back(self) -> Iterator[tuple[int, int, bytes]]:
        at, end = len(MAGIC), len(self._data)
        self._passed_bytes = 0
        while at + _HEAD.size <= end:
            kind, size = _HEAD.unpack_from(self._data, at)
            start = at + _HEAD.size
            if kind == _DATA_END:
                return
            whole = start + size <= end and 0 < kind <= _DATA_END
            if not whole and (after := self._next_chunk(at + 1)) is not None:
                self._passed_bytes += after - at
                at = after
                continue
            data = self._data[start : min(start + size, end)]
            if kind == _CHUNK:
                yield from self._in_chunk(data)
            elif whole:
                yield from self._message(kind, data)
            if not whole:
                break
            at = start + size
        if not self._has_summary:
            self._cut = f"ends early: cut off inside the record at byte {at} of {end}"

    _has_summary = False

    def _next_chunk(self, start: int) -> int | None:
        """Find the next chunk that lies whole in the file, after damage."""
        for found in _CHUNK_START.finditer(self._data, start):
            at = found.start()
            size = _HEAD.unpack_from(self._data, at)[1]
            first, last, unpacked, _ = _CHUNK_HEAD.unpack_from(self._data, at + _HEAD.size)
            plain = found[0].endswith(bytes(4))
            fits = found.end() < at + _HEAD.size + size <= len(self._data) and first <= last
            if fits and (not plain or size == unpacked + _CHUNK_HEAD.size + 4 + 8):
                return at
        return None

    def _in_chunk(self, data: bytes) -> Iterator[tuple[int, int, bytes]]:
        for kind, record in _records(_unpacked(data)):
            yield from self._message(kind, record)

    def _message(self, kind: int, data: bytes) -> Iterator[tuple[int, int, bytes]]:
        """Note schemas and channels, yield messages of known channels."""
        if kind != _MESSAGE:
            self._define(kind, data)
        elif len(data) >= _MESSAGE_HEAD.size:
            channel, _, record_ns, _ = _MESSAGE_HEAD.unpack_from(data)
            if channel in self._channels:
                yield channel, _within(record_ns), data[_MESSAGE_HEAD.size :]

    def _define(self, kind: int, data: bytes) -> None:
        if kind == _SCHEMA and len(data) >= 6:
            number = int.from_bytes(data[:2], "little")
            self._schemas.setdefault(number, _string(data, 2))
        elif kind == _CHANNEL and len(data) >= 8:
            number, schema = struct.unpack_from("<HH", data)
            self._channels.setdefault(number, (_string(data, 4), self._schemas.get(schema, "")))


def _within(time_ns: int) -> int:
    """Whether a time fits into the signed range; others are damage."""
    return min(time_ns, 2**63 - 1)


def _string(data: bytes, at: int) -> str:
    """Read a string, truncated where the data end."""
    size = min(_STRING.unpack_from(data, at)[0], MAX_TEXT_BYTES)
    text = data[at + _STRING.size : at + _STRING.size + size].decode("utf-8", "replace")
    return brief(text, 200)


def _records(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield kind and data of every whole record; a damaged one costs those up to the next message.

    Messages are found again by their fixed start: kind, a length that fits, a known size.
    """
    at = 0
    while at + _HEAD.size <= len(data):
        kind, size = _HEAD.unpack_from(data, at)
        end = at + _HEAD.size + size
        if end <= len(data) and 0 < kind <= _DATA_END:
            yield kind, data[at + _HEAD.size : end]
            at = end
            continue
        at = _next_message(data, at + 1)
        if at < 0:
            return


def _next_message(data: bytes, at: int) -> int:
    """Find the next message record that is followed by another record, or by the end; else -1."""
    while (at := data.find(bytes([_MESSAGE]), at)) >= 0 and at + _HEAD.size <= len(data):
        size = _HEAD.unpack_from(data, at)[1]
        end = at + _HEAD.size + size
        if size >= _MESSAGE_HEAD.size and end <= len(data):
            if end + _HEAD.size > len(data):
                return at
            kind, following = _HEAD.unpack_from(data, end)
            if kind in (_SCHEMA, _CHANNEL, _MESSAGE) and end + _HEAD.size + following <= len(data):
                return at
        at += 1
    return -1


def _unpacked(chunk: bytes) -> bytes:
    """Decompress a chunk as far as it is intact; empty where that is impossible."""
    if len(chunk) < _CHUNK_HEAD.size + 4:
        return b""
    claimed = _CHUNK_HEAD.unpack_from(chunk)[2]
    compression = _string(chunk, _CHUNK_HEAD.size)
    packed = chunk[_CHUNK_HEAD.size + 4 + len(compression) + 8 :]
    return unpack_partly(packed, compression, claimed)
