# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Trajectory against odometry: where they part although they agree elsewhere, scans decide."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slarm_graph.consistency.pairs import cross_check
from slarm_graph.consistency.visits import pack_visits, thinned_by_motion, way_along_m
from slarm_graph.geometry import Floats, between, compose, invert, wrap_angles
from slarm_graph.readings import LaserScan
from slarm_graph.trajectory import Trajectory

STEP_M, STEP_RAD = 0.5, 0.5
"""Odometry and trajectory are compared over steps of this motion [m, rad]."""

SPANS = (1, 4)
"""Steps taken together: a jump shows within one, what a graph has spread out within a few."""

LEAST_M, LEAST_RAD = 0.3, 0.14
"""Differences below are never looked at [m, rad]: a tenth of a visit's way, 8 degrees."""

SIGMAS = 6.0
"""Differences from so many robust standard deviations on are looked at, those of the same
recording: odometry that is in agreement everywhere else is a witness."""

RARE = 0.05
"""Share of steps in disagreement up to which odometry is a witness at all."""

AROUND_M = 2.0
"""Way before and after a difference whose scans decide who is right [m]."""

MOST = 40
"""Differences looked at, the largest first."""


@dataclass(frozen=True, slots=True)
class Tear:
    """A step at which the trajectory leaves what odometry says.

    Parameters
    ----------
    stamps_ns : (int, int)
        Of the scans before and after it [ns].
    position_m : (float, float)
        Where the trajectory has the robot before it, in the map [m].
    off : (float, float, float)
        The trajectory's motion, seen from where odometry has it [m, m, rad].
    evidence_nat : float
        Log-likelihood ratio of `odometry is right` over `the trajectory is`, from the scans
        before and after [nat].
    """

    stamps_ns: tuple[int, int]
    position_m: tuple[float, float]
    off: tuple[float, float, float]
    evidence_nat: float


def tears(scans: Sequence[LaserScan], trajectory: Trajectory, odometry: Floats) -> tuple[Tear, ...]:
    """Find the steps where trajectory and odometry part, and ask the scans who is right.

    Parameters
    ----------
    scans : sequence of N LaserScan
    trajectory : Trajectory of N poses
        `map_from_robot`.
    odometry : (N, 3) float64
        `odom_from_robot` [m, m, rad]; nan where there was none.
    """
    stamps_ns, poses = trajectory.stamps_ns, trajectory.poses
    known = np.flatnonzero(np.isfinite(odometry).all(axis=1))
    if len(known) < 3:
        return ()
    nodes = _nodes(poses, odometry, known)
    found: list[tuple[float, int, int, Floats]] = []
    for span in SPANS:
        found += _differences(poses, odometry, nodes, span)
    found.sort(key=lambda row: -row[0])
    chosen: list[tuple[int, int, Floats]] = []
    for _, a, b, off in found:
        if len(chosen) < MOST and all(b <= other[0] or a >= other[1] for other in chosen):
            chosen.append((a, b, off))
    way_m = way_along_m(poses)
    return tuple(
        Tear(
            stamps_ns=(int(stamps_ns[a]), int(stamps_ns[b])),
            position_m=(float(poses[a, 0]), float(poses[a, 1])),
            off=(float(off[0]), float(off[1]), float(off[2])),
            evidence_nat=_evidence(scans, poses, way_m, a, b, off),
        )
        for a, b, off in chosen
    )


def _nodes(poses: Floats, odometry: Floats, known: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the scans at which the robot had moved by a step, whoever says so."""
    by_either = [known[thinned_by_motion(p[known], STEP_M, STEP_RAD)] for p in (poses, odometry)]
    return np.union1d(*by_either)


def _differences(
    poses: Floats, odometry: Floats, nodes: NDArray[np.int64], span: int
) -> list[tuple[float, int, int, Floats]]:
    """Return size in sigmas, first and last scan, and difference of what is out of the ordinary."""
    first, last = nodes[:-span], nodes[span:]
    if len(first) < 8:
        return []
    moved, told = between(poses[first], poses[last]), between(odometry[first], odometry[last])
    told = _calibrated(moved, told)
    off = between(told, moved)
    size_m, size_rad = np.hypot(off[:, 0], off[:, 1]), np.abs(off[:, 2])
    sigma_m, sigma_rad = _spread(size_m, 0.01), _spread(size_rad, 0.005)
    sigmas = np.maximum(size_m / sigma_m, size_rad / sigma_rad)
    large = ((size_m > LEAST_M) & (size_m > SIGMAS * sigma_m)) | (
        (size_rad > LEAST_RAD) & (size_rad > SIGMAS * sigma_rad)
    )
    if large.mean() > RARE and large.sum() > 2 * span:
        return []
    return [(float(sigmas[k]), int(first[k]), int(last[k]), off[k]) for k in np.flatnonzero(large)]


def _calibrated(moved: Floats, told: Floats) -> Floats:
    """Return odometry's motions with scale of way and turn, and drift per metre, set right."""
    out = told.copy()
    along = np.abs(told[:, 0]) > 0.5 * STEP_M
    if along.sum() >= 8:
        out[:, :2] *= np.clip(np.median(moved[along, 0] / told[along, 0]), 0.5, 2.0)
    way = np.hypot(told[:, 0], told[:, 1])
    terms = np.stack([told[:, 2], way], axis=1)
    lack = wrap_angles(moved[:, 2] - told[:, 2])
    weights = np.ones(len(lack))
    for _ in range(8):
        factors = np.linalg.lstsq(terms * weights[:, None], lack * weights, rcond=None)[0]
        left = np.abs(lack - terms @ factors)
        weights = 1.0 / np.sqrt(1.0 + (left / (2.0 * _spread(left, 0.005))) ** 2)
    out[:, 2] = wrap_angles(told[:, 2] + terms @ factors)
    return out


def _spread(sizes: Floats, least: float) -> float:
    """Return a robust standard deviation of sizes about zero."""
    return max(1.4826 * float(np.median(sizes)), least)


def _evidence(
    scans: Sequence[LaserScan], poses: Floats, way_m: Floats, a: int, b: int, off: Floats
) -> float:
    """Return how much better odometry's step explains the scans around it [nat]."""
    before = np.arange(np.searchsorted(way_m, way_m[a] - AROUND_M), a + 1)
    after = np.arange(b, np.searchsorted(way_m, way_m[b] + AROUND_M, side="right"))
    parts = [part[thinned_by_motion(poses[part])] for part in (before, after)]
    visits = pack_visits(scans, poses, way_m, parts)
    if len(visits) < 2:
        return 0.0
    # a_from_b as odometry has it is the trajectory's with the difference taken back.
    told = compose(poses[a], compose(between(poses[a], poses[b]), invert(off)))
    moved = visits.poses.copy()
    moved[1] = compose(compose(told, invert(poses[b])), visits.poses[1])
    torn, whole = (cross_check(visits, p, least_cells=0).evidence() for p in (visits.poses, moved))
    return float(torn.sum() - whole.sum())
