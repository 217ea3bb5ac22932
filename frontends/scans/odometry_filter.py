# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""How far the robot moved before anything was matched: odometry, constant velocity, or both."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from slarm_graph.frontends.scans.kalman import KalmanFilter
from slarm_graph.frontends.scans.small_matrix import invert3
from slarm_graph.geometry import Floats, Pose2

_FIRST_SPEED = np.array([0.5, 0.2, 0.5])
_ACCELERATION = np.array([1.0, 0.5, 2.0])
_FLOOR = np.array([0.004, 0.004, 0.004])
_PER_DISTANCE = np.array([0.10, 0.06, 0.15])
_PER_ANGLE = np.array([0.06, 0.06, 0.20])
_MEMORY = 0.95
_MAX_COASTING_S = 1.0
_CONTRADICTION = 9.0
_ANYWHERE = np.array([1.0, 1.0, 1.5])
_FADING = 0.7


@dataclass(frozen=True, slots=True)
class Prediction:
    """Where the robot probably went.

    Parameters
    ----------
    motion : (3,) float64
        Previous robot frame from the present one [m, m, rad].
    covariance : (3, 3) float64
        Of `motion`, in the body frame.
    """

    motion: Floats
    covariance: Floats


class OdometryFilter:
    """Predicts the motion between scans with its covariance, and learns from the matches.

    A Kalman filter whose state is the robot's velocity in its own frame. Odometry, where there is
    any that ever moved, measures it by the way made in between, with a noise that grows when
    matches contradict it; where there is none, the velocity is constant but for accelerations,
    which grow when matches show the robot, or the log's clock, to be less steady than that.
    """

    def __init__(self) -> None:
        self._kalman = KalmanFilter(np.zeros(3), np.diag(_FIRST_SPEED**2))
        self._last_odom: Pose2 | None = None
        self._odometry_lives = False
        self._distrust = 1.0
        self._unsteadiness = 1.0
        self._steady_motion: Prediction | None = None
        self._measured: tuple[Floats, Floats] | None = None
        self._usual_span_s = 0.0

    def predict(
        self, span_s: float, odom_from_robot: Pose2 | None, lag_s: float = 0.0
    ) -> tuple[Prediction, ...]:
        """Predict the motion over `span_s`.

        Parameters
        ----------
        span_s : float
            Time since the last prediction [s].
        odom_from_robot : Pose2 or None
        lag_s : float
            How much later than the odometry the motion is asked for [s].

        Returns
        -------
        tuple of Prediction
            The best first. When odometry contradicts the velocity so far (a slip, a jump, a frozen
            encoder, or a true jerk), both stand apart; else they are fused to one.
        """
        span = self._steady(span_s)
        if span_s > _MAX_COASTING_S:
            self._kalman.x, self._kalman.P = np.zeros(3), np.diag((_ANYWHERE / span) ** 2)
        else:
            self._kalman.predict(Q=self._unsteadiness * np.diag((_ACCELERATION * span) ** 2))
        self._steady_motion = steady = self._motion(span)
        self._measured = None
        increment = self._increment(odom_from_robot)
        if increment is None:
            return (steady,)
        noise = odometry_covariance(increment, self._distrust) + self.lag_covariance(lag_s)
        self._measured = (increment, noise)
        measured = Prediction(increment, noise)
        if squared_sigmas(increment - steady.motion, steady.covariance + noise) > _CONTRADICTION:
            return (measured, steady)
        self._kalman.update(increment, R=noise, H=span * np.eye(3))
        return (self._motion(span), measured, steady)

    def correct(self, span_s: float, motion: Pose2, covariance: Floats) -> None:
        """Learn from the motion (robot frame before from now) that came out of matching."""
        span = max(span_s, 0.5 * self._usual_span_s, 1e-3)
        moved = motion.as_array()
        if self._measured is not None:
            increment, noise = self._measured
            apart = squared_sigmas(increment - moved, noise / self._distrust + covariance)
            self._distrust = _learned(self._distrust, apart)
        if self._steady_motion is not None:
            steady = self._steady_motion
            noise = steady.covariance / self._unsteadiness + covariance
            apart = squared_sigmas(steady.motion - moved, noise)
            self._unsteadiness = _learned(self._unsteadiness, apart)
        # The match has used the prediction already, so it replaces it.
        self._kalman.x, self._kalman.P = moved / span, covariance / (span * span)

    def coast(self) -> None:
        """Note that nothing was matched: the velocity fades, its uncertainty grows."""
        self._kalman.x = _FADING * self._kalman.x
        grown = np.diag(self._kalman.P) / _FADING**2
        self._kalman.P = np.diag(np.minimum(grown, _ANYWHERE**2))

    def _motion(self, span: float) -> Prediction:
        """Motion over `span` at the filter's velocity."""
        return Prediction(self._kalman.x * span, self._kalman.P * (span * span))

    def rate(self, motion: Floats, span_s: float) -> Floats:
        """Velocity (3,) [m/s, m/s, rad/s] of a motion (3,) over `span_s`; 0 across a gap."""
        if not 0.0 < span_s < _MAX_COASTING_S:
            return np.zeros(3)
        return np.asarray(motion / max(span_s, 0.5 * self._usual_span_s))

    def lag_covariance(self, lag_s: float) -> Floats:
        """Covariance (3, 3) of carrying a pose over `lag_s` with the last interval's velocity."""
        return np.diag((_ACCELERATION * self._usual_span_s * lag_s) ** 2)

    def _steady(self, span_s: float) -> float:
        """Floor a span by half the usual one: some logs' stamps bunch up, the robot does not."""
        if self._usual_span_s == 0.0:
            self._usual_span_s = span_s
        self._usual_span_s += 0.05 * (min(span_s, 1.0) - self._usual_span_s)
        return max(span_s, 0.5 * self._usual_span_s, 1e-3)

    def _increment(self, odom_from_robot: Pose2 | None) -> Floats | None:
        last, self._last_odom = self._last_odom, odom_from_robot
        if last is None or odom_from_robot is None:
            return None
        increment = last.between(odom_from_robot).as_array()
        # Odometry that never moved is a placeholder, not a measurement of standing still.
        self._odometry_lives = self._odometry_lives or bool(np.any(increment != 0.0))
        return increment if self._odometry_lives else None


def _learned(factor: float, squared: float) -> float:
    """Bring a factor on a variance, at least 1, nearer to what the latest miss calls for."""
    return max(1.0, _MEMORY * factor + (1.0 - _MEMORY) * squared / 3.0)


@njit(cache=True, nogil=True)
def odometry_covariance(increment: Floats, distrust: float = 1.0) -> Floats:
    """Covariance (3, 3) of a differential odometry's increment (3,) [m, m, rad]."""
    distance = math.hypot(increment[0], increment[1])
    covariance = np.zeros((3, 3))
    for k in range(3):
        sigma = _FLOOR[k] + _PER_DISTANCE[k] * distance + _PER_ANGLE[k] * abs(increment[2])
        covariance[k, k] = distrust * sigma * sigma
    return covariance


@njit(cache=True, nogil=True)
def squared_sigmas(miss: Floats, covariance: Floats) -> float:
    """Squared Mahalanobis length of a difference of motions (3,), its angle wrapped."""
    wrapped = miss.copy()
    wrapped[2] -= 2.0 * math.pi * math.floor((wrapped[2] + math.pi) / (2.0 * math.pi))
    return float(wrapped @ (invert3(covariance) @ wrapped))
