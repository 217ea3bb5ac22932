# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""How many walls stand between an access point and an antenna, counted cell by cell."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slarm_graph.geometry import Floats
from slarm_graph.grid import GridGeometry, Mask
from slarm_graph.kernels import kernel
from slarm_graph.raster.lines import first_crossing

Counts = NDArray[np.int16]
Ints = NDArray[np.int64]

_AROUND = np.array([(0, 0), (0, 1), (0, -1), (1, 0), (-1, 0)])
"""Where a map is moved to: nowhere, then along either axis either way [rows, cols]."""

_GAP_CELLS = 2.0
"""Along a slanted face a segment leaves and enters cells of the same obstacle; without it 7 % of
the links of the world `cluttered` count an obstacle twice, with 4 thin passages vanish."""


def wall_crossings(
    geometry: GridGeometry,
    heights_m: ArrayLike,
    access_point_m: ArrayLike,
    points_m: ArrayLike,
    antenna_height_m: float,
    *,
    mount_radius_m: float = 0.0,
) -> Counts:
    """Count the walls and obstacles that the straight segment to each antenna passes.

    Every run of cells whose top is above the segment counts once, however thick; gaps of two cells
    do not break it, for slanted faces are staircases. Outside the grid there is nothing.

    Parameters
    ----------
    geometry : GridGeometry
    heights_m : (rows, cols)
        Top of the obstacle that fills the cell [m]; 0 where free, inf where unbounded.
    access_point_m : (3,)
        x, y in the map, z above the floor [m].
    points_m : (N, 2)
        Antennas in plan [m].
    antenna_height_m : float
        Of all antennas.
    mount_radius_m : float
        What the segment passes this near to the access point, in plan, carries it and does not
        count.

    Returns
    -------
    (N,) int16
    """
    passed = passages(
        geometry,
        heights_m,
        access_point_m,
        points_m,
        antenna_height_m,
        mount_radius_m=mount_radius_m,
    )
    return np.asarray(passed.counts[0])


def crossings_by_height(
    geometry: GridGeometry,
    heights_m: ArrayLike,
    access_point_m: tuple[float, float],
    access_heights_m: ArrayLike,
    points_m: ArrayLike,
    antenna_height_m: float,
    *,
    mount_radius_m: float = 0.0,
) -> Counts:
    """Count as `wall_crossings` for several heights (H,) of an access point in one walk.

    Returns
    -------
    (H, N) int16
    """
    eye_heights = np.asarray(access_heights_m, dtype=np.float64)
    heights = np.ascontiguousarray(heights_m, dtype=np.float32)
    moved = np.zeros((len(eye_heights), 2), dtype=np.int64)
    grids = heights, heights, moved, np.zeros((1, 1), dtype=np.int16)
    how = antenna_height_m, mount_radius_m
    return _walked(geometry, grids, access_point_m, eye_heights, points_m, *how).counts


@dataclass(frozen=True, slots=True)
class Passages:
    """What N links pass.

    Parameters
    ----------
    counts : (K, N) int16
        Walls and obstacles: of the map as it is, and of the map moved.
    through : (N, B) bool
        Through the inside of which obstacles, of the map as it is.
    """

    counts: Counts
    through: Mask


def passages(
    geometry: GridGeometry,
    heights_m: ArrayLike,
    access_point_m: ArrayLike,
    points_m: ArrayLike,
    antenna_height_m: float,
    *,
    mount_radius_m: float = 0.0,
    off_cells: int = 0,
    insides: NDArray[np.int16] | None = None,
) -> Passages:
    """Count what links pass as `wall_crossings` does, on the map and on the map moved.

    Parameters
    ----------
    geometry, heights_m, access_point_m, points_m, antenna_height_m, mount_radius_m
        As of `wall_crossings`.
    off_cells : int
        The map is moved by so many cells to either side along either axis, too; 0 does not move it.
    insides : (rows, cols) int16, optional
        Number, from 1, of the obstacle whose inside the cell is; 0 elsewhere.
    """
    x, y, z = np.asarray(access_point_m, dtype=np.float64)
    heights = np.ascontiguousarray(heights_m, dtype=np.float32)
    moved = off_cells * _AROUND if off_cells else _AROUND[:1]
    inside = np.zeros((1, 1), dtype=np.int16) if insides is None else insides
    grids = heights, _tallest(heights, moved), moved, inside
    how = antenna_height_m, mount_radius_m
    return _walked(geometry, grids, (x, y), np.full(len(moved), z), points_m, *how)


def _walked(
    geometry: GridGeometry,
    grids: tuple[NDArray[np.float32], NDArray[np.float32], Ints, NDArray[np.int16]],
    access_point_m: tuple[float, float],
    eye_heights: Floats,
    points_m: ArrayLike,
    antenna_height_m: float,
    mount_radius_m: float,
) -> Passages:
    """Count what links pass, the map being moved and the access point high in as many ways."""
    origin = np.array([geometry.origin_x_m, geometry.origin_y_m])
    ends = (np.asarray(points_m, dtype=np.float64).reshape(-1, 2) - origin) / geometry.resolution_m
    eye = (np.asarray(access_point_m) - origin) / geometry.resolution_m
    counts: Counts = np.zeros((len(eye_heights), len(ends)), dtype=np.int16)
    through = np.zeros((len(ends), int(grids[3].max(initial=0))), dtype=np.bool_)
    carried = mount_radius_m / geometry.resolution_m
    _count(*grids, eye, eye_heights, ends, antenna_height_m, carried, counts, through)
    return Passages(counts, through)


def _tallest(heights: NDArray[np.float32], moved: Ints) -> NDArray[np.float32]:
    """Greatest height that comes to lie on a cell, with so much of a margin as it is moved."""
    margin = int(np.abs(moved).max())
    if not margin:
        return heights
    rows, cols = heights.shape
    tallest = np.zeros((rows + 2 * margin, cols + 2 * margin), dtype=np.float32)
    for up, along in moved + margin:
        there = tallest[up : up + rows, along : along + cols]
        np.maximum(there, heights, out=there)
    return tallest


@kernel
def _count(
    heights: NDArray[np.float32],
    tallest: NDArray[np.float32],
    moved: Ints,
    inside: NDArray[np.int16],
    eye: Floats,
    eye_heights: Floats,
    ends: Floats,
    end_height: float,
    mount_cells: float,
    counts: Counts,
    through: Mask,
) -> None:
    """Walk from the access point to every end; ends and eye in cells, heights in metres."""
    rows, cols = heights.shape
    margin = (tallest.shape[0] - rows) // 2
    left_at, lowest_eye = np.empty(len(moved)), eye_heights.min()
    for i in range(len(ends)):
        dx, dy = ends[i, 0] - eye[0], ends[i, 1] - eye[1]
        col, col_step, col_next, col_every = first_crossing(eye[0], dx)
        row, row_step, row_next, row_every = first_crossing(eye[1], dy)
        carried = mount_cells / max(math.hypot(dx, dy), 1e-12)
        rise, entered = end_height - lowest_eye, 0.0
        left_at.fill(-1.0)
        gap = _GAP_CELLS / max(math.hypot(dx, dy), 1e-12)
        while entered < 1.0:
            left = min(col_next, row_next, 1.0)
            known = -margin <= row < rows + margin and -margin <= col < cols + margin
            lowest = lowest_eye + rise * (left if rise < 0.0 else entered)
            if known and tallest[row + margin, col + margin] > lowest and left > carried:
                for k in range(len(moved)):
                    r, c = row - moved[k, 0], col - moved[k, 1]
                    up = end_height - eye_heights[k]
                    lowest = eye_heights[k] + up * (left if up < 0.0 else entered)
                    if 0 <= r < rows and 0 <= c < cols and heights[r, c] > lowest:
                        if left_at[k] < 0.0 or entered - left_at[k] > gap:
                            counts[k, i] += 1
                        left_at[k] = left
                        if k == 0 and through.shape[1] > 0 and inside[r, c] > 0:
                            through[i, inside[r, c] - 1] = True
            entered = left
            if col_next <= row_next:
                col, col_next = col + col_step, col_next + col_every
            else:
                row, row_next = row + row_step, row_next + row_every
