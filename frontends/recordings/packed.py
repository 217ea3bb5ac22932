# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Serialized messages packed end to end, and a cursor that reads one field of all of them at once.

A recording holds thousands of messages of one layout. Reading field after field over all messages
costs one numpy call per field instead of one Python object per message.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]
Ints = NDArray[np.int64]


class Malformed(ValueError):
    """A message ends before its fields do."""


@dataclass(frozen=True, slots=True)
class Packed:
    """Messages of one topic in one buffer.

    Parameters
    ----------
    buffer : (L,) uint8
    starts, ends : (N,) int64
        Message i is `buffer[starts[i]:ends[i]]`.
    record_ns : (N,) int64
        When each message was recorded [ns].
    """

    buffer: Bytes
    starts: Ints
    ends: Ints
    record_ns: Ints

    def __len__(self) -> int:
        return len(self.starts)

    def subset(self, keep: NDArray[np.bool_] | Ints) -> Packed:
        """Return the chosen messages, the buffer shared."""
        return Packed(self.buffer, self.starts[keep], self.ends[keep], self.record_ns[keep])


def pack(messages: Iterable[tuple[int, bytes]]) -> Packed:
    """Pack (record time [ns], serialized message) pairs into one buffer."""
    pairs = list(messages)
    ends = np.cumsum(np.fromiter((len(raw) for _, raw in pairs), np.int64, len(pairs)))
    starts = np.concatenate([[0], ends[:-1]]).astype(np.int64)[: len(pairs)]
    buffer = np.frombuffer(b"".join(raw for _, raw in pairs), np.uint8)
    return Packed(buffer, starts, ends, np.array([ns for ns, _ in pairs], np.int64))


def gather(buffer: Bytes, starts: Ints, length: int) -> Bytes:
    """Copy `length` bytes from each start into the rows of an (N, length) array."""
    if length == 0 or len(starts) == 0:
        return np.zeros((len(starts), length), np.uint8)
    # An overlapping view of `length`-byte items turns the gather into one memcpy per row.
    items = np.ndarray((len(buffer) - length + 1,), f"V{length}", buffer.data, 0, (1,))
    return np.asarray(items[starts]).view(np.uint8).reshape(len(starts), length)


class Cursor:
    """A read position in every message, which advances field by field.

    ROS 1 fields are packed; CDR aligns every primitive to its size, counted from the end of the
    four-byte encapsulation header, which also tells the byte order.

    Parameters
    ----------
    packed : Packed
        All of the same byte order.
    cdr : bool
    little_endian : bool

    Raises
    ------
    Malformed
        From any read that would pass the end of a message.
    """

    def __init__(self, packed: Packed, *, cdr: bool, little_endian: bool = True) -> None:
        self.packed = packed
        self.cdr = cdr
        self.big_endian = not little_endian
        self._origin = packed.starts + (4 if cdr else 0)
        self.at = self._origin.copy()

    def __len__(self) -> int:
        return len(self.at)

    def subset(self, keep: NDArray[np.bool_] | Ints) -> Cursor:
        """Return a cursor at the present position of the chosen messages."""
        other = Cursor(self.packed.subset(keep), cdr=self.cdr, little_endian=not self.big_endian)
        other.at = self.at[keep]
        return other

    def column(self, kind: str, count: int = 1) -> NDArray[np.generic]:
        """Read `count` primitives ('u4', 'i4', 'f4', 'f8') from every message, (N, count)."""
        dtype = np.dtype((">" if self.big_endian else "<") + kind)
        if count:
            self.align(dtype.itemsize)
        rows = gather(
            self.packed.buffer, self._take(dtype.itemsize * count), dtype.itemsize * count
        )
        return rows.view(dtype).astype(dtype.newbyteorder("="), copy=False)

    def counts(self) -> Ints:
        """Read the length that precedes a string or a sequence, (N,)."""
        return np.asarray(self.column("u4")[:, 0], np.int64)

    def strings(self) -> tuple[list[str], Ints]:
        """Read one string from every message: the distinct strings, and which one each has."""
        lengths = self.counts()
        starts, codes = self._take(lengths), np.zeros(len(self), np.int64)
        names: dict[str, int] = {}
        for length in np.unique(lengths).tolist():
            rows = np.flatnonzero(lengths == length)
            texts = gather(self.packed.buffer, starts[rows], length)
            unique, inverse = _distinct_rows(texts)
            decoded = [row.tobytes().rstrip(b"\0").decode("utf-8", "replace") for row in unique]
            known = np.array([names.setdefault(text, len(names)) for text in decoded], np.int64)
            codes[rows] = known[inverse]
        return list(names), codes

    def align(self, size: int) -> None:
        """Move to the next multiple of `size` where the encoding asks for it."""
        if self.cdr:
            self.at += -(self.at - self._origin) % size

    def _take(self, sizes: Ints | int) -> Ints:
        starts = self.at
        self.at = starts + sizes
        if np.any(self.at > self.packed.ends):
            raise Malformed("a message is shorter than its fields")
        return starts


def _distinct_rows(rows: Bytes) -> tuple[Bytes, Ints]:
    """Return the distinct rows and which one each row is; fast when all are equal."""
    if (rows == rows[:1]).all():
        return rows[:1], np.zeros(len(rows), np.int64)
    unique, inverse = np.unique(rows, axis=0, return_inverse=True)
    return unique, inverse.ravel().astype(np.int64)
