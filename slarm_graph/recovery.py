# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Map recovery, the plain part of GGMR: reachability, expansion and coverage of a grid."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from slarm_graph.config import RecoveryConfig
from slarm_graph.geographic import CellState, Coverage, GeographicMap
from slarm_graph.grid import GridGeometry, Mask, OccupancyGrid
from slarm_graph.trajectory import Trajectory

_BODY_RADIUS_M = 0.18


def recover(grid: OccupancyGrid, trajectory: Trajectory, config: RecoveryConfig) -> GeographicMap:
    """Say of every cell whether the robot can be there.

    Parameters
    ----------
    grid : OccupancyGrid
    trajectory : Trajectory
        `map_from_robot`; cells it visits are never obstacles.
    config : RecoveryConfig
    """
    visited = _visited(grid.geometry, trajectory)
    occupied = grid.occupied & ~visited
    free = grid.free | visited
    apart_m = ndimage.distance_transform_edt(~occupied) * grid.geometry.resolution_m
    near = apart_m <= config.expansion_radius_m
    labels, _ = ndimage.label(free & ~near)
    reached = np.isin(labels, np.setdiff1d(np.unique(labels[visited]), [0]))
    states = np.full(grid.geometry.shape, CellState.UNKNOWN, dtype=np.uint8)
    states[free] = CellState.ENCLOSED
    states[free & near] = CellState.EXPANSION
    states[reached] = CellState.ACCESSIBLE
    states[occupied] = CellState.OBSTACLE
    height_m = np.inf if config.default_height_m is None else config.default_height_m
    passed_m = ndimage.distance_transform_edt(~visited) * grid.geometry.resolution_m
    return GeographicMap(
        grid.geometry,
        states,
        np.where(occupied, height_m, 0.0).astype(np.float32),
        "infinite" if config.default_height_m is None else "default",
        Coverage(grid.free, visited, (passed_m <= _BODY_RADIUS_M) & free),
        int(np.sum(occupied != grid.occupied)),
    )


def _visited(geometry: GridGeometry, trajectory: Trajectory) -> Mask:
    """Mark the cells (rows, cols) that the robot's centre passed through."""
    visited = np.zeros(geometry.shape, dtype=np.bool_)
    points = trajectory.poses[:, :2]
    steps = max(1, int(np.ceil(trajectory.path_length_m() / geometry.resolution_m * 2)))
    along = np.linspace(0, len(points) - 1, steps + len(points))
    index = np.arange(len(points))
    way = np.column_stack([np.interp(along, index, points[:, axis]) for axis in (0, 1)])
    cells = geometry.cell_of(way)
    cells = cells[geometry.contains(cells)]
    visited[cells[:, 0], cells[:, 1]] = True
    return visited
