# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Matching with a line search along the least certain axis, and its marginal information.

Refinement ends in the nearest local optimum with its curvature. Along a corridor one optimum
follows the other, by doors and noise: so the likelihood is evaluated along the least certain axis
as far as the match may be off, and its variance there is that of all that fits.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from slarm_graph.frontends.scans.gauss_newton import refine_near
from slarm_graph.frontends.scans.likelihood_grid import Lattice, LikelihoodGrid, likelihoods
from slarm_graph.geometry import Floats, compose
from slarm_graph.kernels import kernel


class LineSearchMatch(NamedTuple):
    """Pose of a scan on a grid, with local and marginal information.

    Parameters
    ----------
    pose : (3,) float64
        `grid_from_robot` [m, m, rad].
    score : float
        Mean likelihood of the points, 0 to 1.
    information : (3, 3) float64
        By the curvature at the optimum, in the pose's body frame.
    marginal_information : (3, 3) float64
        The same with the variance along the least certain axis taken over the line search.
    """

    pose: Floats
    score: float
    information: Floats
    marginal_information: Floats


def line_search_match(
    grid: LikelihoodGrid,
    points: Floats,
    start: Floats,
    prior_information: Floats,
    point_information: float,
    max_iterations: int,
    reach_m: float,
) -> LineSearchMatch:
    """Align points with a grid: refinement, then a line search along the least certain axis.

    Another optimum is accepted only if it is likelier by the log of the number of independent
    positions within reach, as the best of many fits better by chance.

    Parameters
    ----------
    grid : LikelihoodGrid
    points : (K, 2) float64
        In the robot's frame and in beam order [m].
    start : (3,) float64
        Initial guess and prior of `grid_from_robot`.
    prior_information : (3, 3) float64
        Of the prior, in its body frame.
    point_information : float
        Weight of a point's likelihood as a log likelihood.
    max_iterations : int
    reach_m : float
        Of the line search, to either side.
    """
    settings = prior_information, point_information, max_iterations
    points = np.ascontiguousarray(points, dtype=np.float64)
    steps_m = np.arange(-reach_m, reach_m + grid.resolution_m, grid.resolution_m)
    pose, information, score, *_ = refine_near(grid, points, start, *settings)
    axis, likelihood = _likelihoods_along_weakest(grid, points, pose, information, steps_m)
    best_m = float(steps_m[np.argmax(likelihood)])
    gain_nat = point_information * (likelihood.max() - score * len(points))
    if gain_nat > math.log(reach_m / grid.sigma_m):
        shifted = compose(pose, np.append(best_m * axis, 0.0))
        other, other_information, other_score, *_ = refine_near(grid, points, shifted, *settings)
        if other_score > score:
            pose, information, score = other, other_information, other_score
            axis, likelihood = _likelihoods_along_weakest(grid, points, pose, information, steps_m)
    weights = np.exp(point_information * (likelihood - likelihood.max()))
    variance = float(weights @ steps_m**2 / weights.sum())
    return LineSearchMatch(pose, score, information, _marginalised(information, axis, variance))


def _likelihoods_along_weakest(
    grid: LikelihoodGrid, points: Floats, pose: Floats, information: Floats, steps_m: Floats
) -> tuple[Floats, Floats]:
    """Return the least certain axis (2,) and the summed likelihoods (S,) of steps along it."""
    axis = np.ascontiguousarray(np.linalg.eigh(information[:2, :2])[1][:, 0])
    return axis, _likelihoods_along(grid.lattice, points, pose, axis, steps_m)


@kernel
def _likelihoods_along(
    lattice: Lattice, points: Floats, pose: Floats, axis: Floats, steps_m: Floats
) -> Floats:
    """Summed likelihood (S,) of points (K, 2) moved by steps along an axis (2,) (body frame)."""
    sums = np.empty(len(steps_m))
    c, s = np.cos(pose[2]), np.sin(pose[2])
    shifted = pose.copy()
    for k in range(len(steps_m)):
        shifted[0] = pose[0] + steps_m[k] * (c * axis[0] - s * axis[1])
        shifted[1] = pose[1] + steps_m[k] * (s * axis[0] + c * axis[1])
        sums[k] = likelihoods(lattice, points, shifted).sum()
    return sums


def _marginalised(information: Floats, axis: Floats, variance: float) -> Floats:
    """Reduce an information (3, 3) to a variance along an axis (2,), conditional on all else.

    By the Sherman-Morrison formula, which needs no invertible information.
    """
    row = information[:, :2] @ axis
    information_along = float(axis @ row[:2])
    added = variance - 1.0 / information_along if information_along > 0.0 else 0.0
    if added <= 0.0:
        return information
    return np.asarray(
        information - np.outer(row, row) * (added / (1.0 + added * information_along))
    )
