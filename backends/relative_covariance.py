# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Approximate relative covariances between graph nodes, along the paths of least uncertainty."""

from __future__ import annotations

from array import array
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import dijkstra

from slarm_graph.constraint import Constraint
from slarm_graph.geometry import Floats, between, transform_covariances
from slarm_graph.kernels import kernel

_LEVER_M = 2.0
"""Lever that weighs a heading error as a shift when paths are compared. Half and double change no
recording that was tried, and a ward and a hall by 5 %."""
_LINEAR_RAD = 0.3
"""Standard deviation of a heading up to which its sine is the angle, within 6 % at two of them.
Half and double change nothing: steps beyond are lost, or measured twice a radian apart."""


class _Links(NamedTuple):
    """Constraints between pairs of nodes as arrays, sorted by pair.

    Parameters
    ----------
    nodes : int
    lengths : (nodes, nodes) sparse float64
        Of every pair, the first before the second.
    keys, bodies : (E,) int64
        Key of each pair, and the node in whose body frame its covariance is.
    covariances : (E, 3, 3) float64
    """

    nodes: int
    lengths: sparse.csr_matrix
    keys: NDArray[np.int64]
    bodies: NDArray[np.int64]
    covariances: Floats

    def at(self, one: NDArray[np.int64], other: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the indices of the pairs of nodes (P,), in either order."""
        keys = np.minimum(one, other) * self.nodes + np.maximum(one, other)
        return np.searchsorted(self.keys, keys)


class RelativeCovariances:
    """Covariances between nodes, summed over the constraints on the path of least uncertainty.

    Errors of constraints are taken as independent; parallel paths are ignored.

    Parameters
    ----------
    edges : iterable of Constraint
    """

    def __init__(self, edges: Iterable[Constraint] = ()) -> None:
        self._index: dict[tuple[int, int], int] = {}
        self._ends, self._bodies = array("q"), array("q")
        self._lengths = array("d")
        self._covariances = array("d")
        self._cached: Floats | None = None
        self._cached_node = -1
        self._links: _Links | None = None
        for edge in edges:
            self.add(edge)

    def kept_state(self) -> dict[str, object]:
        """Leave out of a snapshot what is derived."""
        return {**self.__dict__, "_links": None}

    def add(self, edge: Constraint) -> None:
        """Add a constraint; of parallel ones that of least uncertainty counts."""
        self._cached = self._links = None
        c = edge.covariance
        length = float(c[0, 0] + c[1, 1] + _LEVER_M**2 * c[2, 2])
        ends = (min(edge.i, edge.j), max(edge.i, edge.j))
        at = self._index.setdefault(ends, len(self._lengths))
        if at == len(self._lengths):
            self._ends.extend(ends)
            self._bodies.append(edge.j)
            self._lengths.append(length)
            self._covariances.extend(c.ravel())
        elif length < self._lengths[at]:
            self._bodies[at], self._lengths[at] = edge.j, length
            self._covariances[9 * at : 9 * at + 9] = array("d", c.ravel())

    def invalidate(self) -> None:
        """Drop cached covariances, the nodes having moved."""
        self._cached = None

    def covariances(self, poses: Floats, node: int) -> Floats:
        """Covariances of one node's pose relative to every node, in its own body frame.

        Parameters
        ----------
        poses : (N, 3) float64
            Current `map_from_node` [m, m, rad].
        node : int

        Returns
        -------
        covariances : (N, 3, 3) float64
            [m^2, m rad, rad^2]
        """
        if self._cached is None or self._cached_node != node:
            self._cached, self._cached_node = self._accumulated(poses, node), node
        return self._cached

    def _accumulated(self, poses: Floats, node: int) -> Floats:
        """Sum along the shortest-path tree by pointer jumping: O(log N) passes."""
        count = len(poses)
        links = self._links = self._links or self._linked(count)
        parents = dijkstra(links.lengths, directed=False, indices=node, return_predecessors=True)[1]
        parents = np.where(parents < 0, np.arange(count), parents).astype(np.int64)
        total = np.zeros((count, 3, 3))
        others = np.flatnonzero(parents != np.arange(count))
        at = links.at(others, parents[others])
        levers = between(poses[node], poses[links.bodies[at]])
        total[others] = _transformed(links.covariances[at], levers)
        return np.asarray(_summed_to_root(total, parents))

    def _linked(self, count: int) -> _Links:
        """Build the sparse matrix and the sorted table of the constraints among so many nodes."""
        ends = np.array(self._ends, dtype=np.int64).reshape(-1, 2)
        keys = ends[:, 0] * count + ends[:, 1]
        order = np.argsort(keys)
        return _Links(
            count,
            sparse.csr_matrix((np.array(self._lengths), ends.T), (count, count)),
            keys[order],
            np.array(self._bodies, dtype=np.int64)[order],
            np.array(self._covariances).reshape(-1, 3, 3)[order],
        )


@kernel
def _summed_to_root(total: Floats, parents: NDArray[np.int64]) -> Floats:
    """Sum values (N, 3, 3) from every node up to its root, whose own is zero; parents (N,)."""
    is_done = False
    while not is_done:
        next_total, next_parents, is_done = np.empty_like(total), np.empty_like(parents), True
        for k in range(len(parents)):
            for i in range(3):
                for j in range(3):
                    next_total[k, i, j] = total[k, i, j] + total[parents[k], i, j]
            next_parents[k] = parents[parents[k]]
            is_done = is_done and next_parents[k] == parents[k]
        if not is_done:
            total, parents = next_total, next_parents
    return total


def _transformed(covariances: Floats, levers: Floats) -> Floats:
    """Covariances (N, 3, 3) by the adjoint in frames that lie at levers (N, 3) from their own.

    Beyond `_LINEAR_RAD` the adjoint's linearisation would exclude where a long lever swings to: its
    position is then uniform on the circle about the pivot, its heading as uncertain as before.
    """
    variances = covariances[:, 2, 2]
    is_nonlinear = variances > _LINEAR_RAD**2
    linear_levers = np.where(is_nonlinear[:, None], levers * [0.0, 0.0, 1.0], levers)
    out = transform_covariances(linear_levers, covariances)
    circle = is_nonlinear * np.minimum(variances, 1.0) * (levers[:, :2] ** 2).sum(axis=1)
    out[:, [0, 1], [0, 1]] += circle[:, None]
    return out
