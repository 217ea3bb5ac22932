# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Moving objects: small things whose trail other scans have looked through, and its fresh end.

Nobody looks through the place where somebody has just been, nor through somebody who walks ahead:
the beams end at his back. But what he leaves behind is looked through, step by step, and the rest
hangs together with it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from slarm_graph.consistency.evidence import TOLERANCE_M
from slarm_graph.geometry import Floats

_SHARE: Final = 0.5
"""Share of a trail's returns that have been looked through from which on it moves: most. With 0.25
halls 46 and 115 stay (0.09 to 0.15 m), with 0.75 the second is lost (0.83 and 1.47 m)."""
_MARGIN_CELLS: Final = 2
"""Around the returns: one cell that the trail is widened by, and one that is empty."""


@dataclass(frozen=True, slots=True)
class TrailCells:
    """Cells of the local map in which small things are taken to move.

    Parameters
    ----------
    first : (2,) int64
        Column and row of the corner cell, counted in `TOLERANCE_M` from the map's origin.
    moving : (H, W) bool
    """

    first: NDArray[np.int64]
    moving: NDArray[np.bool_]

    def contain(self, points: Floats) -> NDArray[np.bool_]:
        """Which of the points (K, 2) in the local map lie in a cell of a trail, or beside one."""
        if self is NO_TRAILS:
            return np.zeros(len(points), dtype=np.bool_)
        column, row = (np.floor(points / TOLERANCE_M).astype(np.int64) - self.first).T
        height, width = self.moving.shape
        inside = (column >= 0) & (row >= 0) & (column < width) & (row < height)
        found = np.zeros(len(points), dtype=np.bool_)
        found[inside] = self.moving[row[inside], column[inside]]
        return found


NO_TRAILS: Final = TrailCells(np.zeros(2, dtype=np.int64), np.zeros((0, 0), dtype=np.bool_))
"""Where nothing has moved."""


def trail_cells(points: Floats, looked_through: NDArray[np.bool_]) -> TrailCells:
    """Find the trails of moving objects.

    Returns in the same cell or in neighbouring ones hang together; together they move if most of
    them have been looked through.

    Parameters
    ----------
    points : (K, 2) float64
        Returns of small things in the last keyframes, in the local map [m].
    looked_through : (K,) bool
    """
    if not looked_through.any():
        return NO_TRAILS
    cells = np.floor(points / TOLERANCE_M).astype(np.int64)
    first = cells.min(axis=0) - _MARGIN_CELLS
    column, row = (cells - first).T
    width, height = (cells.max(axis=0) - first + 1 + _MARGIN_CELLS).tolist()
    counts = np.zeros((2, height, width))
    np.add.at(counts, (looked_through.astype(np.int64), row, column), 1.0)
    occupied = counts.sum(axis=0) > 0.0
    count, labels = cv2.connectedComponents(occupied.astype(np.uint8), connectivity=8)
    kept, gone = (np.bincount(labels.ravel(), n.ravel(), minlength=count) for n in counts)
    is_trail = gone > _SHARE / (1.0 - _SHARE) * kept
    if not is_trail.any():
        return NO_TRAILS
    moving = (is_trail[labels] & occupied).astype(np.uint8)
    with_neighbours = cv2.dilate(moving, np.ones((3, 3), dtype=np.uint8))
    return TrailCells(first, with_neighbours.astype(np.bool_))
