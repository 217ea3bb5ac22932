# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The geographic map: where the obstacles are, how high, and where the robot can be."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from slarm_graph.geometry import Floats
from slarm_graph.grid import GridGeometry, Mask, OccupancyGrid
from slarm_graph.raster.bands import by_windows
from slarm_graph.tiles import KnownTiles, Where
from slarm_graph.world import Solid


class CellState(IntEnum):
    """What the geographic map says of a cell."""

    UNKNOWN = 0
    ACCESSIBLE = 1
    OBSTACLE = 2
    EXPANSION = 3
    """Free, but within the expansion radius of an obstacle."""
    ENCLOSED = 4
    """Free, but the robot cannot get there."""


@dataclass(frozen=True, slots=True)
class Coverage:
    """Three layers of what the robot has covered, never mixed with occupancy.

    Parameters
    ----------
    observed : (rows, cols) bool
        Seen free by the laser.
    visited : (rows, cols) bool
        The robot's centre was in the cell.
    footprint : (rows, cols) bool
        The robot's disc passed over the cell's centre.
    """

    observed: Mask
    visited: Mask
    footprint: Mask


@dataclass(frozen=True, slots=True)
class HeightGroup:
    """Solids whose height is uncertain, and low or high together: sides of one outline.

    Parameters
    ----------
    solids : tuple of int, length N
        Numbers of the map's solids.
    levels_m : (K, N) float64
        Equally likely heights of each [m], ascending; the k-th of all belong together.
    """

    solids: tuple[int, ...]
    levels_m: Floats


@dataclass(frozen=True, slots=True)
class GeographicMap:
    """The recovered map, one state per cell.

    Parameters
    ----------
    geometry : GridGeometry
    states : (rows, cols) uint8
        Values of CellState.
    heights_m : (rows, cols) float32
        Top of the obstacle in the cell [m]; 0 where there is none, inf where unbounded.
    height_source : str
        Where the heights came from: `infinite`, `default`, `prior`, `matched sizes`, `truth`.
    coverage : Coverage
    changed_cells : int
        Cells whose class recovery changed.
    solids : tuple of Solid
        All obstacles as straight-walled prisms, sharper than the cells; empty where only cells are
        known.
    height_groups : tuple of HeightGroup
        Which of them have an uncertain height; that of the solid itself is the median.
    expansion_radius_m : float
        Kept from obstacles, rounded up to cells (the paper's R_e) [m].
    tiles : KnownTiles, optional
        Of a large map, those outside of which all cells are unknown.
    """

    geometry: GridGeometry
    states: NDArray[np.uint8]
    heights_m: NDArray[np.float32]
    height_source: str
    coverage: Coverage
    changed_cells: int = 0
    solids: tuple[Solid, ...] = ()
    height_groups: tuple[HeightGroup, ...] = ()
    expansion_radius_m: float = 0.0
    tiles: KnownTiles | None = None

    @property
    def where(self) -> Where:
        """Where it has to be looked at: everywhere, unless it has tiles."""
        return self.tiles or self.geometry.shape

    @property
    def accessible(self) -> Mask:
        """Cells in which the robot can be."""
        return np.asarray(self.states == CellState.ACCESSIBLE)

    @property
    def reachable(self) -> Mask:
        """Cells over which an antenna of the robot can be, see `is_reachable`."""
        return by_windows(self.where, 0, lambda window: is_reachable(self.states[window]))

    @property
    def free(self) -> Mask:
        """Cells known to have no obstacle, see `is_free`."""
        return by_windows(self.where, 0, lambda window: is_free(self.states[window]))

    @property
    def obstacle(self) -> Mask:
        """Cells that belong to a wall or an obstacle."""
        return np.asarray(self.states == CellState.OBSTACLE)


def is_reachable(states: NDArray[np.uint8]) -> Mask:
    """Accessible cells and those too near to an obstacle for the robot's centre."""
    return np.asarray((states == CellState.ACCESSIBLE) | (states == CellState.EXPANSION))


def is_free(states: NDArray[np.uint8]) -> Mask:
    """Cells known to have no obstacle, whether the robot can get there or not."""
    return np.asarray((states != CellState.OBSTACLE) & (states != CellState.UNKNOWN))


def as_geographic(grid: OccupancyGrid, default_height_m: float | None = None) -> GeographicMap:
    """Take an occupancy grid as it is: free cells accessible, obstacles of one height.

    Parameters
    ----------
    grid : OccupancyGrid
    default_height_m : float, optional
        Of every obstacle [m]; infinite when left out.
    """
    states = np.full(grid.geometry.shape, CellState.UNKNOWN, dtype=np.uint8)
    states[grid.free] = CellState.ACCESSIBLE
    states[grid.occupied] = CellState.OBSTACLE
    height_m = np.inf if default_height_m is None else default_height_m
    nowhere = np.zeros(grid.geometry.shape, dtype=np.bool_)
    return GeographicMap(
        grid.geometry,
        states,
        np.where(grid.occupied, height_m, 0.0).astype(np.float32),
        "infinite" if default_height_m is None else "default",
        Coverage(grid.free, nowhere, nowhere),
    )
