# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""A pose for every scan out of corrected poses for some."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slarm_graph.geometry import Floats, between, compose, wrap_angles


def fill_path(
    stamps_ns: NDArray[np.int64], local: Floats, corrected: NDArray[np.int64], path: Floats
) -> Floats:
    """Carry a smooth path over to corrected poses; what is left of a step is spread over time.

    Parameters
    ----------
    stamps_ns : (N,) int64
    local : (N, 3) float64
        `local_from_robot` at every scan, smooth but drifting.
    corrected : (U,) int64
        Increasing indices of the scans with a corrected pose; the first is 0.
    path : (U, 3) float64
        Their `map_from_robot`.

    Returns
    -------
    (N, 3) float64
        `map_from_robot` at every scan, equal to `path` at the corrected ones.
    """
    scans = np.arange(len(stamps_ns))
    step = np.searchsorted(corrected, scans, side="right") - 1
    filled = compose(path[step], between(local[corrected[step]], local))
    if len(corrected) < 2:
        return filled
    left = compose(path[:-1], between(local[corrected[:-1]], local[corrected[1:]]))
    residual = np.concatenate([between(left, path[1:]), np.zeros((1, 3))])
    span_ns = np.append(np.diff(stamps_ns[corrected]), 1)
    share = (stamps_ns - stamps_ns[corrected[step]]) / span_ns[step]
    return compose(filled, share[:, None] * residual[step])


def spread(local: Floats, at: NDArray[np.int64], anchor_poses: Floats) -> Floats:
    """Give every scan a pose in the map, given the poses of some.

    Parameters
    ----------
    local : (N, 3) float64
        `local_from_robot` of all scans.
    at : (A,) int64
        Scans whose pose is known, ascending.
    anchor_poses : (A, 3) float64
        `map_from_robot` of those.

    Returns
    -------
    (N, 3) float64
        `map_from_robot` of all scans.
    """
    before, after, share = neighbours(at, len(local))
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
    at: NDArray[np.int64], count: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], Floats]:
    """Which known scans lie before and after every scan, and what share of the way has passed.

    Parameters
    ----------
    at : (A,) int64
        Scans of which something is known, ascending.
    count : int
        Number S of all scans.

    Returns
    -------
    before, after : (S,) int64
        Indices into `at`; the two last ones for what follows the last.
    share : (S,) float64
        Of the scans from the one to the other, 0 to 1; above 1 for what follows the last.
    """
    scans, last = np.arange(count), len(at) - 1
    before = np.clip(np.searchsorted(at, scans, side="right") - 1, 0, max(last - 1, 0))
    after = np.minimum(before + 1, last)
    gap = np.maximum(at[after] - at[before], 1)
    return before, after, np.maximum((scans - at[before]) / gap, 0.0)
