# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Cell states of one visit (wall, free, unknown) from its beams, and the evidence of two."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from slarm_graph.geometry import Floats
from slarm_graph.kernels import kernel

UNKNOWN, FREE, BLOCKED = 0, 1, 2
"""States of a cell: unknown; passed by beams; something stands there or within tolerance."""

CELL_M = 0.1
"""Side of a cell [m]: a beam's footprint at 5 to 10 m for the usual 0.5 to 1 degree a beam."""

CLEARANCE_M = 0.4
"""A beam clears cells up to this short of its return [m], or more at a grazing angle, so that it
stays `TOLERANCE_M` off the surface. Half of it lets 3 cm of noise count as free; twice hides what
stands before a wall."""

TOLERANCE_M = 0.25
"""A wall is confirmed by a return as near as this [m]: both sides of a partition of 15 cm, with
10 cm of noise and pose error. Smaller errors of a pose are not detected; lost means 0.5 m."""

MIN_BEAMS = 3
"""Least beams of a wall or a free cell: one or two are noise, a passer-by, an edge."""

BLOCKED_SHARE = 0.2
"""Share of beams ending in a cell from which it is no longer free (chairs, edges). Stray
returns, spread evenly over a beam of 5 m, reach 0.02 a cell even when every beam strays."""

MIN_PASSED_AROUND = 6
"""Of a free cell and its eight neighbours more than these are passed by a beam: beams along a
straight surface that cut its cells pass six."""

RIGHT_CONFLICT_RATE, WRONG_CONFLICT_RATE = 0.03, 0.5
"""Share of wall cells in conflict between visits at right poses (people, doors, glass, noise;
measured: 0.001 to 0.016 over whole recordings) and at wrong ones (measured: 0.35 to 1)."""

CELLS_PER_OBSERVATION = 10.0
"""Correlated cells, as one door or one cupboard has so many: a metre of wall is one observation.
Halving it doubles all evidence."""

_NEAR_CELLS = math.ceil(TOLERANCE_M / CELL_M)


@kernel
def count_beams(
    hits: NDArray[np.int16], passes: NDArray[np.int16], low: Floats, beams: Floats
) -> None:
    """Count in each cell the beams that end there (hits), and those that pass.

    Parameters
    ----------
    hits, passes : (rows, cols) int16, row = y
        Grow in place, up to what they can hold.
    low : (2,) float64
        x, y of the first cell's corner [m]; every beam lies inside.
    beams : (M, 5) float64
        Start x, y, end x, y of returns and the length over which they clear cells [m].
    """
    top = np.iinfo(np.int16).max
    for b in range(len(beams)):
        u, v = (beams[b, 2] - low[0]) / CELL_M, (beams[b, 3] - low[1]) / CELL_M
        if hits[int(v), int(u)] < top:
            hits[int(v), int(u)] += 1
    count_passes(passes, low, beams)


@kernel
def count_passes(passes: NDArray[np.int16], low: Floats, beams: Floats) -> None:
    """Count in each cell (rows, cols) the beams (M, 5) that pass, as `count_beams` does."""
    top = np.iinfo(np.int16).max
    for b in range(len(beams)):
        if beams[b, 4] <= 0.0:
            continue
        x, y = (beams[b, 0] - low[0]) / CELL_M, (beams[b, 1] - low[1]) / CELL_M
        u, v = (beams[b, 2] - low[0]) / CELL_M, (beams[b, 3] - low[1]) / CELL_M
        length = math.hypot(u - x, v - y)
        # One sample per column or row, whichever are more.
        longer = max(abs(u - x), abs(v - y))
        du, dv = (u - x) / longer, (v - y) / longer
        for _ in range(int(longer * beams[b, 4] / (CELL_M * length)) + 1):
            if passes[int(y), int(x)] < top:
                passes[int(y), int(x)] += 1
            x += du
            y += dv


@kernel
def classify_cells(
    hits: NDArray[np.int16], passes: NDArray[np.int16], unreturned: NDArray[np.int16]
) -> tuple[NDArray[np.uint8], NDArray[np.int32]]:
    """Classify cells by counts: states (rows, cols), and row, col (W, 2) of wall cells.

    A wall is a cell where no fewer beams end than pass; free is one that beams pass, unless
    something stands within `TOLERANCE_M`. Beams that do not return (`unreturned`) pass, too: who
    walks where they meet nothing leaves no wall. But no cell is free by them alone: glass and
    black walls send nothing back.
    """
    rows, cols = hits.shape
    states = np.zeros((rows, cols), dtype=np.uint8)
    walls = np.empty((rows * cols, 2), dtype=np.int32)
    count = 0
    for r in range(rows):
        for c in range(cols):
            h, p = hits[r, c], passes[r, c]
            if p >= MIN_BEAMS and states[r, c] == UNKNOWN and _is_passed_around(passes, r, c):
                states[r, c] = FREE
            if h == 0 or h < BLOCKED_SHARE * (h + p):
                continue
            _block_within_tolerance(states, r, c)
            if h >= MIN_BEAMS and h >= p + unreturned[r, c]:
                walls[count, 0] = r
                walls[count, 1] = c
                count += 1
    return states, walls[:count].copy()


@kernel
def _is_passed_around(passes: NDArray[np.int16], row: int, col: int) -> bool:
    """Whether beams pass a cell on all sides, not only along a surface."""
    rows, cols = passes.shape
    if row == 0 or col == 0 or row == rows - 1 or col == cols - 1:
        return False
    around = 0
    for i in range(row - 1, row + 2):
        for j in range(col - 1, col + 2):
            around += passes[i, j] > 0
    return around > MIN_PASSED_AROUND


@kernel
def _block_within_tolerance(states: NDArray[np.uint8], row: int, col: int) -> None:
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
def count_agreement(
    walls: Floats, b_from_a: Floats, states: NDArray[np.uint8], low: Floats
) -> tuple[int, int]:
    """Count the wall cells of a visit that another one confirms, and those that it contradicts.

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
    """Log-likelihood ratio [nat] of a wrong relative pose over a right one, of any shape.

    Conflicts are binomial with rates `WRONG_CONFLICT_RATE` and `RIGHT_CONFLICT_RATE`, of one
    observation per `CELLS_PER_OBSERVATION` cells.
    """
    per_conflict = math.log(WRONG_CONFLICT_RATE / RIGHT_CONFLICT_RATE) / CELLS_PER_OBSERVATION
    per_match = (
        math.log((1.0 - WRONG_CONFLICT_RATE) / (1.0 - RIGHT_CONFLICT_RATE)) / CELLS_PER_OBSERVATION
    )
    return per_conflict * np.asarray(contradicted) + per_match * np.asarray(confirmed)
