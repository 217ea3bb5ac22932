# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Information of a match about the pose, corrected for what Gauss-Newton overestimates.

The sum of squared slopes, which Gauss-Newton takes for the curvature, is too large in three cases.
In a degenerate geometry, such as a bare corridor, rough walls have slopes of both signs: their
squares add up, though the likelihood is the same a step further on. Where a crowd occludes the
walls, points are matched to false counterparts. And where small objects alone constrain the
motion along an axis, they may be people walking ahead.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

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
_PROVEN_KEYFRAMES = 5
"""Keyframes that have met an object in the same block of 0.2 m, after which it stands: a metre
of way, in which people walk on by two beside a robot of 0.6 m/s. Half and twice as many leave halls
19, 103, 121 and ward 3 at 0.042 to 0.060 m, as 5 do; halls 46 and 115 are lost in one of four draws
either way."""
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
    met: NDArray[np.int32],
    block_cells: int,
    points: Floats,
    tangents: Floats,
    pose: Floats,
    mixture: MotionMixture,
) -> Floats:
    """Discount the information of a match along its weakest (most degenerate) axis.

    The information there is bounded by the measured drop of the likelihood, calibrated by drop and
    information along the strongest axis. The part of small objects that were not met for long is
    discounted by the probability that they have moved, all together as people in company do, which
    grows with their distance from the predicted pose.

    Parameters
    ----------
    information : (3, 3) float64
        Of a match by Gauss-Newton, in the body frame.
    lattice : Lattice
    met, block_cells : (rows, cols) int32, int
        Keyframes that have met something in each block of so many cells.
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
    values, unproven, unproven_share = _unproven_objects(
        lattice, met, block_cells, points, tangents, pose, axes[:, 0]
    )
    others = (1.0 - unproven_share) * eigenvalues[0]
    weak_drop, noise, unproven_drop = _likelihood_drop(
        values, lattice, points, unproven, pose, axes[:, 0]
    )
    strong_drop, _, _ = _likelihood_drop(values, lattice, points, unproven, pose, axes[:, 1])
    count = unproven.sum()
    if strong_drop > 0.0:
        significant_drop = (
            weak_drop
            if weak_drop > SIGMAS_1_PERCENT * noise / math.sqrt(max(len(points) - count, 1))
            else 0.0
        )
        others = min(others, significant_drop / strong_drop * eigenvalues[1])
    if unproven_share > 0.0 and unproven_drop <= _SIGMAS_OF_STRONGEST * noise / math.sqrt(count):
        unproven_share = 0.0
    variance = 1.0 / max(others + unproven_share * eigenvalues[0], _LEAST * eigenvalues[0])
    # Everything else bounds how far a moved object can drag the match.
    moved_variance = 1.0 / max(others, 1.0 / DYNAMIC_STEP_M**2) if unproven_share > 0.0 else 0.0
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
    unproven: NDArray[np.bool_],
    pose: Floats,
    axis: Floats,
) -> tuple[float, float, float]:
    """Drop of the mean likelihood along an axis, to the side where it is smaller.

    Returns
    -------
    drop, noise : float
        Drop of the other points, and the noise of one of them, by those that fit better there:
        where the likelihood is flat, as many fit worse.
    unproven_drop : float
        Drop of the unproven points; either is 0 where there are none.
    """
    unproven_count = unproven.sum()
    other_count = len(points) - unproven_count
    drop, noise = np.inf if other_count else 0.0, 0.0
    unproven_drop = np.inf if unproven_count else 0.0
    for sign in (1.0, -1.0):
        shift = np.array([sign * _DROP_STEP_M * axis[0], sign * _DROP_STEP_M * axis[1], 0.0])
        there = likelihoods(lattice, points, compose3(pose, shift))
        total, squared_gains, unproven_loss = 0.0, 0.0, 0.0
        for i in range(len(points)):
            loss = values[i] - there[i]
            if unproven[i]:
                unproven_loss += loss
            else:
                total += loss
                squared_gains += min(loss, 0.0) ** 2
        if other_count and total / other_count < drop:
            drop = total / other_count
            noise = math.sqrt(2.0 * squared_gains / other_count)
        if unproven_count:
            unproven_drop = min(unproven_drop, unproven_loss / unproven_count)
    return drop, noise, unproven_drop


@kernel
def _unproven_objects(
    lattice: Lattice,
    met: NDArray[np.int32],
    block_cells: int,
    points: Floats,
    tangents: Floats,
    pose: Floats,
    axis: Floats,
) -> tuple[Floats, NDArray[np.bool_], float]:
    """Find the small objects with information along an axis (2,) that were not met for long.

    Only returns with information on that axis are segmented: somebody beside a wall is connected to
    it, but the wall has none along itself.

    Returns
    -------
    likelihoods : (K,) float64
        Of all points.
    unproven : (K,) bool
        Which points belong to such objects.
    share : float
        Their part of the information along the axis.
    """
    values, squared_slopes = np.empty(len(points)), np.empty(len(points))
    unproven, is_met = np.zeros((2, len(points)), dtype=np.bool_)
    c, s = math.cos(pose[2]), math.sin(pose[2])
    total = 0.0
    for i in range(len(points)):
        jx, jy, values[i], weight = slope(lattice, points, tangents, i, pose, c, s)
        squared_slopes[i] = weight * (jx * axis[0] + jy * axis[1]) ** 2
        total += squared_slopes[i]
        x = pose[0] + c * points[i, 0] - s * points[i, 1] - lattice.origin_x
        y = pose[1] + s * points[i, 0] + c * points[i, 1] - lattice.origin_y
        col = math.floor(x / lattice.resolution) // block_cells
        row = math.floor(y / lattice.resolution) // block_cells
        if 0 <= row < met.shape[0] and 0 <= col < met.shape[1]:
            is_met[i] = met[row, col] >= _PROVEN_KEYFRAMES
    gap_ratio = gap_per_range(points)
    if math.isinf(gap_ratio):
        return values, unproven, 0.0
    share, first, last, strength, width_m, count, known = 0.0, -1, -1, 0.0, 0.0, 0, 0
    for i in range(len(points) + 1):
        is_end = i == len(points)
        if not is_end and squared_slopes[i] * len(points) <= total:
            continue
        if first >= 0 and (is_end or is_breakpoint(points, last, i, gap_ratio)):
            if width_m < SMALL_M and 2 * known < count:
                share += strength / max(total, 1e-12)
                unproven[first : last + 1] = True
            first = -1
        if is_end:
            break
        if first < 0:
            first, strength, width_m, count, known = i, 0.0, 0.0, 0, 0
        last, strength = i, strength + squared_slopes[i]
        width_m = max(width_m, distance_m(points, first, i))
        count, known = count + 1, known + is_met[i]
    return values, unproven, min(share, 1.0)
