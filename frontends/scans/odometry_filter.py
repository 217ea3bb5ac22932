# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""How far the robot moved before anything was matched, and how much of that to believe.

Two stories are kept beside each other. Wheels: odometry, its systematic errors calibrated on the
way, with a noise that is learned from how well matches agree. Inertia: the robot went on as before;
true also while wheels slip, encoders hang or odometry jumps. Which of the two holds is a state that
changes rarely: a hidden Markov chain, whose probabilities matches update. Encoders that hang are a
state of their own, since they read the same until they work again, and nobody sees when that was.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from slarm_graph.frontends.scans.kalman import KalmanState
from slarm_graph.frontends.scans.odometry_weighing import (
    ACCELERATION,
    accelerated,
    add_spread,
    along_path,
    learned_unsteadiness,
    log_ratios,
    over,
    weighed,
)
from slarm_graph.frontends.scans.reliability import Reliability
from slarm_graph.frontends.scans.small_pose import between3
from slarm_graph.frontends.scans.wheel_calibration import WheelCalibration
from slarm_graph.frontends.scans.wheel_motion import WheelMotion
from slarm_graph.geometry import Floats, Pose2

_FIRST_SPEED = np.array([0.5, 0.2, 0.5])
"""Standard deviation of the velocity before anything is known [m/s, m/s, rad/s]: indoor robots."""
_ANYWHERE = np.array([1.0, 1.0, 1.5])
"""Speed in a gap of which nothing is known [m/s, m/s, rad/s]."""
_MAX_COASTING_S = 1.0
"""At 1 m/s^2 a velocity older than this says as little as none."""
_NO_LAG = np.zeros(3)
"""Variances (3,) of what was asked for at the stamp itself."""
_FADING = 0.7
"""Velocity kept per scan while nothing is matched: it is gone within a second at 10 Hz."""


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
        add_spread(total, one.probability, one.covariance, one.motion - motion)
        chances += one.probability
    return np.asarray(total / chances)


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
        self.reliability = Reliability()
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
        other.reliability = self.reliability.branched()
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
        self.reliability.begin()
        kalman = self._kalman
        self._measured = None
        self._increment = self._odometry_increment(odom_from_robot)
        if span_s > _MAX_COASTING_S:
            # Odometry that failed in a gap did so in some of its steps.
            told = np.zeros(3) if self._increment is None else self._increment
            kalman.x, kalman.P = told / span, np.diag((_ANYWHERE / span) ** 2)
        else:
            kalman.P = accelerated(kalman.P, span, self._unsteadiness)
        if self._increment is None:
            self._steady_motion = Prediction(*over(kalman.x, kalman.P, span))
            return (self._steady_motion,)
        self.reliability.go_on(self._increment)
        lag = self._lag_variances(lag_s)
        kalman.x, kalman.P, motions, covariances = weighed(
            (kalman.x, kalman.P),
            span,
            self._increment,
            self.wheels.known,
            lag,
            self._steps_in(span),
        )
        holds = self.reliability.holds
        self._steady_motion = Prediction(motions[0], covariances[0], 1.0 - holds)
        self._measured = Prediction(motions[1], covariances[1], holds)
        wheels = Prediction(motions[2], covariances[2], holds, covariances[3])
        both = (wheels, self._steady_motion)
        return both if holds >= 0.5 else both[::-1]

    def correct(self, span_s: float, moved: Floats, covariance: Floats) -> None:
        """Learn the velocity from the motion (3,) (robot frame before from now) that was found."""
        span = max(span_s, 0.5 * self._usual_span_s, 1e-3)
        if self._steady_motion is not None:
            steady = self._steady_motion
            self._unsteadiness = learned_unsteadiness(
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
        ratios = log_ratios(
            wheels.motion, wheels.covariance, steady.motion, steady.covariance, found, covariance
        )
        self.reliability.judge(*ratios)

    def learn(self, moved: Floats, claimed: Floats) -> None:
        """Learn odometry's errors from the way (3,) between two matches; see `WheelCalibration`."""
        if self._increment is not None:
            self.wheels.learn(self._increment, moved, claimed, self.reliability.holds)

    def wheel_motion(self) -> WheelMotion | None:
        """Return the last step by odometry alone; None where there is none.

        As far as odometry may have failed in it, the robot may have gone on as before: mean and
        spread are about the way that odometry tells. See `Reliability` for what speaks against it.
        """
        steady = self._steady_motion
        if self._increment is None or steady is None:
            return None
        motion, covariance, held, effect = along_path(
            self._increment,
            self.wheels.known,
            self.reliability.holds_on_a_path(),
            steady.motion,
            steady.covariance,
            self._steps_in(self._span_s),
        )
        held = held if self.reliability.speaks_against_matches() else covariance
        return WheelMotion(
            motion, covariance, held, self.wheels.noise.reading, effect, self.wheels.covariance
        )

    def coast(self) -> None:
        """Note that nothing was matched: the velocity fades, its uncertainty grows.

        Odometry that holds is followed as it is: a velocity that fades would shorten its steps.
        """
        if self._measured is not None and self.reliability.holds >= 0.5:
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

    def _steps_in(self, span_s: float) -> float:
        """How many usual steps a gap is; one where there is none, whose noise is learned whole."""
        return max(span_s / self._usual_span_s, 1.0) if span_s > _MAX_COASTING_S else 1.0

    def _lag_variances(self, lag_s: float) -> Floats:
        return (ACCELERATION * (self._usual_span_s * lag_s)) ** 2 if lag_s else _NO_LAG

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
