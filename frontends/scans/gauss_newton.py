# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Gauss-Newton refinement of a scan on a smooth likelihood grid, with a prior on the pose.

With likelihood L = exp(-d^2 / 2 sigma^2) of the distance d to what the map holds, 1 - L is
Welsch's robust cost of d / sigma: near points count as in point-to-line ICP, far ones not at all.

Where the scan shows a straight wall only the gradient's component across it is used: along a wall
the pose is unobservable, and the end of an old view of it is no feature.

The Hessian is approximated in two ways. At first by the residual sqrt(2 (1 - L)), which makes long
steps. For the final steps and for the covariance as L / sigma^2 across the wall, whose direction
the gradient shows: valid also on the ridge itself, where the first one vanishes.
"""

from __future__ import annotations

import math
from typing import cast

import numpy as np

from slarm_graph.frontends.scans.likelihood_grid import Lattice, LikelihoodGrid, interpolate
from slarm_graph.frontends.scans.small_matrix import add_square3, invert3, matvec3, mirror3, scaled3
from slarm_graph.frontends.scans.wall_tangents import wall_tangents
from slarm_graph.geometry import Floats
from slarm_graph.kernels import kernel, kernel_with

_FLOOR = 0.02
"""Floor of the squared residual 2 (1 - L) in sigmas: nearer than a seventh of a sigma, where the
likelihood is flat to a hundredth, the weight grows no further."""
_FLAT = 0.03
"""Gradient, times sigma, below which it is noise: along a wall the grid's rounding is as steep."""
_LONG_STEPS = 6
"""Largest number of long steps (first Hessian): six of three cells reach a metre."""
_LONG, _SHORT = cast(bool, np.True_), cast(bool, np.False_)
"""Values of `long_steps` as variables: for a literal numba compiles a kernel anew."""
_NEAR_SIGMAS, _NEAR_RAD = 0.2, 0.01
"""Steps below which the second Hessian takes over: a fifth of the fall-off, and what moves a return
5 m away by a cell of 0.05 m."""
_LONGEST_CELLS, _LONGEST_RAD = 3.0, 0.1
"""Longest step: three cells, the basin of convergence to either side, and as much 1.5 m away."""
_CONVERGED_M, _CONVERGED_RAD = 2e-4, 1e-4
"""A hundredth of the noise of a return, 0.02 m, and what moves one 20 m away by a tenth of it."""


def refine_near(
    grid: LikelihoodGrid,
    points: Floats,
    start: Floats,
    prior_information: Floats,
    point_information: float,
    max_iterations: int,
) -> tuple[Floats, Floats, float, int, int]:
    """Align points with a grid from a pose (3,) that is also the prior, of an information (3, 3).

    Returns
    -------
    tuple
        As of `refine`.
    """
    points = np.ascontiguousarray(points, dtype=np.float64)
    pose, information, score, inliers, iterations = refine(
        grid.lattice,
        points,
        wall_tangents(points),
        start,
        start,
        prior_information,
        point_information,
        max_iterations,
    )
    return pose, information, float(score), inliers, iterations


@kernel
def refine(
    lattice: Lattice,
    points: Floats,
    tangents: Floats,
    start: Floats,
    prior: Floats,
    prior_information: Floats,
    point_information: float,
    max_iterations: int,
) -> tuple[Floats, Floats, float, int, int]:
    """Align points (K, 2), in the robot's frame and in beam order, with the grid.

    Parameters
    ----------
    lattice : Lattice
    tangents : (K, 2) float64
        Unit vectors along straight walls at the points, zero elsewhere.
    start, prior : (3,) float64
        Initial and expected `grid_from_robot` [m, m, rad].
    prior_information : (3, 3) float64
        Inverse covariance of the prior in its own body frame.
    point_information : float
        Weight that turns the robust costs into negative log likelihoods: the ratio of the grid's
        `sigma` squared to a return's variance.

    Returns
    -------
    pose : (3,), data_information : (3, 3) in the body frame, score : mean likelihood 0 to 1,
    inliers : points with likelihood above a half, iterations : int
    """
    pose = start.copy()
    iterations = 0
    long_steps = _LONG
    for iteration in range(max_iterations):
        iterations = iteration + 1
        h, g, _, _ = _normal_equations(lattice, points, tangents, pose, long_steps)
        a, b = scaled3(h, point_information), np.empty(3)
        for k in range(3):
            b[k] = g[k] * point_information
        _add_prior(a, b, pose, prior, prior_information)
        for k in range(3):
            a[k, k] += 1e-6 * a[k, k] + 1e-9
        step = matvec3(invert3(a), b)
        length = math.hypot(step[0], step[1])
        longest = _LONGEST_CELLS * lattice.resolution
        share = min(1.0, longest / max(length, 1e-12), _LONGEST_RAD / max(abs(step[2]), 1e-12))
        for k in range(3):
            step[k] *= share
        c, s = math.cos(pose[2]), math.sin(pose[2])
        pose[0] += c * step[0] - s * step[1]
        pose[1] += s * step[0] + c * step[1]
        pose[2] += step[2]
        if long_steps:
            is_near = length < _NEAR_SIGMAS * lattice.sigma and abs(step[2]) < _NEAR_RAD
            long_steps = not is_near and iterations < _LONG_STEPS
        elif abs(step[2]) < _CONVERGED_RAD and length < _CONVERGED_M:
            break
    h, _, score, inliers = _normal_equations(lattice, points, tangents, pose, _SHORT)
    return pose, scaled3(h, point_information), score, inliers, iterations


@kernel
def _normal_equations(
    lattice: Lattice, points: Floats, tangents: Floats, pose: Floats, long_steps: bool
) -> tuple[Floats, Floats, float, int]:
    """Body-frame Hessian (3, 3), descent direction (3,), score and inliers."""
    h, g = np.zeros((3, 3)), np.zeros(3)
    c, s = math.cos(pose[2]), math.sin(pose[2])
    total, inliers = 0.0, 0
    for i in range(len(points)):
        jx, jy, value, weight = slope(lattice, points, tangents, i, pose, c, s)
        if value <= 0.0:
            continue
        total += value
        if value > 0.5:
            inliers += 1
        jt = points[i, 0] * jy - points[i, 1] * jx
        if long_steps:
            weight = 1.0 / (2.0 * max(1.0 - value, 0.0) + _FLOOR)
        g[0] += jx
        g[1] += jy
        g[2] += jt
        add_square3(h, jx, jy, jt, weight)
    mirror3(h)
    return h, g, total / max(len(points), 1), inliers


@kernel_with(inline=True)
def slope(
    lattice: Lattice, points: Floats, tangents: Floats, i: int, pose: Floats, c: float, s: float
) -> tuple[float, float, float, float]:
    """Gradient of the likelihood at a point, across its wall, and its weight in the Hessian.

    Parameters
    ----------
    lattice : Lattice
    points, tangents : (K, 2) float64
    i : int
        Which of them.
    pose : (3,) float64
    c, s : float
        Cosine and sine of its heading.

    Returns
    -------
    slope_x, slope_y : float
        In the body frame [1/m].
    value : float
        Likelihood, 0 to 1.
    weight : float
        Of the squared slope in the information.
    """
    px, py = points[i, 0], points[i, 1]
    x = pose[0] + c * px - s * py
    y = pose[1] + s * px + c * py
    value, gx, gy = interpolate(lattice, x, y)
    jx = c * gx + s * gy
    jy = -s * gx + c * gy
    along = jx * tangents[i, 0] + jy * tangents[i, 1]
    precision = 1.0 / (lattice.sigma * lattice.sigma)
    weight = max(value, 0.0) * precision / (gx * gx + gy * gy + _FLAT * _FLAT * precision)
    return jx - along * tangents[i, 0], jy - along * tangents[i, 1], value, weight


@kernel
def _add_prior(a: Floats, b: Floats, pose: Floats, prior: Floats, information: Floats) -> None:
    """Add the prior to the normal equations, linearised at the pose."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    dx, dy = prior[0] - pose[0], prior[1] - pose[1]
    turn = prior[2] - pose[2]
    turn -= 2.0 * math.pi * math.floor((turn + math.pi) / (2.0 * math.pi))
    residual = np.array([c * dx + s * dy, -s * dx + c * dy, turn])
    for r in range(3):
        for k in range(3):
            a[r, k] += information[r, k]
            b[r] += information[r, k] * residual[k]
