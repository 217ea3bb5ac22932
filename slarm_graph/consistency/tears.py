# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Tears: steps where a trajectory deviates from odometry, and the scans confirm odometry."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slarm_graph.consistency.pairs import cross_check
from slarm_graph.consistency.visits import pack_visits, path_lengths_m, thinned_by_motion
from slarm_graph.geometry import Floats, between, compose, invert, wrap_angles
from slarm_graph.readings import LaserScan
from slarm_graph.trajectory import Trajectory

STEP_M, STEP_RAD = 0.5, 0.5
"""Odometry and trajectory are compared over steps of this motion [m, rad]."""

SPANS = (1, 4)
"""Steps taken together: a jump shows within one, one that a graph distributed within a few."""

MIN_DIFFERENCE_M, MIN_DIFFERENCE_RAD = 0.3, 0.14
"""Differences below are ignored [m, rad]: six cells of a map, 8 degrees."""

SIGMAS = 6.0
"""Differences above so many robust standard deviations of the recording are examined: odometry that
agrees everywhere else is trustworthy."""

LEAST_SIGMA_M, LEAST_SIGMA_RAD = 0.01, 0.005
"""Least of these standard deviations: half of a laser's noise of 0.02 m, and that 4 m away."""

MAX_TEAR_SHARE = 0.05
"""Share of differing steps above which odometry is not trustworthy."""

CONTEXT_M = 2.0
"""Path length before and after a difference whose scans decide which is right [m]."""

MAX_TEARS = 40
"""Differences examined at most, the largest first."""


@dataclass(frozen=True, slots=True)
class Tear:
    """A step at which the trajectory deviates from odometry.

    Parameters
    ----------
    stamps_ns : (int, int)
        Of the scans before and after it [ns].
    position_m : (float, float)
        Of the robot before it, in the map [m].
    off : (float, float, float)
        The trajectory's motion relative to odometry's [m, m, rad].
    evidence_nat : float
        Log-likelihood ratio of odometry's over the trajectory's step, from the scans before and
        after [nat].
    """

    stamps_ns: tuple[int, int]
    position_m: tuple[float, float]
    off: tuple[float, float, float]
    evidence_nat: float


def find_tears(
    scans: Sequence[LaserScan], trajectory: Trajectory, odometry: Floats
) -> tuple[Tear, ...]:
    """Find the steps where the trajectory deviates from odometry, with the evidence of the scans.

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
    outliers: list[tuple[float, int, int, Floats]] = []
    for span in SPANS:
        outliers += _differences(poses, odometry, nodes, span)
    outliers.sort(key=lambda row: -row[0])
    chosen: list[tuple[int, int, Floats]] = []
    for _, a, b, off in outliers:
        if len(chosen) < MAX_TEARS and all(b <= other[0] or a >= other[1] for other in chosen):
            chosen.append((a, b, off))
    path_m = path_lengths_m(poses)
    return tuple(
        Tear(
            stamps_ns=(int(stamps_ns[a]), int(stamps_ns[b])),
            position_m=(float(poses[a, 0]), float(poses[a, 1])),
            off=(float(off[0]), float(off[1]), float(off[2])),
            evidence_nat=_evidence(scans, poses, path_m, a, b, off),
        )
        for a, b, off in chosen
    )


def _nodes(poses: Floats, odometry: Floats, known: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the scans at which the robot had moved by a step, by trajectory or odometry."""
    by_either = [known[thinned_by_motion(p[known], STEP_M, STEP_RAD)] for p in (poses, odometry)]
    return np.union1d(*by_either)


def _differences(
    poses: Floats, odometry: Floats, nodes: NDArray[np.int64], span: int
) -> list[tuple[float, int, int, Floats]]:
    """Return size in sigmas, first and last scan, and difference (3,) of outlying steps."""
    first, last = nodes[:-span], nodes[span:]
    if len(first) < 8:
        return []
    moved, measured = between(poses[first], poses[last]), between(odometry[first], odometry[last])
    measured = _calibrated(moved, measured)
    off = between(measured, moved)
    size_m, size_rad = np.hypot(off[:, 0], off[:, 1]), np.abs(off[:, 2])
    sigma_m, sigma_rad = (
        _robust_sigma(size_m, LEAST_SIGMA_M),
        _robust_sigma(size_rad, LEAST_SIGMA_RAD),
    )
    sigmas = np.maximum(size_m / sigma_m, size_rad / sigma_rad)
    large = ((size_m > MIN_DIFFERENCE_M) & (size_m > SIGMAS * sigma_m)) | (
        (size_rad > MIN_DIFFERENCE_RAD) & (size_rad > SIGMAS * sigma_rad)
    )
    if large.mean() > MAX_TEAR_SHARE and large.sum() > 2 * span:
        return []
    return [(float(sigmas[k]), int(first[k]), int(last[k]), off[k]) for k in np.flatnonzero(large)]


def _calibrated(moved: Floats, measured: Floats) -> Floats:
    """Odometry (N, 3) calibrated by the trajectory: scales of distance and turn, heading drift."""
    out = measured.copy()
    along = np.abs(measured[:, 0]) > 0.5 * STEP_M
    if along.sum() >= 8:
        out[:, :2] *= np.clip(np.median(moved[along, 0] / measured[along, 0]), 0.5, 2.0)
    path_m = np.hypot(measured[:, 0], measured[:, 1])
    terms = np.stack([measured[:, 2], path_m], axis=1)
    error_rad = wrap_angles(moved[:, 2] - measured[:, 2])
    weights = np.ones(len(error_rad))
    for _ in range(8):
        factors = np.linalg.lstsq(terms * weights[:, None], error_rad * weights, rcond=None)[0]
        residual = np.abs(error_rad - terms @ factors)
        scale_rad = 2.0 * _robust_sigma(residual, LEAST_SIGMA_RAD)
        weights = 1.0 / np.sqrt(1.0 + (residual / scale_rad) ** 2)
    out[:, 2] = wrap_angles(measured[:, 2] + terms @ factors)
    return out


def _robust_sigma(sizes: Floats, least: float) -> float:
    """Robust standard deviation about zero, from the median of absolute values (N,)."""
    return max(1.4826 * float(np.median(sizes)), least)


def _evidence(
    scans: Sequence[LaserScan], poses: Floats, path_m: Floats, a: int, b: int, off: Floats
) -> float:
    """Log-likelihood ratio [nat] of odometry's over the trajectory's step, by nearby scans."""
    before = np.arange(np.searchsorted(path_m, path_m[a] - CONTEXT_M), a + 1)
    after = np.arange(b, np.searchsorted(path_m, path_m[b] + CONTEXT_M, side="right"))
    parts = [part[thinned_by_motion(poses[part])] for part in (before, after)]
    visits = pack_visits(scans, poses, path_m, parts)
    if len(visits) < 2:
        return 0.0
    # Odometry's a_from_b is the trajectory's with the difference undone.
    by_odometry = compose(poses[a], compose(between(poses[a], poses[b]), invert(off)))
    moved = visits.poses.copy()
    moved[1] = compose(compose(by_odometry, invert(poses[b])), visits.poses[1])
    given, mended = (
        cross_check(visits, p, least_cells=0).evidence() for p in (visits.poses, moved)
    )
    return float(given.sum() - mended.sum())
