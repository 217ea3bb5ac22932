# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Local views: walls and free space seen from a stretch of path, and the evidence of two poses."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slarm_graph.consistency.evidence import (
    CELL_M,
    CLEARANCE_M,
    TOLERANCE_M,
    UNKNOWN,
    classify_cells,
    count_agreement,
    count_beams,
    count_passes,
    state_at,
    wrong_place_evidence,
)
from slarm_graph.geometry import Floats, between
from slarm_graph.kernels import kernel
from slarm_graph.readings import LaserScan

MAX_RANGE_M = 15.0
"""Farther returns are left out [m]: a degree of error moves them by `TOLERANCE_M`."""
_LEAST_SINE = 0.01
"""Of the angle at which a beam meets a wall: half a degree, that of the beams."""


@dataclass(frozen=True, slots=True)
class View:
    """Walls and cell states seen from a stretch of path, in its own frame.

    Parameters
    ----------
    walls : (W, 2) float64
        Centres of the wall cells [m].
    states : (rows, cols) uint8, row = y
        State of every cell.
    low : (2,) float64
        Corner of the first cell [m].
    """

    walls: Floats
    states: NDArray[np.uint8]
    low: Floats


def view_of(returns: Sequence[Floats], lasers: Floats, clear_ends: Sequence[Floats] = ()) -> View:
    """Rasterise the walls that beams end at and the cells that they pass.

    Parameters
    ----------
    returns : sequence of S (K, 2) float64
        Of every scan, in the view's frame [m].
    lasers : (S, 2) float64
        Position of the laser at each [m].
    clear_ends : sequence of S (M, 2) float64
        How far the beams of every scan reach that have met nothing [m]; none where not known.
    """
    ends = np.cumsum([0, *(len(scan) for scan in returns)])
    beams, low, high = _all_beams(np.concatenate([np.zeros((0, 2)), *returns]), ends, lasers)
    if not len(beams):
        return View(np.zeros((0, 2)), np.zeros((0, 0), dtype=np.uint8), np.zeros(2))
    clear = _clear_beams(lasers, clear_ends)
    low = np.minimum(low, clear[:, 2:4].min(axis=0, initial=np.inf)) - CELL_M
    high = np.maximum(high, clear[:, 2:4].max(axis=0, initial=-np.inf))
    cols, rows = np.ceil((high - low) / CELL_M).astype(int) + 1
    hits, passes, unreturned = np.zeros((3, rows, cols), dtype=np.int16)
    count_beams(hits, passes, low, beams)
    count_passes(unreturned, low, clear)
    states, cells = classify_cells(hits, passes, unreturned)
    return View(low + (cells[:, ::-1] + 0.5) * CELL_M, states, low)


def clear_beams(scan: LaserScan) -> LaserScan:
    """Return only the beams that have met nothing, as if they ended where the scan's sight does.

    At its farthest return, less `CLEARANCE_M`: what is farther away may be too far for the laser.
    """
    is_near = scan.is_return() & (scan.ranges_m < MAX_RANGE_M)
    reach_m = float(np.max(scan.ranges_m, initial=0.0, where=is_near)) - CLEARANCE_M
    return replace(scan, ranges_m=np.where(scan.is_clear(), reach_m, np.nan))


def _clear_beams(lasers: Floats, ends: Sequence[Floats]) -> Floats:
    """Beams (M, 5) that pass all that lies before their ends."""
    stops = np.concatenate([np.zeros((0, 2)), *ends])
    starts = np.repeat(lasers[: len(ends)], [len(scan) for scan in ends], axis=0)
    return np.column_stack([starts, stops, np.hypot(*(stops - starts).T)])


def evidence_against(a: View, b: View, b_from_a: Floats) -> float:
    """Log-likelihood ratio [nat] of a wrong over a right pose of one view in another.

    Parameters
    ----------
    a, b : View
    b_from_a : (3,) float64
        Pose to test [m, m, rad].
    """
    a_from_b = between(b_from_a, np.zeros(3))
    both = (
        count_agreement(a.walls, b_from_a, b.states, b.low),
        count_agreement(b.walls, a_from_b, a.states, a.low),
    )
    counts = np.array(both).sum(axis=0)
    return float(wrong_place_evidence(counts[:1], counts[1:])[0])


@kernel
def count_known(
    points: Floats, view_from_robot: Floats, states: NDArray[np.uint8], low: Floats
) -> int:
    """Count the points (K, 2) [m], at a pose (3,), that lie in known cells of a view."""
    c, s = math.cos(view_from_robot[2]), math.sin(view_from_robot[2])
    known = 0
    for k in range(len(points)):
        x = view_from_robot[0] + c * points[k, 0] - s * points[k, 1]
        y = view_from_robot[1] + s * points[k, 0] + c * points[k, 1]
        known += state_at(states, low, x, y) != UNKNOWN
    return known


@kernel
def _all_beams(
    returns: Floats, ends: NDArray[np.int64], lasers: Floats
) -> tuple[Floats, Floats, Floats]:
    """Beams (M, 5) of all scans, and the lowest and highest x, y (2,) that they reach [m].

    Scan k has the returns (K, 2) from ends[k] to ends[k + 1].
    """
    beams = np.empty((len(returns), 5))
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    count = 0
    for k in range(len(lasers)):
        count = _add_beams(beams, count, returns[ends[k] : ends[k + 1]], lasers[k])
    for b in range(count):
        for axis in range(4):
            low[axis % 2] = min(low[axis % 2], beams[b, axis])
            high[axis % 2] = max(high[axis % 2], beams[b, axis])
    return beams[:count], low, high


@kernel
def _add_beams(beams: Floats, count: int, returns: Floats, laser: Floats) -> int:
    """Append start x, y, end x, y of returns (K, 2) and the length over which they clear cells [m].

    Returns the number of beams so far.
    """
    gap_before = np.inf
    for i in range(len(returns)):
        gap_after = _gap(returns, i) if i + 1 < len(returns) else np.inf
        x, y = returns[i, 0] - laser[0], returns[i, 1] - laser[1]
        length = math.hypot(x, y)
        if length < MAX_RANGE_M:
            sine = 1.0
            if len(returns) > 1:
                side = i if gap_after <= gap_before else i - 1
                across = x * (returns[side + 1, 1] - returns[side, 1])
                across -= y * (returns[side + 1, 0] - returns[side, 0])
                sine = abs(across) / (length * min(gap_after, gap_before) + 1e-9)
            beams[count, 0], beams[count, 1] = laser[0], laser[1]
            beams[count, 2], beams[count, 3] = returns[i, 0], returns[i, 1]
            hidden = TOLERANCE_M / min(max(sine, _LEAST_SINE), 1.0)
            beams[count, 4] = length - max(CLEARANCE_M, hidden)
            count += 1
        gap_before = gap_after
    return count


@kernel
def _gap(returns: Floats, i: int) -> float:
    """Distance from one return of (K, 2) to the next [m]; above zero."""
    x, y = returns[i + 1, 0] - returns[i, 0], returns[i + 1, 1] - returns[i, 1]
    return math.hypot(x, y) + 1e-9
