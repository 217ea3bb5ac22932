# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""How sure a graph is of where its nodes lie relative to each other."""

from __future__ import annotations

from array import array
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import dijkstra

from slarm_graph.constraint import Constraint
from slarm_graph.geometry import Floats, adjoints, between
from slarm_graph.kernels import kernel

_LEVER_M = 2.0
"""What a turn is worth as a shift where ways are compared. Half and double change no recording that
was tried, and a ward and a hall by 5 %."""
_LINEAR_RAD = 0.3
"""Standard deviation of a heading up to which its sine is the angle, within 6 % at two of them.
Half and double change nothing: steps beyond are lost, or told in two ways a radian apart."""


class _Links(NamedTuple):
    """Constraints between pairs of nodes, in the order of their codes.

    Parameters
    ----------
    nodes : int
    lengths : (nodes, nodes) sparse float64
        Of every pair, the first before the second.
    codes, bodies : (E,) int64
        A number for each pair, and the node that its covariance is seen from.
    covariances : (E, 3, 3) float64
    """

    nodes: int
    lengths: sparse.csr_matrix
    codes: NDArray[np.int64]
    bodies: NDArray[np.int64]
    covariances: Floats

    def at(self, one: NDArray[np.int64], other: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return where the pairs of nodes (P,) stand, in whichever order."""
        codes = np.minimum(one, other) * self.nodes + np.maximum(one, other)
        return np.searchsorted(self.codes, codes)


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
        self._links: _Links | None = None
        for edge in edges:
            self.add(edge)

    def kept_state(self) -> dict[str, object]:
        """Leave out what can be laid out again."""
        return {**self.__dict__, "_links": None}

    def add(self, edge: Constraint) -> None:
        """Take in a constraint; of parallel ones the surest counts."""
        self._known = self._links = None
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
        links = self._links = self._links or self._linked(count)
        before = dijkstra(links.lengths, directed=False, indices=node, return_predecessors=True)[1]
        before = np.where(before < 0, np.arange(count), before).astype(np.int64)
        total = np.zeros((count, 3, 3))
        away = np.flatnonzero(before != np.arange(count))
        at = links.at(away, before[away])
        levers = between(poses[node], poses[links.bodies[at]])
        total[away] = _carried(links.covariances[at], levers)
        return np.asarray(_summed(total, before))

    def _linked(self, count: int) -> _Links:
        """Lay the constraints among so many nodes out for looking ways up in them."""
        ends = np.array(self._ends, dtype=np.int64).reshape(-1, 2)
        codes = ends[:, 0] * count + ends[:, 1]
        order = np.argsort(codes)
        return _Links(
            count,
            sparse.csr_matrix((np.array(self._lengths), ends.T), (count, count)),
            codes[order],
            np.array(self._bodies, dtype=np.int64)[order],
            np.array(self._covariances).reshape(-1, 3, 3)[order],
        )


@kernel
def _summed(total: Floats, before: NDArray[np.int64]) -> Floats:
    """Sum what (N, 3, 3) lies along the ways by nodes before (N,), that of a root being zero."""
    is_done = False
    while not is_done:
        longer, farther, is_done = np.empty_like(total), np.empty_like(before), True
        for k in range(len(before)):
            for i in range(3):
                for j in range(3):
                    longer[k, i, j] = total[k, i, j] + total[before[k], i, j]
            farther[k] = before[before[k]]
            is_done = is_done and farther[k] == before[k]
        if not is_done:
            total, before = longer, farther
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
