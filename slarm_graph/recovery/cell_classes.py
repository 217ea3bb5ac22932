# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Classes of cells once walls stand: kept clear of by the robot's size, cut off, changed."""

from __future__ import annotations

import math

import numpy as np

from slarm_graph.geographic import CellState
from slarm_graph.grid import GridGeometry, Mask, OccupancyGrid
from slarm_graph.raster.bands import by_windows, windows
from slarm_graph.raster.distance import within
from slarm_graph.raster.patches import joined
from slarm_graph.tiles import Where, Window


def expansion(target: GridGeometry, states: np.ndarray, radius_m: float, where: Where) -> Mask:
    """Accessible cells within the expansion radius, rounded up to cells, of what is not free.

    That is obstacles, what nobody has seen, which behind a wall is all there is of it on coarse
    cells, and what lies beyond the lattice.
    """
    if radius_m <= 0.0:
        return np.zeros(target.shape, dtype=np.bool_)
    whole_m, cell_m = whole_cells_m(target, radius_m), target.resolution_m
    rim = round(whole_m / cell_m)

    def part(window: Window) -> Mask:
        """Those of a window; what is beyond its halo is farther away than the radius."""
        here = states[window]
        shut = np.isin(here, (CellState.OBSTACLE, CellState.UNKNOWN))
        near = within(np.pad(shut, rim, constant_values=True), whole_m, cell_m)
        inner = near[rim : rim + here.shape[0], rim : rim + here.shape[1]]
        return np.asarray(inner & (here == CellState.ACCESSIBLE))

    return by_windows(where, rim, part)


def enclosed_cells(states: np.ndarray, visited: Mask, where: Where) -> Mask:
    """Accessible cells that no accessible way joins to where the robot was."""
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
        now_occupied = now == CellState.OBSTACLE
        now_free = ~now_occupied & (now != CellState.UNKNOWN)
        count += int(np.sum((here.occupied != now_occupied) | (here.free != now_free)))
    return count
