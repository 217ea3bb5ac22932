# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Scan-to-map match on the likelihood grid: pose, corrected information and fit.

In one compiled call, since each call costs some microseconds to begin.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slarm_graph.frontends.scans.gauss_newton import refine
from slarm_graph.frontends.scans.likelihood_grid import Lattice
from slarm_graph.frontends.scans.match_information import discounted_information
from slarm_graph.frontends.scans.odometry_filter import MotionMixture
from slarm_graph.frontends.scans.scan_fit import agreement_at
from slarm_graph.frontends.scans.small_matrix import invert3, scaled3
from slarm_graph.frontends.scans.small_pose import moved
from slarm_graph.frontends.scans.wall_tangents import wall_tangents
from slarm_graph.geometry import Floats
from slarm_graph.kernels import kernel


@kernel
def match_on_grid(
    lattice: Lattice,
    observed: NDArray[np.bool_],
    observed_step: int,
    met: NDArray[np.int32],
    points: Floats,
    mixture: MotionMixture,
    motion: Floats,
    covariance: Floats,
    start: Floats,
    point_information: float,
    effective_share: float,
    neutral: float,
    max_iterations: int,
) -> tuple[Floats, Floats, float, int, int, float]:
    """Refine a scan on the local map; return pose, the match's own information and fit.

    Parameters
    ----------
    lattice : Lattice
    observed, observed_step : (rows, cols) bool, int
        Known space, in blocks of so many cells.
    met : (rows, cols) int32
        Keyframes that have met something in each block.
    points : (K, 2) float64
        In the robot's frame and in beam order [m].
    mixture : MotionMixture
        All predictions.
    motion, covariance : (3,), (3, 3) float64
        The prediction that is the prior [m, m, rad].
    start : (3,) float64
        Initial guess; empty for the predicted pose.
    point_information : float
        As of `refine`.
    effective_share : float
        Factor in `point_information` for correlated points, undone in the information.
    neutral : float
        Fit of a return in unknown space.
    max_iterations : int

    Returns
    -------
    pose : (3,), information : (3, 3) without the prior, score, inliers, iterations,
    agreement : sum of the likelihood of the points
    """
    prior = moved(mixture.base, motion)
    tangents = wall_tangents(points)
    pose, weighted, score, inliers, iterations = refine(
        lattice,
        points,
        tangents,
        start if len(start) else prior,
        prior,
        invert3(covariance),
        point_information,
        max_iterations,
    )
    unweighted = scaled3(weighted, 1.0 / effective_share)
    information = discounted_information(
        unweighted, lattice, met, observed_step, points, tangents, pose, mixture
    )
    agreement = agreement_at(lattice, observed, observed_step, points, pose, neutral)
    return pose, information, score, inliers, iterations, agreement
