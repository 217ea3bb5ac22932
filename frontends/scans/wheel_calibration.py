# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""What wheel odometry gets wrong systematically, and how sure it is of a motion.

Systematic errors are three numbers: the scale of the way, the scale of turns, and a turn per metre
(unequal wheels), as in Borenstein and Feng, "Measurement and Correction of Systematic Odometry
Errors in Mobile Robots", IEEE T-RA 12(6), 1996. They are a Gaussian state, measured by every match.
"""

from __future__ import annotations

import copy
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slarm_graph.frontends.scans.odometry_noise import OdometryNoise
from slarm_graph.frontends.scans.small_matrix import (
    invert3,
    less3,
    more3,
    product3,
    sandwich3,
    scaled3,
    sum3,
    symmetric3,
    times3,
    with_diagonal3,
)
from slarm_graph.frontends.scans.small_pose import wrapped
from slarm_graph.geometry import Floats
from slarm_graph.kernels import kernel

_UNSURE = np.array([0.1, 0.1, 0.035])
"""Of the systematic errors before they are known [1, 1, rad/m]: 10 % of way and turns, 2 deg/m."""
_CHANGES_M = 200.0
"""Way in which their variance doubles: loads, tyres, floors."""
_FLOOR = np.array([0.004, 0.004, 0.004])
"""Noise of a step of length zero [m, m, rad]: encoder ticks, and stamps off by a few ms."""
_PER_DISTANCE = np.array([0.05, 0.03, 0.05])
"""Noise of the way and the turn per metre, before it is learned [m/m, m/m, rad/m]."""
_PER_ANGLE = np.array([0.03, 0.03, 0.10])
"""The same per radian turned [m/rad, m/rad, rad/rad]."""
_NOTHING = 1e6
"""Variance of a measurement that tells nothing [m^2, rad^2]: a kilometre."""
_TAIL = 4.0
"""Degrees of freedom of Student's distribution for misses, as Lange, Little and Taylor ("Robust
Statistical Modeling Using the t Distribution", JASA 84, 1989) advise where they are not estimated:
a miss of five sigmas counts a sixth. With half a hall is 0.072 m in place of 0.075 (mean of three)
and edmonton 0.89 in place of 0.71 (one of three draws), with double 0.092 and 0.68, with no tails
0.090 in place of 0.079 (of eight); mit-csail and fr-clinic 5.6 m deep move less than by draws."""
_MOVED_M, _MOVED_RAD = 0.005, 0.005
"""Shorter steps tell nothing of the errors of driving."""


class WheelsKnown(NamedTuple):
    """What is known of odometry as compiled code takes it: of calibration and noise."""

    excess: Floats
    path_excess: Floats
    errors: Floats
    covariance: Floats


class WheelCalibration:
    """Systematic errors of odometry as known so far, and the noise that is left of it."""

    def __init__(self) -> None:
        self.errors: Floats = np.zeros(3)
        """Scale of the way and of turns, less 1, and turn per metre [1, 1, rad/m]."""
        self.covariance: Floats = np.diag(_UNSURE**2)
        """Of the errors (3, 3)."""
        self.noise = OdometryNoise()

    def branched(self) -> WheelCalibration:
        """Return a calibration of its own that has learned the same so far."""
        other = copy.copy(self)
        other.noise = self.noise.branched()
        return other

    @property
    def known(self) -> WheelsKnown:
        """What is known so far, for compiled code."""
        return WheelsKnown(self.noise.excess, self.noise.path_excess, self.errors, self.covariance)

    def interrupt(self) -> None:
        """Note that the next match does not follow one."""
        self.noise.interrupt()

    def learn(self, increment: Floats, moved: Floats, claimed: Floats, share: float) -> None:
        """Learn from the way between two matches, in so far as odometry held.

        Parameters
        ----------
        increment : (3,) float64
            By odometry [m, m, rad].
        moved : (3,) float64
            From one match, odometry left aside, to the next [m, m, rad].
        claimed : (3,) float64
            Variances of a match by its points alone.
        share : float
            Probability that odometry held in this step.
        """
        distance = math.hypot(increment[0], increment[1])
        if share < 0.5 or (distance < _MOVED_M and abs(increment[2]) < _MOVED_RAD):
            self.noise.interrupt()
            return
        noises = self.noise.excess, self.noise.match_excess
        self.errors, self.covariance, miss, guess, tells = _learned(
            self.errors, self.covariance, increment, moved, claimed, noises
        )
        self.noise.learn(miss, guess, claimed, tells)


@kernel
def effect_of(increment: Floats) -> Floats:
    """Derivative (3, 3) of the motion by the systematic errors."""
    x, y, turn = increment
    effect = np.zeros((3, 3))
    effect[0, 0], effect[1, 0] = x, y
    effect[2, 1], effect[2, 2] = turn, math.hypot(x, y)
    return effect


@kernel
def _noise(increment: Floats) -> Floats:
    """Guessed variances (3,) of an increment's noise."""
    distance = math.hypot(increment[0], increment[1])
    noise = np.empty(3)
    for k in range(3):
        sigma = _FLOOR[k] + _PER_DISTANCE[k] * distance + _PER_ANGLE[k] * abs(increment[2])
        noise[k] = sigma * sigma
    return noise


@kernel
def told(
    increment: Floats, excess: Floats, errors: Floats, covariance: Floats
) -> tuple[Floats, Floats]:
    """Motion (3,) that an increment (3,) means, and its covariance, by the systematic errors."""
    effect = effect_of(increment)
    guess, spread = _noise(increment), sandwich3(effect, covariance)
    for k in range(3):
        spread[k, k] += excess[k] * guess[k]
    return more3(increment, times3(effect, errors)), spread


@kernel
def unlearned(increment: Floats, excess: Floats, path_excess: Floats) -> Floats:
    """Return how much the covariance (3, 3) of a step is more where many steps add up.

    Along a path, odometry errs alike for many steps; from one scan to the next that is hidden.
    """
    guess, more = _noise(increment), np.zeros((3, 3))
    for k in range(3):
        more[k, k] = max(path_excess[k] - excess[k], 0.0) * guess[k]
    return more


@kernel
def _learned(
    errors: Floats,
    covariance: Floats,
    increment: Floats,
    moved: Floats,
    claimed: Floats,
    noises: tuple[Floats, Floats],
) -> tuple[Floats, Floats, Floats, Floats, NDArray[np.bool_]]:
    """Update the systematic errors by one step.

    Parameters
    ----------
    errors, covariance : (3,), (3, 3) float64
    increment, moved, claimed : (3,) float64
        As for `WheelCalibration.learn`.
    noises : tuple of two (3,) float64
        Variances of odometry and of a match, over the guessed and the claimed one.

    Returns
    -------
    errors, covariance : (3,), (3, 3) float64
    miss, guess : (3,) float64
        Of the motion, within three sigmas, and odometry's guessed variances.
    tells : (3,) bool
        Along which axes the match tells anything.
    """
    effect, guess = effect_of(increment), _noise(increment)
    miss = less3(moved, more3(increment, times3(effect, errors)))
    miss[2] = wrapped(miss[2])
    # A match less certain than odometry tells nothing of it, such as along a bare corridor.
    tells, noise = np.empty(3, dtype=np.bool_), np.empty(3)
    for k in range(3):
        tells[k] = claimed[k] < guess[k]
        noise[k] = noises[0][k] * guess[k] + 2.0 * noises[1][k] * claimed[k]
        noise[k] = noise[k] if tells[k] else _NOTHING
    doubted = _doubted(miss, noise, sandwich3(effect, covariance))
    errors, covariance = _updated(errors, covariance, effect, miss, doubted)
    aged = scaled3(covariance, 1.0 + math.hypot(increment[0], increment[1]) / _CHANGES_M)
    share = 1.0
    for k in range(3):
        share = min(share, _UNSURE[k] * _UNSURE[k] / aged[k, k])
    # Beyond three sigmas a miss is an event, not noise.
    for k in range(3):
        limit = 3.0 * math.sqrt(noise[k])
        miss[k] = min(max(miss[k], -limit), limit)
    return errors, scaled3(aged, share), miss, guess, tells


@kernel
def _doubted(miss: Floats, noise: Floats, spread: Floats) -> Floats:
    """Variances (3,) of a noise with heavy tails, by how large a miss (3,) it comes with.

    Parameters
    ----------
    miss, noise : (3,) float64
        Along each axis, and the variance that is usual there.
    spread : (3, 3) float64
        Of the miss by what is not known of the systematic errors.
    """
    out = np.empty(3)
    for k in range(3):
        squared = miss[k] * miss[k] / (noise[k] + spread[k, k])
        out[k] = noise[k] * max(1.0, (_TAIL + squared) / (_TAIL + 1.0))
    return out


@kernel
def _updated(
    errors: Floats, covariance: Floats, effect: Floats, miss: Floats, noise: Floats
) -> tuple[Floats, Floats]:
    """Kalman update of a state (3,) and its covariance by a miss (3,), in Joseph's form."""
    innovation = with_diagonal3(sandwich3(effect, covariance), noise)
    gain = product3(product3(covariance, effect.T), invert3(innovation))
    left = sum3(np.eye(3), scaled3(product3(gain, effect), -1.0))
    spread = with_diagonal3(np.zeros((3, 3)), noise)
    joseph = sum3(sandwich3(left, covariance), sandwich3(gain, spread))
    return more3(errors, times3(gain, miss)), symmetric3(joseph)
