# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Cells under discs: what a round body passes over."""

from __future__ import annotations

import math

from slarm_graph.geometry import Floats
from slarm_graph.grid import Mask
from slarm_graph.kernels import kernel


@kernel
def mark_discs(cells: Mask, centers: Floats, radius: float) -> None:
    """Mark the cells whose centre lies under a disc, whichever of them.

    Parameters
    ----------
    cells : (rows, cols) bool
        Marked in place.
    centers : (N, 2) float64
        Of the discs, x and y from the first cell's corner [cells].
    radius : float
        Of all [cells].
    """
    rows, cols = cells.shape
    for i in range(len(centers)):
        x, y = centers[i, 0], centers[i, 1]
        for row in range(max(0, math.floor(y - radius)), min(rows, math.ceil(y + radius) + 1)):
            dy = row + 0.5 - y
            left = radius * radius - dy * dy
            if left < 0.0:
                continue
            half = math.sqrt(left)
            first = max(0, math.ceil(x - half - 0.5))
            for col in range(first, min(cols, math.floor(x + half - 0.5) + 1)):
                cells[row, col] = True
