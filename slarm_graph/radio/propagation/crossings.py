# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""How many walls stand between an access point and an antenna, counted cell by cell."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from slarm_graph.convex import convex_plans
from slarm_graph.geometry import Floats
from slarm_graph.grid import GridGeometry
from slarm_graph.polygons import counter_clockwise
from slarm_graph.raster.lines import first_crossing
from slarm_graph.world import Solid

Counts = NDArray[np.int16]

_GAP_CELLS = 2.0
"""Along a slanted face a segment leaves and enters cells of the same obstacle; without it 7 % of
the links of the world `cluttered` count an obstacle twice, with 4 thin passages vanish."""


_TOUCH_M = 1e-3
"""Solids that are this near touch: worlds are written to the millimetre."""


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
    x, y, z = np.asarray(access_point_m, dtype=np.float64)
    origin = np.array([geometry.origin_x_m, geometry.origin_y_m])
    ends = (np.asarray(points_m, dtype=np.float64).reshape(-1, 2) - origin) / geometry.resolution_m
    eye = (np.array([x, y]) - origin) / geometry.resolution_m
    heights = np.ascontiguousarray(heights_m, dtype=np.float32)
    counts: Counts = np.zeros(len(ends), dtype=np.int16)
    mount_cells = mount_radius_m / geometry.resolution_m
    _count(heights, eye, float(z), ends, antenna_height_m, mount_cells, counts)
    return counts


@njit(cache=True, nogil=True)
def _count(
    heights: NDArray[np.float32],
    eye: Floats,
    eye_height: float,
    ends: Floats,
    end_height: float,
    mount_cells: float,
    counts: Counts,
) -> None:
    """Walk from the access point to every end; ends and eye in cells, heights in metres."""
    rows, cols = heights.shape
    for i in range(len(ends)):
        dx, dy = ends[i, 0] - eye[0], ends[i, 1] - eye[1]
        col, col_step, col_next, col_every = first_crossing(eye[0], dx)
        row, row_step, row_next, row_every = first_crossing(eye[1], dy)
        carried = mount_cells / max(math.hypot(dx, dy), 1e-12)
        rise, entered, left_at = end_height - eye_height, 0.0, -1.0
        gap = _GAP_CELLS / max(math.hypot(dx, dy), 1e-12)
        while entered < 1.0:
            left = min(col_next, row_next, 1.0)
            lowest = eye_height + rise * (left if rise < 0.0 else entered)
            blocked = 0 <= row < rows and 0 <= col < cols and heights[row, col] > lowest
            if blocked and left > carried:
                if left_at < 0.0 or entered - left_at > gap:
                    counts[i] += 1
                left_at = left
            entered = left
            if col_next <= row_next:
                col, col_next = col + col_step, col_next + col_every
            else:
                row, row_next = row + row_step, row_next + row_every


def solids_passed(
    solids: Sequence[Solid],
    access_point_m: ArrayLike,
    points_m: ArrayLike,
    antenna_height_m: float,
    *,
    mount_radius_m: float = 0.0,
) -> Counts:
    """Count the walls and obstacles that the straight segment to each antenna passes.

    Solids that touch along it are one, as a wall's pieces at a corner, however many they are; what
    it passes above does not count.

    Parameters
    ----------
    solids : sequence of Solid
    access_point_m : (3,)
        x, y in the world, z above the floor [m].
    points_m : (N, 2)
        Antennas in plan [m].
    antenna_height_m : float
        Of all antennas.
    mount_radius_m : float
        What the segment has left this near to the access point, in plan, carries it and does not
        count.

    Returns
    -------
    (N,) int16
    """
    x, y, z = np.asarray(access_point_m, dtype=np.float64)
    ends = np.asarray(points_m, dtype=np.float64).reshape(-1, 2)
    length_m = np.hypot(*(ends - [x, y]).T)
    plans = convex_plans([counter_clockwise(solid.corners_m) for solid in solids])
    runs_m = []
    for solid, pieces in zip(solids, plans, strict=True):
        for piece in pieces:
            enter, leave = _inside(np.array([x, y]), ends, piece)
            lowest = z + (antenna_height_m - z) * (leave if antenna_height_m < z else enter)
            passed = (leave > enter) & (lowest < solid.height_m)
            passed &= leave * length_m > mount_radius_m
            if passed.any():
                runs_m.append(np.where(passed, [enter * length_m, leave * length_m], np.inf))
    return _separate(np.array(runs_m)) if runs_m else np.zeros(len(ends), dtype=np.int16)


def _separate(runs_m: Floats) -> Counts:
    """Count (N,) the runs (K, 2, N) that are left when those that touch are one; inf: no run."""
    runs_m = np.take_along_axis(runs_m, runs_m[:, :1].argsort(axis=0), axis=0)
    reached_m = np.maximum.accumulate(np.where(np.isinf(runs_m[:, 1]), -np.inf, runs_m[:, 1]))
    begins = np.isfinite(runs_m[:, 0])
    begins[1:] &= runs_m[1:, 0] > reached_m[:-1] + _TOUCH_M
    return np.asarray(begins.sum(axis=0), dtype=np.int16)


def _inside(start: Floats, ends: Floats, corners: Floats) -> tuple[Floats, Floats]:
    """Shares (N,) of segments at which they enter and leave a convex polygon (Cyrus and Beck)."""
    way = ends - start
    enter, leave = np.zeros(len(ends)), np.ones(len(ends))
    for corner, edge in zip(corners, np.roll(corners, -1, axis=0) - corners, strict=True):
        inward = np.array([-edge[1], edge[0]])
        depth, rate = (start - corner) @ inward, way @ inward
        with np.errstate(divide="ignore", invalid="ignore"):
            at = -depth / rate
        enter = np.where(rate > 0.0, np.maximum(enter, at), enter)
        leave = np.where(rate < 0.0, np.minimum(leave, at), leave)
        leave = np.where((rate == 0.0) & (depth <= 0.0), -1.0, leave)
    return enter, leave
