# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Read what there is of an MCAP file that was cut off before its summary was written.

The records are walked from the front, the last chunk as far as it can be decompressed.
Format: https://mcap.dev/spec.
"""

from __future__ import annotations

import struct
import sys
from collections.abc import Collection, Iterator
from pathlib import Path

import lz4.frame
from rosbags.interfaces import (
    Connection,
    ConnectionExtRosbag2,
    MessageDefinition,
    MessageDefinitionFormat,
)
from rosbags.rosbag2.metadata import ReaderMetadata

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

MAGIC = b"\x89MCAP0\r\n"

_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK = 0x03, 0x04, 0x05, 0x06
_HEAD = struct.Struct("<BQ")
_MESSAGE_HEAD = struct.Struct("<HIQQ")
_CHUNK_HEAD = struct.Struct("<QQQI")
_STRING = struct.Struct("<I")


class SalvagedMcap:
    """An MCAP file without its end, with the manners of a rosbags storage reader.

    Parameters
    ----------
    path : Path
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.connections: list[Connection] = []
        self.metadata = ReaderMetadata(0, 2**63 - 1, 0, 0, None, None, None, None)
        self._channels: dict[int, tuple[str, str]] = {}
        self._schemas: dict[int, str] = {}

    def open(self) -> None:
        """Walk the file once to learn its topics."""
        counts: dict[int, int] = {}
        first, last = 2**63 - 1, 0
        for channel, record_ns, _ in self._messages():
            counts[channel] = counts.get(channel, 0) + 1
            first, last = min(first, record_ns), max(last, record_ns)
        self.metadata = self.metadata._replace(
            start_time=first, end_time=last + 1, message_count=sum(counts.values())
        )
        self.connections = [
            Connection(
                number,
                *self._channels[number],
                MessageDefinition(MessageDefinitionFormat.NONE, ""),
                "",
                count,
                ConnectionExtRosbag2("cdr", []),
                self,
            )
            for number, count in counts.items()
        ]

    def close(self) -> None:
        """Nothing stays open."""

    def messages(
        self, connections: Collection[Connection]
    ) -> Iterator[tuple[Connection, int, bytes]]:
        """Yield messages in the order of the file."""
        wanted = {connection.id: connection for connection in connections}
        for channel, record_ns, raw in self._messages():
            if channel in wanted:
                yield wanted[channel], record_ns, raw

    def _messages(self) -> Iterator[tuple[int, int, bytes]]:
        with self.path.open("rb") as file:
            file.seek(len(MAGIC))
            while len(head := file.read(_HEAD.size)) == _HEAD.size:
                kind, size = _HEAD.unpack(head)
                # A damaged length must not make us ask for more memory than there is file.
                data = file.read(min(size, self.path.stat().st_size))
                if kind == _CHUNK:
                    yield from self._walk(_records(data))
                elif len(data) == size:
                    yield from self._take(kind, data)

    def _walk(self, records: bytes) -> Iterator[tuple[int, int, bytes]]:
        at = 0
        while at + _HEAD.size <= len(records):
            kind, size = _HEAD.unpack_from(records, at)
            at += _HEAD.size
            if at + size > len(records):
                return
            yield from self._take(kind, records[at : at + size])
            at += size

    def _take(self, kind: int, data: bytes) -> Iterator[tuple[int, int, bytes]]:
        """Note schemas and channels, yield messages of known channels."""
        if kind == _SCHEMA:
            number = int.from_bytes(data[:2], "little")
            self._schemas[number] = _string(data, 2)[0]
        elif kind == _CHANNEL:
            number, schema = struct.unpack_from("<HH", data)
            topic, _ = _string(data, 4)
            self._channels[number] = (topic, self._schemas.get(schema, ""))
        elif kind == _MESSAGE and len(data) >= _MESSAGE_HEAD.size:
            channel, _, record_ns, _ = _MESSAGE_HEAD.unpack_from(data)
            if channel in self._channels:
                yield channel, record_ns, data[_MESSAGE_HEAD.size :]


def _string(data: bytes, at: int) -> tuple[str, int]:
    """Read a string; also return where it ends."""
    size = _STRING.unpack_from(data, at)[0]
    end = at + _STRING.size + size
    return data[at + _STRING.size : end].decode("utf-8", "replace"), end


def _records(chunk: bytes) -> bytes:
    """Decompress a chunk as far as it goes; nothing where it cannot be."""
    try:
        compression, at = _string(chunk, _CHUNK_HEAD.size)
        packed = chunk[at + 8 :]
        if compression == "lz4":
            return bytes(lz4.frame.LZ4FrameDecompressor().decompress(packed))
        if compression == "zstd":
            return bytes(zstd.ZstdDecompressor().decompress(packed))
        return packed if not compression else b""
    except (struct.error, RuntimeError, EOFError, zstd.ZstdError):
        return b""
