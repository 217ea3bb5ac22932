# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""How sure a graph is of where its nodes lie relative to each other."""

from __future__ import annotations

from array import array
from collections.abc import Iterable

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import dijkstra

from slarm_graph.constraint import Constraint
from slarm_graph.geometry import Floats, adjoints, between

_LEVER_M = 2.0
"""What a turn is worth as a shift where ways are compared. Half and double change no recording that
was tried, and a ward and a hall by 5 %."""
_LINEAR_RAD = 0.3
"""Standard deviation of a heading up to which its sine is the angle, within 6 % at two of them.
Half and double change nothing: steps beyond are lost, or told in two ways a radian apart."""


class GraphReach:
    """Uncertainty between nodes: what the constraints on the surest way between them add up to.

    Errors of the constraints are taken as independent, and other ways as saying nothing new.

    Parameters
    ----------
    edges : iterable of Constraint
    """

    def __init__(self, edges: Iterable[Constraint] = ()) -> None:
        self._at: dict[tuple[int, int], int] = {}
        self._ends, self._bodies = array("q"), array("q")
        self._lengths = array("d")
        self._covariances = array("d")
        self._known: Floats | None = None
        self._known_of = -1
        for edge in edges:
            self.add(edge)

    def add(self, edge: Constraint) -> None:
        """Take in a constraint; of parallel ones the surest counts."""
        self._known = None
        c = edge.covariance
        length = float(c[0, 0] + c[1, 1] + _LEVER_M**2 * c[2, 2])
        ends = (min(edge.i, edge.j), max(edge.i, edge.j))
        at = self._at.setdefault(ends, len(self._lengths))
        if at == len(self._lengths):
            self._ends.extend(ends)
            self._bodies.append(edge.j)
            self._lengths.append(length)
            self._covariances.extend(c.ravel())
        elif length < self._lengths[at]:
            self._bodies[at], self._lengths[at] = edge.j, length
            self._covariances[9 * at : 9 * at + 9] = array("d", c.ravel())

    def outdate(self) -> None:
        """Have everything added up anew, the nodes having moved."""
        self._known = None

    def covariances(self, poses: Floats, node: int) -> Floats:
        """Covariances of where one node is as seen from every one, in its own body frame.

        Parameters
        ----------
        poses : (N, 3) float64
            `map_from_node` as they stand [m, m, rad].
        node : int
            The one whose place is asked for.

        Returns
        -------
        covariances : (N, 3, 3) float64
            [m^2, m rad, rad^2]
        """
        if self._known is None or self._known_of != node:
            self._known, self._known_of = self._added_up(poses, node), node
        return self._known

    def _added_up(self, poses: Floats, node: int) -> Floats:
        """Add up along the tree of the surest ways, in steps of doubled length."""
        count = len(poses)
        ends = np.array(self._ends, dtype=np.int64).reshape(-1, 2)
        links = sparse.csr_matrix((np.array(self._lengths), ends.T), (count, count))
        before = dijkstra(links, directed=False, indices=node, return_predecessors=True)[1]
        before = np.where(before < 0, np.arange(count), before).astype(np.int64)
        total = np.zeros((count, 3, 3))
        away = np.flatnonzero(before != np.arange(count))
        steps = zip(away.tolist(), before[away].tolist(), strict=True)
        at = [self._at[(a, b) if a < b else (b, a)] for a, b in steps]
        bodies = np.array(self._bodies, dtype=np.int64)[at]
        total[away] = _carried(
            np.array(self._covariances).reshape(-1, 3, 3)[at], between(poses[node], poses[bodies])
        )
        while (before != before[before]).any():
            total = total + total[before]
            before = before[before]
        return total


def _carried(own: Floats, levers: Floats) -> Floats:
    """Covariances (N, 3, 3) in frames that lie at levers (N, 3), carried from those.

    A heading known to a tenth of a turn swings its lever to one side or the other, one that is not
    to anywhere round it: there what is linear in the angle would rule out where it comes to lie.
    """
    turns = own[:, 2, 2]
    loose = turns > _LINEAR_RAD**2
    fixed = np.where(loose[:, None], levers * [0.0, 0.0, 1.0], levers)
    carry = adjoints(fixed)
    out = carry @ own @ carry.transpose(0, 2, 1)
    round_it = loose * np.minimum(turns, 1.0) * (levers[:, :2] ** 2).sum(axis=1)
    out[:, [0, 1], [0, 1]] += round_it[:, None]
    return np.asarray(out)
