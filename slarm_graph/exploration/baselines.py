# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Baseline coverage planners on tiles as wide as the robot: BA* and boustrophedon decomposition."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from slarm_graph.config import DrivingConfig, Stage
from slarm_graph.exploration.coverage_grid import (
    BLOCKED,
    OPEN,
    VISITED,
    Codes,
    CoverageGrid,
    DrivingGrid,
    driving_cell,
    in_blocks,
    start_cell,
    tiled,
)
from slarm_graph.exploration.explorer import Finished, Leg
from slarm_graph.exploration.floor_cells import label_floor_cells
from slarm_graph.exploration.moves import Moves
from slarm_graph.exploration.paths import leg_along
from slarm_graph.exploration.searches import Indices, path_to_nearest, reachable
from slarm_graph.geometry import Pose2
from slarm_graph.grid import Cells, Mask
from slarm_graph.kernels import kernel

_TRACKING_M: Final = 0.01
"""How far from its lane the robot may be, as for `ggmr+`; in the tests the follower strays 12 mm at
sharp corners and less elsewhere."""
_SWEPT_SHARE: Final = 0.7
"""A tile counts as covered when the body passed over this share of its free cells."""
_MAX_ATTEMPTS: Final = 4
"""Times a tile is targeted before it is given up: open on the map, but the robot finds it is
not."""
_HORIZON_TILES: Final = 60
"""Planning horizon of a sweep [tiles]: over unknown ground the rest will change."""


class _OnTiles(ABC):
    """An explorer that plans on tiles as wide as the robot."""

    def __init__(self, settings: Stage, driving: DrivingConfig) -> None:
        del settings
        self._tiles = _TiledFloor(driving.robot_radius_m)

    def next_goal(self, coverage: CoverageGrid, pose: Pose2) -> Leg | Finished:
        """Sweep from here, or drive to the next open tile, and sweep there."""
        tiles = self._tiles.around(coverage, pose)
        start = start_cell(tiles, pose) if tiles else None
        if tiles is None or start is None:
            return Finished("no free tile near the robot")
        path = self._next_tiles(tiles, start)
        if path is None:
            return Finished("no reachable tile is left")
        return self._tiles.leg(tiles, pose, path)

    @abstractmethod
    def _next_tiles(self, tiles: CoverageGrid, start: tuple[int, int]) -> Cells | None:
        """Next tiles (M, 2) to drive over, from the robot's; None where none is left."""


class BaStar(_OnTiles):
    """BA* (Viet, Dang, Laskar, Chung 2013): sweep north, south, east, west; else backtrack.

    Where no neighbouring tile is open, the robot goes by A* to the nearest covered tile at which a
    new sweep can begin.
    """

    def _next_tiles(self, tiles: CoverageGrid, start: tuple[int, int]) -> Cells | None:
        cells = self._sweep(tiles, start)
        if len(cells) >= 2:
            return cells
        back = self._backtrack(tiles, start)
        if back is None:
            return None
        return np.concatenate([back, self._sweep(tiles, (int(back[-1, 0]), int(back[-1, 1])))])

    def _sweep(self, tiles: CoverageGrid, start: tuple[int, int]) -> Cells:
        cols = tiles.geometry.cols
        flat = _sweep_north_south(tiles.codes.copy(), tiles.moves, start[0] * cols + start[1])
        return np.stack(np.divmod(flat, cols), axis=-1)

    def _backtrack(self, tiles: CoverageGrid, start: tuple[int, int]) -> Cells | None:
        """Path to the nearest backtracking point, or to the nearest open tile if there is none."""
        codes = tiles.codes.copy()
        codes[start] = VISITED
        points = _backtracking_points(codes)
        points[start] = False
        path = path_to_nearest(tiles.moves, points, start)
        if path is None or len(self._sweep(tiles, (int(path[-1, 0]), int(path[-1, 1])))) < 2:
            path = path_to_nearest(tiles.moves, codes == OPEN, start)
        return path


class Boustrophedon(_OnTiles):
    """Boustrophedon cells (Choset 2000): sweep the present cell row by row, then the nearest."""

    def _next_tiles(self, tiles: CoverageGrid, start: tuple[int, int]) -> Cells | None:
        labels = label_floor_cells(tiles.codes != BLOCKED, 3.0)
        is_open = tiles.codes == OPEN
        is_open[start] = False
        mine = is_open & (labels == labels[start])
        path = path_to_nearest(tiles.moves, mine, start) if mine.any() else None
        path = path_to_nearest(tiles.moves, is_open, start) if path is None else path
        if path is None:
            return None
        here = is_open & (labels == labels[path[-1, 0], path[-1, 1]])
        rows = _boustrophedon_rows(here, (int(path[-1, 0]), int(path[-1, 1])))
        return np.concatenate([path[:-1], rows])


@dataclass(slots=True)
class _TiledFloor:
    """Tiles of the robot's size, and how often each was targeted."""

    radius_m: float
    attempts: NDArray[np.uint8] | None = None

    def around(self, coverage: CoverageGrid, pose: Pose2) -> CoverageGrid | None:
        """Gather the driving cells that the robot can reach into tiles; None where it has none.

        A tile is covered when most of its floor was passed over.
        """
        driving = coverage.driving
        start = driving_cell(driving, pose.x, pose.y)
        if start is None:
            return None
        near = replace(driving, passable=driving.passable & reachable(driving.moves, start))
        tiles = tiled(near, self._side(driving))
        visited = self._covered(tiles)
        if self.attempts is None:
            self.attempts = np.zeros(tiles.codes.shape, dtype=np.uint8)
        visited |= self.attempts >= _MAX_ATTEMPTS
        return replace(tiles, codes=np.where(visited & (tiles.codes == OPEN), VISITED, tiles.codes))

    def _side(self, driving: DrivingGrid) -> int:
        """Return how many driving cells a tile is wide."""
        cell_m = driving.geometry.resolution_m
        return max(1, math.floor(2.0 * (self.radius_m - _TRACKING_M) / cell_m + 1e-6))

    def _covered(self, tiles: CoverageGrid) -> Mask:
        floor, swept, side = ~tiles.driving.occupied, tiles.driving.swept, tiles.fineness
        free = in_blocks(floor, side).sum(axis=(2, 3))
        return np.asarray(in_blocks(floor & swept, side).sum(axis=(2, 3)) >= _SWEPT_SHARE * free)

    def leg(self, tiles: CoverageGrid, pose: Pose2, cells: Cells) -> Leg:
        """Turn tiles into a path, and count an attempt at the first open one."""
        assert self.attempts is not None
        is_open = tiles.codes[cells[:, 0], cells[:, 1]] == OPEN
        first = int(np.argmax(is_open))
        self.attempts[cells[first, 0], cells[first, 1]] += 1
        return leg_along(tiles, pose, cells[: first + _HORIZON_TILES], more=True)


def _boustrophedon_rows(wanted: Mask, entry: tuple[int, int]) -> Cells:
    """Boustrophedon order (M, 2) of wanted tiles: row by row from the side nearer to the entry."""
    rows = np.flatnonzero(wanted.any(axis=1))
    if entry[0] - rows[0] > rows[-1] - entry[0]:
        rows = rows[::-1]
    here = entry[1]
    out = []
    for row in rows:
        cols = np.flatnonzero(wanted[row])
        if abs(cols[-1] - here) < abs(cols[0] - here):
            cols = cols[::-1]
        out.append(np.stack([np.full(len(cols), row), cols], axis=-1))
        here = cols[-1]
    return np.concatenate(out)


@kernel
def _sweep_north_south(codes: Codes, moves: Moves, start: int) -> Indices:
    """Boustrophedon motion of BA*: the first open tile of north, south, east, west."""
    cols = codes.shape[1]
    flat, bits = codes.ravel(), moves.ravel()
    here = start
    flat[here] = VISITED
    path = [here]
    while True:
        found = False
        for d, step in ((2, cols), (6, -cols), (0, 1), (4, -1)):
            if (bits[here] >> d) & 1 and flat[here + step] == OPEN:
                here += step
                flat[here] = VISITED
                path.append(here)
                found = True
                break
        if not found:
            return np.array(path)


def _backtracking_points(codes: Codes) -> Mask:
    """Covered tiles beside which an open tile is followed by one that is not (BA*, eq. (4)-(5)).

    With s1 ... s8 the neighbours counter-clockwise from east, a tile is one when any of the pairs
    (s1, s8), (s1, s2), (s5, s6), (s5, s4), (s7, s6), (s7, s8) is (open, not open).
    """
    is_open = np.pad(codes == OPEN, 1)
    rows, cols = codes.shape

    def at(d_row: int, d_col: int) -> Mask:
        """Whether the neighbour at an offset is open, for every tile."""
        return is_open[1 + d_row : 1 + d_row + rows, 1 + d_col : 1 + d_col + cols]

    east, west, south = at(0, 1), at(0, -1), at(-1, 0)
    pairs = (
        (east, at(-1, 1)),
        (east, at(1, 1)),
        (west, at(-1, -1)),
        (west, at(1, -1)),
        (south, at(-1, -1)),
        (south, at(-1, 1)),
    )
    found = np.zeros(codes.shape, dtype=np.bool_)
    for first, second in pairs:
        found |= first & ~second
    return np.asarray(found & (codes == VISITED))
