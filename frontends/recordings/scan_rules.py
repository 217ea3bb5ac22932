# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Plausibility rules for recorded scans, shared by the run and the diagnosis."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slarm_graph.config.stage import MOST_BEAMS
from slarm_graph.counts import count_of
from slarm_graph.frontends.recordings.messages import ScanBlock
from slarm_graph.frontends.recordings.packed import Ints
from slarm_graph.frontends.recordings.ranges import Ranges
from slarm_graph.frontends.recordings.scan_table import ScanTable, recorded_beam_period_s
from slarm_graph.geometry import Floats, between

LONGEST_SWEEP_PERIODS = 1.5
"""Longest plausible sweep, in periods: it ends before the next one; the half more allows for scans
that were lost or stamped late. Mistaken units are wrong a thousandfold and more."""
LONGEST_SWEEP_S = 1.0
"""Longest plausible sweep without a known period: no planar lidar turns slower."""
MAX_EMPTY_SHARE = 0.9
"""Largest share of scans without any return; with more the sensor is at fault, not the place."""
FEW_BEAMS = 16
"""Fewest returns in most scans for matching: three unknowns need some ten lines of
sight that see different walls; at half as many even a square room leaves matches undetermined."""
MOVED_M, MOVED_RAD = 0.02, 0.01
"""Motion by which two scans differ in every bit: ranges have noise of a centimetre or so, and a
robot that stands still on encoders that tremble moves less."""
CODE_SHARE = 0.02
"""Of the returns: a measured range is hardly ever range_max to the bit (not one is in the eight
recordings of real lasers this was tried on), a driver's code for `no return` always is."""
FAR_OFF_NS = 7 * 86_400 * 1_000_000_000
"""A week: no recording lasts so long, so that a stamp this far from most others is damaged."""
FAR_OFF_SHARE = 0.1
"""More far stamps than this are no damage but two recordings in one, which is told otherwise."""


@dataclass(frozen=True, slots=True)
class Sweeps:
    """Recorded sweep times of scans.

    Parameters
    ----------
    beam_period_s : (N,) float64
        Between neighbouring beams; 0 where unknown or implausible.
    ignored : (N,) bool
        Scans whose recorded sweep time is implausible.
    period_s : float
        Usual time between scans; 0 where it is unknown.
    """

    beam_period_s: Floats
    ignored: NDArray[np.bool_]
    period_s: float

    def describe(self) -> str:
        """Return a notice on ignored times, with its consequence; empty without any."""
        count = int(np.count_nonzero(self.ignored))
        if not count:
            return ""
        return (
            f"{count} of {count_of(len(self.ignored), 'scan')} lasting longer than the"
            f" {self.period_s:.3f} s between scans (time_increment x beams)"
        )


SWEEPS_IGNORED = "the time is ignored: motion within these scans is not undone"


def sweeps(table: ScanTable, *, believed: bool = True) -> Sweeps:
    """Return the plausible sweep times: those shorter than the time between scans."""
    if not believed:
        return Sweeps(np.zeros(len(table)), np.zeros(len(table), np.bool_), 0.0)
    recorded = table.flat([recorded_beam_period_s(block) for block in table.blocks])
    beams = table.flat([np.full(len(b), max(b.ranges_m.shape[1], 1)) for b in table.blocks])
    steps = np.diff(np.unique(table.stamp_ns))
    period_s = float(np.median(steps)) * 1e-9 if len(steps) > 1 else 0.0
    longest_s = LONGEST_SWEEP_PERIODS * period_s if period_s else LONGEST_SWEEP_S
    with np.errstate(over="ignore", invalid="ignore"):
        ignored = ~(recorded * beams <= longest_s)
    return Sweeps(np.where(ignored, 0.0, recorded), ignored, period_s)


def far_off(stamps_ns: Ints) -> NDArray[np.bool_]:
    """Return the few stamps (N,) that are so far from the others that they must be damaged."""
    if not len(stamps_ns):
        return np.zeros(0, np.bool_)
    away = np.abs(stamps_ns - np.median(stamps_ns)) > FAR_OFF_NS
    return away if np.count_nonzero(away) < FAR_OFF_SHARE * len(stamps_ns) else away & False


def repeats(table: ScanTable, rows: Ints) -> Ints:
    """Return for scans in time order the index (M,) of the first equal scan."""
    first = np.arange(len(rows))
    for number in range(1, len(rows)):
        one, other = table.recorded(int(rows[number - 1])), table.recorded(int(rows[number]))
        if one.shape == other.shape and one.tobytes() == other.tobytes():
            first[number] = first[number - 1]
    return first


def frozen(first: Ints, poses: Floats, known: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which scans (M,) repeat an earlier one bit by bit although the robot has moved.

    Parameters
    ----------
    first : (M,) int64
        As `repeats` gives it.
    poses : (M, 3)
        Of the odometry.
    known : (M,) bool
        Where there is odometry.
    """
    again = (first != np.arange(len(first))) & known & known[first]
    moved = np.abs(between(poses[first], poses))
    far = (np.hypot(moved[:, 0], moved[:, 1]) > MOVED_M) | (moved[:, 2] > MOVED_RAD)
    return np.asarray(again & far)


def too_few_beams(returns: Ints) -> str:
    """Return a notice where most scans have hardly any return (N,); else empty."""
    usual = float(np.median(returns)) if len(returns) else FEW_BEAMS
    if usual >= FEW_BEAMS:
        return ""
    return (
        f"most scans have {usual:.0f} returns or fewer: too few to be matched; the trajectory is "
        "hardly better than the odometry"
    )


def at_the_limit(blocks: Iterable[ScanBlock], ranges: Iterable[Ranges]) -> str:
    """Return a notice where many returns are exactly range_max; else empty.

    Parameters
    ----------
    blocks : iterable of ScanBlock
        As recorded.
    ranges : iterable of (N, B) float32
        Theirs, cleaned.
    """
    there = total = 0
    for block, cleaned in zip(blocks, ranges, strict=True):
        there += int(np.count_nonzero(cleaned == block.limits[:, 6:7].astype(np.float32)))
        total += int(np.count_nonzero(np.isfinite(cleaned)))
    if there <= CODE_SHARE * max(total, 1):
        return ""
    return f"{there / total:.0%} of all returns are exactly range_max"


AT_THE_LIMIT = (
    "looks like a code for `no return`: walls appear where there are none; "
    "set --set source.range_max_m slightly lower"
)
"""Notice on such ranges, with advice."""


def too_many_beams(block: ScanBlock) -> bool:
    """Whether scans have more beams than any lidar measures."""
    return bool(block.ranges_m.shape[1] > MOST_BEAMS)
