# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Map recovery, the second half of GGMR: from an occupancy grid to the geographic map.

Threshold; drop specks; close pinholes; straighten walls on lines fitted to the laser's returns;
match obstacles to known sizes for their heights; expansion radius; what can be driven to; coverage.
No visited cell ever becomes an obstacle, and where the robot fits, free space keeps its
connections.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from slarm_graph.config import MappingConfig, RecoveryConfig
from slarm_graph.geographic import CellState, Coverage, GeographicMap
from slarm_graph.geometry import Floats
from slarm_graph.grid import GridGeometry, Mask, OccupancyGrid
from slarm_graph.mapping import end_points_m, render
from slarm_graph.raster.distance import within
from slarm_graph.raster.fill import inside_any, inside_outlines, inside_solids
from slarm_graph.raster.outlines import outlines_m
from slarm_graph.raster.patches import joined
from slarm_graph.readings import LaserScan
from slarm_graph.recovery.coverage import footprint_cells, observed_cells, visited_cells
from slarm_graph.recovery.grid_cleaning import (
    CleanGrid,
    cleaned,
)
from slarm_graph.recovery.known_sizes import known_sizes_of
from slarm_graph.recovery.obstacles import matched_blocks, wall_strips
from slarm_graph.recovery.returns import gathered, returns_of_cells
from slarm_graph.recovery.walls import Outline, straightened
from slarm_graph.trajectory import Trajectory
from slarm_graph.truth_map import NUDGE_M
from slarm_graph.world import Solid, WorldMap

_COARSEST_M = 0.05
_MOVED_CELLS = 2.5
_FACE_CELLS, _FACE_M = 0.1, 0.015


@dataclass(frozen=True, slots=True)
class _Shape:
    """What is known on the grid: classes, and where straightened, outlines and solids."""

    clean: CleanGrid
    outlines: list[Outline]
    blocks: list[Solid]
    strips: list[Solid]


def recover(
    grid: OccupancyGrid,
    trajectory: Trajectory,
    config: RecoveryConfig,
    *,
    end_points: Floats | None = None,
    geometry: GridGeometry | None = None,
) -> GeographicMap:
    """Recover the geographic map from an occupancy grid.

    Parameters
    ----------
    grid : OccupancyGrid
    trajectory : Trajectory
        `map_from_robot`; cells it visits are never obstacles.
    config : RecoveryConfig
    end_points : (N, 2) float64, optional
        Laser returns in the map [m], from the corrected trajectory; they place walls more finely
        than cells can.
    geometry : GridGeometry, optional
        Cells of the result, for instance coarser ones; a cell is what its centre is. The grid's
        own when left out.
    """
    target = grid.geometry if geometry is None else geometry
    shape = _shape(grid, trajectory, config, end_points)
    visited = visited_cells(target, trajectory)
    region = _region(shape, target, visited)
    behind = _behind(shape, target)
    states = _states(shape.clean, target, region, behind)
    expanded = _expanded(target, states, config.expansion_radius_m) & ~visited
    states[expanded] = CellState.EXPANSION
    accessible = states == CellState.ACCESSIBLE
    states[accessible & ~joined(accessible, visited)] = CellState.ENCLOSED
    heights_m, source = _heights(shape, target, states, config)
    footprint = footprint_cells(target, trajectory, config.robot_radius_m)
    footprint &= states != CellState.OBSTACLE
    return GeographicMap(
        geometry=target,
        states=states,
        heights_m=heights_m,
        height_source=source,
        coverage=Coverage(observed_cells(grid, target, states) | visited, visited, footprint),
        changed_cells=_changed(grid, target, states),
        solids=(*shape.blocks, *shape.strips),
    )


def recover_scans(
    scans: Sequence[LaserScan],
    trajectory: Trajectory,
    mapping: MappingConfig,
    config: RecoveryConfig,
    *,
    geometry: GridGeometry,
    grid: OccupancyGrid | None = None,
) -> GeographicMap:
    """Recover the geographic map of a drive on given cells, from a map of 0.05 m or finer.

    Parameters
    ----------
    scans : sequence of N LaserScan
    trajectory : Trajectory of N poses
    mapping : MappingConfig
    config : RecoveryConfig
    geometry : GridGeometry
    grid : OccupancyGrid, optional
        Rendered from the same; used where it is fine enough.
    """
    fine_m = min(_COARSEST_M, geometry.resolution_m)
    fine = mapping.model_copy(update={"resolution_m": fine_m})
    if grid is None or grid.geometry.resolution_m != fine_m:
        grid = render(scans, trajectory, fine)
    points = end_points_m(scans, trajectory, fine)
    return recover(grid, trajectory, config, end_points=points, geometry=geometry)


def with_sizes_of(world: WorldMap, config: RecoveryConfig) -> RecoveryConfig:
    """Take the sizes of a world's walls and boxes for known, as the paper does, unless given."""
    if config.known_sizes:
        return config
    return config.model_copy(update={"known_sizes": known_sizes_of(world)})


def _shape(
    grid: OccupancyGrid,
    trajectory: Trajectory,
    config: RecoveryConfig,
    end_points: Floats | None,
) -> _Shape:
    """Clean the grid and straighten the outline of the region the robot can get to."""
    geometry = grid.geometry
    clean = cleaned(grid, visited_cells(geometry, trajectory), config)
    if not config.straighten or not clean.reached.any():
        return _Shape(clean, [], [], [])
    if end_points is None:
        returns = returns_of_cells(geometry, clean.occupied, clean.reached)
    else:
        returns = gathered(end_points, geometry.resolution_m)
    outlines = straightened(outlines_m(geometry, clean.reached), returns, geometry.resolution_m)
    blocks = matched_blocks(outlines, returns, config.known_sizes, config.size_tolerance_m)
    height_m = math.inf if config.default_height_m is None else config.default_height_m
    strips = wall_strips(outlines, blocks, geometry, clean.occupied, height_m)
    return _Shape(clean, outlines, [block.solid for block in blocks], strips)


def _region(shape: _Shape, target: GridGeometry, visited: Mask) -> Mask:
    """Cells the robot can get to, by their centres: straightened near walls, else the grid's."""
    clean = shape.clean
    region = clean.geometry.resample(clean.reached, target, outside=False)
    if shape.outlines:
        near = clean.geometry.resample(_near_border(clean), target, outside=True)
        region = np.where(near, _straight(shape, target), region)
        region &= ~clean.geometry.resample(_thin_walls(shape), target, outside=False)
        region |= clean.geometry.resample(clean.passable, target, outside=False)
    return np.asarray(region | visited)


def _near_border(clean: CleanGrid) -> Mask:
    """Cells of the grid that straightening may change."""
    reach_m = _MOVED_CELLS * clean.geometry.resolution_m
    cell_m = clean.geometry.resolution_m
    return within(clean.reached, reach_m, cell_m) & within(~clean.reached, reach_m, cell_m)


def _straight(shape: _Shape, geometry: GridGeometry) -> Mask:
    """Cells whose centre the straightened outlines call free; on a face, the reference's rule."""
    inside = inside_outlines(geometry, [outline.corners_m for outline in shape.outlines])
    free_faces, blocked_faces = _faces(shape.outlines, geometry.resolution_m)
    return (inside | inside_any(geometry, free_faces)) & ~inside_any(geometry, blocked_faces)


def _thin_walls(shape: _Shape) -> Mask:
    """Occupied cells of the grid with nothing left near them, as both faces met in one line."""
    clean, cell_m = shape.clean, shape.clean.geometry.resolution_m
    free = np.where(_near_border(clean), _straight(shape, clean.geometry), clean.reached)
    blocked = ~free & (clean.occupied | _behind(shape, clean.geometry))
    left = within(blocked, 1.5 * cell_m, cell_m)
    return clean.occupied & free & ~left


def _faces(outlines: list[Outline], resolution_m: float) -> tuple[list[Floats], list[Floats]]:
    """Thin quadrilaterals (4, 2) around the sides [m], of free and of blocked faces.

    Lattices and buildings share round numbers, so that whole rows of centres lie exactly on a
    face, which is only known to about a centimetre. As in the reference, such a centre is free
    when the free side lies to its right or above, else blocked.
    """
    half_m = min(_FACE_CELLS * resolution_m, _FACE_M)
    quads: tuple[list[Floats], list[Floats]] = ([], [])
    for outline in outlines:
        starts, ends = outline.corners_m, np.roll(outline.corners_m, -1, axis=0)
        for start, end in zip(starts, ends, strict=True):
            step = end - start
            length = math.hypot(step[0], step[1])
            if length > 0.0:
                along = step * (half_m / length)
                side = np.array([-along[1], along[0]])
                free = side @ NUDGE_M > 0.0
                reach = along if free else -along
                a, b = start - reach, end + reach
                quads[0 if free else 1].append(np.array([a - side, b - side, b + side, a + side]))
    return quads


def _behind(shape: _Shape, target: GridGeometry) -> Mask:
    """Cells whose centre lies in a block or just behind a wall's face."""
    return inside_solids(target, (*shape.blocks, *shape.strips))


def _states(clean: CleanGrid, target: GridGeometry, region: Mask, behind: Mask) -> np.ndarray:
    """Class of every cell before expansion (rows, cols) uint8."""
    occupied = clean.geometry.resample(clean.occupied, target, outside=False)
    free = clean.geometry.resample(clean.free & ~clean.reached, target, outside=False)
    states = np.full(target.shape, CellState.UNKNOWN, dtype=np.uint8)
    states[free] = CellState.ENCLOSED
    states[occupied | behind] = CellState.OBSTACLE
    states[region] = CellState.ACCESSIBLE
    return states


def _expanded(target: GridGeometry, states: np.ndarray, radius_m: float) -> Mask:
    """Accessible cells within the expansion radius, rounded up to cells, of an obstacle."""
    if radius_m <= 0.0:
        return np.zeros(target.shape, dtype=np.bool_)
    cells = math.ceil(radius_m / target.resolution_m - 1e-9)
    near = within(states == CellState.OBSTACLE, cells * target.resolution_m, target.resolution_m)
    return np.asarray(near & (states == CellState.ACCESSIBLE))


def _heights(
    shape: _Shape, target: GridGeometry, states: np.ndarray, config: RecoveryConfig
) -> tuple[np.ndarray, str]:
    """Top of every obstacle cell (rows, cols) float32 [m], and where the heights came from."""
    height_m = math.inf if config.default_height_m is None else config.default_height_m
    source = "infinite" if config.default_height_m is None else "default"
    heights_m = np.where(states == CellState.OBSTACLE, height_m, 0.0).astype(np.float32)
    for block in shape.blocks:
        inside = inside_outlines(target, [block.corners_m]) & (states == CellState.OBSTACLE)
        heights_m[inside] = block.height_m
    if shape.blocks:
        source = f"matched sizes ({len(shape.blocks)} obstacles), else {source}"
    return heights_m, source


def _changed(grid: OccupancyGrid, target: GridGeometry, states: np.ndarray) -> int:
    """Cells whose class differs from that of the grid at their centre."""
    occupied = grid.geometry.resample(grid.occupied, target, outside=False)
    free = grid.geometry.resample(grid.free, target, outside=False)
    now_occupied = states == CellState.OBSTACLE
    now_free = ~now_occupied & (states != CellState.UNKNOWN)
    return int(np.sum((occupied != now_occupied) | (free != now_free)))
