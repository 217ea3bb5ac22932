# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""One echo per beam out of sensor_msgs/MultiEchoLaserScan, whose beams vary in length."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slarm_graph.frontends.recordings.packed import Bytes, Cursor, Ints, Malformed
from slarm_graph.kernels import kernel

_MODES = {"first": 0, "last": 1, "strongest": 2}
"""Which return of a beam is taken, by the setting's word, as compiled code takes it."""
_NAN = np.uint32(0x7FC00000)
"""The bits of the quiet NaN in float32 (IEEE 754)."""


def choose_echoes(cursor: Cursor, beams: int, echo: str) -> NDArray[np.float32]:
    """Read the ranges of messages that all have the same number of beams.

    Parameters
    ----------
    cursor : Cursor
        Behind the beam count of `ranges`.
    beams : int
    echo : {"first", "last", "strongest"}
        Where the message has no matching intensities, the strongest is the first.

    Returns
    -------
    (N, beams) float32 [m]
        nan where a beam has no echo.

    Raises
    ------
    Malformed
        When a message ends before its fields do.
    """
    packed = cursor.packed
    words, whole = _choose(
        packed.buffer, cursor.at, packed.ends, beams, _MODES[echo], cursor.big_endian
    )
    if not whole.all():
        raise Malformed("a message is shorter than its fields")
    return words.view(np.float32)


@kernel
def _word(buffer: Bytes, at: int, big_endian: bool) -> int:
    """Read an unsigned 32-bit integer."""
    a, b = int(buffer[at]), int(buffer[at + 1])
    c, d = int(buffer[at + 2]), int(buffer[at + 3])
    if big_endian:
        return (a << 24) | (b << 16) | (c << 8) | d
    return (d << 24) | (c << 16) | (b << 8) | a


@kernel
def _rank(word: int) -> int:
    """Order float32 bit patterns as the floats they are; nan lowest."""
    if (word & 0x7FFFFFFF) > 0x7F800000:
        return 0
    if word & 0x80000000:
        return 1 + 0xFFFFFFFF - word
    return 1 + 0x80000000 + word


@kernel
def _lists(
    buffer: Bytes, at: int, end: int, beams: int, big_endian: bool, starts: Ints, counts: Ints
) -> int:
    """Find where each beam's list begins and how long it is; return the end, or -1 if cut off."""
    for beam in range(beams):
        if at + 4 > end:
            return -1
        counts[beam] = _word(buffer, at, big_endian)
        starts[beam] = at + 4
        at += 4 + 4 * counts[beam]
    return at if at <= end else -1


@kernel
def _choose(
    buffer: Bytes, begin: Ints, ends: Ints, beams: int, mode: int, big_endian: bool
) -> tuple[NDArray[np.uint32], NDArray[np.bool_]]:
    words = np.full((len(begin), beams), _NAN, np.uint32)
    whole = np.ones(len(begin), np.bool_)
    starts, counts = np.empty(beams, np.int64), np.empty(beams, np.int64)
    strong_starts, strong_counts = np.empty(beams, np.int64), np.empty(beams, np.int64)
    for row in range(len(begin)):
        at = _lists(buffer, begin[row], ends[row], beams, big_endian, starts, counts)
        if at < 0:
            whole[row] = False
            continue
        ranked = False
        if mode == 2 and at + 4 <= ends[row] and _word(buffer, at, big_endian) == beams:
            after = _lists(
                buffer, at + 4, ends[row], beams, big_endian, strong_starts, strong_counts
            )
            ranked = after >= 0
        for beam in range(beams):
            count = counts[beam]
            if count == 0:
                continue
            which = count - 1 if mode == 1 else 0
            if ranked and strong_counts[beam] == count:
                best = -1
                for echo in range(count):
                    rank = _rank(_word(buffer, strong_starts[beam] + 4 * echo, big_endian))
                    if rank > best:
                        best, which = rank, echo
            words[row, beam] = _word(buffer, starts[beam] + 4 * which, big_endian)
    return words, whole
