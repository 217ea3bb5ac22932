# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Prediction of the motion between scans from odometry and velocity, and their reliability.

Two motion modes make a Gaussian mixture. Odometry: its systematic errors calibrated online, its
noise learned from the residuals to the matches. Constant velocity: also valid while wheels slip,
encoders freeze or odometry jumps. Which mode holds is the rarely changing state of a hidden Markov
model, updated by the matches. Frozen encoders are a state of their own, since they read the same
until they recover, and nobody sees when that was.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from slarm_graph.frontends.scans.kalman import KalmanState
from slarm_graph.frontends.scans.odometry_fusion import (
    ACCELERATION,
    add_component,
    fused_predictions,
    integrated_velocity,
    log_likelihood_ratios,
    path_motion,
    propagated_velocity_covariance,
    updated_acceleration_factor,
)
from slarm_graph.frontends.scans.odometry_reliability import OdometryReliability
from slarm_graph.frontends.scans.small_pose import between3
from slarm_graph.frontends.scans.wheel_calibration import WheelCalibration
from slarm_graph.frontends.scans.wheel_motion import WheelMotion
from slarm_graph.geometry import Floats, Pose2

_PRIOR_SPEED = np.array([0.5, 0.2, 0.5])
"""Standard deviation of the velocity before anything is known [m/s, m/s, rad/s]: indoor robots."""
_UNKNOWN_SPEED = np.array([1.0, 1.0, 1.5])
"""Standard deviation of the speed in a gap [m/s, m/s, rad/s]."""
_MAX_COASTING_S = 1.0
"""At 1 m/s^2 a velocity older than this is worth as little as none."""
_NO_LAG = np.zeros(3)
"""Variances (3,) of a motion that is predicted for the odometry's own stamp."""
_SPAN_RATE = 0.05
"""Learning rate of the mean time between scans: about the last 20 of them. Half and double
move nothing (six recordings and buildings)."""
_FADING = 0.7
"""Decay of the velocity per unmatched scan: it is gone within a second at 10 Hz."""


@dataclass(frozen=True, slots=True)
class Prediction:
    """One mode of the predicted motion: a component of a Gaussian mixture.

    Parameters
    ----------
    motion : (3,) float64
        Previous robot frame from the present one [m, m, rad].
    covariance : (3, 3) float64
        Of `motion`, in the body frame.
    probability : float
        Of the mode.
    correlated_covariance : (3, 3) float64
        Of errors that are correlated over steps: to be added where a path is integrated.
    """

    motion: Floats
    covariance: Floats
    probability: float = 1.0
    correlated_covariance: Floats = field(default_factory=lambda: np.zeros((3, 3)))


class MotionMixture(NamedTuple):
    """A Gaussian mixture of motions from a pose, as arrays for compiled code.

    Parameters
    ----------
    base : (3,) float64
        Pose that the motions start from [m, m, rad].
    motions, covariances : (P, 3), (P, 3, 3) float64
    probabilities, correlated_covariances : (P,), (P, 3, 3) float64
        As of `Prediction`.
    """

    base: Floats
    motions: Floats
    covariances: Floats
    probabilities: Floats
    correlated_covariances: Floats


def mixture_covariance(motion: Floats, predictions: Iterable[Prediction]) -> Floats:
    """Covariance (3, 3) of a mixture of predictions about a motion (3,), in the body frame."""
    total, total_probability = np.zeros((3, 3)), 0.0
    for one in predictions:
        add_component(total, one.probability, one.covariance, one.motion - motion)
        total_probability += one.probability
    return np.asarray(total / total_probability)


class OdometryFilter:
    """Predicts the motion between scans with its covariance; updated by the matches.

    A Kalman filter whose state is the robot's velocity in its own frame. Odometry, where there is
    any that ever moved, measures it by its increments; where there is none, a constant-velocity
    model with white acceleration, whose variance grows when matches show the robot, or the log's
    clock, to be less steady.
    """

    def __init__(self) -> None:
        self._kalman = KalmanState(np.zeros(3), np.diag(_PRIOR_SPEED**2))
        self.wheels = WheelCalibration()
        self._last_odom: Pose2 | None = None
        self._odometry_active = False
        self.reliability = OdometryReliability()
        self._acceleration_factor = 1.0
        self._constant_velocity: Prediction | None = None
        self._increment: Floats | None = None
        self._odometry_alone: Prediction | None = None
        self._mean_span_s = 0.0
        self._span_s = 1.0

    def branched(self) -> OdometryFilter:
        """Return an independent copy."""
        other = copy.copy(self)
        other._kalman, other.wheels = copy.copy(self._kalman), self.wheels.branched()
        other.reliability = self.reliability.branched()
        return other

    def predict(
        self, span_s: float, odom_from_robot: Pose2 | None, lag_s: float = 0.0
    ) -> tuple[Prediction, ...]:
        """Predict the motion over `span_s`, by mode.

        Parameters
        ----------
        span_s : float
            Time since the last prediction [s].
        odom_from_robot : Pose2 or None
        lag_s : float
            How much later than the odometry the motion is predicted for [s].

        Returns
        -------
        tuple of Prediction
            One per mode, the likeliest first: odometry, fused with the velocity where they agree,
            and constant velocity.
        """
        span = self._span_s = self._floored(span_s)
        self.reliability.begin_step()
        kalman = self._kalman
        self._odometry_alone = None
        self._increment = self._odometry_increment(odom_from_robot)
        if span_s > _MAX_COASTING_S:
            # Odometry that failed in a gap did so in some of its steps.
            motion = np.zeros(3) if self._increment is None else self._increment
            kalman.x, kalman.P = motion / span, np.diag((_UNKNOWN_SPEED / span) ** 2)
        else:
            kalman.P = propagated_velocity_covariance(kalman.P, span, self._acceleration_factor)
        if self._increment is None:
            self._constant_velocity = Prediction(*integrated_velocity(kalman.x, kalman.P, span))
            return (self._constant_velocity,)
        self.reliability.predict(self._increment)
        lag = self._lag_variances(lag_s)
        kalman.x, kalman.P, motions, covariances = fused_predictions(
            (kalman.x, kalman.P),
            span,
            self._increment,
            self.wheels.parameters,
            lag,
            self._step_count(span),
        )
        p_working = self.reliability.p_working
        self._constant_velocity = Prediction(motions[0], covariances[0], 1.0 - p_working)
        self._odometry_alone = Prediction(motions[1], covariances[1], p_working)
        odometry = Prediction(motions[2], covariances[2], p_working, covariances[3])
        modes = (odometry, self._constant_velocity)
        return modes if p_working >= 0.5 else modes[::-1]

    def correct(self, span_s: float, motion: Floats, covariance: Floats) -> None:
        """Correct the velocity by the posterior motion (3,) (robot frame before from now)."""
        span = max(span_s, 0.5 * self._mean_span_s, 1e-3)
        if self._constant_velocity is not None:
            velocity = self._constant_velocity
            self._acceleration_factor = updated_acceleration_factor(
                self._acceleration_factor, velocity.motion, velocity.covariance, motion, covariance
            )
        # The posterior includes the prediction already, so it replaces the state.
        self._kalman.x, self._kalman.P = motion / span, covariance / (span * span)

    def update_reliability(self, match_motion: Floats, covariance: Floats) -> None:
        """Update the probability that odometry works by Bayes' rule.

        Parameters
        ----------
        match_motion : (3,) float64
            Motion by the match alone [m, m, rad].
        covariance : (3, 3) float64
            Of the motion, the last pose's included.
        """
        odometry, velocity = self._odometry_alone, self._constant_velocity
        if odometry is None or velocity is None:
            return
        ratios = log_likelihood_ratios(
            odometry.motion,
            odometry.covariance,
            velocity.motion,
            velocity.covariance,
            match_motion,
            covariance,
        )
        self.reliability.update(*ratios)

    def calibrate(self, motion: Floats, nominal: Floats) -> None:
        """Calibrate odometry by the motion (3,) between two matches; see `WheelCalibration`."""
        if self._increment is not None:
            self.wheels.learn(self._increment, motion, nominal, self.reliability.p_working)

    def wheel_motion(self) -> WheelMotion | None:
        """Return the last step's motion by odometry alone; None where there is none.

        The covariance includes the constant-velocity mode, weighted by the probability that
        odometry failed; that without failure does not, as far as odometry contradicts matches.
        """
        velocity = self._constant_velocity
        if self._increment is None or velocity is None:
            return None
        motion, covariance, covariance_if_working, error_jacobian = path_motion(
            self._increment,
            self.wheels.parameters,
            self.reliability.p_working_on_path(),
            velocity.motion,
            velocity.covariance,
            self._step_count(self._span_s),
        )
        covariance_if_working = (
            covariance_if_working if self.reliability.contradicts_matches() else covariance
        )
        return WheelMotion(
            motion,
            covariance,
            covariance_if_working,
            self.wheels.noise.reading_variances,
            error_jacobian,
            self.wheels.covariance,
        )

    def coast(self) -> None:
        """Coast without a match: the velocity decays, its covariance grows.

        Working odometry is followed unchanged: a decaying velocity would shorten its steps.
        """
        if self._odometry_alone is not None and self.reliability.p_working >= 0.5:
            self._kalman.x = self._odometry_alone.motion / self._span_s
            self._kalman.P = np.diag(_UNKNOWN_SPEED**2)
            return
        self._kalman.x = _FADING * self._kalman.x
        variances = np.diag(self._kalman.P) / _FADING**2
        self._kalman.P = np.diag(np.minimum(variances, _UNKNOWN_SPEED**2))

    def rate(self, motion: Floats, span_s: float) -> Floats:
        """Velocity (3,) [m/s, m/s, rad/s] of a motion (3,) over `span_s`; 0 across a gap."""
        if not 0.0 < span_s < _MAX_COASTING_S:
            return np.zeros(3)
        return np.asarray(motion / max(span_s, 0.5 * self._mean_span_s))

    def lag_covariance(self, lag_s: float) -> Floats:
        """Covariance (3, 3) of extrapolating a pose over `lag_s` with the last step's velocity."""
        return np.diag(self._lag_variances(lag_s))

    def _step_count(self, span_s: float) -> float:
        """Length of a gap in mean steps; 1 where there is none, whose noise is learned as it is."""
        return max(span_s / self._mean_span_s, 1.0) if span_s > _MAX_COASTING_S else 1.0

    def _lag_variances(self, lag_s: float) -> Floats:
        return (ACCELERATION * (self._mean_span_s * lag_s)) ** 2 if lag_s else _NO_LAG

    def _floored(self, span_s: float) -> float:
        """Bound a span below by half the mean one: some logs' stamps bunch up."""
        if self._mean_span_s == 0.0:
            self._mean_span_s = span_s
        self._mean_span_s += _SPAN_RATE * (min(span_s, 1.0) - self._mean_span_s)
        return max(span_s, 0.5 * self._mean_span_s, 1e-3)

    def _odometry_increment(self, odom_from_robot: Pose2 | None) -> Floats | None:
        last, self._last_odom = self._last_odom, odom_from_robot
        if last is None or odom_from_robot is None:
            return None
        # Odometry that never moved is a placeholder, not a measurement of standing still.
        self._odometry_active = self._odometry_active or last.between(odom_from_robot) != Pose2()
        if not self._odometry_active:
            return None
        return between3(last.as_array(), odom_from_robot.as_array())
