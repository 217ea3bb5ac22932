# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The search window of correlative matching, a lattice of poses, and its brute-force search."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from slarm_graph.frontends.scans.likelihood_grid import Grid, LikelihoodGrid
from slarm_graph.frontends.scans.search_pyramid import Bytes, SearchPyramid
from slarm_graph.geometry import Floats, Pose2
from slarm_graph.kernels import kernel


class Window(NamedTuple):
    """A search window: a lattice of angles and of whole-cell offsets.

    Parameters
    ----------
    center, points : (2,) and (K, 2) float64
        In cells: the window's middle from cell (0, 0), and the returns.
    heading, step : float
        Middle angle and angular step [rad].
    reach, turns : int
        Half the window in cells and in angular steps.
    """

    center: Floats
    points: Floats
    heading: float
    step: float
    reach: int
    turns: int


def window_of(
    grid: SearchPyramid | LikelihoodGrid,
    points: Floats,
    center: Pose2,
    step_rad: float,
    reach_m: float,
    reach_rad: float = math.pi,
) -> Window:
    """Lay a window over a grid, for points (K, 2) [m]; the rest as of `search`."""
    corner = [grid.origin_x_m, grid.origin_y_m]
    return Window(
        (np.array([center.x, center.y]) - corner) / grid.resolution_m,
        points / grid.resolution_m,
        center.theta,
        step_rad,
        math.ceil(reach_m / grid.resolution_m),
        math.ceil(min(reach_rad, math.pi) / step_rad),
    )


@kernel
def search_every_pose(values: Bytes | Grid, window: Window) -> tuple[int, int, int, float]:
    """Score every pose of a lattice: the oracle of `search`, and quick for small windows.

    Parameters
    ----------
    values : (rows, cols) uint8 or float32
        The pyramid's lowest level, or a likelihood grid as it is.
    window : Window

    Returns
    -------
    angle step, column offset, row offset, sum of values
    """
    center, points, heading, step, reach, turns = window
    rows, cols = values.shape
    width = 2 * reach + 1
    sums = np.empty((width, width), dtype=np.float32)
    best_k, best_i, best_j, best = 0, 0, 0, -1.0
    for k in range(-turns, turns + 1):
        c, s = math.cos(heading + k * step), math.sin(heading + k * step)
        sums[:] = 0.0
        for p in range(len(points)):
            col = math.floor(center[0] + 0.5 + c * points[p, 0] - s * points[p, 1]) - reach
            row = math.floor(center[1] + 0.5 + s * points[p, 0] + c * points[p, 1]) - reach
            low, high = max(0, -col), min(width, cols - col)
            if low >= high:
                continue
            for j in range(max(0, -row), min(width, rows - row)):
                # Slices tell the compiler that no index is negative, so it takes many at a time.
                line = values[row + j, col + low : col + high]
                out = sums[j, low:high]
                for i in range(len(line)):
                    out[i] += line[i]
        for j in range(width):
            for i in range(width):
                if sums[j, i] > best:
                    best_k, best_i, best_j, best = k, i - reach, j - reach, float(sums[j, i])
    return best_k, best_i, best_j, best
