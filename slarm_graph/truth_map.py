# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The truth about a world on a lattice: what is blocked, what is reachable, how high it is."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy import ndimage

from slarm_graph.errors import BadInput
from slarm_graph.geometry import Floats
from slarm_graph.grid import GridGeometry, Mask
from slarm_graph.polygons import contains, edges_m
from slarm_graph.raster.segments import cells_passed
from slarm_graph.world import Solid, WorldMap

Rule = Literal["centre", "touched"]
Heights = NDArray[np.float32]

_EDGE_M: Final = 1e-6
_PROBE_M: Final = 2e-6
# Odd angles, so that no probe around a centre lies on an edge that the centre lies on.
_PROBES: Final = _PROBE_M * np.stack(
    [np.cos(0.123 + np.arange(8) * math.pi / 4), np.sin(0.123 + np.arange(8) * math.pi / 4)],
    axis=1,
)
_SHRINK_M: Final = 1e-9


@dataclass(frozen=True, slots=True)
class TruthMap:
    """A world rasterised.

    Parameters
    ----------
    geometry : GridGeometry
        Starts at the lower-left corner of the world's extent.
    blocked : (rows, cols) bool
        Cells of solids, and cells outside the boundary.
    reachable : (rows, cols) bool
        Unblocked cells joined to the start by steps over sides.
    on_edge : (rows, cols) bool
        Cells whose centre lies on the edge of a solid or of the boundary (within 1 um): the
        centre rule calls them free, but a wall drawn a hair thicker would not.
    heights_m : (rows, cols) float32
        Top of the highest solid in the cell [m]; 0 where free, the ceiling outside the boundary.
    area_weight : (rows, cols) float64
        Share of the cell's area within the world's extent; below 1 in a clipped last row or column.
    rule : str
        `centre` or `touched`.
    """

    geometry: GridGeometry
    blocked: Mask
    reachable: Mask
    on_edge: Mask
    heights_m: Heights
    area_weight: Floats
    rule: str


def truth_map(world: WorldMap, resolution_m: float, rule: Rule = "centre") -> TruthMap:
    """Rasterise a world.

    Parameters
    ----------
    world : WorldMap
    resolution_m : float
    rule : str
        `centre`: a cell is blocked when its centre lies inside a solid (an edge is not inside);
        the reference of accuracy. `touched`: a cell is blocked when a solid covers any of its
        area; for driving.

    Raises
    ------
    BadInput
        When the start lies in a blocked cell.
    """
    geometry = GridGeometry.covering(*world.extent_m(), resolution_m)
    heights, on_edge = _heights_by_centre(world, geometry)
    if rule == "touched":
        _raise_touched(world, geometry, heights)
    blocked = heights > 0.0
    reachable = reachable_from_start(world, geometry, blocked)
    return TruthMap(
        geometry=geometry,
        blocked=blocked,
        reachable=reachable,
        on_edge=on_edge & ~blocked,
        heights_m=heights,
        area_weight=area_weight(world, geometry),
        rule=rule,
    )


def reachable_from_start(world: WorldMap, geometry: GridGeometry, blocked: Mask) -> Mask:
    """Unblocked cells (rows, cols) that steps over cell sides join to the start's cell."""
    row, col = (int(v) for v in geometry.cell_of([world.start.x, world.start.y]))
    if blocked[row, col]:
        raise BadInput(
            f"{world.name}: start: ({world.start.x:.3f}, {world.start.y:.3f}) lies in a blocked"
            f" cell at a resolution of {geometry.resolution_m} m"
        )
    labels, _ = ndimage.label(~blocked)
    return np.asarray(labels == labels[row, col])


def area_weight(world: WorldMap, geometry: GridGeometry) -> Floats:
    """Share of every cell's area (rows, cols) within the world's extent."""
    x_min, x_max, y_min, y_max = world.extent_m()
    return np.outer(
        _overlap(geometry.origin_y_m, geometry.resolution_m, geometry.rows, y_min, y_max),
        _overlap(geometry.origin_x_m, geometry.resolution_m, geometry.cols, x_min, x_max),
    )


def solid_heights_m(world: WorldMap, geometry: GridGeometry, rule: Rule = "centre") -> Heights:
    """Top of the highest solid per cell (rows, cols) [m] on any lattice; ceiling outside."""
    heights, _ = _heights_by_centre(world, geometry)
    if rule == "touched":
        _raise_touched(world, geometry, heights)
    return heights


def _overlap(origin: float, side: float, count: int, low: float, high: float) -> Floats:
    start = origin + side * np.arange(count)
    share = (np.minimum(start + side, high) - np.maximum(start, low)) / side
    # Rounding must not turn a whole cell into 0.9999999999999.
    return np.asarray(np.clip(np.round(share, 9), 0.0, 1.0))


def _heights_by_centre(world: WorldMap, geometry: GridGeometry) -> tuple[Heights, Mask]:
    """Heights of solids at the cell centres, and which centres lie on an edge."""
    heights = np.zeros(geometry.shape, dtype=np.float32)
    near_edge = np.zeros(geometry.shape, dtype=np.bool_)
    centers = geometry.centers()
    for solid in world.solids:
        window = _window(geometry, solid.corners_m)
        points = centers[window]
        inside = contains(solid.corners_m, points)
        heights[window] = np.maximum(heights[window], np.where(inside, solid.height_m, 0.0))
        near_edge[window] |= _near_edges(solid.corners_m, points)
    heights[~contains(world.boundary_m, centers)] = world.ceiling_m
    near_edge |= _near_edges(world.boundary_m, centers)
    heights[near_edge] = _heights_around(world, centers[near_edge])
    return heights, near_edge


def _near_edges(corners_m: Floats, points_m: Floats) -> Mask:
    """Which points (R, C, 2) lie within a micrometre of a polygon's edge."""
    near = np.zeros(points_m.shape[:2], dtype=np.bool_)
    if points_m.size:
        _mark_near(np.ascontiguousarray(edges_m(corners_m)), points_m, _EDGE_M, near)
    return near


def _heights_around(world: WorldMap, points_m: Floats) -> Floats:
    """Heights at points (N, 2) on edges: 0 unless solids surround them (a seam between two)."""
    probes = points_m[:, None] + _PROBES
    tops = np.where(contains(world.boundary_m, probes), 0.0, world.ceiling_m)
    for solid in world.solids:
        low = solid.corners_m.min(axis=0) - 2 * _PROBE_M
        high = solid.corners_m.max(axis=0) + 2 * _PROBE_M
        near = np.flatnonzero(((points_m >= low) & (points_m <= high)).all(axis=1))
        inside = contains(solid.corners_m, probes[near])
        tops[near] = np.maximum(tops[near], np.where(inside, solid.height_m, 0.0))
    return np.asarray(np.where((tops > 0.0).all(axis=1), tops.max(axis=1), 0.0))


def _raise_touched(
    world: WorldMap,
    geometry: GridGeometry,
    heights: Heights,
) -> None:
    """Raise every cell of which a solid covers some area."""
    for solid in (*world.solids, Solid("boundary", world.boundary_m, world.ceiling_m)):
        origin = (geometry.origin_x_m, geometry.origin_y_m) * 2
        ends = (edges_m(solid.corners_m) - origin) / geometry.resolution_m
        _, passed = cells_passed(ends, geometry.shape, -_SHRINK_M / geometry.resolution_m)
        heights.flat[passed] = np.maximum(heights.flat[passed], solid.height_m)


def _window(geometry: GridGeometry, corners_m: Floats) -> tuple[slice, slice]:
    """Rows and columns that a polygon's bounding box covers, one cell wider."""
    low = np.maximum(geometry.cell_of(corners_m.min(axis=0)) - 1, 0)
    high = np.minimum(geometry.cell_of(corners_m.max(axis=0)) + 2, geometry.shape)
    return slice(int(low[0]), int(high[0])), slice(int(low[1]), int(high[1]))


@njit(cache=True, nogil=True)
def _mark_near(edges: Floats, points: Floats, radius: float, near: Mask) -> None:
    """Mark points within `radius` of an edge."""
    for e in range(len(edges)):
        x, y = edges[e, 0], edges[e, 1]
        ex, ey = edges[e, 2] - x, edges[e, 3] - y
        length2 = max(ex * ex + ey * ey, 1e-30)
        for r in range(points.shape[0]):
            for c in range(points.shape[1]):
                px, py = points[r, c, 0] - x, points[r, c, 1] - y
                share = min(1.0, max(0.0, (px * ex + py * ey) / length2))
                qx, qy = px - share * ex, py - share * ey
                if qx * qx + qy * qy < radius * radius:
                    near[r, c] = True
