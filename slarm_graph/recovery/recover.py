# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Map recovery, the second half of GGMR: from an occupancy grid to the geographic map.

Threshold; remove specks; close pinholes; straighten walls on lines fitted to the laser's returns;
match obstacles to known sizes for their heights; expansion radius; reachable space; coverage. No
visited cell ever becomes an obstacle, and free space in which the robot fits stays connected.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from slarm_graph.config import MappingConfig, RecoveryConfig
from slarm_graph.geographic import CellState, Coverage, GeographicMap, HeightGroup
from slarm_graph.geometry import Floats
from slarm_graph.grid import GridGeometry, Mask, OccupancyGrid
from slarm_graph.polygons import next_corners
from slarm_graph.raster.bands import by_windows, put, side_by_side, windows
from slarm_graph.raster.distance import within
from slarm_graph.raster.fill import Polygons
from slarm_graph.raster.layers import set_aside
from slarm_graph.raster.outlines import outlines_m
from slarm_graph.readings import LaserScan
from slarm_graph.recovery.cell_classes import (
    changed_cells,
    enclosed_cells,
    expansion,
    whole_cells_m,
)
from slarm_graph.recovery.cell_heights import cell_heights
from slarm_graph.recovery.coverage import (
    footprint_cells,
    observed_cells,
    visited_cells,
    with_path_tiles,
)
from slarm_graph.recovery.fine_map import FineMap, fine_map
from slarm_graph.recovery.grid_cleaning import (
    CleanGrid,
    clean_grid,
)
from slarm_graph.recovery.heights import (
    certain_height_m,
    height_source,
    uncertain_heights,
    with_medians,
)
from slarm_graph.recovery.known_sizes import known_sizes_of
from slarm_graph.recovery.obstacles import matched_blocks, wall_strips
from slarm_graph.recovery.returns import Returns, returns_of_cells
from slarm_graph.recovery.walls import Outline, straighten_outlines
from slarm_graph.tiles import Where, Window
from slarm_graph.trajectory import Trajectory
from slarm_graph.truth_map import NUDGE_M
from slarm_graph.world import Solid, WorldMap

_MOVED_CELLS = 2.5
"""Straightening moves an outline by two cells at most, `_BAND_CELLS` of the walls, and half of
one."""
_NEAR_HALO, _THIN_HALO = 3, 5
"""Halo of a window [cells]: as far as straightening moves, and one more cell and its corner."""
_FACE_CELLS, _FACE_M = 0.1, 0.015
"""A face is known to about a centimetre (walls are fitted to within millimetres, poses to
centimetres), and to a tenth of a cell where cells are finer."""


@dataclass(frozen=True, slots=True)
class _Shape:
    """Recovered shape on the grid: cleaned classes, and if straightened, outlines and solids."""

    clean: CleanGrid
    outlines: list[Outline]
    blocks: list[Solid]
    strips: list[Solid]
    groups: tuple[HeightGroup, ...] = ()


def recover(
    grid: OccupancyGrid,
    trajectory: Trajectory,
    config: RecoveryConfig,
    *,
    returns: Returns | None = None,
    geometry: GridGeometry | None = None,
) -> GeographicMap:
    """Recover the geographic map from an occupancy grid.

    Parameters
    ----------
    grid : OccupancyGrid
    trajectory : Trajectory
        `map_from_robot`; cells it visits are never obstacles.
    config : RecoveryConfig
    returns : Returns, optional
        Of the laser in the map, from the corrected trajectory, averaged per cell of the grid
        (`gather_returns`); they place walls more finely than cells can.
    geometry : GridGeometry, optional
        Cells of the result, for instance coarser ones; a cell is what its centre is. The grid's
        own when left out.
    """
    target = grid.geometry if geometry is None else geometry
    grid = with_path_tiles(grid, trajectory)
    visited = visited_cells(target, trajectory)
    shape = _shape(grid, trajectory, config, returns)
    raster = _RasterisedShape.on(target, shape)
    tiles = raster.solids.tiles_of(grid.tiles) if grid.tiles and target == grid.geometry else None
    where = tiles or target.shape
    states = _states(shape.clean, target, _region(shape, raster, target, visited), raster, where)
    blocks, strips, groups = shape.blocks, shape.strips, shape.groups
    # On a large site the layers so far take more memory than the result.
    del shape, raster
    near_m = config.expansion_radius_m
    put(states, expansion(target, states, near_m, where), CellState.EXPANSION, where)
    put(states, enclosed_cells(states, visited, where), CellState.ENCLOSED, where)
    heights_m = cell_heights(target, states, blocks, strips, certain_height_m(config), where)
    source = height_source(blocks, strips, config)
    footprint = footprint_cells(target, trajectory, config.robot_radius_m)
    for part in windows(where):
        footprint[part.cells] &= states[part.cells] != CellState.OBSTACLE
    seen = grid.on(target)
    observed = observed_cells(seen, states, where)
    put(observed, visited, True, where)
    changed = changed_cells(seen, states, where)
    set_aside(grid.probability)
    beside = tiles.grown(math.ceil(config.robot_radius_m / target.resolution_m)) if tiles else where
    states, *covered = side_by_side(beside, states, observed, visited, footprint)
    return GeographicMap(
        geometry=target,
        states=states,
        heights_m=heights_m,
        height_source=source,
        coverage=Coverage(*(mask.view(np.bool_) for mask in covered)),
        changed_cells=changed,
        solids=(*blocks, *strips),
        height_groups=groups,
        expansion_radius_m=whole_cells_m(target, config.expansion_radius_m),
        tiles=tiles,
    )


def recover_scans(
    scans: Sequence[LaserScan],
    trajectory: Trajectory,
    mapping: MappingConfig,
    config: RecoveryConfig,
    *,
    geometry: GridGeometry,
) -> GeographicMap:
    """Recover the geographic map of a drive on given cells, from a map of 0.05 m or finer.

    Parameters
    ----------
    scans : sequence of N LaserScan
    trajectory : Trajectory of N poses
    mapping : MappingConfig
    config : RecoveryConfig
    geometry : GridGeometry
    """
    fine = fine_map(scans, trajectory, mapping, geometry.resolution_m)
    return recover_fine(fine, trajectory, config, geometry)


def recover_fine(
    drawn: FineMap, trajectory: Trajectory, config: RecoveryConfig, geometry: GridGeometry
) -> GeographicMap:
    """Recover the geographic map on given cells from a drive's fine map."""
    return recover(drawn.grid, trajectory, config, returns=drawn.returns, geometry=geometry)


def with_sizes_of(world: WorldMap, config: RecoveryConfig) -> RecoveryConfig:
    """Take the sizes of a world's walls and boxes for known, as the paper does, unless given."""
    if config.known_sizes:
        return config
    return config.model_copy(update={"known_sizes": known_sizes_of(world)})


def _shape(
    grid: OccupancyGrid,
    trajectory: Trajectory,
    config: RecoveryConfig,
    returns: Returns | None,
) -> _Shape:
    """Clean the grid and straighten the outline of the reachable region."""
    geometry = grid.geometry
    clean = clean_grid(grid, visited_cells(geometry, trajectory), config)
    set_aside(grid.probability)
    if not config.straighten or not _any(clean.reached, clean.where):
        return _Shape(clean, [], [], [])
    if returns is None:
        returns = returns_of_cells(geometry, clean.occupied, clean.reached)
    rings = outlines_m(geometry, clean.reached, grid.tiles)
    outlines = straighten_outlines(rings, returns, geometry.resolution_m)
    blocks = matched_blocks(outlines, returns, config.known_sizes, config.size_tolerance_m)
    height_m = certain_height_m(config)
    strips = wall_strips(outlines, blocks, geometry, clean.occupied, height_m or math.inf)
    groups: tuple[HeightGroup, ...] = ()
    if height_m is None:
        groups = uncertain_heights(outlines, strips, returns, config, len(blocks))
        strips = with_medians(strips, groups, len(blocks))
    solids = [block.solid for block in blocks], [strip.solid for strip in strips]
    return _Shape(clean, outlines, *solids, groups)


@dataclass(frozen=True, slots=True)
class _RasterisedShape:
    """A shape's polygons rasterised on a grid: outlines, free and blocked faces, solids."""

    outlines: Polygons
    free_faces: Polygons
    blocked_faces: Polygons
    solids: Polygons

    @staticmethod
    def on(geometry: GridGeometry, shape: _Shape) -> _RasterisedShape:
        """Rasterise a recovered shape on the cells of a grid."""
        rings = [outline.corners_m for outline in shape.outlines]
        free_faces, blocked_faces = _faces(rings, geometry.resolution_m)
        return _RasterisedShape(
            Polygons.on(geometry, rings),
            Polygons.on(geometry, free_faces),
            Polygons.on(geometry, blocked_faces),
            Polygons.of_solids(geometry, (*shape.blocks, *shape.strips)),
        )

    def free(self, window: Window) -> Mask:
        """Cells whose centre is inside the outlines; on a face, the reference's rule."""
        free = self.outlines.odd(window)
        free |= self.free_faces.any(window)
        free &= ~self.blocked_faces.any(window)
        return free


def _region(shape: _Shape, raster: _RasterisedShape, target: GridGeometry, visited: Mask) -> Mask:
    """Reachable cells, by their centres: straightened near walls, else the grid's."""
    clean, look_up = shape.clean, shape.clean.geometry.resample
    where = clean.where if target == clean.geometry else target.shape
    region = look_up(clean.reached, target, outside=False)
    if not shape.outlines:
        return by_windows(where, 0, lambda window: region[window] | visited[window])
    if target == clean.geometry:
        return by_windows(
            where,
            _THIN_HALO,
            lambda w: _without_thin(clean, raster, w)[0] | clean.passable[w] | visited[w],
        )
    mine = _RasterisedShape.on(clean.geometry, shape)
    thin = by_windows(clean.where, _THIN_HALO, lambda w: _without_thin(clean, mine, w)[1])
    near = by_windows(clean.where, _NEAR_HALO, lambda window: _near_border(clean, window))
    near, thin = look_up(near, target, outside=True), look_up(thin, target, outside=False)
    passable = look_up(clean.passable, target, outside=False)

    def part(window: Window) -> Mask:
        """Reachable cells in a window of the target."""
        here = np.where(near[window], raster.free(window), region[window]) & ~thin[window]
        return here | passable[window] | visited[window]

    return by_windows(where, 0, part)


def _any(mask: Mask, where: Where) -> bool:
    """Whether any cell of a mask is true."""
    return any(bool(mask[part.cells].any()) for part in windows(where))


def _near_border(clean: CleanGrid, window: Window) -> Mask:
    """Cells, of a window of the grid, that straightening may change."""
    cell_m = clean.geometry.resolution_m
    reached, reach_m = clean.reached[window], _MOVED_CELLS * cell_m
    near = within(reached, reach_m, cell_m)
    near &= within(~reached, reach_m, cell_m)
    return near


def _without_thin(clean: CleanGrid, raster: _RasterisedShape, window: Window) -> tuple[Mask, Mask]:
    """Free cells of a window as straightened, and cells of walls whose two faces coincide.

    The latter are occupied cells without any blocked one left near them, and are not free.
    """
    occupied, cell_m = clean.occupied[window], clean.geometry.resolution_m
    free = np.where(_near_border(clean, window), raster.free(window), clean.reached[window])
    blocked = ~free & (occupied | raster.solids.any(window))
    thin = occupied & free & ~within(blocked, 1.5 * cell_m, cell_m)
    return free & ~thin, thin


def _faces(rings: list[Floats], resolution_m: float) -> tuple[Floats, Floats]:
    """Thin quadrilaterals (N, 4, 2) around the sides [m], of free and of blocked faces.

    Grids and buildings share round numbers, so that whole rows of centres lie exactly on a face,
    which is only known to about a centimetre. As in the reference, such a centre is free when the
    free side lies to its right or above, else blocked.
    """
    half_m = min(_FACE_CELLS * resolution_m, _FACE_M)
    if not rings:
        return np.zeros((0, 4, 2)), np.zeros((0, 4, 2))
    starts = np.concatenate(rings)
    ends = np.concatenate([next_corners(ring) for ring in rings])
    step = ends - starts
    length = np.hypot(step[:, 0], step[:, 1])
    real = length > 0.0
    starts, ends, step, length = starts[real], ends[real], step[real], length[real]
    along = step * (half_m / length)[:, None]
    side = np.stack([-along[:, 1], along[:, 0]], axis=1)
    free = side @ NUDGE_M > 0.0
    reach = np.where(free[:, None], along, -along)
    a, b = starts - reach, ends + reach
    quads = np.stack([a - side, b - side, b + side, a + side], axis=1)
    return quads[free], quads[~free]


def _states(
    clean: CleanGrid, target: GridGeometry, region: Mask, raster: _RasterisedShape, where: Where
) -> np.ndarray:
    """Class of every cell before expansion (rows, cols) uint8."""
    occupied, free, reached = (
        clean.geometry.resample(layer, target, outside=False)
        for layer in (clean.occupied, clean.free, clean.reached)
    )
    states = np.zeros(target.shape, dtype=np.uint8)  # all CellState.UNKNOWN
    for window, *_ in windows(where):
        kept_out, obstacle = free[window] & ~reached[window], raster.solids.any(window)
        obstacle |= occupied[window]
        here = states[window]
        here[kept_out] = CellState.ENCLOSED
        here[obstacle] = CellState.OBSTACLE
        here[region[window]] = CellState.ACCESSIBLE
    return states
