# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Check whether scans and odometry agree on the motion, and which wrong mounting would explain it.

Pairs of scans are matched without the odometry. A laser whose transform has a wrong angle turns
every matched translation by that angle; one that hangs upside down, or odometry with a wrong sign,
reverses every rotation; a wheel of another size scales all steps.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slarm_graph.config import FrontendConfig
from slarm_graph.geometry import Floats, Pose2, between
from slarm_graph.readings import LaserScan

STEP_M, STEP_RAD = 0.2, 0.2
"""Motion between the scans of a pair: far more than a match is wrong by (1 cm), far less than what
makes two views differ. Halved, the angle of a step is twice as uncertain."""
REACH_M, REACH_RAD = 0.9, 0.7
"""Search window of the matching, in every direction; steps up to two thirds of it are used."""
MOST_PAIRS = 40
"""Most pairs that are matched, spread over the recording: a third of a second."""
LEAST_PAIRS = 8
"""Fewest matches for a conclusion: one in ten is wrong in repetitive places."""
CERTAIN_M = 0.05
"""Largest standard deviation [m] of a match in any direction; larger ones, as along a corridor,
determine no direction."""
STRAIGHT_RAD = 0.1
"""Largest rotation of a step used for the direction; the laser's lever arm distorts others."""
NOTICED_RAD = math.radians(6.0)
"""Least reported angle: over eight real robots the mean of the steps is off by 0.2 to 2.3
degrees, which is how well mountings are known."""
UNANIMOUS = 0.9
"""Mean resultant length of the angles between steps (1 when all are equal; 0.9 is a spread of 26
degrees), and share of pairs that agree in sign."""
LONGEST_STEP_M = 5.0
"""Between scans no robot drives as far: at the slowest rate in use, a scan a second, it would be at
5 m/s; millimetres taken for metres are a thousandfold."""
SCALE = 1.5
"""Least reported ratio of lengths; slipping wheels are within a tenth or two."""


@dataclass(frozen=True, slots=True)
class MotionPairs:
    """Steps between scans, as matched and by the odometry, (N, 3) each [m, m, rad]."""

    matched: Floats
    odometry: Floats


def disagreement(
    scan_at: Callable[[int], LaserScan], poses: Floats, known: NDArray[np.bool_]
) -> str:
    """Return a notice on how scans and odometry contradict each other; empty when they agree.

    Parameters
    ----------
    scan_at : callable
        Returns the scan of an index.
    poses : (M, 3)
        `odom_from_robot` at every scan.
    known : (M,) bool
        Where there is odometry.
    """
    if told := _too_far(poses[known]):
        return told
    pairs = _matched_pairs(scan_at, poses, _steps(poses, known))
    for contradiction in (_stands_still, _rotation_reversed, _mounting_turned, _scale_differs):
        if told := contradiction(pairs):
            return told
    return ""


def _steps(poses: Floats, known: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Choose pairs of scans with a step between them, spread over the recording."""
    rows = np.flatnonzero(known)
    found: list[tuple[int, int]] = []
    last = 0
    for start in np.unique(np.linspace(0, max(len(rows) - 2, 0), 6 * MOST_PAIRS).astype(int)):
        if len(rows) < 3 or start < last:
            continue
        ahead = rows[start + 1 : start + 60]
        step = between(poses[rows[start]], poses[ahead])
        length_m, turn_rad = np.hypot(step[:, 0], step[:, 1]), np.abs(step[:, 2])
        enough = (length_m >= STEP_M) | (turn_rad >= STEP_RAD)
        near = (length_m <= REACH_M / 1.5) & (turn_rad <= REACH_RAD / 1.5)
        first = int(np.argmax(enough)) if enough.any() else -1
        if first >= 0 and near[first]:
            found.append((int(rows[start]), int(ahead[first])))
            last = start + first + 1
    if len(found) > MOST_PAIRS:
        found = [found[n] for n in np.linspace(0, len(found) - 1, MOST_PAIRS).astype(int)]
    return found


def _matched_pairs(
    scan_at: Callable[[int], LaserScan], poses: Floats, steps: list[tuple[int, int]]
) -> MotionPairs:
    """Match the scans of every pair without initial guess; uncertain matches are dropped."""
    from slarm_graph.frontends.scans.matcher import CorrelativeConfig, CorrelativeMatcher
    from slarm_graph.frontends.scans.scan_filter import points_for_matching

    config = FrontendConfig()
    window = CorrelativeConfig(reach_m=REACH_M, reach_rad=REACH_RAD)
    matcher = CorrelativeMatcher(window, config.matching)
    matched, odometry = [], []
    for earlier, later in steps:
        target, source = (points_for_matching(scan_at(row), config) for row in (earlier, later))
        match = matcher.match(source, target, target_from_source=Pose2())
        if match and _is_certain(match.covariance):
            matched.append(match.target_from_source.as_array())
            odometry.append(between(poses[earlier], poses[later]))
    return MotionPairs(np.array(matched).reshape(-1, 3), np.array(odometry).reshape(-1, 3))


def _is_certain(covariance: Floats) -> bool:
    return float(np.linalg.eigvalsh(covariance[:2, :2])[-1]) < CERTAIN_M**2


def _too_far(poses: Floats) -> str:
    """Whether most steps from scan to scan are longer than any robot's."""
    steps = np.abs(np.diff(poses[:, :2], axis=0)).max(axis=1) if len(poses) > 1 else np.zeros(0)
    moving = steps[steps > 0]
    if len(moving) < LEAST_PAIRS or np.median(moving) < LONGEST_STEP_M:
        return ""
    return (
        f"the odometry usually moves {np.median(moving):.3g} m from one scan to the next: its"
        " positions are not metres (millimetres?); use --odom none"
    )


def _stands_still(pairs: MotionPairs) -> str:
    """Whether the scans tell of no motion at all."""
    seen, told = (
        np.column_stack([np.hypot(p[:, 0], p[:, 1]), np.abs(p[:, 2])])
        for p in (pairs.matched, pairs.odometry)
    )
    still = np.all(seen < 0.1 * np.maximum(told, (STEP_M, STEP_RAD)), axis=1)
    if len(still) < LEAST_PAIRS or still.mean() < UNANIMOUS:
        return ""
    return (
        f"the scans do not move although the odometry does in {len(still)} compared steps: the"
        " laser sees only the robot itself, its driver is stuck, or the wheels spin freely"
    )


def _rotation_reversed(pairs: MotionPairs) -> str:
    """Whether all rotations have the other sign."""
    turning = np.abs(pairs.odometry[:, 2]) > STRAIGHT_RAD
    ratio = pairs.matched[turning, 2] / pairs.odometry[turning, 2]
    if len(ratio) < LEAST_PAIRS or np.mean(ratio < -0.5) < UNANIMOUS:
        return ""
    return (
        f"scans and odometry turn opposite ways in {np.count_nonzero(ratio < -0.5)} of {len(ratio)}"
        " compared steps: the laser is upside down (then the map is mirrored: give a roll of pi"
        " with --static-tf 'PARENT LASER x y z yaw 0 3.1416'), or the odometry's yaw has the wrong"
        " sign (then use --odom none)"
    )


def _mounting_turned(pairs: MotionPairs) -> str:
    """Whether all translations are turned by one angle."""
    straight = _straight(pairs)
    matched, odometry = pairs.matched[straight], pairs.odometry[straight]
    if len(matched) < LEAST_PAIRS:
        return ""
    angles = np.arctan2(odometry[:, 1], odometry[:, 0]) - np.arctan2(matched[:, 1], matched[:, 0])
    mean = np.exp(1j * angles).mean()
    turn = float(np.angle(mean))
    if abs(mean) < UNANIMOUS or abs(turn) < NOTICED_RAD:
        return ""
    return (
        f"scans and odometry move in directions {abs(math.degrees(turn)):.0f} deg apart in"
        f" {len(matched)} compared steps: a mounting yaw of the laser larger by"
        f" {math.degrees(turn):+.0f} deg explains it; else the whole map and every access point"
        " are turned. Check the transform of the laser (--static-tf)"
    )


def _scale_differs(pairs: MotionPairs) -> str:
    """Whether all translations are longer or shorter by one ratio."""
    straight = _straight(pairs)
    lengths = [np.hypot(p[straight, 0], p[straight, 1]) for p in (pairs.odometry, pairs.matched)]
    if len(lengths[0]) < LEAST_PAIRS:
        return ""
    ratio = float(np.median(lengths[0] / np.maximum(lengths[1], 1e-3)))
    agree = np.abs(lengths[0] / np.maximum(lengths[1], 1e-3) / ratio - 1.0) < 0.25
    if 1 / SCALE < ratio < SCALE or agree.mean() < UNANIMOUS:
        return ""
    return (
        f"the odometry's steps are {ratio:.2g} times as long as those of the scans in"
        f" {len(agree)} compared steps: wrong units, or wheels of another size; use --odom none"
    )


def _straight(pairs: MotionPairs) -> NDArray[np.bool_]:
    """Return which steps are long and straight enough to determine a direction."""
    length = np.hypot(pairs.odometry[:, 0], pairs.odometry[:, 1])
    return np.asarray(
        (length >= 0.5 * STEP_M)
        & (np.abs(pairs.odometry[:, 2]) < STRAIGHT_RAD)
        & (np.abs(pairs.matched[:, 2]) < 2 * STRAIGHT_RAD)
    )
