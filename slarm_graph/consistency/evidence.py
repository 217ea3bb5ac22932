# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""What one visit says of cells (wall, looked through, unknown), counted from its beams."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from slarm_graph.geometry import Floats
from slarm_graph.kernels import kernel

UNKNOWN, FREE, BLOCKED = 0, 1, 2
"""States of a cell: never judged; looked through; something stands there or within tolerance."""

CELL_M = 0.1
"""Side of a cell [m]: a beam's footprint at 5 to 10 m for the usual 0.5 to 1 degree a beam."""

BEYOND_M = 0.4
"""A beam looks through cells up to this short of its return [m], or farther where it meets a
surface at a flat angle, so that it passes the surface at `TOLERANCE_M`. Half of it lets 3 cm of
noise pass as sight; twice hides what stands before a wall."""

TOLERANCE_M = 0.25
"""A wall is confirmed by a return as near as this [m]: both sides of a partition of 15 cm, with
10 cm of noise and pose error. Smaller errors of a pose are not looked for; lost means 0.5 m."""

MIN_BEAMS = 3
"""Beams that a wall or a sight takes: one or two are noise, a passer-by, an edge."""

BLOCKED_SHARE = 0.2
"""Share of beams ending in a cell from which it stands in the way of sight (chairs, edges). Stray
returns, spread evenly over a beam of 5 m, reach 0.02 a cell even when every beam strays."""

SEEN_AROUND = 6
"""Of a free cell and its eight neighbours more are passed by a beam: beams along a straight
surface that cut its cells pass six."""

RIGHT_SHARE, WRONG_SHARE = 0.03, 0.5
"""Share of walls looked through between visits in the right place (people, doors, glass, noise;
measured: 0.001 to 0.016 over whole recordings) and in a wrong one (measured: 0.35 to 1)."""

CELLS_ALIKE = 10.0
"""Cells that say the same, because one door or one cupboard has so many: a metre of wall counts
as one observation. Halving it doubles all evidence."""

_NEAR_CELLS = math.ceil(TOLERANCE_M / CELL_M)


@kernel
def count_beams(
    hits: NDArray[np.int16], passes: NDArray[np.int16], low: Floats, beams: Floats
) -> None:
    """Count in each cell the beams that end there, and those that look through.

    Parameters
    ----------
    hits, passes : (rows, cols) int16, row = y
        Grow in place, up to what they can hold.
    low : (2,) float64
        x, y of the first cell's corner [m]; every beam lies inside.
    beams : (M, 5) float64
        Start x, y, end x, y of returns and the length over which they look through [m].
    """
    top = np.iinfo(np.int16).max
    for b in range(len(beams)):
        x, y = (beams[b, 0] - low[0]) / CELL_M, (beams[b, 1] - low[1]) / CELL_M
        u, v = (beams[b, 2] - low[0]) / CELL_M, (beams[b, 3] - low[1]) / CELL_M
        if hits[int(v), int(u)] < top:
            hits[int(v), int(u)] += 1
        length = math.hypot(u - x, v - y)
        if beams[b, 4] <= 0.0:
            continue
        # One sample per column or row, whichever are more.
        longer = max(abs(u - x), abs(v - y))
        du, dv = (u - x) / longer, (v - y) / longer
        for _ in range(int(longer * beams[b, 4] / (CELL_M * length)) + 1):
            if passes[int(y), int(x)] < top:
                passes[int(y), int(x)] += 1
            x += du
            y += dv


@kernel
def judge_cells(
    hits: NDArray[np.int16], passes: NDArray[np.int16]
) -> tuple[NDArray[np.uint8], NDArray[np.int32]]:
    """Turn counts into states (rows, cols) and the walls' cells (W, 2) row, col.

    A wall is a cell where beams end more often than they go on; free is what beams go through,
    unless something stands within `TOLERANCE_M`.
    """
    rows, cols = hits.shape
    states = np.zeros((rows, cols), dtype=np.uint8)
    walls = np.empty((rows * cols, 2), dtype=np.int32)
    count = 0
    for r in range(rows):
        for c in range(cols):
            h, p = hits[r, c], passes[r, c]
            if p >= MIN_BEAMS and states[r, c] == UNKNOWN and _seen_around(passes, r, c):
                states[r, c] = FREE
            if h == 0 or h < BLOCKED_SHARE * (h + p):
                continue
            _block_around(states, r, c)
            if h >= MIN_BEAMS and h >= p:
                walls[count, 0] = r
                walls[count, 1] = c
                count += 1
    return states, walls[:count].copy()


@kernel
def _seen_around(passes: NDArray[np.int16], row: int, col: int) -> bool:
    """Whether beams pass beside a cell on all sides, not along a surface on one."""
    rows, cols = passes.shape
    if row == 0 or col == 0 or row == rows - 1 or col == cols - 1:
        return False
    around = 0
    for i in range(row - 1, row + 2):
        for j in range(col - 1, col + 2):
            around += passes[i, j] > 0
    return around > SEEN_AROUND


@kernel
def _block_around(states: NDArray[np.uint8], row: int, col: int) -> None:
    rows, cols = states.shape
    reach2 = (TOLERANCE_M / CELL_M) ** 2
    for i in range(max(row - _NEAR_CELLS, 0), min(row + _NEAR_CELLS + 1, rows)):
        for j in range(max(col - _NEAR_CELLS, 0), min(col + _NEAR_CELLS + 1, cols)):
            if (i - row) ** 2 + (j - col) ** 2 <= reach2:
                states[i, j] = BLOCKED


@kernel
def state_at(states: NDArray[np.uint8], low: Floats, x: float, y: float) -> int:
    """State of the cell at x, y [m] of the states' frame; unknown outside."""
    u, v = (x - low[0]) / CELL_M, (y - low[1]) / CELL_M
    if u < 0.0 or v < 0.0 or v >= states.shape[0] or u >= states.shape[1]:
        return UNKNOWN
    return int(states[int(v), int(u)])


@kernel
def tally(
    walls: Floats, b_from_a: Floats, states: NDArray[np.uint8], low: Floats
) -> tuple[int, int]:
    """Count the walls of a visit that another one confirms, and those that it looks through.

    Parameters
    ----------
    walls : (W, 2) float64
        Of visit a, in its frame [m].
    b_from_a : (3,) float64
        Pose [m, m, rad].
    states : (rows, cols) uint8
        Of visit b's cells.
    low : (2,) float64
        Corner of its first cell, in its frame [m].

    Returns
    -------
    confirmed, contradicted : int
    """
    c, s = math.cos(b_from_a[2]), math.sin(b_from_a[2])
    confirmed, contradicted = 0, 0
    for w in range(len(walls)):
        x = b_from_a[0] + c * walls[w, 0] - s * walls[w, 1]
        y = b_from_a[1] + s * walls[w, 0] + c * walls[w, 1]
        state = state_at(states, low, x, y)
        if state == BLOCKED:
            confirmed += 1
        elif state == FREE:
            contradicted += 1
    return confirmed, contradicted


def wrong_place_evidence(confirmed: NDArray[np.int64], contradicted: NDArray[np.int64]) -> Floats:
    """Log-likelihood ratio [nat] of a wrong place over the right one, of any shape.

    Both are binomial, with `WRONG_SHARE` and `RIGHT_SHARE`, of observations that are
    `CELLS_ALIKE` cells each.
    """
    per_conflict = math.log(WRONG_SHARE / RIGHT_SHARE) / CELLS_ALIKE
    per_match = math.log((1.0 - WRONG_SHARE) / (1.0 - RIGHT_SHARE)) / CELLS_ALIKE
    return per_conflict * np.asarray(contradicted) + per_match * np.asarray(confirmed)
