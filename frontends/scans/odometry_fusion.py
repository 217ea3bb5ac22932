# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Fusion of odometry with velocity: the compiled part of `OdometryFilter`."""

from __future__ import annotations

import math

import numpy as np

from slarm_graph.frontends.scans.kalman import kalman_update
from slarm_graph.frontends.scans.significance import CHI2_1_PERCENT
from slarm_graph.frontends.scans.small_matrix import add3, add_diagonal3, scaled3, subtract3
from slarm_graph.frontends.scans.small_pose import (
    BASIN_COVARIANCE,
    SEARCH_REACH,
    log_density,
    log_det_2pi,
    squared_mahalanobis,
    wrapped,
)
from slarm_graph.frontends.scans.wheel_calibration import (
    WheelParameters,
    calibrated_motion,
    correlated_covariance,
    error_jacobian,
)
from slarm_graph.geometry import Floats
from slarm_graph.kernels import kernel

ACCELERATION = np.array([1.0, 0.5, 2.0])
"""Of indoor robots, sideways by turning [m/s^2, m/s^2, rad/s^2]; scaled by a learned factor, so
only the first scans depend on it."""
_MEMORY = 0.95
"""Of the learned acceleration factor: 20 scans, about the length of a manoeuvre at 10 Hz."""
_LOG_SCALES = math.log(float(SEARCH_REACH[0]) / math.sqrt(float(BASIN_COVARIANCE[0, 0])))
"""From the basin's size to the search reach, as a natural logarithm of the ratio."""


@kernel
def add_component(total: Floats, probability: float, covariance: Floats, offset: Floats) -> None:
    """Add a mixture component, at an offset (3,) from the mean, to the mixture's covariance."""
    offset[2] = wrapped(offset[2])
    for row in range(3):
        for col in range(3):
            total[row, col] += probability * (covariance[row, col] + offset[row] * offset[col])


@kernel
def propagated_velocity_covariance(covariance: Floats, span_s: float, factor: float) -> Floats:
    """Covariance (3, 3) of a velocity after a span of random acceleration times a factor."""
    gain = np.empty(3)
    for k in range(3):
        gain[k] = factor * (ACCELERATION[k] * span_s * (ACCELERATION[k] * span_s))
    return add_diagonal3(covariance, gain)


@kernel
def fused_predictions(
    velocity: tuple[Floats, Floats],
    span_s: float,
    increment: Floats,
    parameters: WheelParameters,
    lag: Floats,
    steps: float,
) -> tuple[Floats, Floats, Floats, Floats]:
    """Fuse a velocity with an increment of odometry, where the two pass a gate.

    Parameters
    ----------
    velocity : (3,) and (3, 3) float64
        Of the robot in its own frame, and its covariance.
    span_s : float
    increment : (3,) float64
        By odometry [m, m, rad].
    parameters : WheelParameters
    lag : (3,) float64
        Variances of the increment by the lag of its reading [m^2, m^2, rad^2].
    steps : float
        The span in mean steps.

    Returns
    -------
    x, P : (3,), (3, 3) float64
        Velocity, updated by odometry where they agree.
    motions : (3, 3) float64
        By the velocity alone, by odometry alone, and fused.
    covariances : (4, 3, 3) float64
        Of these, and of errors that are correlated over steps.
    """
    (x, P), motions, covariances = velocity, np.empty((3, 3)), np.empty((4, 3, 3))
    z, R = calibrated_motion(
        increment,
        parameters.source_factors,
        np.ones(3),
        parameters.errors,
        parameters.covariance,
    )
    R = add_diagonal3(_with_heading_lever(R, z, steps), lag)
    predicted, covariance = integrated_velocity(x, P, span_s)
    fused, fused_covariance = z, R
    if squared_mahalanobis(subtract3(z, predicted), add3(covariance, R)) < CHI2_1_PERCENT:
        x, P = kalman_update(x, P, subtract3(z, predicted), R, scaled3(np.eye(3), span_s))
        fused, fused_covariance = integrated_velocity(x, P, span_s)
    correlated = correlated_covariance(
        increment, parameters.source_factors, parameters.path_variance_factor
    )
    for row in range(3):
        motions[0, row], motions[1, row], motions[2, row] = predicted[row], z[row], fused[row]
        for col in range(3):
            covariances[0, row, col] = covariance[row, col]
            covariances[1, row, col] = R[row, col]
            covariances[2, row, col] = fused_covariance[row, col]
            covariances[3, row, col] = correlated[row, col]
    return x, P, motions, covariances


@kernel
def _with_heading_lever(covariance: Floats, motion: Floats, steps: float) -> Floats:
    """Covariance (3, 3) of a motion (3,) of many steps, with the lever arm of heading errors.

    A step's heading error displaces those after it: of a heading variance that grows evenly over n
    steps, by the sums over (n - k)^2 / n^3 and (n - k) / n^2. One step displaces nothing.
    """
    cos, sin = math.cos(motion[2]), math.sin(motion[2])
    lever = sin * motion[0] - cos * motion[1], cos * motion[0] + sin * motion[1]
    squared = (1.0 - 1.0 / steps) * (1.0 - 0.5 / steps) / 3.0
    cross = 0.5 * (1.0 - 1.0 / steps)
    out = covariance.copy()
    for row in range(2):
        out[row, 2] += cross * lever[row] * covariance[2, 2]
        out[2, row] = out[row, 2]
        for col in range(2):
            out[row, col] += squared * lever[row] * lever[col] * covariance[2, 2]
    return out


@kernel
def integrated_velocity(x: Floats, P: Floats, span_s: float) -> tuple[Floats, Floats]:
    """Integrate a velocity over a span: motion (3,) and its covariance (3, 3)."""
    motion = np.empty(3)
    for k in range(3):
        motion[k] = x[k] * span_s
    return motion, scaled3(P, span_s * span_s)


@kernel
def log_likelihood_ratios(
    odometry_motion: Floats,
    odometry_covariance: Floats,
    velocity_motion: Floats,
    velocity_covariance: Floats,
    match_motion: Floats,
    match_covariance: Floats,
) -> tuple[float, float]:
    """Log-likelihood ratios of a matched motion (3,): odometry, velocity and false match.

    Returns
    -------
    by_odometry, by_velocity : float
        Odometry against velocity, and velocity against a false match. A false match (odometry
        works then) has a log-uniform distance to odometry, from the basin to the search reach.
    """
    residual, S = (
        subtract3(odometry_motion, match_motion),
        add3(odometry_covariance, match_covariance),
    )
    by_velocity = log_density(
        subtract3(velocity_motion, match_motion), add3(velocity_covariance, match_covariance)
    )
    by_odometry = log_density(residual, S) - by_velocity
    S = add3(S, BASIN_COVARIANCE)
    scale = max(math.sqrt(squared_mahalanobis(residual, S)), 1.0)
    # An ellipsoid of that many sigmas has a volume of 4 pi / 3 times their cube times its axes.
    log_det = 0.5 * log_det_2pi(S) - 1.5 * math.log(2.0 * math.pi)
    if_false = -math.log(4.0 * math.pi * _LOG_SCALES) - 3.0 * math.log(scale) - log_det
    return by_odometry, by_velocity - if_false


@kernel
def path_motion(
    increment: Floats,
    parameters: WheelParameters,
    p_working: float,
    velocity_motion: Floats,
    velocity_covariance: Floats,
    steps: float,
) -> tuple[Floats, Floats, Floats, Floats]:
    """Motion (3,) by odometry, its covariances (3, 3) with and without failures, and Jacobian.

    The covariances are of errors independent per step. The remaining systematic errors are the same
    in all steps; of them the Jacobian (3, 3), in the body frame after the motion, adds up instead.
    """
    motion, working = calibrated_motion(
        increment,
        parameters.source_factors,
        parameters.path_variance_factor,
        parameters.path_errors,
        np.zeros((3, 3)),
    )
    total = np.zeros((3, 3))
    working = _with_heading_lever(working, motion, steps)
    add_component(total, p_working, working, np.zeros(3))
    add_component(total, 1.0 - p_working, velocity_covariance, subtract3(velocity_motion, motion))
    jacobian = error_jacobian(increment)
    cos, sin = math.cos(motion[2]), math.sin(motion[2])
    x, y = jacobian[0, 0], jacobian[1, 0]
    jacobian[0, 0], jacobian[1, 0] = cos * x + sin * y, cos * y - sin * x
    return motion, total, working, jacobian


@kernel
def updated_acceleration_factor(
    factor: float,
    velocity_motion: Floats,
    velocity_covariance: Floats,
    motion: Floats,
    motion_covariance: Floats,
) -> float:
    """Adapt the acceleration factor, at least 1, to the latest innovation (NIS)."""
    squared = squared_mahalanobis(
        subtract3(velocity_motion, motion),
        add3(scaled3(velocity_covariance, 1.0 / factor), motion_covariance),
    )
    return max(1.0, _MEMORY * factor + (1.0 - _MEMORY) * squared / 3.0)
