# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Constraints between graph nodes with covariances: from matches, from odometry, from closures."""

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
from slarm_graph.geometry import Floats, Pose2, symmetric, transform_covariances

_ODOMETRY_FLOOR = np.diag([0.003, 0.003, 0.0015]) ** 2
"""Least of a keyframe's match to the local map [m, m, rad]. With half of it, and of the closures',
graduated non-convexity rejects every closure of the paper's room."""
_CORRELATION_FACTOR = 3.0
"""Inflation of a keyframe's variance along the path: neighbours are matched to one local map, and
with a correlation of one half 1 + 2 (1/2 + 1/4 + ...) = 3 times as much adds up. With a tenth, true
closures are rejected where matches are uncertain; a third changes plain ones by at most 1 %."""
_CLOSURE_FLOOR = np.diag([0.02, 0.02, 0.006]) ** 2
"""Least of a keyframe's match to an old submap [m, m, rad]: two fifths of a cell, as far as these
bend. With half of it graduated non-convexity rejects a quarter of the closures that a robot of a
narrow view needs (0.047 m in place of 0.040, mean of three drives); plain recordings change by
1 %."""
_UNINFORMED = np.array([300.0, 300.0, math.pi / math.sqrt(3.0)])
"""Standard deviations of an uninformed step [m, m, rad]: buildings are no larger, and a heading is
uniform on the circle. What minutes without a match add up to is beyond reason."""
_INFORMATION_FLOOR = np.diag([1.0, 1.0, 10.0])
"""Added to a closure's, so that it is invertible: a metre, and a third of a radian. Half and double
change nothing (edmonton, mit-csail plain and with hard_1_of_2)."""


def matched_step(node: int, keyframes: Sequence[Keyframe]) -> Constraint:
    """Constraint from the previous node to a node by the scan matches of the keyframes in between.

    Parameters
    ----------
    node : int
    keyframes : sequence
        From the previous node to this one, both included.
    """
    before, last = keyframes[0].local_from_robot, keyframes[-1].local_from_robot
    matches, floor = np.zeros((3, 3)), np.zeros((3, 3))
    for keyframe in keyframes[1:]:
        last_from_keyframe = keyframe.local_from_robot.between(last).inverse().as_array()
        match = _CORRELATION_FACTOR * _match_covariance(keyframe)
        matches += transform_covariances(last_from_keyframe, match)
        floor += transform_covariances(last_from_keyframe, _ODOMETRY_FLOOR)
    total = matches + floor
    factors = clamping_factors(total)
    covariance, shared = symmetric(total * factors), symmetric(matches * factors)
    step = before.between(last)
    return Constraint(node - 1, node, step, covariance, ConstraintKind.SCAN_MATCH, shared)


def _match_covariance(keyframe: Keyframe) -> Floats:
    """Covariance (3, 3) of a keyframe's scan match: uninformed where odometry alone placed it.

    Odometry has a constraint of its own, and is counted once.
    """
    if keyframe.is_matched or keyframe.wheels is None:
        return keyframe.covariance
    return np.diag(_UNINFORMED**2)


def wheels_step(node: int, keyframes: Sequence[Keyframe]) -> Constraint | None:
    """Return the same by odometry alone; None where it has gaps.

    Odometry is read at a scan's stamp, a sweep is matched at its middle: the motion between the two
    and the reading error add to the covariance at either end, and there alone.
    """
    wheels = functools.reduce(chained, [keyframe.wheels for keyframe in keyframes[1:]])
    if wheels is None:
        return None
    motion = Pose2.from_array(wheels.motion)
    first, last = (keyframes[k].lag_covariance + np.diag(wheels.reading_variances) for k in (0, -1))
    before = transform_covariances(motion.inverse().as_array(), first)
    readings = _ODOMETRY_FLOOR + before + last
    both = (wheels.total_covariance() + readings, wheels.total_covariance_if_working() + readings)
    total, nominal = (symmetric(covariance * clamping_factors(covariance)) for covariance in both)
    return Constraint(node - 1, node, motion, total, ConstraintKind.ODOMETRY, unfailed=nominal)


def closure_constraint(
    closure: Closure, node: int, keyframe: Keyframe, anchor: Keyframe
) -> Constraint:
    """Constraint between two nodes from a keyframe matched to an old submap.

    Parameters
    ----------
    closure : Closure
    node : int
        The keyframe's.
    keyframe : Keyframe
    anchor : Keyframe
        The node's.
    """
    keyframe_from_anchor = keyframe.local_from_robot.between(anchor.local_from_robot)
    measured = Pose2.from_array(closure.submap_from_keyframe) @ keyframe_from_anchor
    anchor_from_keyframe = keyframe_from_anchor.inverse().as_array()
    own = invert3(closure.information + _INFORMATION_FLOOR)
    match, floor = (transform_covariances(anchor_from_keyframe, c) for c in (own, _CLOSURE_FLOOR))
    covariance = symmetric(match + floor)
    kind = ConstraintKind.LOOP_CLOSURE
    return Constraint(closure.submap, node, measured, covariance, kind, symmetric(match))


def clamping_factors(covariance: Floats) -> Floats:
    """Return the factors (3, 3) that limit a covariance (3, 3) to that of an uninformed step.

    Parameters
    ----------
    covariance : (3, 3) float64
        In the body frame [m^2, m rad, rad^2].
    """
    sigmas = np.sqrt(np.diag(covariance))
    least = _UNINFORMED / np.maximum(sigmas, _UNINFORMED)
    return np.outer(least, least)
