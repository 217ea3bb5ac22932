# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Exact line of sight in 2.5D: the cells outside the shadows that obstacles cast.

Seen from an access point O, the antennas at height h that an upright prism with convex plan C and
top H hides are exactly the scaled copies of C about O: the union of s C over near < s < far. (A
segment to the plan point t passes over the plan point t / s at a height linear in 1 / s, so the
prism blocks it where that height is below H; for h < O_z this is 1 <= s < (O_z - h) / (O_z - H).)
That union is the convex hull of near C and far C, a polygon, which is filled row by row. Nothing is
sampled along a ray, and the cost grows with the outline of obstacles instead of with ray lengths.

A link that only grazes a surface is clear.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slarm_graph.convex import convex_plans, nearest_on_outline
from slarm_graph.geometry import Floats
from slarm_graph.grid import GridGeometry, Mask
from slarm_graph.polygons import contains, counter_clockwise
from slarm_graph.radio.shadows import (
    GRAZE_CELLS,
    boxes_of_cells,
    hidden_points,
    next_containing,
    outlines_of_shadows,
    shadowed_cells,
    unoccluded,
)
from slarm_graph.raster.bands import by_windows, copy_of
from slarm_graph.tiles import Where, Window, known_tiles
from slarm_graph.world import Solid

_ENDLESS = 1e7
"""Scale of an unbounded shadow: takes the nearest obstacle beyond any grid."""
_OFF_WALL_M = 1e-6
"""Offset of points moved onto a face: outside the wall for any rounding, and irrelevant to the
radio."""


def line_of_sight_over_cells(
    geometry: GridGeometry,
    heights_m: ArrayLike,
    access_point_m: ArrayLike,
    antenna_height_m: float,
    *,
    mount_radius_m: float = 0.0,
    where: Where | None = None,
) -> Mask:
    """Decide for every cell whether the antenna at its centre is in sight.

    Parameters
    ----------
    geometry : GridGeometry
    heights_m : (rows, cols)
        Top of the obstacle that fills the cell [m]; 0 where free, inf where unbounded.
    access_point_m : (3,)
        x, y in the map, z above the floor [m]; may lie outside the grid.
    antenna_height_m : float
    mount_radius_m : float
        Cells whose centre is this near to the access point in plan are its mount and transparent.
    where : (rows, cols) or KnownTiles, optional
        Tiles hold all obstacles; cells outside of them are False.

    Returns
    -------
    (rows, cols) bool
    """
    where = where or geometry.shape
    x, y, z = np.asarray(access_point_m, dtype=np.float64)
    heights = np.asarray(heights_m)
    if mount_radius_m > 0.0:
        heights = copy_of(heights, where)
        _clear_mount(geometry, heights, np.array([x, y]), mount_radius_m)
    boxes, tops = boxes_of_cells(heights, min(float(z), antenna_height_m), known_tiles(where))
    scales = _scales(tops, z, antenna_height_m)
    return _past_boxes(geometry, boxes, np.array([x, y]), scales, where)


def line_of_sight_past_cells(
    geometry: GridGeometry,
    cells: Mask,
    access_point_m: ArrayLike,
    antenna_height_m: float,
    *,
    mount_radius_m: float = 0.0,
    where: Where | None = None,
) -> Mask:
    """As `line_of_sight_over_cells`, for opaque cells (rows, cols) of infinite height.

    With tiles, the cells lie in them, and cells outside of them are False.
    """
    where = where or geometry.shape
    x, y, z = np.asarray(access_point_m, dtype=np.float64)
    filled = copy_of(cells, where).view(np.uint8)
    if mount_radius_m > 0.0:
        _clear_mount(geometry, filled, np.array([x, y]), mount_radius_m)
    boxes, _ = boxes_of_cells(filled, 0.0, known_tiles(where))
    del filled
    boxes = boxes[unoccluded(_in_cells(geometry, np.array([x, y])), boxes)]
    scales = _scales(np.full(len(boxes), np.inf), z, antenna_height_m)
    return _past_boxes(geometry, boxes, np.array([x, y]), scales, where)


def _past_boxes(
    geometry: GridGeometry,
    boxes: NDArray[np.int64],
    plan: Floats,
    scales: Floats,
    where: Where,
) -> Mask:
    """Cells (rows, cols) in no shadow of boxes (N, 4): col0, row0, col1, row1, half open."""
    corners = boxes[:, [0, 1, 2, 1, 2, 3, 0, 3]].reshape(-1, 2).astype(np.float64)
    starts = np.arange(0, len(corners) + 1, 4)
    eye = _in_cells(geometry, plan)
    shadow = shadowed_cells(where, eye, corners, starts, scales, 1.0)
    return by_windows(where, 0, lambda window: ~shadow[window])


def line_of_sight_past_solids(
    geometry: GridGeometry,
    solids: Sequence[Solid],
    access_point_m: ArrayLike,
    antenna_height_m: float,
    *,
    boundary_m: Floats | None = None,
    mount_radius_m: float = 0.0,
    where: Where | None = None,
) -> Mask:
    """Decide for every cell whether the antenna at its centre is in sight past vector solids.

    Parameters
    ----------
    geometry : GridGeometry
    solids : sequence of Solid
    access_point_m : (3,)
        x, y in the map, z above the floor [m].
    antenna_height_m : float
    boundary_m : (K, 2), optional
        Counter-clockwise outer wall of infinite height.
    mount_radius_m : float
        An access point at most this deep in a solid, or beyond the boundary, is put on its face.
    where : (rows, cols) or KnownTiles, optional
        Cells outside of tiles are False.

    Returns
    -------
    (rows, cols) bool
    """
    where = where or geometry.shape
    x, y, z = np.asarray(access_point_m, dtype=np.float64)
    plan = _on_face(np.array([x, y]), float(z), solids, boundary_m, mount_radius_m)
    eye = _in_cells(geometry, plan)
    shadows = []
    whole, cut = _plans(solids, boundary_m)
    # Cut solids are closed sets: a ray along the cut must not slip through.
    for plans, slack in ((whole, 1.0), (cut, -1.0)):
        if not plans:
            continue
        corners, starts, tops_m = _concatenated(plans)
        scales = _scales(tops_m, z, antenna_height_m)
        inside = _in_cells(geometry, corners)
        shadows.append(shadowed_cells(where, eye, inside, starts, scales, slack))

    def part(window: Window) -> Mask:
        """Cells of a window in no shadow."""
        blocked = np.zeros([at.stop - at.start for at in window], dtype=np.bool_)
        for shadow in shadows:
            blocked |= shadow[window]
        return ~blocked

    return by_windows(where, 0, part)


def shadow_outlines(
    geometry: GridGeometry,
    sets: Sequence[Sequence[Solid]],
    position_m: Floats,
    antenna_height_m: float,
) -> tuple[Floats, NDArray[np.int64], Floats, NDArray[np.int64]]:
    """Outlines of the shadows of sets of solids, as in `line_of_sight_past_solids`.

    Returns
    -------
    outlines : (P, 2) float64
        End to end, in cells from the corner of the grid.
    starts : (N + 1,) int64
        Where each starts.
    slacks : (N,) float64
        Distance inside from which a centre is hidden [cells].
    sets : (N,) int64
        Number of the set that each belongs to, ascending.
    """
    plans, sides, of = [], [], []
    solids = [(number, solid) for number, solids in enumerate(sets) for solid in solids]
    cut = convex_plans([solid.corners_m for _, solid in solids])
    for (number, solid), pieces in zip(solids, cut, strict=True):
        plans += [(piece, solid.height_m) for piece in pieces]
        sides += [1.0 if len(pieces) == 1 else -1.0] * len(pieces)
        of += [number] * len(pieces)
    corners, starts, tops_m = _concatenated(plans)
    eye, inside = _in_cells(geometry, position_m[:2]), _in_cells(geometry, corners)
    scales = _scales(tops_m, float(position_m[2]), antenna_height_m)
    outlines, begins = outlines_of_shadows(eye, inside, starts, scales)
    return outlines, begins, GRAZE_CELLS * np.array(sides), np.array(of, dtype=np.int64)


def _clear_mount(
    geometry: GridGeometry, heights: NDArray[np.generic], plan: Floats, radius_m: float
) -> None:
    """Set the heights of cells whose centre is within a radius of a plan point to 0."""
    low = np.maximum(geometry.cell_of(plan - radius_m), 0)
    high = np.minimum(geometry.cell_of(plan + radius_m) + 1, geometry.shape)
    if (low >= high).any():
        return
    near = (slice(low[0], high[0]), slice(low[1], high[1]))
    cells = np.moveaxis(np.mgrid[near], 0, -1)
    off = np.linalg.norm(geometry.center_of(cells) - plan, axis=-1)
    heights[near] = np.where(off <= radius_m, 0, heights[near])


def line_of_sight_to_points(
    points_m: ArrayLike,
    solids: Sequence[Solid],
    access_point_m: ArrayLike,
    antenna_height_m: float,
) -> Mask:
    """Decide for antennas (N, 2) [m] outside of solids whether they are in sight past them.

    Parameters
    ----------
    points_m : (N, 2)
    solids : sequence of Solid
    access_point_m : (3,)
    antenna_height_m : float

    Returns
    -------
    (N,) bool
    """
    points = np.asarray(points_m, dtype=np.float64).reshape(-1, 2)
    x, y, z = np.asarray(access_point_m, dtype=np.float64)
    whole, cut = _plans(solids, None)
    if not solids:
        return np.ones(len(points), dtype=np.bool_)
    # Near solids hide most points: few of the others are then tested.
    nearest_first = sorted(whole + cut, key=lambda plan: math.dist(plan[0][0], (x, y)))
    corners, starts, tops_m = _concatenated(nearest_first)
    scales = _scales(tops_m, float(z), antenna_height_m)
    return ~hidden_points(np.array([x, y]), points, corners, starts, scales)


def moved_to_faces(points_m: ArrayLike, solids: Sequence[Solid]) -> Floats:
    """Move antennas (N, 2) [m] inside a solid to its nearest face: wall positions are uncertain."""
    points = np.array(points_m, dtype=np.float64).reshape(-1, 2)
    corners, starts, _ = _concatenated([(solid.corners_m, solid.height_m) for solid in solids])
    at = next_containing(0, points, corners, starts)
    while at < len(solids):
        ring = solids[at].corners_m
        for index in np.flatnonzero(contains(ring, points)):
            foot, normal = nearest_on_outline(ring, points[index])
            points[index] = foot + _OFF_WALL_M * normal
        at = next_containing(at + 1, points, corners, starts)
    return points


def _plans(
    solids: Sequence[Solid], boundary_m: Floats | None
) -> tuple[list[tuple[Floats, float]], list[tuple[Floats, float]]]:
    """Convex plans (K, 2) with their tops [m]: of convex solids and walls, and of cut solids."""
    whole: list[tuple[Floats, float]] = []
    cut: list[tuple[Floats, float]] = []
    for solid, pieces in zip(solids, convex_plans([s.corners_m for s in solids]), strict=True):
        (whole if len(pieces) == 1 else cut).extend((piece, solid.height_m) for piece in pieces)
    if boundary_m is not None:
        ends = np.roll(boundary_m, -1, axis=0)
        whole += [(np.stack([a, b]), math.inf) for a, b in zip(boundary_m, ends, strict=True)]
    return whole, cut


def _concatenated(
    plans: Sequence[tuple[Floats, float]],
) -> tuple[Floats, NDArray[np.int64], Floats]:
    """Corners of all plans in one array (N, 2) [m], where each starts, and the tops [m]."""
    corners = np.concatenate([np.zeros((0, 2)), *(corners for corners, _ in plans)])
    starts = np.cumsum([0, *(len(corners) for corners, _ in plans)])
    return corners, starts, np.array([top for _, top in plans])


def _on_face(
    plan: Floats, z: float, solids: Sequence[Solid], boundary_m: Floats | None, radius_m: float
) -> Floats:
    """Move an access point that sits a little inside a wall to the wall's face."""
    tall = [(solid.corners_m, solid.height_m) for solid in solids if solid.height_m > z]
    corners, starts, _ = _concatenated(tall)
    at = next_containing(0, plan[None], corners, starts)
    while at < len(tall):
        plan = _put_on(tall[at][0], plan, 1.0, radius_m)
        at = next_containing(at + 1, plan[None], corners, starts)
    if boundary_m is not None and not contains(boundary_m, plan):
        plan = _put_on(boundary_m, plan, -1.0, radius_m)
    return plan


def _put_on(corners_m: Floats, plan: Floats, outward: float, radius_m: float) -> Floats:
    """Move a point to the nearest face of a polygon where that is within a radius."""
    foot, normal = nearest_on_outline(counter_clockwise(corners_m), plan)
    if np.linalg.norm(foot - plan) > radius_m:
        return plan
    return np.asarray(foot + outward * _OFF_WALL_M * normal)


def _in_cells(geometry: GridGeometry, points: Floats) -> Floats:
    """Points (..., 2) in units of cells from the corner of the grid."""
    origin = np.array([geometry.origin_x_m, geometry.origin_y_m])
    return np.asarray((points - origin) / geometry.resolution_m)


def _scales(tops_m: Floats, z_m: float, antenna_height_m: float) -> Floats:
    """Near and far scale factor (S, 2) of each prism's shadow; nan where it casts none."""
    drop = z_m - antenna_height_m
    with np.errstate(divide="ignore", invalid="ignore"):
        if drop > 0.0:
            far = np.where(tops_m >= z_m, _ENDLESS, drop / (z_m - tops_m))
            near = np.ones_like(far)
            near[tops_m <= antenna_height_m] = np.nan
        else:
            near = np.maximum(1.0, -drop / (tops_m - z_m))
            near[tops_m <= z_m] = np.nan
            far = np.full_like(near, _ENDLESS)
    return np.stack([near, np.minimum(far, _ENDLESS)], axis=1)
