# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The newest part of a graph by itself, so that optimising it costs the same however long it is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from slarm_graph.constraint import Constraint, ConstraintKind, PoseGraph
from slarm_graph.geometry import Floats, Pose2


def newest(nodes: Sequence[Floats], constraints: Sequence[Constraint], first: int) -> PoseGraph:
    """Return the nodes from one on, all older ones held where they are.

    Parameters
    ----------
    nodes : sequence of (3,) float64
        `map_from_node` [m, m, rad].
    constraints : sequence of Constraint
        Steps in the order of their nodes, each before the closures that came after it.
    first : int

    Returns
    -------
    PoseGraph
        Its pose 0 stands for the map's frame, pose 1 for the first node.
    """
    kept = []
    for c in reversed(constraints):
        if c.j >= first:
            kept.append(_held(c, first, nodes))
        elif c.kind is ConstraintKind.ODOMETRY:
            break
    return PoseGraph(np.array([np.zeros(3), *nodes[first:]]), tuple(kept))


def _held(c: Constraint, first: int, nodes: Sequence[Floats]) -> Constraint:
    """Renumber a constraint, an older end becoming the map's frame."""
    j = c.j - first + 1
    if c.i >= first:
        return Constraint(c.i - first + 1, j, c.i_from_j, c.covariance, c.kind)
    map_from_j = Pose2.from_array(nodes[c.i]) @ c.i_from_j
    return Constraint(0, j, map_from_j, c.covariance, c.kind)
