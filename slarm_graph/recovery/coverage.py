# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Coverage of a drive: cells observed, visited by the robot's centre, swept by its footprint."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slarm_graph.geographic import CellState, is_reachable
from slarm_graph.geometry import Floats
from slarm_graph.grid import GridGeometry, Mask, OccupancyGrid
from slarm_graph.raster.bands import by_windows
from slarm_graph.raster.discs import mark_discs
from slarm_graph.tiles import TILE_CELLS, Where, Window
from slarm_graph.trajectory import Trajectory

_ROUNDING_M = 1e-6
"""Far above rounding of metres and far below a cell: a centre just at the disc is passed over."""


def observed_cells(grid: OccupancyGrid, states: np.ndarray, where: Where) -> Mask:
    """Mark the cells (rows, cols) observed free, or observed and recovered as free."""

    def part(window: Window) -> Mask:
        """Observed cells of a window."""
        here, now = grid.in_window(window), states[window]
        known_free = is_reachable(now) & ~np.isnan(here.probability)
        return np.asarray(known_free | (here.free & (now != CellState.OBSTACLE)))

    return by_windows(where, 0, part)


def visited_cells(geometry: GridGeometry, trajectory: Trajectory) -> Mask:
    """Mark the cells (rows, cols) that the robot's centre passed through."""
    visited = np.zeros(geometry.shape, dtype=np.bool_)
    if not len(trajectory):
        return visited
    # A tenth of a cell between samples leaves out no more than the tip of a corner.
    cells = geometry.cell_of(path_points_m(trajectory, 0.1 * geometry.resolution_m))
    cells = cells[geometry.contains(cells)]
    visited[cells[:, 0], cells[:, 1]] = True
    return visited


def with_path_tiles(grid: OccupancyGrid, trajectory: Trajectory) -> OccupancyGrid:
    """Add the tiles along the robot's path, where it may have observed nothing."""
    if grid.tiles is None or not len(trajectory):
        return grid
    # Between samples half a tile apart none is left out, as those beside are added as well.
    way = path_points_m(trajectory, 0.5 * TILE_CELLS * grid.geometry.resolution_m)
    cells = grid.geometry.cell_of(way)
    return replace(grid, tiles=grid.tiles.with_boxes(cells, cells))


def path_points_m(trajectory: Trajectory, step_m: float) -> Floats:
    """Sample the path (N, 2) [m]: every pose, and points in between at most a step apart."""
    points = trajectory.poses[:, :2]
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(lengths)])
    samples = np.arange(0.0, along[-1], step_m)
    way = np.column_stack([np.interp(samples, along, points[:, axis]) for axis in range(2)])
    return np.concatenate([points, way])


def footprint_cells(geometry: GridGeometry, trajectory: Trajectory, radius_m: float) -> Mask:
    """Mark the cells (rows, cols) whose centre a disc along the path covers."""
    over = np.zeros(geometry.shape, dtype=np.bool_)
    if len(trajectory):
        cell_m = geometry.resolution_m
        path = path_points_m(trajectory, 0.1 * min(cell_m, radius_m))
        origin = np.array([geometry.origin_x_m, geometry.origin_y_m])
        mark_discs(over, (path - origin) / cell_m, (radius_m + _ROUNDING_M) / cell_m)
    return over
