# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""How far the robot moved before anything was matched, and how much of that to believe.

Two stories are kept beside each other. Wheels: odometry, its systematic errors calibrated on the
way, with a noise that is learned from how well matches agree. Inertia: the robot went on as before;
true also while wheels slip, encoders hang or odometry jumps. Which of the two holds is a state with
two values that changes rarely: a hidden Markov chain, whose probability matches update.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numba import njit

from slarm_graph.frontends.scans.kalman import KalmanState, updated
from slarm_graph.frontends.scans.small_matrix import less3, scaled3, sum3, with_diagonal3
from slarm_graph.frontends.scans.small_pose import between3, log_density, squared_sigmas, wrapped
from slarm_graph.frontends.scans.wheel_calibration import (
    WheelCalibration,
    WheelsKnown,
    told,
    unlearned,
)
from slarm_graph.frontends.scans.wheel_motion import WheelMotion
from slarm_graph.geometry import Floats, Pose2

_FIRST_SPEED = np.array([0.5, 0.2, 0.5])
"""Standard deviation of the velocity before anything is known [m/s, m/s, rad/s]: indoor robots."""
_ACCELERATION = np.array([1.0, 0.5, 2.0])
"""Of indoor robots, sideways by what turning mixes in [m/s^2, m/s^2, rad/s^2]; scaled by what is
learned, so only the first scans depend on it."""
_ANYWHERE = np.array([1.0, 1.0, 1.5])
"""Speed in a gap of which nothing is known [m/s, m/s, rad/s]."""
_MAX_COASTING_S = 1.0
"""At 1 m/s^2 a velocity older than this says as little as none."""
_MEMORY = 0.95
"""Of the learned unsteadiness: 20 scans, about the length of a manoeuvre at 10 Hz."""
_NO_LAG = np.zeros(3)
_CONTRADICTION = 11.34
"""Chi-square quantile of 99 % for 3 degrees of freedom."""
_FADING = 0.7
"""Velocity kept per scan while nothing is matched: it is gone within a second at 10 Hz."""
_FAILS = 1.0 / 300.0
"""Probability that odometry begins to fail in a step, before failures are counted."""
_RECOVERS = 0.2
"""Probability that it ends in a step: slips and jumps last for some scans, hung encoders longer."""
_COUNTED = 300.0
"""Steps that the first guess of a failure's probability is worth."""


@dataclass(frozen=True, slots=True)
class Prediction:
    """Where the robot probably went.

    Parameters
    ----------
    motion : (3,) float64
        Previous robot frame from the present one [m, m, rad].
    covariance : (3, 3) float64
        Of `motion`, in the body frame.
    probability : float
        That this story is the true one.
    unlearned : (3, 3) float64
        What to add to the covariance where errors of many steps add up.
    """

    motion: Floats
    covariance: Floats
    probability: float = 1.0
    unlearned: Floats = field(default_factory=lambda: np.zeros((3, 3)))


class Expectation(NamedTuple):
    """Predictions from a pose as compiled code takes them.

    Parameters
    ----------
    base : (3,) float64
        Pose that they go on from [m, m, rad].
    motions, covariances, probabilities, unlearned : (P, 3), (P, 3, 3), (P,), (P, 3, 3) float64
        As of `Prediction`.
    """

    base: Floats
    motions: Floats
    covariances: Floats
    probabilities: Floats
    unlearned: Floats


def spread_about(motion: Floats, predictions: Iterable[Prediction]) -> Floats:
    """Covariance (3, 3) of a mixture of predictions about a motion (3,), in the body frame."""
    total, chances = np.zeros((3, 3)), 0.0
    for one in predictions:
        _add_spread(total, one.probability, one.covariance, one.motion - motion)
        chances += one.probability
    return np.asarray(total / chances)


@njit(cache=True, nogil=True)
def _add_spread(total: Floats, probability: float, covariance: Floats, apart: Floats) -> None:
    """Add what one of several predictions, so far apart (3,), has in their spread (3, 3)."""
    apart[2] = wrapped(apart[2])
    for row in range(3):
        for col in range(3):
            total[row, col] += probability * (covariance[row, col] + apart[row] * apart[col])


class OdometryFilter:
    """Predicts the motion between scans with its covariance, and learns from the matches.

    A Kalman filter whose state is the robot's velocity in its own frame. Odometry, where there is
    any that ever moved, measures it by the way made in between; where there is none, the velocity
    is constant but for accelerations, which grow when matches show the robot, or the log's clock,
    to be less steady than that.
    """

    def __init__(self) -> None:
        self._kalman = KalmanState(np.zeros(3), np.diag(_FIRST_SPEED**2))
        self.wheels = WheelCalibration()
        self._last_odom: Pose2 | None = None
        self._odometry_lives = False
        self._holds = 1.0 - _FAILS
        self._steps, self._failures = _COUNTED, _COUNTED * _FAILS
        self._unsteadiness = 1.0
        self._steady_motion: Prediction | None = None
        self._increment: Floats | None = None
        self._measured: Prediction | None = None
        self._usual_span_s = 0.0
        self._span_s = 1.0

    def branched(self) -> OdometryFilter:
        """Return a filter of its own that has learned the same so far."""
        other = copy.copy(self)
        other._kalman, other.wheels = copy.copy(self._kalman), self.wheels.branched()
        return other

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
            One per story, the likeliest first: odometry, made surer by the velocity where they
            agree, and the velocity alone.
        """
        span = self._span_s = self._steady(span_s)
        kalman = self._kalman
        if span_s > _MAX_COASTING_S:
            kalman.x, kalman.P = np.zeros(3), np.diag((_ANYWHERE / span) ** 2)
        else:
            kalman.P = _accelerated(kalman.P, span, self._unsteadiness)
        self._measured = None
        self._increment = self._odometry_increment(odom_from_robot)
        if self._increment is None:
            self._steady_motion = Prediction(*_over(kalman.x, kalman.P, span))
            return (self._steady_motion,)
        self._holds = self._holds * (1.0 - self._failures / self._steps)
        self._holds += (1.0 - self._holds) * _RECOVERS
        lag = self._lag_variances(lag_s)
        kalman.x, kalman.P, motions, covariances = _weighed(
            kalman.x, kalman.P, span, self._increment, self.wheels.known, lag
        )
        self._steady_motion = Prediction(motions[0], covariances[0], 1.0 - self._holds)
        self._measured = Prediction(motions[1], covariances[1], self._holds)
        wheels = Prediction(motions[2], covariances[2], self._holds, covariances[3])
        both = (wheels, self._steady_motion)
        return both if self._holds >= 0.5 else both[::-1]

    def correct(self, span_s: float, moved: Floats, covariance: Floats) -> None:
        """Learn the velocity from the motion (3,) (robot frame before from now) that was found."""
        span = max(span_s, 0.5 * self._usual_span_s, 1e-3)
        if self._steady_motion is not None:
            steady = self._steady_motion
            self._unsteadiness = _learned(
                self._unsteadiness, steady.motion, steady.covariance, moved, covariance
            )
        # The match has used the prediction already, so it replaces it.
        self._kalman.x, self._kalman.P = moved / span, covariance / (span * span)

    def judge(self, found: Floats, covariance: Floats) -> None:
        """Update by Bayes' rule whether odometry holds.

        Parameters
        ----------
        found : (3,) float64
            Motion by the match alone [m, m, rad].
        covariance : (3, 3) float64
            Of it and of the pose before.
        """
        wheels, steady = self._measured, self._steady_motion
        if wheels is None or steady is None:
            return
        before = self._holds
        log_odds = _log_ratio(
            wheels.motion, wheels.covariance, steady.motion, steady.covariance, found, covariance
        )
        log_odds += math.log(max(before, 1e-12)) - math.log(max(1.0 - before, 1e-12))
        self._holds = 1.0 / (1.0 + math.exp(min(-log_odds, 700.0)))
        self._steps += before
        self._failures += before * (1.0 - self._holds)

    def learn(self, moved: Floats, claimed: Floats) -> None:
        """Learn odometry's errors from the way (3,) between two matches; see `WheelCalibration`."""
        if self._increment is not None:
            self.wheels.learn(self._increment, moved, claimed, self._holds)

    def wheel_motion(self) -> WheelMotion | None:
        """Return the last step by odometry alone; None where there is none.

        As far as odometry may have failed in it, the robot may have gone on as before: mean and
        spread are about the way that odometry tells.
        """
        if self._increment is None:
            return None
        steady, holds = self._steady_motion, self._holds
        if steady is None:
            return self.wheels.along_path(self._increment)
        motion, covariance = _along_path(
            self._increment, self.wheels.known, holds, steady.motion, steady.covariance
        )
        return WheelMotion(motion, covariance, self.wheels.reading)

    def coast(self) -> None:
        """Note that nothing was matched: the velocity fades, its uncertainty grows.

        Odometry that holds is followed as it is: a velocity that fades would shorten its steps.
        """
        if self._measured is not None and self._holds >= 0.5:
            self._kalman.x = self._measured.motion / self._span_s
            self._kalman.P = np.diag(_ANYWHERE**2)
            return
        self._kalman.x = _FADING * self._kalman.x
        grown = np.diag(self._kalman.P) / _FADING**2
        self._kalman.P = np.diag(np.minimum(grown, _ANYWHERE**2))

    def rate(self, motion: Floats, span_s: float) -> Floats:
        """Velocity (3,) [m/s, m/s, rad/s] of a motion (3,) over `span_s`; 0 across a gap."""
        if not 0.0 < span_s < _MAX_COASTING_S:
            return np.zeros(3)
        return np.asarray(motion / max(span_s, 0.5 * self._usual_span_s))

    def lag_covariance(self, lag_s: float) -> Floats:
        """Covariance (3, 3) of carrying a pose over `lag_s` with the last interval's velocity."""
        return np.diag(self._lag_variances(lag_s))

    def _lag_variances(self, lag_s: float) -> Floats:
        return (_ACCELERATION * (self._usual_span_s * lag_s)) ** 2 if lag_s else _NO_LAG

    def _steady(self, span_s: float) -> float:
        """Floor a span by half the usual one: some logs' stamps bunch up, the robot does not."""
        if self._usual_span_s == 0.0:
            self._usual_span_s = span_s
        self._usual_span_s += 0.05 * (min(span_s, 1.0) - self._usual_span_s)
        return max(span_s, 0.5 * self._usual_span_s, 1e-3)

    def _odometry_increment(self, odom_from_robot: Pose2 | None) -> Floats | None:
        last, self._last_odom = self._last_odom, odom_from_robot
        if last is None or odom_from_robot is None:
            return None
        # Odometry that never moved is a placeholder, not a measurement of standing still.
        self._odometry_lives = self._odometry_lives or last.between(odom_from_robot) != Pose2()
        if not self._odometry_lives:
            return None
        return between3(last.as_array(), odom_from_robot.as_array())


@njit(cache=True, nogil=True)
def _accelerated(covariance: Floats, span_s: float, factor: float) -> Floats:
    """Covariance (3, 3) of a velocity after a span, what it gains in it times a factor."""
    gained = np.empty(3)
    for k in range(3):
        gained[k] = factor * (_ACCELERATION[k] * span_s * (_ACCELERATION[k] * span_s))
    return with_diagonal3(covariance, gained)


@njit(cache=True, nogil=True)
def _weighed(
    x: Floats, P: Floats, span_s: float, increment: Floats, wheels: WheelsKnown, lag: Floats
) -> tuple[Floats, Floats, Floats, Floats]:
    """Weigh a velocity and an increment of odometry.

    Parameters
    ----------
    x, P : (3,), (3, 3) float64
        Velocity in the robot's frame, and its covariance.
    span_s : float
    increment : (3,) float64
        By odometry [m, m, rad].
    wheels : WheelsKnown
    lag : (3,) float64
        Variances of the increment by when it was read [m^2, m^2, rad^2].

    Returns
    -------
    x, P : (3,), (3, 3) float64
        Velocity, of which odometry has told where the two agree.
    motions : (3, 3) float64
        By the velocity alone, by odometry alone, and by both.
    covariances : (4, 3, 3) float64
        Of these, and what errors that add up have more.
    """
    motions, covariances = np.empty((3, 3)), np.empty((4, 3, 3))
    told_motion, noise = told(increment, wheels.excess, wheels.errors, wheels.covariance)
    noise = with_diagonal3(noise, lag)
    steady, spread = _over(x, P, span_s)
    both, both_spread = told_motion, noise
    if squared_sigmas(less3(told_motion, steady), sum3(spread, noise)) < _CONTRADICTION:
        x, P = updated(x, P, told_motion, noise, scaled3(np.eye(3), span_s))
        both, both_spread = _over(x, P, span_s)
    more = unlearned(increment, wheels.excess, wheels.path_excess)
    for row in range(3):
        motions[0, row], motions[1, row], motions[2, row] = steady[row], told_motion[row], both[row]
        for col in range(3):
            covariances[0, row, col] = spread[row, col]
            covariances[1, row, col] = noise[row, col]
            covariances[2, row, col] = both_spread[row, col]
            covariances[3, row, col] = more[row, col]
    return x, P, motions, covariances


@njit(cache=True, nogil=True)
def _over(x: Floats, P: Floats, span_s: float) -> tuple[Floats, Floats]:
    """Motion (3,) of a velocity over a span, and its covariance (3, 3)."""
    motion = np.empty(3)
    for k in range(3):
        motion[k] = x[k] * span_s
    return motion, scaled3(P, span_s * span_s)


@njit(cache=True, nogil=True)
def _log_ratio(
    wheels: Floats,
    of_wheels: Floats,
    steady: Floats,
    of_steady: Floats,
    found: Floats,
    of_found: Floats,
) -> float:
    """Log of how much more probable what was found (3,) is by odometry than by the velocity."""
    for_it = log_density(less3(wheels, found), sum3(of_wheels, of_found))
    return for_it - log_density(less3(steady, found), sum3(of_steady, of_found))


@njit(cache=True, nogil=True)
def _along_path(
    increment: Floats, wheels: WheelsKnown, holds: float, steady: Floats, of_steady: Floats
) -> tuple[Floats, Floats]:
    """Motion (3,) that odometry tells, and its covariance (3, 3) where it may have failed."""
    motion, held = told(increment, wheels.path_excess, wheels.errors, wheels.covariance)
    total = np.zeros((3, 3))
    _add_spread(total, holds, held, np.zeros(3))
    _add_spread(total, 1.0 - holds, of_steady, less3(steady, motion))
    return motion, total


@njit(cache=True, nogil=True)
def _learned(
    factor: float, steady: Floats, of_steady: Floats, moved: Floats, of_moved: Floats
) -> float:
    """Bring the unsteadiness, at least 1, nearer to what the latest miss calls for."""
    squared = squared_sigmas(less3(steady, moved), sum3(scaled3(of_steady, 1.0 / factor), of_moved))
    return max(1.0, _MEMORY * factor + (1.0 - _MEMORY) * squared / 3.0)
