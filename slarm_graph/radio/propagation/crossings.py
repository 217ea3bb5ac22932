# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Number of walls that links cross on a grid map, as for a multi-wall model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slarm_graph.geometry import Floats
from slarm_graph.grid import GridGeometry, Mask
from slarm_graph.radio.propagation.link_traversal import (
    Counts,
    CrossingCounts,
    Grids,
    Ints,
    LinkEnds,
    count_crossings,
    free_run_lengths,
)

_AROUND = np.array([(0, 0), (0, 1), (0, -1), (1, 0), (-1, 0)])
"""Shifts of the map: none, then along either axis either way [rows, cols]."""


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

    Every run of cells whose top is above the segment counts once, however thick; gaps of up to two
    cells do not break it, as slanted faces are staircases. Outside the grid is free.

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
        Obstacles this near to the access point, in plan, are its mount and do not count.

    Returns
    -------
    (N,) int16
    """
    passed = link_crossings(
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
    access_points_m: ArrayLike,
    access_heights_m: ArrayLike,
    points_m: ArrayLike,
    antenna_height_m: float,
    *,
    mount_radius_m: float = 0.0,
) -> Counts:
    """Count as `wall_crossings` for access points in plan (E, 2) at several heights (H,) each.

    All heights of one are counted in one traversal.

    Returns
    -------
    (E, H, N) int16
    """
    eye_heights = np.asarray(access_heights_m, dtype=np.float64)
    heights = np.ascontiguousarray(heights_m, dtype=np.float32)
    unmoved = np.zeros((len(eye_heights), 2), dtype=np.int64)
    grids = Grids(heights, heights, unmoved, np.zeros((1, 1), dtype=np.int16))
    how = antenna_height_m, mount_radius_m
    return _count_all(geometry, grids, access_points_m, eye_heights, points_m, *how).counts


@dataclass(frozen=True, slots=True)
class LinkCrossings:
    """Obstacles crossed by N links.

    Parameters
    ----------
    counts : (K, N) int16
        Number of walls and obstacles: on the map as it is, then on the shifted maps.
    through : (N, B) bool
        Whether the link passes the inside of each block, on the map as it is.
    """

    counts: Counts
    through: Mask


def link_crossings(
    geometry: GridGeometry,
    heights_m: ArrayLike,
    access_point_m: ArrayLike,
    points_m: ArrayLike,
    antenna_height_m: float,
    *,
    mount_radius_m: float = 0.0,
    shift_cells: int = 0,
    insides: NDArray[np.int16] | None = None,
) -> LinkCrossings:
    """Count crossings as `wall_crossings` does, on the map and on shifted maps.

    Parameters
    ----------
    geometry, heights_m, access_point_m, points_m, antenna_height_m, mount_radius_m
        As of `wall_crossings`.
    shift_cells : int
        The map is also shifted by so many cells either way along either axis; 0 for no shifts.
    insides : (rows, cols) int16, optional
        Label, from 1, of the block whose inside the cell is; 0 elsewhere.
    """
    x, y, z = np.asarray(access_point_m, dtype=np.float64)
    heights = np.ascontiguousarray(heights_m, dtype=np.float32)
    shifts = shift_cells * _AROUND if shift_cells else _AROUND[:1]
    inside = np.zeros((1, 1), dtype=np.int16) if insides is None else insides
    grids = Grids(heights, _highest_over_shifts(heights, shifts), shifts, inside)
    how = antenna_height_m, mount_radius_m
    counts, through = _count_all(geometry, grids, (x, y), np.full(len(shifts), z), points_m, *how)
    return LinkCrossings(counts[0], through)


def _count_all(
    geometry: GridGeometry,
    grids: Grids,
    access_points_m: ArrayLike,
    eye_heights: Floats,
    points_m: ArrayLike,
    antenna_height_m: float,
    mount_radius_m: float,
) -> CrossingCounts:
    """Count crossings for every pair of map shift and access point height."""
    origin = np.array([geometry.origin_x_m, geometry.origin_y_m])
    eyes, points = (
        (np.asarray(given, dtype=np.float64).reshape(-1, 2) - origin) / geometry.resolution_m
        for given in (access_points_m, points_m)
    )
    carried = mount_radius_m / geometry.resolution_m
    ends = LinkEnds(eyes, eye_heights, points, float(antenna_height_m), carried)
    passed = CrossingCounts(
        np.zeros((len(eyes), len(eye_heights), len(points)), dtype=np.int16),
        np.zeros((len(points), int(grids.inside.max(initial=0))), dtype=np.bool_),
    )
    lowest_m = min(antenna_height_m, float(eye_heights.min()))
    count_crossings(grids, free_run_lengths(grids.tallest > lowest_m), ends, passed)
    return passed


def _highest_over_shifts(heights: NDArray[np.float32], shifts: Ints) -> NDArray[np.float32]:
    """Greatest height on each cell over all shifts, with a margin as wide as the largest."""
    margin = int(np.abs(shifts).max())
    if not margin:
        return heights
    rows, cols = heights.shape
    tallest = np.zeros((rows + 2 * margin, cols + 2 * margin), dtype=np.float32)
    for up, along in shifts + margin:
        there = tallest[up : up + rows, along : along + cols]
        np.maximum(there, heights, out=there)
    return tallest
