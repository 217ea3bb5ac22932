# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Sliding window: the newest part of a graph, at a cost that does not grow with its length."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from slarm_graph.constraint import Constraint, ConstraintKind, PoseGraph
from slarm_graph.geometry import Floats, Pose2


def sliding_window(
    nodes: Sequence[Floats], constraints: Sequence[Constraint], first: int
) -> PoseGraph:
    """Return the graph of the nodes from `first` on, with older ones fixed.

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
        Its pose 0 is the map's origin, pose 1 the first node.
    """
    kept = []
    for c in reversed(constraints):
        if c.j >= first:
            kept.append(_renumbered(c, first, nodes))
        elif c.kind is ConstraintKind.SCAN_MATCH:
            break
    return PoseGraph(np.array([np.zeros(3), *nodes[first:]]), tuple(kept))


def _renumbered(c: Constraint, first: int, nodes: Sequence[Floats]) -> Constraint:
    """Renumber a constraint; one to a fixed node becomes one to the map's origin."""
    j = c.j - first + 1
    if c.i >= first:
        return Constraint(c.i - first + 1, j, c.i_from_j, c.covariance, c.kind)
    map_from_j = Pose2.from_array(nodes[c.i]) @ c.i_from_j
    return Constraint(0, j, map_from_j, c.covariance, c.kind)
