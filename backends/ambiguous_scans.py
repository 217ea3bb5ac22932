# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Scans whose match was ambiguous: matched again once later scans are known, too.

While driving, a scan is matched to earlier ones. One with misread odometry or a wrong stamp that
looks along a corridor may then be misplaced.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from slarm_graph.backends.submap_graph import SubmapGraph
from slarm_graph.counts import count_of
from slarm_graph.frontends.scans.submap_matching import SubmapMatcher
from slarm_graph.geometry import Floats, between


def relocated_scans(
    scans: Mapping[int, Floats], graph: SubmapGraph, matcher: SubmapMatcher, local: Floats
) -> tuple[Floats, Floats]:
    """Match ambiguous scans to the submap around them, of scans before and after.

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
        Pose of every scan relative to the tracker's estimate: zero for most [m, m, rad].
    (S, 3, 3) float64
        Its covariance in the robot's frame: zero where it stays [m^2, m^2, rad^2].
    """
    relocations, covariances = np.zeros_like(local), np.zeros((len(local), 3, 3))
    if not graph.submaps:
        return relocations, covariances
    keyframe_scans = np.array([keyframe.scan for keyframe in graph.keyframes])
    for scan, points in scans.items():
        before = max(int(np.searchsorted(keyframe_scans, scan)) - 1, 0)
        submap = min(graph.node_of(before), len(graph.submaps) - 1)
        anchor = graph.keyframes[graph.submaps[submap].anchor].local_from_robot.as_array()
        start = between(anchor, local[scan])
        pose, covariances[scan] = matcher.better_fit(points, submap, start)
        relocations[scan] = between(start, pose)
    return relocations, covariances


def relocation_notice(relocations: Floats) -> tuple[str, ...]:
    """Report how many scans were relocated (S, 3), and by how much."""
    distance_m = np.hypot(relocations[:, 0], relocations[:, 1])
    count = int(np.count_nonzero(relocations.any(axis=1)))
    if not count:
        return ()
    return (
        f"{count_of(count, 'ambiguous scan')} matched again with what was seen before and after,"
        f" moved by up to {distance_m.max():.2f} m",
    )
