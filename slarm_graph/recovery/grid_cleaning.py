# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Morphological cleaning of an occupancy grid: specks, pinholes, and stray lines of free cells."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from slarm_graph.config import RecoveryConfig
from slarm_graph.grid import GridGeometry, Mask, OccupancyGrid
from slarm_graph.raster.bands import by_windows, put
from slarm_graph.raster.distance import farther_than
from slarm_graph.raster.patches import joined, larger_than, small_patches
from slarm_graph.tiles import KnownTiles, Where, Window, shape_of

_LEAST_CELLS = 3
"""Free lines of one or two cells are single beams through gaps; a door of 0.7 m is 14 cells of 0.05
m."""


@dataclass(frozen=True, slots=True)
class CleanGrid:
    """A grid in three classes, and the part of it that is reachable.

    Parameters
    ----------
    geometry : GridGeometry
    occupied, free : (rows, cols) bool
        Cells in neither are unknown.
    reached : (rows, cols) bool
        Free cells connected to visited ones, by corridors wider than a single beam.
    passable : (rows, cols) bool
        Those of them that were visited or where the robot's disc fits.
    tiles : KnownTiles, optional
        As the grid's.
    """

    geometry: GridGeometry
    occupied: Mask
    free: Mask
    reached: Mask
    passable: Mask
    tiles: KnownTiles | None = None

    @property
    def where(self) -> Where:
        """Cells to process: all, or those of its tiles."""
        return self.tiles or self.geometry.shape


def clean_grid(grid: OccupancyGrid, visited: Mask, config: RecoveryConfig) -> CleanGrid:
    """Threshold a grid, remove specks, close pinholes in walls, fill holes in free space.

    Visited cells become free, and cells where the robot's disc fits stay free, so that passable
    space stays connected whatever is closed.

    Parameters
    ----------
    grid : OccupancyGrid
    visited : (rows, cols) bool
    config : RecoveryConfig
    """
    cell_m = grid.geometry.resolution_m
    radius_cells = config.robot_radius_m / cell_m
    where, reach = grid.where, math.floor(radius_cells)
    occupied, free = _without_specks(grid, visited, config.speck_cells)
    passable = by_windows(
        where, reach, lambda w: (farther_than(occupied[w], radius_cells) & free[w]) | visited[w]
    )
    closed = by_windows(where, 2, lambda w: _closed(occupied[w]) & ~passable[w])
    put(occupied, closed, True, where)
    put(free, closed, False, where)
    del closed
    most_cells = config.hole_area_m2 / cell_m**2
    put(free, _small_holes(free, occupied, most_cells, where), True, where)
    reached = _reached(free, visited, radius_cells, where)
    passable = by_windows(where, 0, lambda w: passable[w] & reached[w])
    return CleanGrid(grid.geometry, occupied, free, reached, passable, grid.tiles)


def _without_specks(grid: OccupancyGrid, visited: Mask, speck_cells: int) -> tuple[Mask, Mask]:
    """Occupied cells without specks and visited cells, and free cells."""
    # What is only written where it is true takes no memory elsewhere.
    where, aside = grid.where, [grid.probability]
    held = by_windows(where, 0, lambda w: grid.in_window(w).occupied, aside=aside)
    occupied = larger_than(held, speck_cells, where)
    put(occupied, visited, False, where)
    free = by_windows(
        where,
        0,
        lambda w: (grid.in_window(w).free | visited[w] | held[w]) & ~occupied[w],
        aside=aside,
    )
    return occupied, free


def _closed(occupied: Mask) -> Mask:
    """Morphological closing by 3 x 3 cells; outside the grid is not occupied."""
    framed = np.pad(occupied, 1).view(np.uint8)
    around = np.ones((3, 3), dtype=np.uint8)
    return cv2.morphologyEx(framed, cv2.MORPH_CLOSE, around)[1:-1, 1:-1].view(np.bool_)


def _small_holes(free: Mask, occupied: Mask, most_cells: float, where: Where) -> Mask:
    """Connected components of unknown cells up to a size that border on free cells only."""

    def part(window: Window) -> Mask:
        """Small components of a window: those that reach into it end within its halo."""
        barred = _dilated(occupied[window])
        for lines, at, most in zip((barred, barred.T), window, shape_of(where), strict=True):
            if at.start == 0:
                lines[0] = True
            if at.stop == most:
                lines[-1] = True
        return small_patches(~(free[window] | occupied[window]), barred, math.floor(most_cells))

    return by_windows(where, math.floor(most_cells) + 2, part)


def _dilated(mask: Mask) -> Mask:
    """Dilation by 3 x 3 cells."""
    return cv2.dilate(mask.view(np.uint8), np.ones((3, 3), dtype=np.uint8)).view(np.bool_)


def _reached(free: Mask, visited: Mask, radius_cells: float, where: Where) -> Mask:
    """Free cells connected to visited ones by corridors at least three cells wide.

    A beam through a window or between the legs of a chair leaves a free line behind it, one or two
    cells wide, that leads nowhere. Where cells are so large that the robot fits through two, every
    connection counts.
    """
    if 2.0 * radius_cells < _LEAST_CELLS:
        return joined(free, visited, where)
    around = np.ones((_LEAST_CELLS, _LEAST_CELLS), dtype=np.uint8)

    def wide(window: Window) -> Mask:
        """Corridors three cells wide (erosion), and visited cells, of a window."""
        corridors = cv2.erode(free[window].view(np.uint8), around).view(np.bool_)
        return corridors | (visited[window] & free[window])

    region = joined(by_windows(where, _LEAST_CELLS, wide), visited, where)
    steps = _LEAST_CELLS - 1

    def dilated(window: Window) -> Mask:
        """The region of a window, dilated within free cells by what erosion took off."""
        here = region[window]
        for _ in range(steps):
            here = _dilated(here) & free[window]
        return here

    return by_windows(where, steps, dilated)
