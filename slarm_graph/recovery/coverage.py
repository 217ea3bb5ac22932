# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""What the robot has covered: cells seen, cells its centre and its body passed over."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from slarm_graph.geographic import CellState
from slarm_graph.geometry import Floats
from slarm_graph.grid import GridGeometry, Mask, OccupancyGrid
from slarm_graph.raster.bands import by_windows, cells_of
from slarm_graph.raster.distance import within
from slarm_graph.tiles import TILE_CELLS, KnownTiles, Where, Window
from slarm_graph.trajectory import Trajectory


def observed_cells(grid: OccupancyGrid, states: np.ndarray, where: Where) -> Mask:
    """Mark the cells (rows, cols) seen free, or seen and free as recovery has it."""
    obstacle, known_free = CellState.OBSTACLE, (CellState.ACCESSIBLE, CellState.EXPANSION)

    def part(window: Window) -> Mask:
        """Those of a window."""
        here, now = grid.in_window(window), states[window]
        seen = ~np.isnan(here.probability)
        return np.asarray((seen & np.isin(now, known_free)) | (here.free & (now != obstacle)))

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


def with_way(grid: OccupancyGrid, trajectory: Trajectory) -> OccupancyGrid:
    """Add the tiles that the robot passed through, where it saw nothing for a while."""
    if grid.tiles is None or not len(trajectory):
        return grid
    # Between samples half a tile apart none is left out, as those beside are added as well.
    way = path_points_m(trajectory, 0.5 * TILE_CELLS * grid.geometry.resolution_m)
    cells = grid.geometry.cell_of(way)
    return replace(grid, tiles=grid.tiles.with_boxes(cells, cells))


def path_points_m(trajectory: Trajectory, step_m: float) -> Floats:
    """Points (N, 2) of the path [m]: every pose's, and in between at most a step apart."""
    points = trajectory.poses[:, :2]
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(lengths)])
    samples = np.arange(0.0, along[-1], step_m)
    way = np.column_stack([np.interp(samples, along, points[:, axis]) for axis in range(2)])
    return np.concatenate([points, way])


def footprint_cells(
    geometry: GridGeometry, trajectory: Trajectory, radius_m: float, tiles: KnownTiles | None = None
) -> Mask:
    """Mark the cells (rows, cols) whose centre a disc on the path passed over.

    With tiles, those that the robot visited are among them.
    """
    cell_m = geometry.resolution_m
    near_m = radius_m + 1.5 * cell_m
    where = tiles.grown(math.ceil(near_m / cell_m)) if tiles else geometry.shape
    over = within(visited_cells(geometry, trajectory), near_m, cell_m, where)
    path = path_points_m(trajectory, 0.1 * min(cell_m, radius_m))
    cells = cells_of(over, where)
    if len(cells):
        centers = geometry.center_of(cells)
        apart_m, _ = cKDTree(path).query(centers, distance_upper_bound=radius_m + 1e-6)
        over[cells[:, 0], cells[:, 1]] = np.isfinite(apart_m)
    return over
