# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Interpolation of corrected poses of some scans to all scans, by the variance of the steps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slarm_graph.frontends.scans.tracker import TrackedScan
from slarm_graph.frontends.scans.wheel_motion import WheelMotion
from slarm_graph.geometry import Floats, between, compose, wrap_angles

_LEAST_GAP_M2 = 1e-30
"""Below the variance of any step, and large enough to divide a lost robot's by."""


def step_variance(scan: TrackedScan) -> float:
    """Position variance of the step to a scan [m^2]: of its match, or of odometry without one."""
    if scan.wheels is not None and not scan.match:
        return odometry_variance(scan.wheels)
    return float(np.trace(scan.local_covariance[:2, :2]))


def odometry_variance(step: WheelMotion) -> float:
    """Position variance of a step by odometry [m^2]."""
    return float(np.trace(step.total_covariance()[:2, :2]))


def interpolate_corrections(
    local: Floats, at: NDArray[np.int64], anchor_poses: Floats, variances: Floats
) -> Floats:
    """Interpolate poses of some scans to all.

    The residual between two known poses is distributed over the steps in proportion to their
    variances: a gap without matches takes it, not the matched scans before and after.

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
    before, after, share = bracketing_anchors(at, variances)
    from_before = compose(anchor_poses[before], between(local[at[before]], local))
    from_after = compose(anchor_poses[after], between(local[at[after]], local))
    return _interpolated(from_before, from_after, np.minimum(share, 1.0))


def bridged_by_odometry(start: Floats, end: Floats, motions: Floats, variances: Floats) -> Floats:
    """Fill the gap between two known poses by odometry.

    Its residual at the end is distributed over the steps in proportion to their variances, as by
    least squares with independent errors.

    Parameters
    ----------
    start, end : (3,) float64
        Known poses [m, m, rad].
    motions : (K, 3) float64
        Steps by odometry, each in the frame at its start; the last ends at `end`.
    variances : (K,) float64
        Of the steps [m^2], above 0.

    Returns
    -------
    (K - 1, 3) float64
        Poses after all steps but the last, in the frame of `start`.
    """
    chain = [start]
    for motion in motions:
        chain.append(compose(chain[-1], motion))
    path = np.array(chain)
    back = compose(end, between(path[-1], path))
    share = np.cumsum(variances) / np.sum(variances)
    return _interpolated(path[1:-1], back[1:-1], share[:-1])


def _interpolated(one: Floats, other: Floats, share: Floats) -> Floats:
    """Poses (N, 3) at a share (N,) from one (N, 3) to the other."""
    difference = other - one
    difference[:, 2] = wrap_angles(difference[:, 2])
    poses = one + share[:, None] * difference
    poses[:, 2] = wrap_angles(poses[:, 2])
    return np.asarray(poses, dtype=np.float64)


def bracketing_anchors(
    at: NDArray[np.int64], variances: Floats
) -> tuple[NDArray[np.int64], NDArray[np.int64], Floats]:
    """Return the known scans before and after every scan, and its share of the variance between.

    Parameters
    ----------
    at : (A,) int64
        Known scans, ascending.
    variances : (S,) float64
        Of the step to every scan [m^2].

    Returns
    -------
    before, after : (S,) int64
        Indices into `at`; the two last ones for what follows the last.
    share : (S,) float64
        Of the variance from the one to the other, 0 to 1; above 1 for what follows the last.
    """
    scans, last, total = np.arange(len(variances)), len(at) - 1, np.cumsum(variances)
    before = np.clip(np.searchsorted(at, scans, side="right") - 1, 0, max(last - 1, 0))
    after = np.minimum(before + 1, last)
    gap = np.maximum(total[at[after]] - total[at[before]], _LEAST_GAP_M2)
    return before, after, np.maximum((total - total[at[before]]) / gap, 0.0)
