# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""First part of recovery: an occupancy grid without specks, pinholes and leaks."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy import ndimage

from slarm_graph.config import RecoveryConfig
from slarm_graph.grid import GridGeometry, Mask, OccupancyGrid
from slarm_graph.raster.distance import distance_to
from slarm_graph.raster.patches import joined, larger_than, patches

_EIGHT = np.ones((3, 3), dtype=np.bool_)
_LEAST_CELLS = 3


@dataclass(frozen=True, slots=True)
class CleanGrid:
    """A grid in three classes and the part of it the robot can get to.

    Parameters
    ----------
    geometry : GridGeometry
    occupied, free : (rows, cols) bool
        Cells in neither are unknown.
    reached : (rows, cols) bool
        Free cells that those the robot visited lead to, by ways wider than a beam is seen to be.
    passable : (rows, cols) bool
        Those of them that it visited or where its disc fits.
    """

    geometry: GridGeometry
    occupied: Mask
    free: Mask
    reached: Mask
    passable: Mask


def cleaned(grid: OccupancyGrid, visited: Mask, config: RecoveryConfig) -> CleanGrid:
    """Threshold a grid, drop specks, close pinholes in walls and in free space.

    Visited cells become free, and cells where the robot's disc fits stay free, so that passable
    space keeps its connections whatever is closed.

    Parameters
    ----------
    grid : OccupancyGrid
    visited : (rows, cols) bool
    config : RecoveryConfig
    """
    occupied = larger_than(grid.occupied, config.speck_cells) & ~visited
    free = (grid.free | visited | (grid.occupied & ~occupied)) & ~occupied
    passable = visited | (
        free & _fits(occupied, config.robot_radius_m / grid.geometry.resolution_m)
    )
    closed = cv2.morphologyEx(
        np.pad(occupied, 1).astype(np.uint8), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8)
    )[1:-1, 1:-1].astype(np.bool_)
    occupied |= closed & ~passable
    free &= ~occupied
    free |= _small_holes(free, occupied, config.hole_area_m2 / grid.geometry.resolution_m**2)
    reached = _reached(free, visited, config.robot_radius_m / grid.geometry.resolution_m)
    return CleanGrid(grid.geometry, occupied, free, reached, passable & reached)


def _fits(occupied: Mask, radius_cells: float) -> Mask:
    """Cells from whose centre a disc reaches into no occupied cell's centre."""
    return np.asarray(distance_to(occupied) > radius_cells)


def _small_holes(free: Mask, occupied: Mask, most_cells: float) -> Mask:
    """Unknown patches no larger than a size that touch free cells only, none of them a wall's."""
    unknown = ~(free | occupied)
    labels, sizes = patches(unknown, over_corners=True)
    small = sizes <= most_cells
    small[0] = False
    beside = labels[ndimage.binary_dilation(occupied, _EIGHT) & unknown]
    small[beside] = False
    edge = np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]])
    small[edge] = False
    return np.asarray(small[labels])


def _reached(free: Mask, visited: Mask, radius_cells: float) -> Mask:
    """Free cells that visited ones lead to, by ways of three cells and more.

    A beam through a window or between the legs of a chair leaves a free line behind it, one or two
    cells wide, that leads nowhere. Where cells are so large that the robot fits through two, every
    way counts.
    """
    if 2.0 * radius_cells < _LEAST_CELLS:
        return joined(free, visited)
    ways = cv2.erode(free.astype(np.uint8), np.ones((_LEAST_CELLS, _LEAST_CELLS), np.uint8))
    region = joined(ways.astype(np.bool_) | (visited & free), visited)
    for _ in range(_LEAST_CELLS - 1):
        region = (cv2.dilate(region.astype(np.uint8), _EIGHT.astype(np.uint8)) > 0) & free
    return region
