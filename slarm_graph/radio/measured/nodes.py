# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Finite volumes over the free floor, none across a wall: the mesh of the residual field."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from slarm_graph.geometry import Floats
from slarm_graph.grid import GridGeometry, Mask
from slarm_graph.kernels import kernel


@dataclass(frozen=True, slots=True)
class Nodes:
    """Finite volumes: the connected components of free cells within each square of cells.

    Parameters
    ----------
    geometry : GridGeometry
        Of the cells.
    of_cell : (rows, cols) int32
        Node of each cell; -1 where not free.
    centers_m : (M, 2) float64
        Mean of a node's cells [m].
    area_m2 : (M,) float64
    stiffness : (M, M) sparse
        Of the Laplacian: length of the common border over the distance of the centres. Across
        walls there is no entry (Neumann boundary).
    """

    geometry: GridGeometry
    of_cell: NDArray[np.int32]
    centers_m: Floats
    area_m2: Floats
    stiffness: sparse.csc_array

    def __len__(self) -> int:
        return len(self.area_m2)

    def at(self, points_m: Floats) -> NDArray[np.int64]:
        """Return the node (N,) of points (N, 2) [m], the nearest one off the floor."""
        found = self.geometry.sample(self.of_cell, points_m, outside=-1.0).astype(np.int64)
        lost = np.flatnonzero(found < 0)
        for index in np.array_split(lost, max(1, len(lost) // 256)) if len(lost) else ():
            away = np.linalg.norm(points_m[index, None] - self.centers_m[None], axis=2)
            found[index] = away.argmin(axis=1)
        return found

    def points_in_node(self, points_m: Floats) -> NDArray[np.int64]:
        """Return for each of points (N, 2) [m] how many of them lie in its node (N,)."""
        own = self.at(points_m)
        return np.asarray(np.bincount(own, minlength=len(self))[own])

    def weights(self, points_m: Floats) -> sparse.csr_array:
        """Return interpolation weights (N, M) of nodes at points (N, 2) [m]; rows add to 1.

        A point's node and its neighbours count the more the nearer their centres; at a node's
        centre it counts alone.
        """
        own, graph = self.at(points_m), self.stiffness
        most = int(np.diff(graph.indptr).max(initial=1))
        columns = np.zeros((len(own), most), dtype=np.int64)
        shares = np.zeros((len(own), most))
        _interpolation_weights(
            points_m, own, self.centers_m, graph.indptr, graph.indices, columns, shares
        )
        rows = np.repeat(np.arange(len(own)), most)
        entries = (shares.ravel(), (rows, columns.ravel()))
        found = sparse.csr_array(entries, shape=(len(own), len(self)))
        found.eliminate_zeros()
        return found


@kernel
def _interpolation_weights(
    points: Floats,
    own: NDArray[np.int64],
    centers: Floats,
    starts: NDArray[np.int32],
    neighbours: NDArray[np.int32],
    columns: NDArray[np.int64],
    shares: Floats,
) -> None:
    """Fill the nodes of each point and their weights (N, K); the rest of a row stays zero."""
    for i in range(len(points)):
        node, total, reach = own[i], 0.0, 1e-9
        for p in range(starts[node], starts[node + 1]):
            k = neighbours[p]
            away = np.hypot(centers[k, 0] - centers[node, 0], centers[k, 1] - centers[node, 1])
            reach = max(reach, away)
        for slot, p in enumerate(range(starts[node], starts[node + 1])):
            k = neighbours[p]
            away = np.hypot(centers[k, 0] - points[i, 0], centers[k, 1] - points[i, 1])
            columns[i, slot] = k
            shares[i, slot] = max(0.0, 1.0 - away / reach)
            total += shares[i, slot]
        if total <= 0.0:
            columns[i, 0], shares[i, 0], total = node, 1.0, 1.0
        for slot in range(shares.shape[1]):
            shares[i, slot] /= total


def make_nodes(geometry: GridGeometry, free: Mask, side_m: float, most: int) -> Nodes:
    """Partition free cells into nodes of about a given side.

    Parameters
    ----------
    geometry : GridGeometry
    free : (rows, cols) bool
        The floor.
    side_m : float
        Side of a node [m]; larger where there would be more than `most` nodes.
    most : int
    """
    floor_m2 = float(free.sum()) * geometry.resolution_m**2
    side_m = max(side_m, math.sqrt(floor_m2 / most), geometry.resolution_m)
    step = max(1, round(side_m / geometry.resolution_m))
    pairs = _neighbours(free)
    rows, cols = np.indices(free.shape)
    block = (rows // step) * (free.shape[1] // step + 1) + cols // step
    same = block.ravel()[pairs[0]] == block.ravel()[pairs[1]]
    cells = free.size
    graph = sparse.coo_array((np.ones(same.sum(), np.int8), pairs[:, same]), shape=(cells, cells))
    _, label = connected_components(graph, directed=False)
    _, node = np.unique(label[free.ravel()], return_inverse=True)
    of_cell = np.full(cells, -1, dtype=np.int32)
    of_cell[free.ravel()] = node
    return _assembled(geometry, of_cell.reshape(free.shape), pairs)


def _neighbours(free: Mask) -> NDArray[np.int64]:
    """Pairs (2, K) of flat indices of free cells that share a side."""
    index = np.arange(free.size).reshape(free.shape)
    across = free[:, :-1] & free[:, 1:]
    up = free[:-1] & free[1:]
    first = np.concatenate([index[:, :-1][across], index[:-1][up]])
    second = np.concatenate([index[:, 1:][across], index[1:][up]])
    return np.stack([first, second])


def _assembled(
    geometry: GridGeometry, of_cell: NDArray[np.int32], pairs: NDArray[np.int64]
) -> Nodes:
    """Areas, centres and stiffness of nodes."""
    flat = of_cell.ravel()
    count = int(flat.max(initial=-1)) + 1
    member = np.flatnonzero(flat >= 0)
    cells = np.bincount(flat[member], minlength=count).astype(np.float64)
    centers = geometry.center_of(np.stack(np.divmod(member, of_cell.shape[1]), axis=1))
    mean_m = np.stack(
        [np.bincount(flat[member], centers[:, axis], count) / cells for axis in (0, 1)], axis=1
    )
    i, j = flat[pairs[0]], flat[pairs[1]]
    i, j = i[i != j].astype(np.int64), j[i != j].astype(np.int64)
    border = sparse.coo_array((np.full(len(i), geometry.resolution_m), (i, j)), (count, count))
    border = (border + border.T).tocoo()
    away_m = np.linalg.norm(mean_m[border.row] - mean_m[border.col], axis=1)
    pull = sparse.csc_array(
        (border.data / np.maximum(away_m, geometry.resolution_m), (border.row, border.col)),
        shape=(count, count),
    )
    stiffness = sparse.diags_array(pull.sum(axis=1)) - pull
    area_m2 = cells * geometry.resolution_m**2
    return Nodes(geometry, of_cell, mean_m, area_m2, sparse.csc_array(stiffness))
