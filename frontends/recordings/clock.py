# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Order of stamps: clocks that jump back, late and equal stamps, gaps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slarm_graph.counts import count_of
from slarm_graph.errors import BadInput
from slarm_graph.frontends.recordings.packed import Ints

JUMP_NS = 1_000_000_000
"""Least step back of a clock jump: less is late delivery; drivers hold messages for a sweep or two
(LONGEST_SWEEP_S)."""
_CONFIRMING = 3
"""Consecutive messages behind that confirm a jump; one or two may be late ones."""
GAP_PERIODS = 3.0
"""Two scans lost in a row are a gap, one is not. A choice; only notices depend on it."""
_BACKWARDS_SHARE = 0.9
"""Share of steps back; late messages and repeated loops have at most one step back in two."""
_MOST_LISTED = 6
"""Most segments that are listed: more do not fit the lines of a terminal."""


@dataclass(frozen=True, slots=True)
class Disorder:
    """Violations of increasing stamps.

    Parameters
    ----------
    late : int
        Messages stamped before one recorded earlier.
    worst_ns : int
        Largest step back behind the latest stamp so far.
    backwards : bool
        Whether nearly all are late: the recording was written backwards.
    """

    late: int
    worst_ns: int
    backwards: bool = False

    def describe(self, what: str) -> list[str]:
        """Return one notice, or none."""
        if not self.late:
            return []
        if self.backwards:
            return [f"warning: the stamps of the {what} run backwards throughout, sorted"]
        return [f"{self.late} {what} out of order (at most {self.worst_ns * 1e-6:.0f} ms), sorted"]


def disorder(stamps_ns: Ints) -> Disorder:
    """Measure the disorder of stamps (N,) in recorded order."""
    if len(stamps_ns) == 0:
        return Disorder(0, 0)
    behind = np.maximum.accumulate(stamps_ns) - stamps_ns
    backwards = runs_backwards(stamps_ns)
    return Disorder(int(np.count_nonzero(behind)), int(behind.max()), backwards)


def segments(stamps_ns: Ints) -> list[tuple[int, int]]:
    """Cut stamps (N,), in recorded order, where the clock jumps back and stays there.

    A message that merely arrives late, with its successors back on time, is no jump; nor is a
    recording that was written backwards throughout.

    Returns
    -------
    list of (start, stop) row numbers
    """
    starts, at = [0], 0
    if runs_backwards(stamps_ns):
        return [(0, len(stamps_ns))]
    while True:
        part = stamps_ns[at:]
        behind = np.maximum.accumulate(part) - part
        for row in np.flatnonzero(behind > JUMP_NS).tolist():
            following = behind[row : row + _CONFIRMING]
            if len(following) == _CONFIRMING and np.all(following > JUMP_NS):
                at += row
                starts.append(at)
                break
        else:
            return list(zip(starts, [*starts[1:], len(stamps_ns)], strict=True))


def runs_backwards(stamps_ns: Ints) -> bool:
    """Whether stamps (N,) decrease from nearly every message to the next."""
    steps = np.diff(stamps_ns)
    return len(steps) >= _CONFIRMING and bool(np.mean(steps < 0) > _BACKWARDS_SHARE)


def choose_segment(stamps_ns: Ints, wanted: int | None, what: str) -> tuple[int, int]:
    """Return the rows (start, stop) of the segment to use.

    Raises
    ------
    BadInput
        When there are several and none is chosen, or the chosen one does not exist.
    """
    parts = segments(stamps_ns)
    if wanted is not None and wanted > len(parts):
        raise BadInput(f"--segment {wanted}: there are only {len(parts)} ({listed(stamps_ns)})")
    if wanted is None and len(parts) > 1:
        row = parts[1][0]
        back_s = int(np.max(stamps_ns[:row]) - stamps_ns[row]) * 1e-9
        raise BadInput(
            f"the clock goes back by {back_s:.1f} s at {what} {row}: two recordings in one? "
            f"Choose with --segment 1 ... {len(parts)} ({listed(stamps_ns)})"
        )
    return parts[(wanted or 1) - 1]


def segment_rows(stamps_ns: Ints, wanted: int, count: int) -> Ints:
    """Return the rows of another stream that belong to one of the scans' segments.

    Parameters
    ----------
    stamps_ns : (N,) int64
        Of the stream, in recorded order.
    wanted : int
        Segment number, counted from 1.
    count : int
        Number of segments of the scans. A stream with another number is used whole.
    """
    parts = segments(stamps_ns)
    fits = len(parts) == count >= wanted
    start, stop = parts[wanted - 1] if fits else (0, len(stamps_ns))
    return np.arange(start, stop)


def listed(stamps_ns: Ints, what: str = "scan") -> str:
    """Format the segments: number, how many scans (or other messages), first and last stamp."""
    parts = segments(stamps_ns)
    told = [
        f"{number}: {count_of(stop - start, what)}, {seconds(stamps_ns[start:stop].min())} to "
        f"{seconds(stamps_ns[start:stop].max())}"
        for number, (start, stop) in enumerate(parts[:_MOST_LISTED], start=1)
    ]
    more = [f"{len(parts) - _MOST_LISTED} more"] if len(parts) > _MOST_LISTED else []
    return "; ".join([*told, *more])


def gap_notice(stamps: Ints, steps: Ints) -> list[str]:
    """Return one notice about long gaps between scans, or none."""
    if len(steps) == 0:
        return []
    usual = np.median(steps)
    long = steps > max(GAP_PERIODS * float(usual), 1e9)
    if not long.any():
        return []
    row = int(np.argmax(steps))
    return [
        f"gaps between scans: {np.count_nonzero(long)}, longest {steps[row] * 1e-9:.1f} s "
        f"after {seconds(stamps[row])}"
    ]


def seconds(stamp_ns: int | np.integer) -> str:
    """Format a stamp in seconds."""
    whole, part = divmod(int(stamp_ns), 1_000_000_000)
    return f"{whole}.{part // 1_000_000:03d} s"
