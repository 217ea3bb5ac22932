# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Visibility between points over passable cells, and path shortcutting by it."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from slarm_graph.exploration.searches import Indices
from slarm_graph.geometry import Floats
from slarm_graph.grid import Mask
from slarm_graph.kernels import kernel
from slarm_graph.raster.lines import first_crossing

_TIE: Final = 1e-9
"""Cells; crossings nearer than this count as a corner, far above rounding and below any map's
accuracy."""


def sees(passable: Mask, start: Floats, end: Floats) -> bool:
    """Whether the straight segment between two points [cells, x right] stays on passable cells.

    Parameters
    ----------
    passable : (rows, cols) bool
    start, end : (2,) float64
        x, y in units of cells from the grid's lower-left corner.
    """
    return bool(_sees(passable, start[0], start[1], end[0], end[1]))


def shortcut(passable: Mask, points: Floats, reach: int = 200) -> Floats:
    """Shortcut a path (K, 2) [cells, x right] wherever the segment stays on passable cells.

    Parameters
    ----------
    reach : int
        How many points ahead a segment may jump at the most.
    """
    if len(points) < 3:
        return points
    return points[_pull(passable, points, reach)]


@kernel
def _sees(passable: Mask, x: float, y: float, end_x: float, end_y: float) -> bool:
    """Traverse every cell that the segment touches (Amanatides and Woo 1987)."""
    rows, cols = passable.shape
    last_col, last_row = math.floor(end_x), math.floor(end_y)
    col, step_col, next_x, per_col = first_crossing(x, end_x - x)
    row, step_row, next_y, per_row = first_crossing(y, end_y - y)
    for _ in range(abs(last_col - col) + abs(last_row - row) + 1):
        if not (0 <= row < rows and 0 <= col < cols and passable[row, col]):
            return False
        if row == last_row and col == last_col:
            return True
        if abs(next_x - next_y) < _TIE:
            # Through a corner: both cells beside it are touched.
            if not (0 <= col + step_col < cols and passable[row, col + step_col]):
                return False
            if not (0 <= row + step_row < rows and passable[row + step_row, col]):
                return False
        if next_x < next_y:
            col += step_col
            next_x += per_col
        else:
            row += step_row
            next_y += per_row
    return 0 <= row < rows and 0 <= col < cols and bool(passable[row, col])


@kernel
def _pull(passable: Mask, points: Floats, reach: int) -> Indices:
    kept = [0]
    here = 0
    while here < len(points) - 1:
        best = here + 1
        for ahead in range(min(len(points) - 1, here + reach), here + 1, -1):
            if _sees(
                passable, points[here, 0], points[here, 1], points[ahead, 0], points[ahead, 1]
            ):
                best = ahead
                break
        kept.append(best)
        here = best
    return np.array(kept)
