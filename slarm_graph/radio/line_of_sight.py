# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Line of sight in 2.5D, exact: which cells lie in the shadow that obstacles cast.

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
from numba import njit
from numpy.typing import ArrayLike, NDArray

from slarm_graph.convex import convex_pieces, nearest_on_outline
from slarm_graph.geometry import Floats
from slarm_graph.grid import GridGeometry, Mask
from slarm_graph.polygons import contains, counter_clockwise
from slarm_graph.world import Solid

_ENDLESS = 1e7
"""Scale that takes the nearest obstacle beyond any grid."""
_GRAZE_CELLS = 1e-9
_OFF_WALL_M = 1e-6


def line_of_sight_over_cells(
    geometry: GridGeometry,
    heights_m: ArrayLike,
    access_point_m: ArrayLike,
    antenna_height_m: float,
    *,
    mount_radius_m: float = 0.0,
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
        Cells whose centre is this near to the access point in plan carry it and do not hide it.

    Returns
    -------
    (rows, cols) bool
    """
    x, y, z = np.asarray(access_point_m, dtype=np.float64)
    heights = np.asarray(heights_m)
    if mount_radius_m > 0.0:
        heights = _without_mount(geometry, heights, np.array([x, y]), mount_radius_m)
    boxes, tops = _boxes(heights, min(float(z), antenna_height_m))
    corners = boxes[:, [0, 1, 2, 1, 2, 3, 0, 3]].reshape(-1, 2).astype(np.float64)
    starts = np.arange(0, len(corners) + 1, 4)
    eye = _in_cells(geometry, np.array([x, y]))
    return ~_shadow(geometry.shape, eye, corners, starts, _scales(tops, z, antenna_height_m), 1.0)


def line_of_sight_past_solids(
    geometry: GridGeometry,
    solids: Sequence[Solid],
    access_point_m: ArrayLike,
    antenna_height_m: float,
    *,
    boundary_m: Floats | None = None,
    mount_radius_m: float = 0.0,
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
        Counter-clockwise outer wall that nothing passes.
    mount_radius_m : float
        An access point at most this deep in a solid, or beyond the boundary, is put on its face.

    Returns
    -------
    (rows, cols) bool
    """
    x, y, z = np.asarray(access_point_m, dtype=np.float64)
    plan = _on_face(np.array([x, y]), float(z), solids, boundary_m, mount_radius_m)
    eye = _in_cells(geometry, plan)
    blocked = np.zeros(geometry.shape, dtype=np.bool_)
    whole, cut = _plans(solids, boundary_m)
    # Cut solids are closed sets: a ray along the cut must not slip through.
    for plans, slack in ((whole, 1.0), (cut, -1.0)):
        if not plans:
            continue
        corners, starts, tops_m = _end_to_end(plans)
        scales = _scales(tops_m, z, antenna_height_m)
        inside = _in_cells(geometry, corners)
        blocked |= _shadow(geometry.shape, eye, inside, starts, scales, slack)
    return ~blocked


def _without_mount(
    geometry: GridGeometry, heights: Floats, plan: Floats, radius_m: float
) -> Floats:
    """Heights without the cells whose centre is within the radius of a plan point."""
    low = np.maximum(geometry.cell_of(plan - radius_m), 0)
    high = np.minimum(geometry.cell_of(plan + radius_m) + 1, geometry.shape)
    if (low >= high).any():
        return heights
    near = (slice(low[0], high[0]), slice(low[1], high[1]))
    cells = np.moveaxis(np.mgrid[near], 0, -1)
    off = np.linalg.norm(geometry.center_of(cells) - plan, axis=-1)
    heights = heights.copy()
    heights[near] = np.where(off <= radius_m, 0.0, heights[near])
    return heights


def line_of_sight_to_points(
    points_m: ArrayLike,
    solids: Sequence[Solid],
    access_point_m: ArrayLike,
    antenna_height_m: float,
) -> Mask:
    """Decide for antennas (N, 2) [m] anywhere whether they are in sight past convex solids.

    An antenna inside a solid is taken to be on the nearest face: walls are only known so well.

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
    points = np.array(points_m, dtype=np.float64).reshape(-1, 2)
    x, y, z = np.asarray(access_point_m, dtype=np.float64)
    for solid in solids:
        for index in np.flatnonzero(contains(solid.corners_m, points)):
            foot, normal = nearest_on_outline(solid.corners_m, points[index])
            points[index] = foot + _OFF_WALL_M * normal
    whole, cut = _plans(solids, None)
    if not solids:
        return np.ones(len(points), dtype=np.bool_)
    corners, starts, tops_m = _end_to_end(whole + cut)
    scales = _scales(tops_m, float(z), antenna_height_m)
    return ~_hidden(np.array([x, y]), points, corners, starts, scales)


def _plans(
    solids: Sequence[Solid], boundary_m: Floats | None
) -> tuple[list[tuple[Floats, float]], list[tuple[Floats, float]]]:
    """Convex plans (K, 2) with their tops: of convex solids and walls, and of cut solids."""
    whole: list[tuple[Floats, float]] = []
    cut: list[tuple[Floats, float]] = []
    for solid in solids:
        pieces = convex_pieces(solid.corners_m)
        (whole if len(pieces) == 1 else cut).extend((piece, solid.height_m) for piece in pieces)
    if boundary_m is not None:
        ends = np.roll(boundary_m, -1, axis=0)
        whole += [(np.stack([a, b]), math.inf) for a, b in zip(boundary_m, ends, strict=True)]
    return whole, cut


def _end_to_end(
    plans: Sequence[tuple[Floats, float]],
) -> tuple[Floats, NDArray[np.int64], Floats]:
    """Corners of all plans in one array (N, 2) [m], where each starts, and the tops [m]."""
    corners = np.concatenate([corners for corners, _ in plans])
    starts = np.cumsum([0, *(len(corners) for corners, _ in plans)])
    return corners, starts, np.array([top for _, top in plans])


def _on_face(
    plan: Floats, z: float, solids: Sequence[Solid], boundary_m: Floats | None, radius_m: float
) -> Floats:
    """Move an access point that sits a little inside a wall to the wall's face."""
    outlines = [(counter_clockwise(s.corners_m), 1.0) for s in solids if s.height_m > z]
    if boundary_m is not None:
        outlines.append((counter_clockwise(boundary_m), -1.0))
    for corners, outward in outlines:
        if bool(contains(corners, plan)) != (outward > 0.0):
            continue
        foot, normal = nearest_on_outline(corners, plan)
        if np.linalg.norm(foot - plan) <= radius_m:
            plan = foot + outward * _OFF_WALL_M * normal
    return plan


def _in_cells(geometry: GridGeometry, points: Floats) -> Floats:
    """Points (..., 2) in units of cells from the corner of the grid."""
    origin = np.array([geometry.origin_x_m, geometry.origin_y_m])
    return np.asarray((points - origin) / geometry.resolution_m)


def _scales(tops_m: Floats, z_m: float, antenna_height_m: float) -> Floats:
    """Near and far scale (S, 2) of each prism's shadow; nan where it casts none."""
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


@njit(cache=True, nogil=True)
def _boxes(heights: Floats, above: float) -> tuple[NDArray[np.int64], Floats]:
    """Cover cells higher than `above` by rectangles of one height, col0, row0, col1, row1."""
    rows, cols = heights.shape
    boxes = np.empty((1024, 4), dtype=np.int64)
    tops = np.empty(1024)
    count = 0
    begun_at = np.full(cols, -1, dtype=np.int64)
    for row in range(rows):
        col = 0
        while col < cols:
            top = heights[row, col]
            first = col
            col += 1
            if not top > above:
                continue
            while col < cols and heights[row, col] == top:
                col += 1
            last = begun_at[first]
            if last >= 0 and boxes[last, 3] == row and boxes[last, 2] == col and tops[last] == top:
                boxes[last, 3] = row + 1
                continue
            if count == len(tops):
                boxes = np.concatenate((boxes, np.empty_like(boxes)))
                tops = np.concatenate((tops, np.empty_like(tops)))
            boxes[count, 0] = first
            boxes[count, 1] = row
            boxes[count, 2] = col
            boxes[count, 3] = row + 1
            tops[count] = top
            begun_at[first] = count
            count += 1
    return boxes[:count], tops[:count]


@njit(cache=True, nogil=True)
def _shadow(
    shape: tuple[int, int],
    eye: Floats,
    corners: Floats,
    starts: NDArray[np.int64],
    scales: Floats,
    slack: float,
) -> Mask:
    """Union of all shadows as a mask; lengths in cells."""
    rows, cols = shape
    steps = np.zeros((rows, cols + 1), dtype=np.int32)
    left, right = np.empty(rows), np.empty(rows)
    most = 0
    for i in range(len(scales)):
        most = max(most, starts[i + 1] - starts[i])
    points = np.empty((2 * most, 2))
    hull = np.empty((2 * most + 2, 2))
    for i in range(len(scales)):
        if math.isnan(scales[i, 0]):
            continue
        size = starts[i + 1] - starts[i]
        for k in range(size):
            for axis in range(2):
                off = corners[starts[i] + k, axis] - eye[axis]
                points[k, axis] = eye[axis] + scales[i, 0] * off
                points[size + k, axis] = eye[axis] + scales[i, 1] * off
        edges = _hull(points[: 2 * size], hull)
        if edges >= 3:
            _mark(steps, left, right, hull[:edges], slack * _GRAZE_CELLS)
    mask = np.empty((rows, cols), dtype=np.bool_)
    for row in range(rows):
        covers = 0
        for col in range(cols):
            covers += steps[row, col]
            mask[row, col] = covers > 0
    return mask


@njit(cache=True, nogil=True)
def _hidden(
    eye: Floats, points: Floats, corners: Floats, starts: NDArray[np.int64], scales: Floats
) -> Mask:
    """Whether any prism hides each point (N, 2) from the eye (2,); lengths in metres."""
    hidden = np.zeros(len(points), dtype=np.bool_)
    for n in range(len(points)):
        for i in range(len(scales)):
            near, far = scales[i, 0], scales[i, 1]
            if not math.isnan(near) and _crosses(
                eye, points[n], corners[starts[i] : starts[i + 1]], 1.0 / far, 1.0 / near
            ):
                hidden[n] = True
                break
    return hidden


@njit(cache=True, nogil=True)
def _crosses(eye: Floats, point: Floats, corners: Floats, begin: float, end: float) -> bool:
    """Whether eye + u (point - eye) enters a convex polygon (K, 2) for begin < u < end."""
    enters, leaves = begin, end
    for k in range(len(corners)):
        x, y = corners[k - 1, 0], corners[k - 1, 1]
        along_x, along_y = corners[k, 0] - x, corners[k, 1] - y
        ahead = along_x * (point[1] - eye[1]) - along_y * (point[0] - eye[0])
        inside = along_x * (eye[1] - y) - along_y * (eye[0] - x)
        if ahead == 0.0:
            if inside <= 0.0:
                return False
        elif ahead > 0.0:
            enters = max(enters, -inside / ahead)
        else:
            leaves = min(leaves, -inside / ahead)
    return leaves - enters > 1e-9


@njit(cache=True, nogil=True)
def _hull(points: Floats, hull: Floats) -> int:
    """Convex hull of points (N, 2), counter-clockwise into `hull`; returns its size."""
    size = len(points)
    for i in range(1, size):
        x, y = points[i, 0], points[i, 1]
        k = i - 1
        while k >= 0 and (points[k, 0] > x or (points[k, 0] == x and points[k, 1] > y)):
            points[k + 1, 0] = points[k, 0]
            points[k + 1, 1] = points[k, 1]
            k -= 1
        points[k + 1, 0] = x
        points[k + 1, 1] = y
    count = 0
    for sweep in range(2):
        base = count
        for j in range(size):
            i = j if sweep == 0 else size - 1 - j
            while count >= base + 2 and not _turns_left(
                hull[count - 2], hull[count - 1], points[i]
            ):
                count -= 1
            hull[count, 0] = points[i, 0]
            hull[count, 1] = points[i, 1]
            count += 1
        count -= 1
    return count


@njit(cache=True, nogil=True)
def _turns_left(a: Floats, b: Floats, c: Floats) -> bool:
    return bool((b[0] - a[0]) * (c[1] - b[1]) - (b[1] - a[1]) * (c[0] - b[0]) > 0.0)


@njit(cache=True, nogil=True)
def _mark(
    steps: NDArray[np.int32], left: Floats, right: Floats, polygon: Floats, slack: float
) -> None:
    """Add one to every cell whose centre lies inside a convex counter-clockwise polygon.

    `steps` (rows, cols + 1) holds differences along each row; `left` and `right` are scratch.
    """
    rows, cols = steps.shape[0], steps.shape[1] - 1
    low, high = polygon[:, 1].min() - 0.5, polygon[:, 1].max() - 0.5
    first = math.floor(min(max(low + slack, -1.0), float(rows))) + 1
    last = math.ceil(min(max(high - slack, -1.0), float(rows))) - 1
    for k in range(len(polygon)):
        x0, y0 = polygon[k, 0], polygon[k, 1] - 0.5
        x1, y1 = polygon[(k + 1) % len(polygon), 0], polygon[(k + 1) % len(polygon), 1] - 0.5
        if y0 == y1:
            continue
        slope = (x1 - x0) / (y1 - y0)
        begin = max(first, math.ceil(max(min(y0, y1) - abs(slack), -1.0)))
        end = min(last, math.floor(min(max(y0, y1) + abs(slack), float(rows))))
        side = right if y1 > y0 else left
        # The nearer end as anchor keeps the far, scaled-up corner's rounding out of the picture.
        anchor_x, anchor_y = (x0, y0) if abs(y0) + abs(x0) < abs(y1) + abs(x1) else (x1, y1)
        for row in range(begin, end + 1):
            side[row] = anchor_x + (row - anchor_y) * slope
    for row in range(first, last + 1):
        begin = max(0, math.floor(min(max(left[row] - 0.5 + slack, -1.0), float(cols))) + 1)
        end = min(cols, math.ceil(min(max(right[row] - 0.5 - slack, -1.0), float(cols))))
        if begin < end:
            steps[row, begin] += 1
            steps[row, end] -= 1
