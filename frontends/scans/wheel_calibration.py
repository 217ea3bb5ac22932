# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Online calibration of wheel odometry: its systematic errors and its noise.

Systematic errors are the scale of distance, the scale of turns, and a turn per metre (unequal
wheels), as in Borenstein and Feng, "Measurement and Correction of Systematic Odometry Errors in
Mobile Robots", IEEE T-RA 12(6), 1996. They are the state of a Kalman filter, measured by every
match.
"""

from __future__ import annotations

import copy
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slarm_graph.frontends.scans.kalman import kalman_update
from slarm_graph.frontends.scans.odometry_noise import MIN_FACTOR, OdometryNoise, noise_variances
from slarm_graph.frontends.scans.small_matrix import (
    add_diagonal3,
    add_vectors3,
    matvec3,
    sandwich3,
    scaled3,
    subtract3,
    symmetric3,
)
from slarm_graph.frontends.scans.small_pose import DEGREES_OF_FREEDOM, wrapped
from slarm_graph.geometry import Floats
from slarm_graph.kernels import kernel

_PRIOR_SIGMA = np.array([0.1, 0.1, 0.035])
"""Of the systematic errors a priori [1, 1, rad/m]: 10 % of distance and turns, 2 deg/m."""
_VARIANCE_DOUBLES_M = 200.0
"""Distance in which their variance doubles: loads, tyres, floors."""
_FLOOR = np.array([0.004, 0.004, 0.004])
"""Noise of a step of length zero [m, m, rad]: encoder ticks, and stamps off by a few ms."""
_PER_DISTANCE = np.array([0.05, 0.03, 0.05])
"""Prior noise of translation and rotation per metre [m/m, m/m, rad/m]."""
_PER_ANGLE = np.array([0.03, 0.03, 0.10])
"""The same per radian turned [m/rad, m/rad, rad/rad]."""
_UNINFORMATIVE = 1e6
"""Variance of an uninformative measurement [m^2, rad^2]: a kilometre."""
_MIN_MOTION_M, _MIN_MOTION_RAD = 0.005, 0.005
"""Shorter steps carry no information on the systematic errors."""


class WheelParameters(NamedTuple):
    """Calibration and noise of odometry, for compiled code."""

    source_factors: Floats
    path_variance_factor: Floats
    errors: Floats
    covariance: Floats
    path_errors: Floats


class WheelCalibration:
    """Kalman filter of odometry's systematic errors, and estimator of its remaining noise."""

    def __init__(self) -> None:
        self.errors: Floats = np.zeros(3)
        """Scale of distance and of turns, less 1, and turn per metre [1, 1, rad/m]."""
        self.covariance: Floats = np.diag(_PRIOR_SIGMA**2)
        """Of the errors (3, 3)."""
        self.path_errors: Floats = np.zeros(3)
        """As `errors`, found from increments without the errors of their readings.

        A noisy increment is best predicted from by too small a scale; along a path, on which the
        errors of readings cancel, the scale is the right one."""
        self._path_covariance: Floats = np.diag(_PRIOR_SIGMA**2)
        self.noise = OdometryNoise()

    def branched(self) -> WheelCalibration:
        """Return an independent copy."""
        other = copy.copy(self)
        other.noise = self.noise.branched()
        return other

    @property
    def parameters(self) -> WheelParameters:
        """Calibration and noise so far, for compiled code."""
        return WheelParameters(
            self.noise.source_factors,
            self.noise.path_variance_factor,
            self.errors,
            self.covariance,
            self.path_errors,
        )

    def interrupt(self) -> None:
        """Note that a step is not matched: the next residual does not follow one."""
        self.noise.interrupt()

    def learn(self, increment: Floats, motion: Floats, nominal: Floats, p_working: float) -> None:
        """Update calibration and noise by the motion between two matches, if odometry worked.

        Parameters
        ----------
        increment : (3,) float64
            By odometry [m, m, rad].
        motion : (3,) float64
            From one match, without the prior, to the next [m, m, rad].
        nominal : (3,) float64
            Variances of a match by its curvature.
        p_working : float
            Probability that odometry worked in this step.
        """
        distance = math.hypot(increment[0], increment[1])
        if p_working < 0.5 or (distance < _MIN_MOTION_M and abs(increment[2]) < _MIN_MOTION_RAD):
            self.noise.interrupt()
            return
        noise = self.noise
        step = increment, motion, nominal, (noise.source_factors, noise.match_variance_factor)
        self.errors, self.covariance, *_ = _calibration_update(
            self.errors, self.covariance, *step, np.zeros(3)
        )
        self.path_errors, self._path_covariance, residual, sources, informative = (
            _calibration_update(
                self.path_errors, self._path_covariance, *step, noise.reading_variances
            )
        )
        noise.learn(residual, sources, nominal, informative)


@kernel
def error_jacobian(increment: Floats) -> Floats:
    """Jacobian (3, 3) of the motion with respect to the systematic errors."""
    x, y, turn = increment
    jacobian = np.zeros((3, 3))
    jacobian[0, 0], jacobian[1, 0] = x, y
    jacobian[2, 1], jacobian[2, 2] = turn, math.hypot(x, y)
    return jacobian


@kernel
def _source_variances(increment: Floats) -> Floats:
    """Prior variances (3, 3) of an increment's noise, by source and axis, before learned factors.

    The sources are independent: the step itself, its distance, and its angle.
    """
    distance = math.hypot(increment[0], increment[1])
    variances = np.empty((3, 3))
    for k in range(3):
        variances[0, k] = _FLOOR[k] ** 2
        variances[1, k] = (_PER_DISTANCE[k] * distance) ** 2
        variances[2, k] = (_PER_ANGLE[k] * increment[2]) ** 2
    return variances


@kernel
def calibrated_motion(
    increment: Floats,
    source_factors: Floats,
    path_variance_factor: Floats,
    errors: Floats,
    covariance: Floats,
) -> tuple[Floats, Floats]:
    """Correct an increment (3,) for the systematic errors: motion (3,) and covariance (3, 3)."""
    jacobian, sources = error_jacobian(increment), _source_variances(increment)
    noise = noise_variances(sources, source_factors)
    spread = sandwich3(jacobian, covariance)
    for k in range(3):
        least = MIN_FACTOR * (sources[0, k] + sources[1, k] + sources[2, k])
        spread[k, k] += max(path_variance_factor[k] * noise[k], least)
    return add_vectors3(increment, matvec3(jacobian, errors)), spread


@kernel
def correlated_covariance(
    increment: Floats, source_factors: Floats, path_variance_factor: Floats
) -> Floats:
    """Covariance (3, 3) of a step's errors that are correlated over many steps.

    They add up along a path, but do not show from one scan to the next.
    """
    noise = noise_variances(_source_variances(increment), source_factors)
    correlated = np.zeros((3, 3))
    for k in range(3):
        correlated[k, k] = max(path_variance_factor[k] - 1.0, 0.0) * noise[k]
    return correlated


@kernel
def _calibration_update(
    errors: Floats,
    covariance: Floats,
    increment: Floats,
    motion: Floats,
    nominal: Floats,
    factors: tuple[Floats, Floats],
    reading_variances: Floats,
) -> tuple[Floats, Floats, Floats, Floats, NDArray[np.bool_]]:
    """Update the systematic errors by one step (robust Kalman update, then aging).

    Parameters
    ----------
    errors, covariance : (3,), (3, 3) float64
    increment, motion, nominal : (3,) float64
        As for `WheelCalibration.learn`.
    factors : tuple of (3, 3) and (3,) float64
        Actual over prior variances of odometry's sources, and over nominal ones of a match.
    reading_variances : (3,) float64
        Of the readings whose errors are to be taken from the increment.

    Returns
    -------
    errors, covariance : (3,), (3, 3) float64
    residual, sources : (3,), (3, 3) float64
        Of the motion, clipped to three sigmas, and odometry's prior variances by source.
    informative : (3,) bool
        Along which axes the match is surer than odometry.
    """
    sources = _source_variances(increment)
    of_odometry = noise_variances(sources, factors[0])
    expected = add_vectors3(increment, matvec3(error_jacobian(increment), errors))
    residual = subtract3(motion, expected)
    residual[2] = wrapped(residual[2])
    # A match less certain than odometry cannot calibrate it, such as along a bare corridor.
    informative, noise = np.empty(3, dtype=np.bool_), np.empty(3)
    # The errors are proportional to the increment without the errors of its two readings, as far as
    # the match tells them: regression on noisy ones finds too little.
    without_readings = increment.copy()
    for k in range(3):
        informative[k] = nominal[k] < sources[0, k] + sources[1, k] + sources[2, k]
        noise[k] = of_odometry[k] + 2.0 * factors[1][k] * nominal[k]
        if informative[k]:
            without_readings[k] += min(2.0 * reading_variances[k] / noise[k], 1.0) * residual[k]
        else:
            noise[k] = _UNINFORMATIVE
    jacobian = error_jacobian(without_readings)
    inflated = _student_t_variances(residual, noise, sandwich3(jacobian, covariance))
    R = add_diagonal3(np.zeros((3, 3)), inflated)
    errors, covariance = kalman_update(errors, covariance, residual, R, jacobian)
    growth = 1.0 + math.hypot(increment[0], increment[1]) / _VARIANCE_DOUBLES_M
    aged = scaled3(symmetric3(covariance), growth)
    shrink = 1.0
    for k in range(3):
        shrink = min(shrink, _PRIOR_SIGMA[k] * _PRIOR_SIGMA[k] / aged[k, k])
    # Beyond three sigmas a residual is an outlier, not noise.
    for k in range(3):
        limit = 3.0 * math.sqrt(noise[k])
        residual[k] = min(max(residual[k], -limit), limit)
    return errors, scaled3(aged, shrink), residual, sources, informative


@kernel
def _student_t_variances(residual: Floats, noise: Floats, systematic: Floats) -> Floats:
    """Inflate variances (3,) by the residuals: iterative reweighting for Student's t noise.

    Parameters
    ----------
    residual, noise : (3,) float64
        Along each axis, and its variance.
    systematic : (3, 3) float64
        Of the residual by the uncertainty of the systematic errors.
    """
    out = np.empty(3)
    for k in range(3):
        squared_residual = residual[k] * residual[k] / (noise[k] + systematic[k, k])
        factor = (DEGREES_OF_FREEDOM + squared_residual) / (DEGREES_OF_FREEDOM + 1.0)
        out[k] = noise[k] * max(1.0, factor)
    return out
