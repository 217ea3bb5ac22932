# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Streaming writer of ZIP archives that compresses long runs of one value at almost no cost.

Layers of a large site are mostly blank. The standard library deflates 0.7 GB of zeros a second, ten
layers of a square kilometre 20 s; here the deflated bytes of an earlier equal run are copied,
and its checksum is composed (zlib's crc32_combine). Format: PKWARE APPNOTE 6.3.9, with 64-bit
sizes; RFC 1951.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from types import TracebackType
from typing import IO, Final, NamedTuple

_LEVEL: Final = 1
"""Compression level of zlib. On the map of a large site level 6, numpy's own, takes three
times as long for a file a third smaller."""
_POLYNOMIAL: Final = 0xEDB88320
"""Of CRC-32, bits reversed (ISO 3309)."""
_ONE: Final = 1 << 31
"""x^0 in that order of bits."""
_VERSION: Final = 45
"""Version of the format, the first with 64-bit sizes."""
_ELSEWHERE: Final = 0xFFFFFFFF
"""Marks a size that is in the 64-bit field."""
_FIRST_DAY: Final = (0, 33)
"""Time and date of files, 1 January 1980: the same input makes the same archive."""
_MANY_RUNS: Final = 256
"""Runs kept: those of a few bands of rows, some kilobytes each."""


class _Entry(NamedTuple):
    """An entry of the central directory."""

    name: bytes
    checksum: int
    size: int
    packed: int
    offset: int


class ZipArchive:
    """An archive that is written sequentially, closed by `with`.

    Parameters
    ----------
    file : binary file that can be sought in
    """

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file
        self._entries: list[_Entry] = []

    def __enter__(self) -> ZipArchive:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if error is None:
            self._end()

    @contextmanager
    def file(self, name: str) -> Iterator[Deflated]:
        """Write the next file."""
        offset, packed_name = self._file.tell(), name.encode()
        self._file.write(_local_header(_Entry(packed_name, 0, 0, 0, offset)))
        begin = self._file.tell()
        writer = Deflated(self._file)
        yield writer
        writer.end()
        end = self._file.tell()
        entry = _Entry(packed_name, writer.checksum, writer.size, end - begin, offset)
        self._file.seek(offset)
        self._file.write(_local_header(entry))
        self._file.seek(end)
        self._entries.append(entry)

    def _end(self) -> None:
        """Write the central directory."""
        begin, count = self._file.tell(), len(self._entries)
        for entry in self._entries:
            self._file.write(_directory_entry(entry))
        end = self._file.tell()
        sizes = count, count, end - begin, begin
        self._file.write(
            struct.pack("<IQHHIIQQQQ", 0x06064B50, 44, _VERSION, _VERSION, 0, 0, *sizes)
        )
        self._file.write(struct.pack("<IIQI", 0x07064B50, 0, end, 1))
        short = 0xFFFF, 0xFFFF, _ELSEWHERE, _ELSEWHERE, 0
        self._file.write(struct.pack("<IHHHHIIH", 0x06054B50, 0, 0, *short))


class Deflated:
    """A stream that deflates its input.

    Parameters
    ----------
    file : binary file
    """

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file
        self._packer = zlib.compressobj(_LEVEL, zlib.DEFLATED, -15)
        self.checksum, self.size = 0, 0

    def write(self, data: bytes) -> int:
        """Write bytes; returns how many."""
        self.checksum = zlib.crc32(data, self.checksum)
        self.size += len(data)
        self._file.write(self._packer.compress(data))
        return len(data)

    def repeat(self, value: bytes, count: int) -> None:
        """Write a value so many times."""
        packed, checksum, shift = _run(value, count)
        # From here on nothing refers to what came before, so that a run fits in as it is.
        self._file.write(self._packer.flush(zlib.Z_FULL_FLUSH) + packed)
        self.checksum = _product(shift, self.checksum) ^ checksum
        self.size += len(value) * count

    def end(self) -> None:
        """Flush the compressor."""
        self._file.write(self._packer.flush())


@lru_cache(maxsize=_MANY_RUNS)
def _run(value: bytes, count: int) -> tuple[bytes, int, int]:
    """Return a deflated run: its bytes, checksum, and the factor that shifts a checksum past it."""
    packer, data = zlib.compressobj(_LEVEL, zlib.DEFLATED, -15), value * count
    packed = packer.compress(data) + packer.flush(zlib.Z_FULL_FLUSH)
    return packed, zlib.crc32(data), _power(8 * len(data))


def _product(a: int, b: int) -> int:
    """Product of polynomials over GF(2) modulo that of CRC-32."""
    product = 0
    for bit in range(31, -1, -1):
        if a >> bit & 1:
            product ^= b
        b = b >> 1 ^ (_POLYNOMIAL if b & 1 else 0)
    return product


def _power(exponent: int) -> int:
    """Take x to a power modulo the polynomial of CRC-32."""
    power, square = _ONE, _ONE >> 1
    while exponent:
        if exponent & 1:
            power = _product(square, power)
        square = _product(square, square)
        exponent >>= 1
    return power


def _local_header(entry: _Entry) -> bytes:
    """Return the header before a file's data."""
    head = 0x04034B50, _VERSION, 0, zlib.DEFLATED, *_FIRST_DAY, entry.checksum
    sizes = _ELSEWHERE, _ELSEWHERE, len(entry.name), 20
    wide = struct.pack("<HHQQ", 1, 16, entry.size, entry.packed)
    return struct.pack("<IHHHHHIIIHH", *head, *sizes) + entry.name + wide


def _directory_entry(entry: _Entry) -> bytes:
    """Return the entry of the central directory, with the file's offset."""
    head = 0x02014B50, _VERSION, _VERSION, 0, zlib.DEFLATED, *_FIRST_DAY, entry.checksum
    sizes = _ELSEWHERE, _ELSEWHERE, len(entry.name), 28, 0, 0, 0, 0, _ELSEWHERE
    wide = struct.pack("<HHQQQ", 1, 24, entry.size, entry.packed, entry.offset)
    return struct.pack("<IHHHHHHIIIHHHHHII", *head, *sizes) + entry.name + wide
