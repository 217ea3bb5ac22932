# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""A world from an occupancy map: what was mapped once can be driven through again."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from slarm_graph.access_points import AccessPoint
from slarm_graph.errors import BadInput
from slarm_graph.geometry import Floats, Pose2
from slarm_graph.grid import GridGeometry, Mask, OccupancyGrid, window_of
from slarm_graph.raster.distance import clearance
from slarm_graph.world import Solid, WorldMap

_CEILING_M = 3.0
"""Of an ordinary room; a map in the plane says nothing about it."""


def world_from_map(
    grid: OccupancyGrid,
    *,
    name: str = "map",
    start: Pose2 | None = None,
    access_points: Sequence[AccessPoint] = (),
    height_m: float = _CEILING_M,
) -> WorldMap:
    """Build a world whose solids are the cells of a map that are not free.

    Parameters
    ----------
    grid : OccupancyGrid
        Unknown cells become solid: nobody knows that one can drive there.
    name : str
    start : Pose2, optional
        By default the middle of the widest free place.
    access_points : sequence of AccessPoint
    height_m : float
        Of all solids and the ceiling [m]; a map says nothing about it.

    Raises
    ------
    BadInput
        When the map has no free cell.
    """
    if not grid.free.any():
        raise BadInput(f"{name}: the map has no free cell")
    # The free cells and one more on every side.
    rows, cols = (slice(max(0, n.start - 1), n.stop + 1) for n in window_of(grid.free))
    geometry, solid = grid.geometry.part(rows, cols), ~grid.free[rows, cols]
    solids = tuple(
        Solid(f"cells {n + 1}", _corners_m(geometry, rectangle), height_m)
        for n, rectangle in enumerate(merged_rectangles(solid))
    )
    x_min, x_max, y_min, y_max = geometry.extent_m
    boundary = np.array([[x_min, y_min], [x_max, y_min], [x_max, y_max], [x_min, y_max]])
    return WorldMap(
        name=name,
        solids=solids,
        boundary_m=boundary,
        ceiling_m=height_m,
        access_points=tuple(access_points),
        start=start or _widest_place(geometry, ~solid),
    )


def merged_rectangles(mask: Mask) -> NDArray[np.int64]:
    """Cover the true cells with disjoint rectangles.

    Runs of a row that repeat in the next row are merged.

    Parameters
    ----------
    mask : (rows, cols) bool

    Returns
    -------
    (N, 4) int64
        First row, first column, row past the last and column past the last.
    """
    done: list[tuple[int, int, int, int]] = []
    growing: dict[tuple[int, int], int] = {}
    edges = np.diff(np.pad(mask.astype(np.int8), ((0, 0), (1, 1))), axis=1)
    for row, edge in enumerate(edges):
        firsts, lasts = np.flatnonzero(edge > 0).tolist(), np.flatnonzero(edge < 0).tolist()
        runs = set(zip(firsts, lasts, strict=True))
        for run in [run for run in growing if run not in runs]:
            done.append((growing.pop(run), run[0], row, run[1]))
        for run in runs:
            growing.setdefault(run, row)
    done += [(first, run[0], len(mask), run[1]) for run, first in growing.items()]
    return np.array(sorted(done), dtype=np.int64).reshape(-1, 4)


def _corners_m(geometry: GridGeometry, rectangle: NDArray[np.int64]) -> Floats:
    first_row, first_col, last_row, last_col = (int(v) for v in rectangle)
    side = geometry.resolution_m
    x = geometry.origin_x_m + side * np.array([first_col, last_col, last_col, first_col])
    y = geometry.origin_y_m + side * np.array([first_row, first_row, last_row, last_row])
    return np.stack([x, y], axis=1)


def _widest_place(geometry: GridGeometry, free: Mask) -> Pose2:
    room = clearance(free)
    row, col = np.unravel_index(int(np.argmax(room)), room.shape)
    x, y = geometry.center_of([int(row), int(col)])
    return Pose2(float(x), float(y), 0.0)
