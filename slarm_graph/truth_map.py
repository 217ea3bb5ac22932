# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The truth about a world on a lattice: what is blocked, what is reachable, how high it is."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from slarm_graph.errors import BadInput
from slarm_graph.geometry import Floats
from slarm_graph.grid import GridGeometry, Mask
from slarm_graph.polygons import contains, edges_m
from slarm_graph.raster.segments import cells_passed, cut_steps, reached_cells
from slarm_graph.world import Solid, WorldMap

Rule = Literal["centre", "touched"]
Heights = NDArray[np.float32]

NUDGE_M: Final = np.array([3.7e-9, 1.6e-9])
"""Centres are tested this far up and right of where they are, so that one on a face is in a solid
to its right or above and not in one to its left or below: half of all faces, by rule. Far above
rounding (1e-14 m), far below what anybody measures."""
_REACH_M: Final = 0.05
"""Reachability is found on cells at most this large, so that it hardly depends on the resolution.
Walls stop it however thin they are; passages narrower than this may be missed."""
_SHRINK_M: Final = 1e-9
"""A nanometre: what only touches a cell's side covers none of its area, whatever rounding says."""


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
    heights_m : (rows, cols) float32
        Top of the highest solid in the cell [m]; 0 where free, the ceiling outside the boundary.
    area_weight : (rows, cols) float64
        Share of the cell's area within the world's extent; below 1 in a clipped last row or column.
    """

    geometry: GridGeometry
    blocked: Mask
    reachable: Mask
    heights_m: Heights
    area_weight: Floats


def truth_map(
    world: WorldMap,
    resolution_m: float,
    rule: Rule = "centre",
    *,
    area: tuple[float, float, float, float] | None = None,
) -> TruthMap:
    """Rasterise a world.

    Parameters
    ----------
    world : WorldMap
    resolution_m : float
    rule : str
        `centre`: a cell is blocked when its centre lies inside a solid, and one on a face when the
        solid lies to its right or above; the reference of accuracy. `touched`: a cell is blocked
        when a solid covers any of its area; for driving.
    area : (x_min, x_max, y_min, y_max), optional
        What lies outside is not reachable, nor what can only be reached through it [m].

    Raises
    ------
    BadInput
        When the start lies in a blocked cell.
    """
    geometry = GridGeometry.covering(*world.extent_m(), resolution_m)
    heights = solid_heights_m(world, geometry, rule)
    blocked = heights > 0.0
    return TruthMap(
        geometry=geometry,
        blocked=blocked,
        reachable=reachable_from_start(world, geometry, rule, area) & ~blocked,
        heights_m=heights,
        area_weight=geometry.share_within(*world.extent_m()),
    )


def reachable_from_start(
    world: WorldMap,
    geometry: GridGeometry,
    rule: Rule = "centre",
    area: tuple[float, float, float, float] | None = None,
) -> Mask:
    """Cells (rows, cols) whose centre can be reached from the start, through no wall.

    Found by steps over sides on cells of 0.05 m or less, which go from centre to centre without
    crossing a face of a solid.
    """
    parts = 2 * math.ceil(round(0.5 * (geometry.resolution_m / _REACH_M - 1.0), 6)) + 1
    parts = max(parts, 1)
    fine = geometry.divided(parts)
    blocked = solid_heights_m(world, fine, rule) > 0.0
    if area is not None:
        blocked |= _outside(fine, area)
    row, col = (int(v) for v in fine.cell_of([world.start.x, world.start.y]))
    if blocked[row, col]:
        raise BadInput(
            f"{world.name}: start: ({world.start.x:.3f}, {world.start.y:.3f}) lies in a blocked"
            f" cell at a resolution of {geometry.resolution_m} m"
        )
    rings = (*(solid.corners_m for solid in world.solids), world.boundary_m)
    origin = np.array([fine.origin_x_m, fine.origin_y_m]) + NUDGE_M
    faces = np.concatenate([edges_m(ring) for ring in rings])
    faces = (faces - np.tile(origin, 2)) / fine.resolution_m - 0.5
    reached = reached_cells(~blocked, *cut_steps(faces, *fine.shape), row, col)
    middle = slice(parts // 2, None, parts)
    return np.asarray(reached[middle, middle])


def _outside(geometry: GridGeometry, area: tuple[float, float, float, float]) -> Mask:
    """Cells (rows, cols) whose centre lies outside x_min, x_max, y_min, y_max [m]."""
    x, y = np.moveaxis(geometry.centers(), -1, 0)
    return np.asarray((x < area[0]) | (x > area[1]) | (y < area[2]) | (y > area[3]))


def solid_heights_m(world: WorldMap, geometry: GridGeometry, rule: Rule = "centre") -> Heights:
    """Top of the highest solid per cell (rows, cols) [m] on any lattice; ceiling outside."""
    heights = np.zeros(geometry.shape, dtype=np.float32)
    centers = geometry.centers() + NUDGE_M
    for solid in world.solids:
        window = _window(geometry, solid.corners_m)
        inside = contains(solid.corners_m, centers[window])
        heights[window] = np.maximum(heights[window], np.where(inside, solid.height_m, 0.0))
    heights[~contains(world.boundary_m, centers)] = world.ceiling_m
    if rule == "touched":
        _raise_touched(world, geometry, heights)
    return heights


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
