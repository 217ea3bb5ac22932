# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""First part of recovery: an occupancy grid without specks, pinholes and leaks."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from slarm_graph.config import RecoveryConfig
from slarm_graph.grid import GridGeometry, Mask, OccupancyGrid
from slarm_graph.raster.bands import by_bands
from slarm_graph.raster.distance import farther_than
from slarm_graph.raster.patches import joined, larger_than, patches

_LEAST_CELLS = 3
"""Free lines of one or two cells are single beams through gaps; a door of 0.7 m is 14 cells of 0.05
m."""


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
    cell_m = grid.geometry.resolution_m
    radius_cells = config.robot_radius_m / cell_m
    shape, reach = grid.geometry.shape, math.ceil(radius_cells) + 1
    # What is only written where it is true takes no memory elsewhere.
    aside = [grid.probability]
    held = by_bands(shape, 0, lambda rows: grid.in_rows(rows).occupied, aside=aside)
    occupied = larger_than(held, config.speck_cells)
    occupied[visited] = False
    free = by_bands(
        shape,
        0,
        lambda r: (grid.in_rows(r).free | visited[r] | held[r]) & ~occupied[r],
        aside=aside,
    )
    passable = by_bands(
        shape, reach, lambda r: (farther_than(occupied[r], radius_cells) & free[r]) | visited[r]
    )
    closed = by_bands(shape, 2, lambda rows: _closed(occupied[rows]) & ~passable[rows])
    occupied[closed] = True
    free[closed] = False
    del closed
    free[_small_holes(free, occupied, config.hole_area_m2 / cell_m**2)] = True
    reached = _reached(free, visited, radius_cells)
    passable[passable & ~reached] = False
    return CleanGrid(grid.geometry, occupied, free, reached, passable)


def _closed(occupied: Mask) -> Mask:
    """Cells with those that a closing by 3 x 3 cells adds; outside the grid is not occupied."""
    framed = np.pad(occupied, 1).view(np.uint8)
    around = np.ones((3, 3), dtype=np.uint8)
    return cv2.morphologyEx(framed, cv2.MORPH_CLOSE, around)[1:-1, 1:-1].view(np.bool_)


def _small_holes(free: Mask, occupied: Mask, most_cells: float) -> Mask:
    """Unknown patches no larger than a size that touch free cells only, none of them a wall's."""
    rows, cols = free.shape

    def part(band: slice) -> Mask:
        """A patch that is small in a band, and reaches into it, ends within its halo."""
        unknown = ~(free[band] | occupied[band])
        labels, sizes = patches(unknown, over_corners=True)
        small = sizes <= most_cells
        small[0] = False
        small[labels[_widened(occupied[band]) & unknown]] = False
        small[labels[:, [0, -1]]] = False
        if band.start == 0:
            small[labels[0]] = False
        if band.stop == rows:
            small[labels[-1]] = False
        return np.asarray(small[labels])

    return by_bands((rows, cols), math.floor(most_cells) + 2, part)


def _widened(mask: Mask) -> Mask:
    """Cells of a mask and their eight neighbours."""
    return cv2.dilate(mask.view(np.uint8), np.ones((3, 3), dtype=np.uint8)).view(np.bool_)


def _reached(free: Mask, visited: Mask, radius_cells: float) -> Mask:
    """Free cells that visited ones lead to, by ways of three cells and more.

    A beam through a window or between the legs of a chair leaves a free line behind it, one or two
    cells wide, that leads nowhere. Where cells are so large that the robot fits through two, every
    way counts.
    """
    if 2.0 * radius_cells < _LEAST_CELLS:
        return joined(free, visited)
    around = np.ones((_LEAST_CELLS, _LEAST_CELLS), dtype=np.uint8)

    def wide(rows: slice) -> Mask:
        """Ways of three cells, of some rows, and where the robot was."""
        ways = cv2.erode(free[rows].view(np.uint8), around).view(np.bool_)
        return ways | (visited[rows] & free[rows])

    region = joined(by_bands(free.shape, _LEAST_CELLS, wide), visited)
    steps = _LEAST_CELLS - 1

    def widened(rows: slice) -> Mask:
        """The region, of some rows, as far as one way is wide."""
        here = region[rows]
        for _ in range(steps):
            here = _widened(here) & free[rows]
        return here

    return by_bands(free.shape, steps, widened)
