# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Matching in an old place, and how far the match could slide along its walls.

Refinement ends in the nearest hollow, and its curvature tells how steep that is. Along a corridor
one hollow follows the other, as doors and noise have it: along the axis on which a match is least
sure it is looked for as far as it may be off, and is as sure as all that fits there leaves it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from slarm_graph.frontends.scans.gauss_newton import refine_near
from slarm_graph.frontends.scans.likelihood_grid import Lattice, LikelihoodGrid, likelihoods
from slarm_graph.geometry import Floats, compose
from slarm_graph.kernels import kernel


class SlidMatch(NamedTuple):
    """Where points lie on a grid, and how surely along its walls.

    Parameters
    ----------
    pose : (3,) float64
        `grid_from_robot` [m, m, rad].
    score : float
        Mean likelihood of the points, 0 to 1.
    information : (3, 3) float64
        By the curvature there, in the pose's body frame.
    over_reach : (3, 3) float64
        The same by all that fits within reach along the least certain axis.
    """

    pose: Floats
    score: float
    information: Floats
    over_reach: Floats


def aligned(
    grid: LikelihoodGrid,
    points: Floats,
    start: Floats,
    looseness: Floats,
    point_information: float,
    max_iterations: int,
    reach_m: float,
) -> SlidMatch:
    """Align points with a grid from a pose, along walls where they fit best within reach.

    Somewhere in reach chance fits better, too: as many places as there are, so much likelier the
    best one must be.

    Parameters
    ----------
    grid : LikelihoodGrid
    points : (K, 2) float64
        In the robot's frame and in beam order [m].
    start : (3,) float64
        `grid_from_robot`, right to within an information.
    looseness : (3, 3) float64
        That information.
    point_information : float
        Weight that makes of likelihoods honest log likelihoods.
    max_iterations : int
    reach_m : float
        To either side.
    """
    how = looseness, point_information, max_iterations
    points = np.ascontiguousarray(points, dtype=np.float64)
    steps_m = np.arange(-reach_m, reach_m + grid.resolution_m, grid.resolution_m)
    pose, information, score, *_ = refine_near(grid, points, start, *how)
    axis, fits = _along(grid, points, pose, information, steps_m)
    best_m = float(steps_m[np.argmax(fits)])
    gain_nat = point_information * (fits.max() - score * len(points))
    if gain_nat > math.log(reach_m / grid.sigma_m):
        moved = compose(pose, np.append(best_m * axis, 0.0))
        other, other_information, other_score, *_ = refine_near(grid, points, moved, *how)
        if other_score > score:
            pose, information, score = other, other_information, other_score
            axis, fits = _along(grid, points, pose, information, steps_m)
    shares = np.exp(point_information * (fits - fits.max()))
    variance = float(shares @ steps_m**2 / shares.sum())
    return SlidMatch(pose, score, information, _loosened(information, axis, variance))


def _along(
    grid: LikelihoodGrid, points: Floats, pose: Floats, information: Floats, steps_m: Floats
) -> tuple[Floats, Floats]:
    """Return the least certain axis (2,) and the summed likelihoods (S,) of steps along it."""
    axis = np.ascontiguousarray(np.linalg.eigh(information[:2, :2])[1][:, 0])
    return axis, _fits_along(grid.lattice, points, pose, axis, steps_m)


@kernel
def _fits_along(
    lattice: Lattice, points: Floats, pose: Floats, axis: Floats, steps_m: Floats
) -> Floats:
    """Sum (S,) the likelihoods of points (K, 2), moved along an axis (2,) of the body frame."""
    found = np.empty(len(steps_m))
    c, s = np.cos(pose[2]), np.sin(pose[2])
    moved = pose.copy()
    for k in range(len(steps_m)):
        moved[0] = pose[0] + steps_m[k] * (c * axis[0] - s * axis[1])
        moved[1] = pose[1] + steps_m[k] * (s * axis[0] + c * axis[1])
        found[k] = likelihoods(lattice, points, moved).sum()
    return found


def _loosened(information: Floats, axis: Floats, variance: float) -> Floats:
    """Information (3, 3) that leaves a variance along an axis (2,), all else being known.

    By Sherman and Morrison, so that nothing need be known of what there is no information on.
    """
    along = information[:, :2] @ axis
    known = float(axis @ along[:2])
    more = variance - 1.0 / known if known > 0.0 else 0.0
    if more <= 0.0:
        return information
    return np.asarray(information - np.outer(along, along) * (more / (1.0 + more * known)))
