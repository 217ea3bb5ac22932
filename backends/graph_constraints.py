# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Constraints between nodes of the graph: what keyframes and closures say, and how surely."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence

import numpy as np

from slarm_graph.constraint import Constraint, ConstraintKind
from slarm_graph.frontends.scans.closures import Closure
from slarm_graph.frontends.scans.small_matrix import invert3
from slarm_graph.frontends.scans.submaps import Keyframe
from slarm_graph.frontends.scans.wheel_motion import chained
from slarm_graph.geometry import Floats, Pose2

_ODOMETRY_FLOOR = np.diag([0.003, 0.003, 0.0015]) ** 2
"""Of a keyframe's place on the local map, whatever its points say [m, m, rad]. Half of it, and of
the closures' floor, has graduated non-convexity turn down every closure of the paper's room."""
_ADDS_UP = 3.0
"""Of a keyframe's variance, along a way: neighbours are matched to one local map and err alike;
with a correlation of one half 1 + 2 (1/2 + 1/4 + ...) = 3 times as much adds up. With a tenth, true
closures are voted down where matches are unsure; a third of it changes the plain recordings by 1 %
at most."""
_CLOSURE_FLOOR = np.diag([0.02, 0.02, 0.006]) ** 2
"""Of a keyframe's place on an old submap [m, m, rad]: two fifths of a cell, as far as submaps bend.
Half of it has graduated non-convexity vote down a quarter of the closures that a robot of a narrow
view needs (0.047 m in place of 0.040, mean of three drives); plain recordings change by 1 %."""
_NOTHING_KNOWN = np.array([300.0, 300.0, math.pi / math.sqrt(3.0)])
"""Standard deviations of a step of which nothing is known [m, m, rad]: buildings are no larger, and
of a heading that of any on the circle. What a silence of minutes adds up to is beyond reason."""
_INFORMATION_FLOOR = np.diag([1.0, 1.0, 10.0])
"""Of a closure, so that it can be inverted: a metre, and a third of a radian. Half and double
change nothing (edmonton, mit-csail plain and with hard_1_of_2)."""


def matched_step(node: int, keyframes: Sequence[Keyframe]) -> Constraint:
    """Constraint to a node from the one before by the matches of the keyframes in between.

    Parameters
    ----------
    node : int
    keyframes : sequence
        From the node before to this one, both included.
    """
    before, last = keyframes[0].local_from_robot, keyframes[-1].local_from_robot
    matches, floor = np.zeros((3, 3)), np.zeros((3, 3))
    for keyframe in keyframes[1:]:
        onwards = keyframe.local_from_robot.between(last)
        matches += _carried(_ADDS_UP * _of_match(keyframe), onwards)
        floor += _carried(_ODOMETRY_FLOOR, onwards)
    total = matches + floor
    within = limits_of(total)
    covariance, shared = _symmetric(total * within), _symmetric(matches * within)
    step = before.between(last)
    return Constraint(node - 1, node, step, covariance, ConstraintKind.ODOMETRY, shared)


def _of_match(keyframe: Keyframe) -> Floats:
    """Covariance (3, 3) of what a keyframe's match says: nothing where odometry placed it.

    That tells of its own, and counts once.
    """
    if keyframe.is_matched or keyframe.wheels is None:
        return keyframe.covariance
    return np.diag(_NOTHING_KNOWN**2)


def wheels_step(node: int, keyframes: Sequence[Keyframe]) -> Constraint | None:
    """Return the same by odometry alone; None where it was not known throughout.

    Odometry is read at a scan's stamp, a sweep is matched in its middle: at either end, and there
    alone, the way between adds to what odometry is unsure of, and what reading it was off.
    """
    wheels = functools.reduce(chained, [keyframe.wheels for keyframe in keyframes[1:]])
    if wheels is None:
        return None
    motion = Pose2.from_array(wheels.motion)
    first, last = (keyframes[k].lag_covariance + np.diag(wheels.reading_variances) for k in (0, -1))
    readings = _ODOMETRY_FLOOR + _carried(first, motion) + last
    told = (wheels.total_covariance() + readings, wheels.total_covariance_if_working() + readings)
    total, held = (_symmetric(covariance * limits_of(covariance)) for covariance in told)
    return Constraint(node - 1, node, motion, total, ConstraintKind.WHEELS, unfailed=held)


def closure_constraint(
    closure: Closure, node: int, keyframe: Keyframe, anchor: Keyframe
) -> Constraint:
    """Turn a keyframe found in a submap into a constraint between two nodes.

    Parameters
    ----------
    closure : Closure
    node : int
        The keyframe's.
    keyframe : Keyframe
    anchor : Keyframe
        That the node stands at.
    """
    from_anchor = keyframe.local_from_robot.between(anchor.local_from_robot)
    measured = Pose2.from_array(closure.submap_from_keyframe) @ from_anchor
    match = _carried(invert3(closure.information + _INFORMATION_FLOOR), from_anchor)
    covariance = _symmetric(match + _carried(_CLOSURE_FLOOR, from_anchor))
    kind = ConstraintKind.LOOP_CLOSURE
    return Constraint(closure.submap, node, measured, covariance, kind, _symmetric(match))


def limits_of(covariance: Floats) -> Floats:
    """Return the factors (3, 3) that leave of a covariance (3, 3) no more than nothing known.

    Parameters
    ----------
    covariance : (3, 3) float64
        In the body frame [m^2, m rad, rad^2].
    """
    sigmas = np.sqrt(np.diag(covariance))
    least = _NOTHING_KNOWN / np.maximum(sigmas, _NOTHING_KNOWN)
    return np.outer(least, least)


def _carried(covariance: Floats, motion: Pose2) -> Floats:
    """Covariance (3, 3) of a pose in its body frame, in the frame that a motion leads to."""
    adjoint = motion.inverse().adjoint()
    return np.asarray(adjoint @ covariance @ adjoint.T)


def _symmetric(covariance: Floats) -> Floats:
    return np.asarray(0.5 * (covariance + covariance.T))
