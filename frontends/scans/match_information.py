# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Information of a match about the pose, corrected for what Gauss-Newton overestimates.

The sum of squared slopes, which Gauss-Newton takes for the curvature, is too large in three cases.
In a degenerate geometry, such as a bare corridor, rough walls have slopes of both signs: their
squares add up, though the likelihood is the same a step further on. Where a crowd occludes the
walls, points are matched to false counterparts. And where one small object alone constrains the
motion along an axis, it may be somebody walking ahead.
"""

from __future__ import annotations

import math

import numpy as np

from slarm_graph.frontends.scans.gauss_newton import slope
from slarm_graph.frontends.scans.likelihood_grid import Lattice, likelihoods
from slarm_graph.frontends.scans.odometry_filter import MotionMixture
from slarm_graph.frontends.scans.significance import SIGMAS_1_PERCENT
from slarm_graph.frontends.scans.small_matrix import eigen2, fma, sandwich3
from slarm_graph.frontends.scans.small_objects import (
    DYNAMIC_SHARE,
    DYNAMIC_STEP_M,
    SMALL_M,
    distance_m,
    gap_per_range,
    is_breakpoint,
)
from slarm_graph.frontends.scans.small_pose import between3, compose3
from slarm_graph.geometry import Floats
from slarm_graph.kernels import kernel

_DROP_STEP_M = 0.1
"""Step at which the drop of the likelihood is measured: twice the fall-off at a wall, beyond its
roughness. Half of it makes intel.bag 6 % better and fr079 the same."""
_SIGMAS_OF_STRONGEST = 3.72
"""Standard deviations that the largest of a hundred numbers exceeds one time in a hundred."""
_LEAST = 1e-3
"""Lower bound of the share of information kept: 30 times the standard deviation."""
_MISFIT = 10.0
"""Log of the variance per share that is missing of the mean fit. Where odometry is good, matches of
scans that fit 0.95, 0.75, 0.55 and 0.4 of the mean differ from it by 5, 19, 32 and 96 mm beyond
its own noise (fr-clinic) and by 3, 6, 12 and 45 mm (intel with people): 5 in the log of the noise
per whole, with tails that are wider. Half of it makes intel.bag 11 % better and fr-clinic with a
view of 90 degrees lose its way (4.1 m instead of 0.37)."""


@kernel
def discounted_information(
    information: Floats,
    lattice: Lattice,
    points: Floats,
    tangents: Floats,
    pose: Floats,
    mixture: MotionMixture,
) -> Floats:
    """Discount the information of a match along its weakest (most degenerate) axis.

    The information there is bounded by the measured drop of the likelihood, calibrated by drop and
    information along the strongest axis. The part of one small object is discounted by the
    probability that it has moved, which grows with its distance from the predicted pose.

    Parameters
    ----------
    information : (3, 3) float64
        Of a match by Gauss-Newton, in the body frame.
    lattice : Lattice
    points, tangents : (K, 2) float64
        In the robot's frame [m], and unit vectors along straight walls there, zero elsewhere.
    pose : (3,) float64
        Of the match on the grid [m, m, rad].
    mixture : MotionMixture
        Prior of the motion.

    Returns
    -------
    (3, 3) float64
    """
    eigenvalues, axes = eigen2(information)
    if eigenvalues[0] <= 0.0:
        return information
    values, segment, segment_share = _dominant_object(lattice, points, tangents, pose, axes[:, 0])
    others = (1.0 - segment_share) * eigenvalues[0]
    weak_drop, noise, segment_drop = _likelihood_drop(
        values, lattice, points, segment, pose, axes[:, 0]
    )
    strong_drop, _, _ = _likelihood_drop(values, lattice, points, segment, pose, axes[:, 1])
    count = segment[1] - segment[0]
    if strong_drop > 0.0:
        significant_drop = (
            weak_drop
            if weak_drop > SIGMAS_1_PERCENT * noise / math.sqrt(max(len(points) - count, 1))
            else 0.0
        )
        others = min(others, significant_drop / strong_drop * eigenvalues[1])
    if segment_share > 0.0 and segment_drop <= _SIGMAS_OF_STRONGEST * noise / math.sqrt(count):
        segment_share = 0.0
    variance = 1.0 / max(others + segment_share * eigenvalues[0], _LEAST * eigenvalues[0])
    # Everything else bounds how far a moved object can drag the match.
    moved_variance = 1.0 / max(others, 1.0 / DYNAMIC_STEP_M**2) if segment_share > 0.0 else 0.0
    variance += moved_variance * _moved_probability(
        axes[:, 0], variance, moved_variance, pose, mixture
    )
    share = min(1.0, max(_LEAST, 1.0 / (variance * eigenvalues[0])))
    scaling = np.zeros((3, 3))
    scaling[2, 2] = 1.0
    for row in range(2):
        for col in range(2):
            along = axes[row, 0] * math.sqrt(share) * axes[col, 0]
            scaling[row, col] = fma(axes[row, 1], axes[col, 1], along)
    return sandwich3(scaling, information)


def misfit_discount(share: float, per_whole: float = _MISFIT) -> float:
    """Return the factor on the information of a match by its fit, as a share of the mean fit.

    Parameters
    ----------
    share : float
    per_whole : float
        Log of the variance per missing share; by default that of a scan.
    """
    return math.exp(-per_whole * max(0.0, 1.0 - share))


@kernel
def _moved_probability(
    axis: Floats, variance: float, moved_variance: float, pose: Floats, mixture: MotionMixture
) -> float:
    """Probability that an object has moved, by the residual of its match to the predictions.

    Parameters
    ----------
    axis : (2,) float64
        That it constrains, in the body frame.
    variance, moved_variance : float
        Of the match along the axis if it is static, and what moving adds [m^2].
    pose : (3,) float64
        Of the match.
    mixture : MotionMixture
    """
    covariances, probabilities = mixture.covariances, mixture.probabilities
    motion = between3(mixture.base, pose)
    static = moved = 0.0
    for k in range(len(probabilities)):
        residual = motion - mixture.motions[k]
        residual2 = (axis[0] * residual[0] + axis[1] * residual[1]) ** 2
        innovation = variance
        for r in range(2):
            for c in range(2):
                innovation += axis[r] * covariances[k, r, c] * axis[c]
        static += (1.0 - DYNAMIC_SHARE) * probabilities[k] * _density(residual2, innovation)
        moved += DYNAMIC_SHARE * probabilities[k] * _density(residual2, innovation + moved_variance)
    return moved / max(static + moved, 1e-300)


@kernel
def _density(squared: float, variance: float) -> float:
    """Normal density of a squared deviation, up to a constant."""
    return math.exp(-0.5 * squared / variance) / math.sqrt(variance)


@kernel
def _likelihood_drop(
    values: Floats,
    lattice: Lattice,
    points: Floats,
    segment: tuple[int, int],
    pose: Floats,
    axis: Floats,
) -> tuple[float, float, float]:
    """Drop of the mean likelihood along an axis, to the side where it is smaller.

    Returns
    -------
    drop, noise : float
        Drop of the points outside the segment, and the noise of one of them, by those that fit
        better there: where the likelihood is flat, as many fit worse.
    segment_drop : float
        Drop of the segment's points; either is 0 where there are none.
    """
    segment_size = segment[1] - segment[0]
    other_count = len(points) - segment_size
    drop, noise = np.inf if other_count else 0.0, 0.0
    segment_drop = np.inf if segment_size else 0.0
    for sign in (1.0, -1.0):
        shift = np.array([sign * _DROP_STEP_M * axis[0], sign * _DROP_STEP_M * axis[1], 0.0])
        there = likelihoods(lattice, points, compose3(pose, shift))
        total, squared_gains, segment_loss = 0.0, 0.0, 0.0
        for i in range(len(points)):
            loss = values[i] - there[i]
            if segment[0] <= i < segment[1]:
                segment_loss += loss
            else:
                total += loss
                squared_gains += min(loss, 0.0) ** 2
        if other_count and total / other_count < drop:
            drop = total / other_count
            noise = math.sqrt(2.0 * squared_gains / other_count)
        if segment_size:
            segment_drop = min(segment_drop, segment_loss / segment_size)
    return drop, noise, segment_drop


@kernel
def _dominant_object(
    lattice: Lattice, points: Floats, tangents: Floats, pose: Floats, axis: Floats
) -> tuple[Floats, tuple[int, int], float]:
    """Find the small object with the most information along an axis (2,) of the body frame.

    Only returns with information on that axis are segmented: somebody beside a wall is connected to
    it, but the wall has none along itself.

    Returns
    -------
    likelihoods : (K,) float64
        Of all points.
    segment : tuple of int
        Its first point, and the one after its last.
    share : float
        Of the information along the axis.
    """
    values, squared_slopes = np.empty(len(points)), np.empty(len(points))
    c, s = math.cos(pose[2]), math.sin(pose[2])
    total = 0.0
    for i in range(len(points)):
        jx, jy, values[i], weight = slope(lattice, points, tangents, i, pose, c, s)
        squared_slopes[i] = weight * (jx * axis[0] + jy * axis[1]) ** 2
        total += squared_slopes[i]
    gap_ratio = gap_per_range(points)
    if math.isinf(gap_ratio):
        return values, (0, 0), 0.0
    largest, segment, first, last, strength, width_m = 0.0, (0, 0), -1, -1, 0.0, 0.0
    for i in range(len(points) + 1):
        is_end = i == len(points)
        if not is_end and squared_slopes[i] * len(points) <= total:
            continue
        if first >= 0 and (is_end or is_breakpoint(points, last, i, gap_ratio)):
            if strength > largest and width_m < SMALL_M:
                largest, segment = strength, (first, last + 1)
            first = -1
        if first < 0:
            first, strength, width_m = i, 0.0, 0.0
        if not is_end:
            last, strength, width_m = (
                i,
                strength + squared_slopes[i],
                max(width_m, distance_m(points, first, i)),
            )
    return values, segment, largest / max(total, 1e-12)
