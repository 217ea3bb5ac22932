# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Point-to-line ICP: every return is pulled to the line through its nearest neighbours.

After Censi 2008, with a robust weight instead of trimming.
Scans have a few hundred returns, so the nearest neighbour is found by looking at all of them: at
this size that is faster than building a tree.
"""

from __future__ import annotations

import math

import numpy as np

from slarm_graph.frontends.scans.small_matrix import add_square3, invert3, mirror3
from slarm_graph.geometry import Floats
from slarm_graph.kernels import kernel

_NEIGHBOURS = 3
"""Returns to either side that a normal is taken from: seven of half a degree span 0.3 m at 5 m."""
_MIN_SCALE_M = 0.03
"""Least scale of the robust kernel: one and a half times a laser's noise of 0.02 m."""
_SHRINK = 0.7
"""Of the scale per iteration: from a metre to the least in ten."""
_CONVERGED_M, _CONVERGED_RAD = 1e-4, 1e-4
"""A two-hundredth of the noise of a return, and what moves one 20 m away by a tenth of it."""


@kernel
def line_normals(points: Floats, max_gap: float) -> Floats:
    """Unit normals (K, 2) of the lines through points (K, 2) and up to three beams either side.

    Zero where a point has no neighbour nearer than `max_gap` [m] along the beam order.
    """
    normals = np.zeros_like(points)
    for i in range(len(points)):
        low, high = i, i
        while low > 0 and i - low < _NEIGHBOURS and _gap(points, low - 1, low) < max_gap:
            low -= 1
        while (
            high + 1 < len(points)
            and high - i < _NEIGHBOURS
            and _gap(points, high, high + 1) < max_gap
        ):
            high += 1
        if high == low:
            continue
        mean_x, mean_y = 0.0, 0.0
        for k in range(low, high + 1):
            mean_x += points[k, 0] / (high + 1 - low)
            mean_y += points[k, 1] / (high + 1 - low)
        xx, xy, yy = 0.0, 0.0, 0.0
        for k in range(low, high + 1):
            dx, dy = points[k, 0] - mean_x, points[k, 1] - mean_y
            xx += dx * dx
            xy += dx * dy
            yy += dy * dy
        along = 0.5 * math.atan2(2.0 * xy, xx - yy)
        normals[i, 0] = -math.sin(along)
        normals[i, 1] = math.cos(along)
    return normals


@kernel
def align(
    source: Floats,
    target: Floats,
    normals: Floats,
    start: Floats,
    max_distance: float,
    point_sigma: float,
    max_iterations: int,
) -> tuple[Floats, Floats, float, int, int]:
    """Align points (K, 2) with points (M, 2) that have normals (M, 2), all [m].

    Pairs count by Welsch's robust weight, whose scale shrinks from `max_distance` to a few
    centimetres as the scans slide into place.

    Returns
    -------
    target_from_source : (3,), information : (3, 3) in the source's body frame,
    score : mean weight at the final scale, inliers : pairs of weight above a half, iterations
    """
    pose = start.copy()
    scale = max_distance
    iterations = 0
    for iteration in range(max_iterations):
        iterations = iteration + 1
        h, g, _, _ = _normal_equations(source, target, normals, pose, max_distance, scale)
        for k in range(3):
            h[k, k] += 1e-9 + 1e-9 * h[k, k]
        step = invert3(h) @ g
        c, s = math.cos(pose[2]), math.sin(pose[2])
        pose[0] += c * step[0] - s * step[1]
        pose[1] += s * step[0] + c * step[1]
        pose[2] += step[2]
        is_still = math.hypot(step[0], step[1]) < _CONVERGED_M and abs(step[2]) < _CONVERGED_RAD
        if is_still and scale <= _MIN_SCALE_M:
            break
        scale = max(_SHRINK * scale, _MIN_SCALE_M)
    h, _, score, inliers = _normal_equations(source, target, normals, pose, max_distance, scale)
    return pose, h / (point_sigma * point_sigma), score, inliers, iterations


@kernel
def _gap(points: Floats, i: int, j: int) -> float:
    return math.hypot(points[j, 0] - points[i, 0], points[j, 1] - points[i, 1])


@kernel
def _normal_equations(
    source: Floats,
    target: Floats,
    normals: Floats,
    pose: Floats,
    max_distance: float,
    scale: float,
) -> tuple[Floats, Floats, float, int]:
    """Body-frame Hessian (3, 3), descent direction (3,), score and inliers."""
    h, g = np.zeros((3, 3)), np.zeros(3)
    c, s = math.cos(pose[2]), math.sin(pose[2])
    total, inliers = 0.0, 0
    for i in range(len(source)):
        px, py = source[i, 0], source[i, 1]
        x = pose[0] + c * px - s * py
        y = pose[1] + s * px + c * py
        nearest, best = -1, max_distance * max_distance
        for k in range(len(target)):
            dx, dy = target[k, 0] - x, target[k, 1] - y
            d2 = dx * dx + dy * dy
            if d2 < best:
                nearest, best = k, d2
        if nearest < 0:
            continue
        nx, ny = normals[nearest, 0], normals[nearest, 1]
        if nx == 0.0 and ny == 0.0:
            continue
        residual = nx * (target[nearest, 0] - x) + ny * (target[nearest, 1] - y)
        weight = math.exp(-0.5 * residual * residual / (scale * scale))
        total += weight
        if weight > 0.5:
            inliers += 1
        jx = c * nx + s * ny
        jy = -s * nx + c * ny
        jt = px * jy - py * jx
        g[0] += weight * residual * jx
        g[1] += weight * residual * jy
        g[2] += weight * residual * jt
        add_square3(h, jx, jy, jt, weight)
    mirror3(h)
    return h, g, total / max(len(source), 1), inliers
