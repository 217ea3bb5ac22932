# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Correlative scan matching: the best pose in a whole window, wherever the guess was."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from slarm_graph.geometry import Floats


@njit(cache=True, nogil=True)
def search_window(
    values: NDArray[np.float32],
    origin_x: float,
    origin_y: float,
    resolution: float,
    points: Floats,
    center: Floats,
    reach_m: float,
    reach_rad: float,
    step_rad: float,
) -> tuple[Floats, float]:
    """Best `grid_from_robot` (3,) within a window around `center`, and its mean likelihood.

    Every offset of whole cells is tried at every angle: the brute-force form.
    """
    cells = math.ceil(reach_m / resolution)
    turns = math.ceil(reach_rad / step_rad)
    rows, cols = values.shape
    best, best_score = center.copy(), -1.0
    col_of = np.empty(len(points), dtype=np.int64)
    row_of = np.empty(len(points), dtype=np.int64)
    width = 2 * cells + 1
    sums = np.empty((width, width))
    for t in range(-turns, turns + 1):
        theta = center[2] + t * step_rad
        c, s = math.cos(theta), math.sin(theta)
        for i in range(len(points)):
            x = center[0] + c * points[i, 0] - s * points[i, 1]
            y = center[1] + s * points[i, 0] + c * points[i, 1]
            col_of[i] = math.floor((x - origin_x) / resolution + 0.5)
            row_of[i] = math.floor((y - origin_y) / resolution + 0.5)
        sums[:] = 0.0
        for i in range(len(points)):
            col_low = max(col_of[i] - cells, 0)
            col_high = min(col_of[i] + cells, cols - 1)
            for row in range(max(row_of[i] - cells, 0), min(row_of[i] + cells, rows - 1) + 1):
                out_row = row - row_of[i] + cells
                shift = cells - col_of[i]
                for col in range(col_low, col_high + 1):
                    sums[out_row, col + shift] += values[row, col]
        for a in range(width):
            for b in range(width):
                score = sums[a, b] / len(points)
                if score > best_score:
                    best_score = score
                    best[0] = center[0] + (b - cells) * resolution
                    best[1] = center[1] + (a - cells) * resolution
                    best[2] = theta
    return best, best_score
