# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Checks of the stamps of a topic."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slarm_graph.frontends.recordings.clock import (
    GAP_PERIODS,
    disorder,
    listed,
    segment_rows,
    segments,
)
from slarm_graph.frontends.recordings.findings import Finding, counted
from slarm_graph.frontends.recordings.packed import Ints
from slarm_graph.frontends.recordings.scan_rules import far_off

_SKEW_WARNING_S = 0.1
"""One period of a lidar of 10 Hz. A choice; only a note depends on it."""
_OTHER_CLOCK_S = 0.5
"""Clocks that NTP keeps agree far better. A choice; only a note depends on it."""
_LEAST_GAP_NS = 100_000_000
"""Shortest reported gap: fast topics may miss some messages in a row."""


@dataclass(frozen=True, slots=True)
class Jumps:
    """Clock jumps of the scans: number of segments, and the chosen one.

    Parameters
    ----------
    parts : int
        Segments of the scans; 0 where there are none.
    chosen : int or None
        As `--segment` says.
    """

    parts: int = 0
    chosen: int | None = None

    @classmethod
    def of_scans(cls, stamps: Ints, chosen: int | None) -> Jumps:
        """Count the segments of scans by their stamps (N,) in recorded order."""
        parts = len(segments(stamps))
        return cls(parts, chosen if chosen is None or chosen <= parts else None)

    def rows(self, stamps: Ints) -> Ints:
        """Return the rows of the chosen segment, of scans or of a stream that jumps as they do."""
        return segment_rows(stamps, self.chosen or self.parts + 1, self.parts)


def check_stamps(
    where: str, stamps: Ints, record_ns: Ints, jumps: Jumps, what: str = "message"
) -> list[Finding]:
    """Check header stamps (N,) [ns] in recorded order against the times of recording (N,)."""
    if not stamps.any():
        advice = "the time of recording is used; better let the driver set header.stamp"
        return [Finding("warning", where, "all stamps are 0", advice, len(stamps))]
    found = counted(
        "warning", where, "{count} of {total} messages with a stamp of 0", stamps == 0, record_ns,
        "these messages are not used",
    )  # fmt: skip
    astray = far_off(stamps) & (stamps != 0)
    found += counted(
        "warning", where, "{count} of {total} stamps more than a week off", astray, stamps,
        "these messages are not used",
    )  # fmt: skip
    set_rows = (stamps != 0) & ~astray
    ordered = check_order(where, stamps[set_rows], jumps, what)
    found += ordered
    if any(finding.severity == "error" for finding in ordered):
        return found  # beats and gaps of several recordings at once say nothing
    found += _check_gaps(where, stamps[set_rows])
    return found + _check_skew(where, stamps[set_rows], record_ns[set_rows])


def check_order(where: str, stamps: Ints, jumps: Jumps, what: str = "message") -> list[Finding]:
    """Check for clocks that jump back, late messages and repeated stamps.

    A clock that jumps back is an error where a segment has to be chosen; a stream that jumps where
    the scans do not is used whole.
    """
    found: list[Finding] = []
    parts = segments(stamps)
    if len(parts) > 1:
        times = "once" if len(parts) == 2 else f"{len(parts) - 1} times"
        told = f"the clock jumps back {times}: {listed(stamps, what)}"
        first = int(stamps[parts[1][0]])
        if len(parts) == jumps.parts and jumps.chosen is None:
            return [Finding("error", where, told, "choose with --segment", len(parts) - 1, first)]
        advice = "that of the scans does not: all is sorted into one; --odom none leaves it out"
        found.append(Finding("warning", where, told, advice, len(parts) - 1, first))
    late = disorder(stamps)
    if late.late:
        told = f"{late.late} of {len(stamps)} out of order, at most {late.worst_ns * 1e-6:.0f} ms"
        first = int(stamps[np.argmax(np.maximum.accumulate(stamps) != stamps)])
        found.append(Finding("note", where, told, "they are sorted", late.late, first))
    ordered = np.sort(stamps)
    again = np.concatenate([[False], np.diff(ordered) == 0])
    return found + counted(
        "warning", where, "{count} of {total} repeating the stamp before", again, ordered,
        "only the first of them is used; two drivers on one topic, or a merged recording?",
    )  # fmt: skip


def _check_gaps(where: str, stamps: Ints) -> list[Finding]:
    steps = np.diff(np.sort(stamps))
    if len(steps) < 3:
        return []
    usual, slow = (float(value) for value in np.quantile(steps, (0.5, 0.95)))
    limit_ns = round(max(GAP_PERIODS * usual, 2.0 * slow, _LEAST_GAP_NS))
    long = np.concatenate([[False], steps > limit_ns])
    worst = f"longest {steps.max() * 1e-9:.2f} s, usual {usual * 1e-9:.3f} s"
    return counted(
        "warning", where, f"gaps: {{count}} ({worst})", long, np.sort(stamps),
        "lost messages: record less, or on a faster disk",
    )  # fmt: skip


def _check_skew(where: str, stamps: Ints, record_ns: Ints) -> list[Finding]:
    if len(stamps) < 2:
        return []
    skew = (record_ns - stamps) * 1e-9
    usual = float(np.median(skew))
    found: list[Finding] = []
    if abs(usual) > _OTHER_CLOCK_S:
        side = "behind" if usual > 0 else "ahead of"
        told = f"stamps are {abs(usual):.3f} s {side} the time of recording: another clock"
        found.append(Finding("note", where, told, "only header stamps are used", len(stamps)))
    return found + counted(
        "note", where, f"{{count}} of {{total}} recorded more than {_SKEW_WARNING_S} s off beat",
        np.abs(skew - usual) > _SKEW_WARNING_S, stamps,
        "a loaded machine or network; header stamps are used, so only wrong stamps matter",
    )  # fmt: skip
