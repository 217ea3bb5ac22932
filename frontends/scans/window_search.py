# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Searching the window that a prediction allows for the pose where a scan fits best."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from slarm_graph.frontends.scans.correlative import search
from slarm_graph.frontends.scans.likelihood_grid import LikelihoodGrid
from slarm_graph.frontends.scans.odometry_filter import Prediction
from slarm_graph.frontends.scans.quantiles import quantile
from slarm_graph.frontends.scans.search_pyramid import SearchPyramid
from slarm_graph.frontends.scans.search_window import search_every_pose, window_of
from slarm_graph.frontends.scans.small_pose import compose3
from slarm_graph.geometry import Floats, Pose2
from slarm_graph.kernels import kernel

_BRUTE_LOOKUPS = 4_000_000
"""Up to so many, trying every pose is faster than preparing a pyramid (5 ms)."""
_LEAST_WINDOW = (0.3, 0.2)
"""Of a scan that fits worse than usual [m, rad]."""
_MOST = 0.75
"""Share of the returns that is most of them."""
LOST_REACH_M = 3.0
"""Window of a lost scan: what a robot drives in the seconds until it is noticed."""


@kernel
def far_m(points: Floats) -> float:
    """How far away most returns (K, 2) are at most, but not less than 1 m."""
    ranges = np.empty(len(points))
    for i in range(len(points)):
        ranges[i] = math.hypot(points[i, 0], points[i, 1])
    return max(quantile(ranges, _MOST), 1.0)


def best_in_window(
    points: Floats,
    grid: LikelihoodGrid,
    base: Floats,
    prediction: Prediction,
    levels: Callable[[], SearchPyramid],
    least: tuple[float, float] = _LEAST_WINDOW,
) -> Floats:
    """Best pose (3,) in a window of four sigmas around the prediction, within bounds."""
    far = far_m(np.ascontiguousarray(points))
    sigma = np.sqrt(np.diag(prediction.covariance))
    start = compose3(base, prediction.motion)
    reach_m = min(max(4.0 * float(sigma[:2].max()), least[0]), LOST_REACH_M)
    reach_rad = min(max(4.0 * float(sigma[2]), least[1]), math.pi)
    step_rad = grid.resolution_m / far
    center = Pose2.from_array(start)
    window = window_of(grid, points, center, step_rad, reach_m, reach_rad)
    if 8 * window.reach**2 * window.turns * len(points) > _BRUTE_LOOKUPS:
        hit = search(
            replace(levels(), max_radius_m=far),
            points,
            center,
            reach_m=reach_m,
            reach_rad=reach_rad,
        )
        return hit.grid_from_robot.as_array() if hit else start
    turn, col, row, _ = search_every_pose(grid.values, window)
    shift = np.array([col * grid.resolution_m, row * grid.resolution_m, turn * step_rad])
    return np.asarray(start + shift, dtype=np.float64)
