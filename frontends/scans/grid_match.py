# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""All that is found by laying one scan on the local map: pose, what it is worth, how well it fits.

In one compiled call, since each call costs some microseconds to begin.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slarm_graph.frontends.scans.fits import agreement_at
from slarm_graph.frontends.scans.gauss_newton import refine
from slarm_graph.frontends.scans.likelihood_grid import Lattice
from slarm_graph.frontends.scans.match_certainty import along_the_weakest
from slarm_graph.frontends.scans.odometry_filter import Expectation
from slarm_graph.frontends.scans.small_matrix import invert3, scaled3
from slarm_graph.frontends.scans.small_pose import moved
from slarm_graph.frontends.scans.wall_tangents import wall_tangents
from slarm_graph.geometry import Floats
from slarm_graph.kernels import kernel


@kernel
def match_on_grid(
    lattice: Lattice,
    seen: NDArray[np.bool_],
    seen_step: int,
    points: Floats,
    expected: Expectation,
    motion: Floats,
    covariance: Floats,
    start: Floats,
    point_information: float,
    evidence: float,
    neutral: float,
    max_iterations: int,
) -> tuple[Floats, Floats, float, int, int, float]:
    """Refine a scan on the local map, and tell what its points alone say of its pose.

    Parameters
    ----------
    lattice : Lattice
    seen, seen_step : (rows, cols) bool, int
        Blocks of so many cells that were looked at.
    points : (K, 2) float64
        In the robot's frame and in beam order [m].
    expected : Expectation
        By all predictions.
    motion, covariance : (3,), (3, 3) float64
        The prediction that is leant on [m, m, rad].
    start : (3,) float64
        Pose to begin at; empty for the predicted one.
    point_information : float
        As of `refine`.
    evidence : float
        Share of the scan's evidence that is in `point_information`.
    neutral : float
        What a return counts where nobody looked yet.
    max_iterations : int

    Returns
    -------
    pose : (3,), information : (3, 3) of the scan alone, score, inliers, iterations,
    agreement : sum of the agreement of the points
    """
    prior = moved(expected.base, motion)
    tangents = wall_tangents(points)
    pose, data, score, inliers, used = refine(
        lattice,
        points,
        tangents,
        start if len(start) else prior,
        prior,
        invert3(covariance),
        point_information,
        max_iterations,
    )
    told = scaled3(data, 1.0 / evidence)
    information = along_the_weakest(told, lattice, points, tangents, pose, expected)
    agreement = agreement_at(lattice, seen, seen_step, points, pose, neutral)
    return pose, information, score, inliers, used, agreement
