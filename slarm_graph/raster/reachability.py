# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Which cells hang together when no step from centre to centre may cross a face."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from slarm_graph.geometry import Floats
from slarm_graph.grid import Mask


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True)
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
