# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The newest part of a graph by itself, so that optimising it costs the same however long it is."""

from __future__ import annotations

import numpy as np

from slarm_graph.constraint import Constraint, ConstraintKind, PoseGraph
from slarm_graph.geometry import Floats, Pose2


def newest(graph: PoseGraph, first: int) -> PoseGraph:
    """Return the nodes from one on, all older ones held where they are.

    Parameters
    ----------
    graph : PoseGraph
        Its steps in the order of their nodes, each before the closures that came after it.
    first : int

    Returns
    -------
    PoseGraph
        Its pose 0 stands for the map's frame, pose 1 for the first node.
    """
    constraints = []
    for c in reversed(graph.constraints):
        if c.j >= first:
            constraints.append(_held(c, first, graph.poses))
        elif c.kind is ConstraintKind.ODOMETRY:
            break
    poses = np.concatenate([np.zeros((1, 3)), graph.poses[first:]])
    return PoseGraph(poses, tuple(constraints))


def _held(c: Constraint, first: int, poses: Floats) -> Constraint:
    """Renumber a constraint, an older end becoming the map's frame."""
    j = c.j - first + 1
    if c.i >= first:
        return Constraint(c.i - first + 1, j, c.i_from_j, c.covariance, c.kind)
    map_from_j = Pose2.from_array(poses[c.i]) @ c.i_from_j
    return Constraint(0, j, map_from_j, c.covariance, c.kind)
