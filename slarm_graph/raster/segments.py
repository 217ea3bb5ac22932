# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Which cells segments pass."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from slarm_graph.geometry import Floats
from slarm_graph.grid import Mask
from slarm_graph.kernels import kernel


def cells_passed(
    ends: Floats, shape: tuple[int, int], grown: float
) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """Find the cells whose square a segment has a point in common with.

    Parameters
    ----------
    ends : (S, 4) float64
        Start x, y and end x, y of every segment [cells]; a cell reaches from its row and column to
        the next.
    shape : (rows, cols)
    grown : float
        How much larger on every side squares are taken to be, or smaller where negative [cells].

    Returns
    -------
    segments : (M,) int32
        Which segment, in order.
    cells : (M,) int64
        Which cell, flat.
    """
    ends = np.ascontiguousarray(ends, dtype=np.float64)
    nothing = np.empty(0, dtype=np.int32), np.empty(0, dtype=np.int64)
    count = _pass(ends, shape, grown, *nothing)
    found = np.empty(count, dtype=np.int32), np.empty(count, dtype=np.int64)
    _pass(ends, shape, grown, *found)
    return found


@kernel
def _pass(
    ends: Floats,
    shape: tuple[int, int],
    grown: float,
    segments: NDArray[np.int32],
    cells: NDArray[np.int64],
) -> int:
    """Count the cells that segments pass, and write them where there is room."""
    count = 0
    for s in range(len(ends)):
        x, y = ends[s, 0], ends[s, 1]
        across, up = ends[s, 2] - x, ends[s, 3] - y
        first_col, last_col = _span(x, across, grown, shape[1])
        first_row, last_row = _span(y, up, grown, shape[0])
        for row in range(first_row, last_row + 1):
            for col in range(first_col, last_col + 1):
                if _meets_square(x - col + grown, y - row + grown, across, up, 1.0 + 2.0 * grown):
                    if len(cells):
                        segments[count] = s
                        cells[count] = row * shape[1] + col
                    count += 1
    return count


@kernel
def _span(start: float, step: float, grown: float, size: int) -> tuple[int, int]:
    """First and last row or column that a segment may pass."""
    reach = max(grown, 0.0)
    first = math.floor(min(start, start + step) - reach)
    last = math.floor(max(start, start + step) + reach)
    return max(0, first), min(size - 1, last)


@kernel
def _meets_square(x: float, y: float, across: float, up: float, side: float) -> bool:
    """Whether a segment enters the square from (0, 0) to (side, side) (Liang and Barsky 1984)."""
    enter, leave = 0.0, 1.0
    for axis in range(2):
        start, step = (x, across) if axis == 0 else (y, up)
        if abs(step) < 1e-15:
            if start < 0.0 or start > side:
                return False
            continue
        a, b = -start / step, (side - start) / step
        enter, leave = max(enter, min(a, b)), min(leave, max(a, b))
    return enter <= leave


@kernel
def cut_steps(faces: Floats, rows: int, cols: int) -> tuple[Mask, Mask]:
    """Steps to the right (rows, cols) and up (rows, cols) that cross a face.

    Faces (N, 4) are x, y and x, y in cells; centres are whole numbers.
    """
    cut = np.zeros((2, rows, cols), dtype=np.bool_)
    for f in range(len(faces)):
        for way in range(2):
            a0, b0, a1, b1 = faces[f, way], faces[f, 1 - way], faces[f, 2 + way], faces[f, 3 - way]
            low, high = min(b0, b1), max(b0, b1)
            for line in range(max(0, math.ceil(low)), min((rows, cols)[way], math.ceil(high))):
                step = math.floor(a0 + (line - b0) * (a1 - a0) / (b1 - b0))
                if 0 <= step < (cols, rows)[way] - 1:
                    row, col = (line, step) if way == 0 else (step, line)
                    cut[way, row, col] = True
    return cut[0], cut[1]


@kernel
def reached_cells(free: Mask, cut_right: Mask, cut_up: Mask, row: int, col: int) -> Mask:
    """Free cells (rows, cols) that steps over sides join to one, none of them cut."""
    reached = np.zeros(free.shape, dtype=np.bool_)
    reached[row, col] = True
    waiting = [(row, col)]
    while waiting:
        row, col = waiting.pop()
        for way in range(4):
            back = way % 2
            next_row = row + (0 if way < 2 else 1 - 2 * back)
            next_col = col + (1 - 2 * back if way < 2 else 0)
            if not (0 <= next_row < free.shape[0] and 0 <= next_col < free.shape[1]):
                continue
            cut = cut_right if way < 2 else cut_up
            if cut[min(row, next_row), min(col, next_col)]:
                continue
            if free[next_row, next_col] and not reached[next_row, next_col]:
                reached[next_row, next_col] = True
                waiting.append((next_row, next_col))
    return reached
