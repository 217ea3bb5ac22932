# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Weighing odometry against velocity, compiled: what `OdometryFilter` works out at every scan."""

from __future__ import annotations

import math

import numpy as np

from slarm_graph.frontends.scans.kalman import updated
from slarm_graph.frontends.scans.significance import CHI2_1_PERCENT
from slarm_graph.frontends.scans.small_matrix import less3, scaled3, sum3, with_diagonal3
from slarm_graph.frontends.scans.small_pose import (
    BASIN,
    SEARCHED,
    log_density,
    log_volume,
    squared_sigmas,
    wrapped,
)
from slarm_graph.frontends.scans.wheel_calibration import WheelsKnown, effect_of, told, unlearned
from slarm_graph.geometry import Floats
from slarm_graph.kernels import kernel

ACCELERATION = np.array([1.0, 0.5, 2.0])
"""Of indoor robots, sideways by what turning mixes in [m/s^2, m/s^2, rad/s^2]; scaled by what is
learned, so only the first scans depend on it."""
_MEMORY = 0.95
"""Of the learned unsteadiness: 20 scans, about the length of a manoeuvre at 10 Hz."""
_SCALES = math.log(float(SEARCHED[0]) / math.sqrt(float(BASIN[0, 0])))
"""From what is one place to as far as is searched, in multiples by e."""


@kernel
def add_spread(total: Floats, probability: float, covariance: Floats, apart: Floats) -> None:
    """Add what one of several predictions, so far apart (3,), has in their spread (3, 3)."""
    apart[2] = wrapped(apart[2])
    for row in range(3):
        for col in range(3):
            total[row, col] += probability * (covariance[row, col] + apart[row] * apart[col])


@kernel
def accelerated(covariance: Floats, span_s: float, factor: float) -> Floats:
    """Covariance (3, 3) of a velocity after a span, what it gains in it times a factor."""
    gained = np.empty(3)
    for k in range(3):
        gained[k] = factor * (ACCELERATION[k] * span_s * (ACCELERATION[k] * span_s))
    return with_diagonal3(covariance, gained)


@kernel
def weighed(
    velocity: tuple[Floats, Floats],
    span_s: float,
    increment: Floats,
    wheels: WheelsKnown,
    lag: Floats,
    steps: float,
) -> tuple[Floats, Floats, Floats, Floats]:
    """Weigh a velocity and an increment of odometry.

    Parameters
    ----------
    velocity : (3,) and (3, 3) float64
        Of the robot in its own frame, and its covariance.
    span_s : float
    increment : (3,) float64
        By odometry [m, m, rad].
    wheels : WheelsKnown
    lag : (3,) float64
        Variances of the increment by when it was read [m^2, m^2, rad^2].
    steps : float
        How many usual steps the span is.

    Returns
    -------
    x, P : (3,), (3, 3) float64
        Velocity, of which odometry has told where the two agree.
    motions : (3, 3) float64
        By the velocity alone, by odometry alone, and by both.
    covariances : (4, 3, 3) float64
        Of these, and what errors that add up have more.
    """
    (x, P), motions, covariances = velocity, np.empty((3, 3)), np.empty((4, 3, 3))
    told_motion, noise = told(increment, wheels.excess, wheels.errors, wheels.covariance)
    noise = with_diagonal3(_levered(noise, told_motion, steps), lag)
    steady, spread = over(x, P, span_s)
    both, both_spread = told_motion, noise
    if squared_sigmas(less3(told_motion, steady), sum3(spread, noise)) < CHI2_1_PERCENT:
        x, P = updated(x, P, told_motion, noise, scaled3(np.eye(3), span_s))
        both, both_spread = over(x, P, span_s)
    more = unlearned(increment, wheels.excess, wheels.path_excess)
    for row in range(3):
        motions[0, row], motions[1, row], motions[2, row] = steady[row], told_motion[row], both[row]
        for col in range(3):
            covariances[0, row, col] = spread[row, col]
            covariances[1, row, col] = noise[row, col]
            covariances[2, row, col] = both_spread[row, col]
            covariances[3, row, col] = more[row, col]
    return x, P, motions, covariances


@kernel
def _levered(covariance: Floats, motion: Floats, steps: float) -> Floats:
    """Covariance (3, 3) of a motion (3,) of many steps, each of which may have turned wrongly.

    What a step turns is carried aside by those after it: of a heading error that grows evenly over
    n steps, sums over (n - k)^2 / n^3 and (n - k) / n^2 of its variance. One step carries nothing.
    """
    cos, sin = math.cos(motion[2]), math.sin(motion[2])
    aside = sin * motion[0] - cos * motion[1], cos * motion[0] + sin * motion[1]
    square = (1.0 - 1.0 / steps) * (1.0 - 0.5 / steps) / 3.0
    cross = 0.5 * (1.0 - 1.0 / steps)
    out = covariance.copy()
    for row in range(2):
        out[row, 2] += cross * aside[row] * covariance[2, 2]
        out[2, row] = out[row, 2]
        for col in range(2):
            out[row, col] += square * aside[row] * aside[col] * covariance[2, 2]
    return out


@kernel
def over(x: Floats, P: Floats, span_s: float) -> tuple[Floats, Floats]:
    """Motion (3,) of a velocity over a span, and its covariance (3, 3)."""
    motion = np.empty(3)
    for k in range(3):
        motion[k] = x[k] * span_s
    return motion, scaled3(P, span_s * span_s)


@kernel
def log_ratios(
    wheels: Floats,
    of_wheels: Floats,
    steady: Floats,
    of_steady: Floats,
    found: Floats,
    of_found: Floats,
) -> tuple[float, float]:
    """How probable a motion (3,) that was found is by odometry, by velocity, and if false.

    Returns
    -------
    by_wheels, by_velocity : float
        Log of how much more probable it is by odometry than by the velocity, and by the velocity
        than if the match is false: then odometry holds, and the match lies as often at any
        multiple of what is one place as at any other, up to how far is searched.
    """
    away, around = less3(wheels, found), sum3(of_wheels, of_found)
    by_velocity = log_density(less3(steady, found), sum3(of_steady, of_found))
    by_wheels = log_density(away, around) - by_velocity
    around = sum3(around, BASIN)
    times = max(math.sqrt(squared_sigmas(away, around)), 1.0)
    # A shell between two multiples has a volume of 4 pi times their cube over 3, by its axes.
    axes = 0.5 * log_volume(around) - 1.5 * math.log(2.0 * math.pi)
    if_false = -math.log(4.0 * math.pi * _SCALES) - 3.0 * math.log(times) - axes
    return by_wheels, by_velocity - if_false


@kernel
def along_path(
    increment: Floats,
    wheels: WheelsKnown,
    holds: float,
    steady: Floats,
    of_steady: Floats,
    steps: float,
) -> tuple[Floats, Floats, Floats, Floats]:
    """Motion (3,) that odometry tells, its covariance (3, 3) in all and where it holds, and effect.

    The covariances are of what is another in every step. What the systematic errors may yet be off
    by is the same in all, so that their effect (3, 3) adds up instead: the derivative by them, in
    the body frame after the motion.
    """
    motion, held = told(increment, wheels.path_excess, wheels.errors, np.zeros((3, 3)))
    total = np.zeros((3, 3))
    held = _levered(held, motion, steps)
    add_spread(total, holds, held, np.zeros(3))
    add_spread(total, 1.0 - holds, of_steady, less3(steady, motion))
    effect = effect_of(increment)
    cos, sin = math.cos(motion[2]), math.sin(motion[2])
    x, y = effect[0, 0], effect[1, 0]
    effect[0, 0], effect[1, 0] = cos * x + sin * y, cos * y - sin * x
    return motion, total, held, effect


@kernel
def learned_unsteadiness(
    factor: float, steady: Floats, of_steady: Floats, moved: Floats, of_moved: Floats
) -> float:
    """Bring the unsteadiness, at least 1, nearer to what the latest miss calls for."""
    squared = squared_sigmas(less3(steady, moved), sum3(scaled3(of_steady, 1.0 / factor), of_moved))
    return max(1.0, _MEMORY * factor + (1.0 - _MEMORY) * squared / 3.0)
