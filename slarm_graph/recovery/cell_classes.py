# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Cell classes of the recovered map: expansion cells, enclosed cells, changes to the grid."""

from __future__ import annotations

import math

import numpy as np

from slarm_graph.geographic import CellState, is_free
from slarm_graph.grid import GridGeometry, Mask, OccupancyGrid
from slarm_graph.raster.bands import by_windows, windows
from slarm_graph.raster.distance import within
from slarm_graph.raster.patches import joined
from slarm_graph.tiles import Where, Window


def expansion(target: GridGeometry, states: np.ndarray, radius_m: float, where: Where) -> Mask:
    """Accessible cells within the expansion radius, rounded up to cells, of any that is not free.

    Not free are obstacles, unknown cells, which on coarse cells may be all there is of a wall, and
    everything outside the grid.
    """
    if radius_m <= 0.0:
        return np.zeros(target.shape, dtype=np.bool_)
    whole_m, cell_m = whole_cells_m(target, radius_m), target.resolution_m
    rim = round(whole_m / cell_m)

    def part(window: Window) -> Mask:
        """Expansion cells of a window; cells beyond its halo are farther away than the radius."""
        here = states[window]
        near = within(np.pad(~is_free(here), rim, constant_values=True), whole_m, cell_m)
        inner = near[rim : rim + here.shape[0], rim : rim + here.shape[1]]
        return np.asarray(inner & (here == CellState.ACCESSIBLE))

    return by_windows(where, rim, part)


def enclosed_cells(states: np.ndarray, visited: Mask, where: Where) -> Mask:
    """Accessible cells not connected to any visited cell."""
    accessible = by_windows(where, 0, lambda window: states[window] == CellState.ACCESSIBLE)
    reached = joined(accessible, visited, where)
    return by_windows(where, 0, lambda window: accessible[window] & ~reached[window])


def whole_cells_m(target: GridGeometry, radius_m: float) -> float:
    """A radius rounded up to cells [m]."""
    return math.ceil(radius_m / target.resolution_m - 1e-9) * target.resolution_m


def changed_cells(grid: OccupancyGrid, states: np.ndarray, where: Where) -> int:
    """Count the cells whose class differs from that of the grid."""
    count = 0
    for part in windows(where):
        here, now = grid.in_window(part.cells), states[part.cells]
        changed = (here.occupied != (now == CellState.OBSTACLE)) | (here.free != is_free(now))
        count += int(np.sum(changed))
    return count
