# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Maps of all particles in one pool of tiles, copy on write.

A map is a table of tile numbers. Resampling copies tables and counts references; cells are copied
only when a particle writes into a tile that another one also uses.

A cell holds what its end points have in common: their number, mean position and mean surface
normal. Means make a 5 cm cell good to millimetres, and the normal separates the two sides of a
thin wall.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from slarm_graph.config import ParticleMapsConfig
from slarm_graph.errors import BadInput
from slarm_graph.geometry import Floats
from slarm_graph.kernels import kernel, kernel_with

TILE_BITS = 4
"""Logarithm of a tile's side, so that indices are shifts; the maps are the same for all."""
TILE_CELLS = 1 << TILE_BITS
"""Cells along the side of a tile."""
CELL_VALUES = 5
"""Of a cell: number of end points, sums of their offsets x, y from its centre in cells, sums of
their normals x, y."""
NO_TILE = -1
"""Entry of a table where a particle has no tile."""
_SPARE_TILES = 2
"""Tiles by which tables grow beyond what is asked for, so that they do so seldom."""
_FIRST_TILES = 1024
"""Tiles of the pool before it grows, 5 MB; the result is the same for any."""
_TILE_BYTES = TILE_CELLS**2 * CELL_VALUES * 4
"""Four bytes for each value of each cell."""
_USUAL_AREA_M = 50.0
"""Side of the area that memory is estimated for; only a notice depends on it."""
_NOTICE_MB = 1000.0
"""Memory from which a notice is given; a choice, an eighth of a common machine's."""

Tables = NDArray[np.int32]
Cells = NDArray[np.float32]
Indices = NDArray[np.int64]


class Tiles(NamedTuple):
    """The maps of P particles as compiled code takes them: fields of `ParticleMaps`, in m."""

    tables: Tables
    corner: Indices
    cells: Cells
    resolution: float


@dataclass
class ParticleMaps:
    """The maps of P particles.

    Parameters
    ----------
    resolution_m : float
        Side of a cell [m].
    tables : (P, R, C) int32
        Tile number of every patch of the plane for every particle; -1 where it has none.
    corner : (2,) int64
        Row and column, counted in tiles from the map's origin, of the tables' first entry.
    cells : (capacity, TILE_CELLS**2, CELL_VALUES) float32
        The pool.
    references : (capacity,) int32
        How many tables use a tile; 0 for a free one.
    max_tiles : int
        The pool never grows beyond it.
    """

    resolution_m: float
    tables: Tables
    corner: Indices
    cells: Cells
    references: NDArray[np.int32]
    max_tiles: int

    @staticmethod
    def empty(particles: int, resolution_m: float, max_tiles: int = 1 << 20) -> ParticleMaps:
        """Make maps without any end point."""
        first = min(_FIRST_TILES, max_tiles)
        return ParticleMaps(
            resolution_m,
            np.full((particles, 1, 1), NO_TILE, dtype=np.int32),
            np.zeros(2, dtype=np.int64),
            np.zeros((first, TILE_CELLS**2, CELL_VALUES), dtype=np.float32),
            np.zeros(first, dtype=np.int32),
            max_tiles,
        )

    @property
    def tiles(self) -> Tiles:
        """The maps for compiled code."""
        return Tiles(self.tables, self.corner, self.cells, self.resolution_m)

    @property
    def particles(self) -> int:
        """Number of maps."""
        return len(self.tables)

    @property
    def memory_bytes(self) -> int:
        """Size of pool and tables [bytes]."""
        return self.cells.nbytes + self.tables.nbytes + self.references.nbytes

    def cover(self, low_m: Floats, high_m: Floats) -> None:
        """Grow the tables to cover the box from `low_m` to `high_m`, each (2,) x, y [m]."""
        tile_m = TILE_CELLS * self.resolution_m
        low = np.floor(low_m[::-1] / tile_m).astype(np.int64) - self.corner
        high = np.floor(high_m[::-1] / tile_m).astype(np.int64) - self.corner
        shape = np.array(self.tables.shape[1:])
        if (low >= 0).all() and (high < shape).all():
            return
        before = np.where(low < 0, -low + _SPARE_TILES, 0)
        after = np.where(high >= shape, high - shape + 1 + _SPARE_TILES, 0)
        pad = ((0, 0), (before[0], after[0]), (before[1], after[1]))
        self.tables = np.pad(self.tables, pad, constant_values=NO_TILE)
        self.corner = self.corner - before

    def resample(self, ancestors: Indices) -> None:
        """Give particle i the map of particle `ancestors[i]`; copies tile numbers only."""
        self.tables = self.tables[ancestors]
        _count_references(self.tables, self.references)

    def insert(self, points: Floats, poses: Floats) -> None:
        """Add the end points of a scan to every map at that particle's pose.

        Parameters
        ----------
        points : (K, 4) float64
            x, y [m] and unit normal x, y (0, 0 where unknown) in the robot's frame.
        poses : (P, 3) float64
            `map_from_robot` of every particle.
        """
        if not len(points):
            return
        reach = float(np.hypot(points[:, 0], points[:, 1]).max()) + self.resolution_m
        self.cover(poses[:, :2].min(axis=0) - reach, poses[:, :2].max(axis=0) + reach)
        self._unshare(_mark_touched(self.tiles, points, poses))
        _add_points(self.tiles, points, poses)

    def _unshare(self, wanted: Indices) -> None:
        """Unshare the tiles that are about to be written."""
        missing = count_missing(self.tables, self.references, wanted)
        free = np.flatnonzero(self.references == 0)
        if missing > len(free):
            self._grow(missing - len(free))
            free = np.flatnonzero(self.references == 0)
        detach(self.tables, self.references, self.cells, wanted, free)

    def _grow(self, tiles: int) -> None:
        capacity = len(self.cells)
        wanted = min(max(capacity + tiles, capacity + capacity // 4), self.max_tiles)
        if wanted < capacity + tiles:
            raise BadInput(
                f"particle maps would need more than {self.max_tiles * _TILE_BYTES / 1e6:.0f} MB;"
                " lower gmapping.particles or raise gmapping.maps.delta_m or"
                " gmapping.maps.max_memory_mb"
            )
        # In place where the system can; no view of it exists between two updates.
        self.cells.resize((wanted, *self.cells.shape[1:]), refcheck=False)
        self.references.resize(wanted, refcheck=False)

    def kept_state(self) -> dict[str, object]:
        """Leave empty cells out of a snapshot: most are, walls being thin."""
        filled = np.flatnonzero((self.cells[..., 0] != 0.0) & (self.references > 0)[:, None])
        state = dict(vars(self))
        state["cells"] = len(self.cells), filled, self.cells.reshape(-1, CELL_VALUES)[filled]
        return state

    def take_state(self, state: dict[str, Any]) -> None:
        """Put the cells back into their tiles."""
        tiles, filled, values = state["cells"]
        cells = np.zeros((tiles, TILE_CELLS**2, CELL_VALUES), dtype=np.float32)
        cells.reshape(-1, CELL_VALUES)[filled] = values
        vars(self).update(state, cells=cells)


def most_tiles(config: ParticleMapsConfig) -> int:
    """Tiles that fit into the memory the configuration allows."""
    return max(1, int(config.max_memory_mb * 1e6 / _TILE_BYTES))


def memory_notice(particles: int, config: ParticleMapsConfig) -> tuple[str, ...]:
    """Report how much memory the particle maps may need, where that is much.

    The estimate is for an area of 50 m x 50 m of which every second tile is touched by walls, and
    particles that share nothing; sharing makes it five to ten times less in practice.
    """
    tiles = 0.5 * (_USUAL_AREA_M / (TILE_CELLS * config.delta_m)) ** 2
    estimate_mb = particles * tiles * _TILE_BYTES / 1e6
    if estimate_mb <= _NOTICE_MB:
        return ()
    return (
        f"{particles} particles with {config.delta_m} m cells may need {estimate_mb:.0f} MB for"
        f" {_USUAL_AREA_M:.0f} m x {_USUAL_AREA_M:.0f} m if they share nothing; the limit is"
        f" gmapping.maps.max_memory_mb = {config.max_memory_mb:g}",
    )


@kernel_with(inline=True)
def within_tile(row: int, col: int) -> int:
    """Index of a cell of the plane within its tile."""
    return ((row & (TILE_CELLS - 1)) << TILE_BITS) + (col & (TILE_CELLS - 1))


@kernel
def _count_references(tables: Tables, references: NDArray[np.int32]) -> None:
    """Count anew how many tables use every tile."""
    references[:] = 0
    for tile in tables.flat:
        if tile >= 0:
            references[tile] += 1


@kernel
def _mark_touched(tiles: Tiles, points: Floats, poses: Floats) -> Indices:
    """List (particle, row, column) of every table entry that end points fall into, each once."""
    particles, rows, cols = tiles.tables.shape
    corner = tiles.corner
    seen = np.full((rows, cols), -1, dtype=np.int32)
    touched = np.empty((particles * len(points), 3), dtype=np.int64)
    count = 0
    tile_m = tiles.resolution * TILE_CELLS
    for p in range(particles):
        c, s = math.cos(poses[p, 2]), math.sin(poses[p, 2])
        for k in range(len(points)):
            x = poses[p, 0] + c * points[k, 0] - s * points[k, 1]
            y = poses[p, 1] + s * points[k, 0] + c * points[k, 1]
            row = math.floor(y / tile_m) - corner[0]
            col = math.floor(x / tile_m) - corner[1]
            if seen[row, col] != p:
                seen[row, col] = p
                touched[count, 0] = p
                touched[count, 1] = row
                touched[count, 2] = col
                count += 1
    return touched[:count]


@kernel
def count_missing(tables: Tables, references: NDArray[np.int32], wanted: Indices) -> int:
    """Return an upper bound of the new tiles needed to own all wanted entries."""
    missing = 0
    for i in range(len(wanted)):
        tile = tables[wanted[i, 0], wanted[i, 1], wanted[i, 2]]
        if tile < 0 or references[tile] > 1:
            missing += 1
    return missing


@kernel
def detach(
    tables: Tables,
    references: NDArray[np.int32],
    cells: Cells,
    wanted: Indices,
    free: Indices,
) -> None:
    """Give all wanted entries unshared tiles, copying shared ones."""
    taken = 0
    for i in range(len(wanted)):
        p, row, col = wanted[i, 0], wanted[i, 1], wanted[i, 2]
        tile = tables[p, row, col]
        if tile >= 0 and references[tile] == 1:
            continue
        new = free[taken]
        taken += 1
        if tile >= 0:
            cells[new] = cells[tile]
            references[tile] -= 1
        else:
            cells[new] = 0.0
        references[new] = 1
        tables[p, row, col] = new


@kernel
def _add_points(tiles: Tiles, points: Floats, poses: Floats) -> None:
    """Add end points and normals to the cells they fall into, eq. (4): p(m | x, o)."""
    tables, corner, cells, resolution = tiles
    for p in range(len(poses)):
        c, s = math.cos(poses[p, 2]), math.sin(poses[p, 2])
        for k in range(len(points)):
            x = (poses[p, 0] + c * points[k, 0] - s * points[k, 1]) / resolution
            y = (poses[p, 1] + s * points[k, 0] + c * points[k, 1]) / resolution
            col, row = math.floor(x), math.floor(y)
            tile = tables[p, (row >> TILE_BITS) - corner[0], (col >> TILE_BITS) - corner[1]]
            cell = cells[tile, within_tile(row, col)]
            cell[0] += 1.0
            cell[1] += x - col - 0.5
            cell[2] += y - row - 0.5
            cell[3] += c * points[k, 2] - s * points[k, 3]
            cell[4] += s * points[k, 2] + c * points[k, 3]
