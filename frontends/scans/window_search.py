# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Correlative search of a scan in the window of a prediction's uncertainty."""

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
"""Cell look-ups up to which brute force is faster than building a pyramid (5 ms)."""
_MIN_WINDOW = (0.3, 0.2)
"""Least half window of a scan that fails the gate [m, rad]."""
_FAR_QUANTILE = 0.75
"""Quantile of the ranges that sets the angular step."""
LOST_REACH_M = 3.0
"""Half window of relocalisation: what a robot drives in the seconds until it is lost."""


@kernel
def far_range_m(points: Floats) -> float:
    """Upper quartile of the ranges of returns (K, 2), at least 1 m."""
    ranges = np.empty(len(points))
    for i in range(len(points)):
        ranges[i] = math.hypot(points[i, 0], points[i, 1])
    return max(quantile(ranges, _FAR_QUANTILE), 1.0)


def best_in_window(
    points: Floats,
    grid: LikelihoodGrid,
    base: Floats,
    prediction: Prediction,
    levels: Callable[[], SearchPyramid],
    min_window: tuple[float, float] = _MIN_WINDOW,
) -> Floats:
    """Best pose (3,) in a window of four sigmas around the prediction, within bounds."""
    range_m = far_range_m(np.ascontiguousarray(points))
    sigma = np.sqrt(np.diag(prediction.covariance))
    start = compose3(base, prediction.motion)
    reach_m = min(max(4.0 * float(sigma[:2].max()), min_window[0]), LOST_REACH_M)
    reach_rad = min(max(4.0 * float(sigma[2]), min_window[1]), math.pi)
    step_rad = grid.resolution_m / range_m
    center = Pose2.from_array(start)
    window = window_of(grid, points, center, step_rad, reach_m, reach_rad)
    if 8 * window.reach**2 * window.turns * len(points) > _BRUTE_LOOKUPS:
        hit = search(
            replace(levels(), max_radius_m=range_m),
            points,
            center,
            reach_m=reach_m,
            reach_rad=reach_rad,
        )
        return hit.grid_from_robot.as_array() if hit else start
    turn, col, row, _ = search_every_pose(grid.values, window)
    shift = np.array([col * grid.resolution_m, row * grid.resolution_m, turn * step_rad])
    return np.asarray(start + shift, dtype=np.float64)
