# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""How far the robot moved before anything was matched: odometry, constant velocity, or both."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from slarm_graph.frontends.small_matrix import invert3
from slarm_graph.geometry import Floats, Pose2

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

    The state is the robot's velocity in its own frame with a covariance; odometry, where there is
    any that ever moved, measures it too, with a noise that grows when matches contradict it.
    """

    def __init__(self) -> None:
        self._velocity = np.zeros(3)
        self._covariance = np.diag([0.5, 0.2, 0.5]) ** 2
        self._last_odom: Pose2 | None = None
        self._odometry_lives = False
        self._distrust = 1.0
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
        steady = at_constant_velocity(
            self._velocity, self._covariance, span, span_s > _MAX_COASTING_S
        )
        self._measured = None
        increment = self._increment(odom_from_robot)
        if increment is None:
            return (Prediction(*steady),)
        noise = odometry_covariance(increment, self._distrust)
        noise = noise + self.lag_covariance(lag_s)
        self._measured = (increment, noise)
        motion, covariance, contradiction = fuse(*steady, increment, noise)
        measured = Prediction(increment, noise)
        if contradiction > _CONTRADICTION:
            return (measured, Prediction(*steady))
        return (Prediction(motion, covariance), measured, Prediction(*steady))

    def correct(self, span_s: float, motion: Pose2, covariance: Floats) -> None:
        """Learn from the motion (robot frame before from now) that came out of matching."""
        span = max(span_s, 0.5 * self._usual_span_s, 1e-3)
        moved = motion.as_array()
        if self._measured is not None:
            increment, noise = self._measured
            _, _, surprise = fuse(moved, covariance, increment, noise / self._distrust)
            self._distrust = max(1.0, _MEMORY * self._distrust + (1 - _MEMORY) * surprise / 3.0)
        self._velocity = moved / span
        self._covariance = covariance / (span * span)

    def coast(self) -> None:
        """Note that nothing was matched: the velocity fades, its uncertainty grows."""
        self._velocity = _FADING * self._velocity
        grown = self._covariance / _FADING**2
        self._covariance = np.minimum(grown, np.diag(_ANYWHERE * _ANYWHERE))

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
def at_constant_velocity(
    velocity: Floats, covariance: Floats, span_s: float, too_long: bool
) -> tuple[Floats, Floats]:
    """Motion (3,) and covariance (3, 3) at constant velocity, or anywhere after too long."""
    motion = np.zeros(3)
    if too_long:
        return motion, np.diag(_ANYWHERE * _ANYWHERE)
    spread = np.empty((3, 3))
    for r in range(3):
        motion[r] = velocity[r] * span_s
        for k in range(3):
            spread[r, k] = covariance[r, k] * span_s * span_s
        spread[r, r] += (_ACCELERATION[r] * span_s * span_s) ** 2
    return motion, spread


@njit(cache=True, nogil=True)
def fuse(
    motion: Floats, covariance: Floats, other: Floats, other_covariance: Floats
) -> tuple[Floats, Floats, float]:
    """Fuse two Gaussian estimates of one motion; returns also how far apart (squared sigmas)."""
    miss = other - motion
    miss[2] -= 2.0 * math.pi * math.floor((miss[2] + math.pi) / (2.0 * math.pi))
    weight = invert3(covariance + other_covariance)
    pull = weight @ miss
    fused = covariance - covariance @ weight @ covariance
    return motion + covariance @ pull, 0.5 * (fused + fused.T), float(miss @ pull)
