# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Scans that could as well have had another place: decided where what came later is known too.

While the robot drives, a scan is matched with what was seen before. One whose odometry was read
amiss, or whose stamp is not its own, and which looks along a corridor, may then lie elsewhere.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from slarm_graph.backends.submap_graph import SubmapGraph
from slarm_graph.counts import count_of
from slarm_graph.frontends.scans.submap_matching import SubmapMatcher
from slarm_graph.geometry import Floats, between


def moved_by_all(
    scans: Mapping[int, Floats], graph: SubmapGraph, matcher: SubmapMatcher, local: Floats
) -> tuple[Floats, Floats]:
    """Find where scans fit better by all that was seen about them, before and after.

    Parameters
    ----------
    scans : mapping
        Returns (K, 2) of scans in the robot's frame [m], by index among all.
    graph : SubmapGraph
    matcher : SubmapMatcher
        Of the graph's submaps.
    local : (S, 3) float64
        `local_from_robot` of all scans.

    Returns
    -------
    (S, 3) float64
        Where every scan belongs, seen from where it was placed: zero for most [m, m, rad].
    (S, 3, 3) float64
        Covariance of that, in the robot's frame: zero where it stays [m^2, m^2, rad^2].
    """
    moved, covariances = np.zeros_like(local), np.zeros((len(local), 3, 3))
    if not graph.submaps:
        return moved, covariances
    at = np.array([keyframe.scan for keyframe in graph.keyframes])
    for scan, points in scans.items():
        before = max(int(np.searchsorted(at, scan)) - 1, 0)
        submap = min(graph.node_of(before), len(graph.submaps) - 1)
        anchor = graph.keyframes[graph.submaps[submap].anchor].local_from_robot.as_array()
        start = between(anchor, local[scan])
        place, covariances[scan] = matcher.better_fit(points, submap, start)
        moved[scan] = between(start, place)
    return moved, covariances


def moved_notice(moved: Floats) -> tuple[str, ...]:
    """Say how many scans were placed again, seen (S, 3) from where they were, and how far off."""
    away_m = np.hypot(moved[:, 0], moved[:, 1])
    count = int(np.count_nonzero(moved.any(axis=1)))
    if not count:
        return ()
    return (
        f"placed by what was seen before and after: {count_of(count, 'scan')} that could have had"
        f" another place, up to {away_m.max():.2f} m from where the tracker had it",
    )
