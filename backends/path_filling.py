# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""A pose for every scan out of corrected poses for some."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slarm_graph.frontends.scans.tracker import TrackedScan
from slarm_graph.frontends.scans.wheel_motion import WheelMotion
from slarm_graph.geometry import Floats, between, compose, wrap_angles


def step_variance(scan: TrackedScan) -> float:
    """How unsure the step to a scan is [m^2]: that of its match, or of odometry without one."""
    if scan.wheels is not None and not scan.match:
        return odometry_variance(scan.wheels)
    return float(np.trace(scan.local_covariance[:2, :2]))


def odometry_variance(step: WheelMotion) -> float:
    """How unsure odometry is of where a step ends [m^2]."""
    return float(np.trace(step.total_covariance()[:2, :2]))


def spread(local: Floats, at: NDArray[np.int64], anchor_poses: Floats, variances: Floats) -> Floats:
    """Give every scan a pose in the map, given the poses of some.

    What the path misses from one to the next goes to its steps as their variances have it: a
    silence takes it, not the scans before and after that were matched.

    Parameters
    ----------
    local : (N, 3) float64
        `local_from_robot` of all scans.
    at : (A,) int64
        Scans whose pose is known, ascending.
    anchor_poses : (A, 3) float64
        `map_from_robot` of those.
    variances : (N,) float64
        Of the step to every scan [m^2].

    Returns
    -------
    (N, 3) float64
        `map_from_robot` of all scans, equal to `anchor_poses` at the known ones.
    """
    before, after, share = neighbours(at, variances)
    from_before = compose(anchor_poses[before], between(local[at[before]], local))
    from_after = compose(anchor_poses[after], between(local[at[after]], local))
    return _blended(from_before, from_after, np.minimum(share, 1.0))


def bridged(start: Floats, end: Floats, motions: Floats, variances: Floats) -> Floats:
    """Lead a path by odometry from one known pose to another.

    What odometry misses the end by goes to its steps as their variances have it, as least squares
    with independent errors do.

    Parameters
    ----------
    start, end : (3,) float64
        Known poses [m, m, rad].
    motions : (K, 3) float64
        Steps by odometry, each in the frame that the one before leads to; the last ends at `end`.
    variances : (K,) float64
        Of the steps [m^2], above 0.

    Returns
    -------
    (K - 1, 3) float64
        Poses after all steps but the last, in the frame of `start`.
    """
    told = [start]
    for motion in motions:
        told.append(compose(told[-1], motion))
    path = np.array(told)
    back = compose(end, between(path[-1], path))
    share = np.cumsum(variances) / np.sum(variances)
    return _blended(path[1:-1], back[1:-1], share[:-1])


def _blended(one: Floats, other: Floats, share: Floats) -> Floats:
    """Poses (N, 3) a share (N,) of the way from one (N, 3) to the other."""
    away = other - one
    away[:, 2] = wrap_angles(away[:, 2])
    poses = one + share[:, None] * away
    poses[:, 2] = wrap_angles(poses[:, 2])
    return np.asarray(poses, dtype=np.float64)


def neighbours(
    at: NDArray[np.int64], variances: Floats
) -> tuple[NDArray[np.int64], NDArray[np.int64], Floats]:
    """Which known scans lie before and after every scan, and what share of the doubt is passed.

    Parameters
    ----------
    at : (A,) int64
        Scans of which something is known, ascending.
    variances : (S,) float64
        Of the step to every scan [m^2].

    Returns
    -------
    before, after : (S,) int64
        Indices into `at`; the two last ones for what follows the last.
    share : (S,) float64
        Of the variance from the one to the other, 0 to 1; above 1 for what follows the last.
    """
    scans, last, passed = np.arange(len(variances)), len(at) - 1, np.cumsum(variances)
    before = np.clip(np.searchsorted(at, scans, side="right") - 1, 0, max(last - 1, 0))
    after = np.minimum(before + 1, last)
    gap = np.maximum(passed[at[after]] - passed[at[before]], np.finfo(np.float64).tiny)
    return before, after, np.maximum((passed - passed[at[before]]) / gap, 0.0)
