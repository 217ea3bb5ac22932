# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Laser returns averaged per cell, to fit walls to."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from slarm_graph.geometry import Floats
from slarm_graph.grid import GridGeometry, Mask


@dataclass(frozen=True, slots=True)
class Returns:
    """Laser returns averaged per cell.

    Parameters
    ----------
    points : (M, 2) float64
        Mean of a cell's returns [m].
    weights : (M,) float64
        Number of these.
    tree : cKDTree
        Of the points.
    """

    points: Floats
    weights: Floats
    tree: cKDTree

    @staticmethod
    def of(points: Floats, weights: Floats) -> Returns:
        """Make them with their search tree."""
        return Returns(points, weights, cKDTree(points))

    def near_each(self, centers: Floats, radii_m: Floats) -> Iterator[NDArray[np.int64]]:
        """Yield the indices (K,), ascending, of points within a radius of each centre (N, 2)."""
        for found in self.tree.query_ball_point(centers, radii_m, return_sorted=True):
            yield np.array(found, dtype=np.int64)


NO_RETURNS = Returns.of(np.zeros((0, 2)), np.zeros(0))
"""Returns of no scan: an empty set."""


def gather_returns(end_points_m: Floats, resolution_m: float) -> Returns:
    """Reduce end points (N, 2) [m] to their mean per cell, which keeps lines through them."""
    if not len(end_points_m):
        return NO_RETURNS
    keys = cell_keys(end_points_m, resolution_m)
    cells, counts = np.unique(keys, return_counts=True)
    # As `return_inverse` gives it, without the order of all points in memory besides.
    index = np.searchsorted(cells, keys)
    sums = [np.bincount(index, weights=end_points_m[:, axis]) for axis in range(2)]
    return Returns.of(np.stack(sums, axis=1) / counts[:, None], counts.astype(np.float64))


def cell_keys(points_m: Floats, resolution_m: float) -> NDArray[np.integer]:
    """Number the cells of points (N, 2) [m] by x, then y, from 0 on, in as few bytes as fit."""
    cells = np.floor(points_m / resolution_m).astype(np.int64)
    low = cells.min(axis=0)
    cells -= low
    width = int(cells[:, 1].max()) + 1
    keys = cells[:, 0] * width + cells[:, 1]
    return keys.astype(np.int32) if keys.max() < 2**31 else keys


def returns_of_cells(geometry: GridGeometry, occupied: Mask, reached: Mask) -> Returns:
    """Substitute for unknown returns: midpoints of sides between occupied and reached cells."""
    points = []
    padded = np.pad(reached, 1)
    for up, right in ((0, 1), (1, 0), (0, -1), (-1, 0)):
        rows, cols = reached.shape
        neighbour = padded[1 + up : 1 + up + rows, 1 + right : 1 + right + cols]
        half = 0.5 * geometry.resolution_m * np.array([right, up])
        points.append(geometry.center_of(np.argwhere(occupied & neighbour)) + half)
    sides = np.concatenate(points)
    return Returns.of(sides, np.ones(len(sides)))
