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
from slarm_graph.frontends.scans.submap_matching import SubmapMatcher
from slarm_graph.geometry import Floats, between


def moved_by_all(
    scans: Mapping[int, Floats], graph: SubmapGraph, matcher: SubmapMatcher, local: Floats
) -> Floats:
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
    """
    moved = np.zeros_like(local)
    if not graph.submaps:
        return moved
    at = np.array([keyframe.scan for keyframe in graph.keyframes])
    for scan, points in scans.items():
        before = max(int(np.searchsorted(at, scan)) - 1, 0)
        submap = min(graph.node_of(before), len(graph.submaps) - 1)
        anchor = graph.keyframes[graph.submaps[submap].anchor].local_from_robot.as_array()
        start = between(anchor, local[scan])
        moved[scan] = between(start, matcher.better_fit(points, submap, start))
    return moved
