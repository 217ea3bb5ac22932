# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Cells once walls stand: kept clear, cut off, changed, and how high; one by one by brute force."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import ndimage

from slarm_graph.config import RecoveryConfig
from slarm_graph.files.world_shapes import rectangle_m
from slarm_graph.geographic import CellState
from slarm_graph.geometry import Floats
from slarm_graph.grid import GridGeometry, OccupancyGrid
from slarm_graph.polygons import contains
from slarm_graph.raster import bands
from slarm_graph.recovery.cell_classes import (
    changed_cells,
    enclosed_cells,
    expansion,
    whole_cells_m,
)
from slarm_graph.recovery.cell_heights import cell_heights
from slarm_graph.recovery.coverage import footprint_cells, observed_cells, path_points_m
from slarm_graph.recovery.grid_cleaning import _small_holes, clean_grid
from slarm_graph.recovery.obstacles import Block, _depth_m, wall_strips
from slarm_graph.recovery.returns import cell_keys, returns_of_cells
from slarm_graph.recovery.walls import Outline
from slarm_graph.trajectory import Trajectory
from slarm_graph.world import Solid

GRID = GridGeometry(-1.0, 2.0, 0.1, 30, 40)


def random_states(seed: int) -> NDArray[np.uint8]:
    rng = np.random.default_rng(seed)
    return rng.choice(np.arange(5, dtype=np.uint8), GRID.shape, p=[0.03, 0.85, 0.04, 0.04, 0.04])


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("radius_m", [0.0, 0.05, 0.1, 0.14, 0.25])
def test_cells_nearer_than_the_radius_to_what_is_not_free_are_kept_clear(
    seed: int, radius_m: float
) -> None:
    """Beyond the lattice nothing is free."""
    states = random_states(seed)
    shut = np.isin(np.pad(states, 4), (CellState.OBSTACLE, CellState.UNKNOWN))
    whole = math.ceil(radius_m / 0.1 - 1e-9)
    near = ndimage.distance_transform_edt(~shut)[4:-4, 4:-4] <= whole + 1e-9
    expected = (states == CellState.ACCESSIBLE) & near & (radius_m > 0.0)
    np.testing.assert_array_equal(expansion(GRID, states, radius_m, GRID.shape), expected)
    assert whole_cells_m(GRID, radius_m) == pytest.approx(0.1 * whole)


@pytest.mark.parametrize("seed", range(3))
def test_what_no_accessible_way_joins_to_the_robot_is_cut_off(seed: int) -> None:
    states = random_states(seed)
    states[:, 17] = CellState.EXPANSION
    visited = np.zeros(GRID.shape, dtype=np.bool_)
    visited[5, 3:6] = True
    accessible = states == CellState.ACCESSIBLE
    labels, _ = ndimage.label(accessible)
    own = np.unique(labels[visited & accessible])
    expected = accessible & ~np.isin(labels, own[own > 0])
    np.testing.assert_array_equal(enclosed_cells(states, visited, GRID.shape), expected)
    assert expected[:, 18:].any()


@pytest.mark.parametrize("seed", range(3))
def test_changed_and_observed_cells_are_counted_one_by_one(seed: int) -> None:
    rng = np.random.default_rng(seed)
    values = rng.choice(np.array([0.0, 1.0, np.nan, 0.5], dtype=np.float32), GRID.shape)
    grid, states = OccupancyGrid(GRID, values), random_states(seed + 9)
    changed, observed = 0, np.zeros(GRID.shape, dtype=np.bool_)
    for at in np.ndindex(GRID.shape):
        now = CellState(int(states[at]))
        before = "occupied" if grid.occupied[at] else "free" if grid.free[at] else "unknown"
        after = {CellState.OBSTACLE: "occupied", CellState.UNKNOWN: "unknown"}.get(now, "free")
        changed += before != after
        seen = not np.isnan(values[at])
        drivable = now in (CellState.ACCESSIBLE, CellState.EXPANSION)
        observed[at] = (seen and drivable) or (before == "free" and after != "occupied")
    assert changed_cells(grid, states, GRID.shape) == changed
    np.testing.assert_array_equal(observed_cells(grid, states, GRID.shape), observed)


@pytest.mark.parametrize("height_m", [None, 2.5])
def test_a_cell_is_as_high_as_the_solid_that_fills_it_or_the_block_at_whose_face_it_is(
    height_m: float | None,
) -> None:
    """Blocks go before strips, the later block before the earlier; at two faces the higher."""
    states = np.full(GRID.shape, CellState.ACCESSIBLE, dtype=np.uint8)
    states[4:20, 5:30] = CellState.OBSTACLE
    states[25:27, 2:38] = CellState.OBSTACLE
    blocks = [
        Solid("a", rectangle_m((0.26, 3.03), (1.04, 0.9), 20.0), 0.8),
        Solid("b", rectangle_m((0.9, 3.3), (0.7, 0.6), 5.0), 1.4),
    ]
    strips = [
        Solid("low", rectangle_m((1.0, 4.61), (1.6, 0.19)), 1.1),
        Solid("high", rectangle_m((1.5, 4.61), (1.6, 0.19)), 1.7),
        Solid("beside", rectangle_m((0.5, 2.6), (2.6, 0.3), 4.0), 0.5),
    ]
    found = cell_heights(GRID, states, blocks, strips, height_m, GRID.shape)
    centers, obstacle = GRID.centers(), states == CellState.OBSTACLE
    inside = [contains(solid.corners_m, centers) & obstacle for solid in (*strips, *blocks)]
    tops_m = [s.height_m if height_m is None else height_m for s in strips] + [0.8, 1.4]
    expected = np.where(obstacle, height_m or math.inf, 0.0)
    for mask, top_m in sorted(zip(inside[:3], tops_m[:3], strict=True), key=lambda one: one[1]):
        expected[mask] = top_m
    for mask, top_m in zip(inside[3:], tops_m[3:], strict=True):
        expected[mask] = top_m
    filled = np.any(inside, axis=0)
    for row, col in np.argwhere(obstacle & ~filled):
        beside = slice(row - 1, row + 2), slice(col - 1, col + 2)
        tops = [m for mask, m in zip(inside[3:], tops_m[3:], strict=True) if mask[beside].any()]
        if tops:
            expected[row, col] = max(tops)
    np.testing.assert_array_equal(found, expected.astype(np.float32))
    assert len(np.unique(expected)) > 3


def test_sides_between_occupied_and_reached_cells_stand_for_returns() -> None:
    """Four neighbours each, at the middle of the side."""
    occupied, reached = np.zeros(GRID.shape, dtype=np.bool_), np.zeros(GRID.shape, dtype=np.bool_)
    occupied[3, 4], occupied[0, 39] = True, True
    reached[2:5, 3:6], reached[3, 4], reached[1, 39] = True, False, True
    found = returns_of_cells(GRID, occupied, reached)
    x, y = GRID.center_of([3, 4])
    last_x, last_y = GRID.center_of([0, 39])
    expected = [[x + 0.05, y], [x - 0.05, y], [x, y + 0.05], [x, y - 0.05], [last_x, last_y + 0.05]]
    order = np.lexsort(np.array(expected).T)
    np.testing.assert_allclose(found.points[np.lexsort(found.points.T.round(9))],
                               np.array(expected)[order], atol=1e-9)  # fmt: skip
    assert found.weights.tolist() == [1.0] * 5


def test_cells_are_numbered_apart() -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform(-3.0, 3.0, (500, 2))
    keys = cell_keys(points, 0.5)
    cells = np.floor(points / 0.5)
    same = (cells[:, None] == cells[None]).all(axis=2)
    np.testing.assert_array_equal(keys[:, None] == keys[None], same)
    assert (keys.min(), keys.dtype) == (0, np.int32)
    order = np.lexsort((cells[:, 1], cells[:, 0]))
    assert (np.diff(keys[order]) >= 0).all()
    assert cell_keys(points * 1e6, 0.5).dtype == np.int64


@pytest.mark.parametrize("seed", range(5))
def test_a_small_hole_in_free_space_is_one_that_touches_no_wall_and_no_border(seed: int) -> None:
    rng = np.random.default_rng(seed)
    kind = rng.choice(3, GRID.shape, p=[0.87, 0.01, 0.12])
    free, occupied = kind == 0, kind == 1
    labels, count = ndimage.label(kind == 2, structure=np.ones((3, 3)))
    expected = np.zeros(GRID.shape, dtype=np.bool_)
    for label in range(1, count + 1):
        mine = labels == label
        rim = mine[0].any() or mine[-1].any() or mine[:, 0].any() or mine[:, -1].any()
        wall = (ndimage.binary_dilation(mine, np.ones((3, 3))) & occupied).any()
        expected |= mine & bool(mine.sum() <= 4.0 and not rim and not wall)
    np.testing.assert_array_equal(_small_holes(free, occupied, 4.0, GRID.shape), expected)
    assert expected.any()


@pytest.mark.parametrize(
    ("radius_cells", "occupied"), [(1.0, 0.02), (2.0, 0.02), (3.7, 0.01), (1.0, 0.15), (1.0, 0.3)]
)
def test_a_grid_is_cleaned_in_bands_as_in_one_piece(
    monkeypatch: pytest.MonkeyPatch, radius_cells: float, occupied: float
) -> None:
    """Whatever reaches across their borders: the robot's disc, specks, pinholes, holes, gaps."""
    rng = np.random.default_rng(3)
    shape, cell_m = (400, 31), 0.25
    kinds = np.array([0.0, 1.0, np.nan], dtype=np.float32)
    values = rng.choice(kinds, shape, p=[0.92 - occupied, occupied, 0.08])
    visited = np.zeros(shape, dtype=np.bool_)
    visited[:, 15] = True
    grid = OccupancyGrid(GridGeometry(0.0, 0.0, cell_m, *shape), values)
    config = RecoveryConfig(robot_radius_m=radius_cells * cell_m, speck_cells=1, hole_area_m2=0.2)
    whole = clean_grid(grid, visited, config)
    monkeypatch.setattr(bands, "_BAND_CELLS", 1)
    in_bands = clean_grid(grid, visited, config)
    for layer in ("occupied", "free", "reached", "passable"):
        np.testing.assert_array_equal(getattr(in_bands, layer), getattr(whole, layer))
    assert (whole.passable & ~visited).any()
    assert (whole.free & np.isnan(values)).any()


def test_the_path_is_sampled_evenly_besides_its_poses() -> None:
    poses = np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [3.0, 4.0, 0.0]])
    found = path_points_m(Trajectory(np.arange(3), poses), 0.5)
    np.testing.assert_array_equal(found[:3], poses[:, :2])
    along = np.where(found[3:, 1] > 0.0, 3.0 + found[3:, 1], found[3:, 0])
    np.testing.assert_allclose(along, np.arange(0.0, 7.0, 0.5), atol=1e-9)


def test_a_robot_that_stands_covers_its_disc() -> None:
    standing = Trajectory(np.arange(2), np.array([[0.63, 3.31, 0.0]] * 2))
    found = footprint_cells(GRID, standing, 0.37)
    away_m = np.linalg.norm(GRID.centers() - [0.63, 3.31], axis=2)
    np.testing.assert_array_equal(found, away_m <= 0.37)


def square(fitted: list[bool]) -> Outline:
    """A room of 2 x 2 m, its outline counter-clockwise."""
    return Outline(np.array([[0.0, 2.5], [2.0, 2.5], [2.0, 4.5], [0.0, 4.5]]), np.array(fitted))


def test_strips_stand_behind_what_is_a_wall_and_in_no_block() -> None:
    """A fitted side is one; another is where most of what lies behind it is occupied."""
    occupied = np.zeros(GRID.shape, dtype=np.bool_)
    x, y = np.moveaxis(GRID.centers(), -1, 0)
    occupied |= (x > 2.0) & (x < 2.1) & (y > 2.5) & (y < 3.7)  # 60 % of the second side
    occupied |= (y > 4.5) & (y < 4.6) & (x > 0.0) & (x < 0.8)  # 40 % of the third
    outline = square([True, False, False, True])
    own = Block(Solid("own", outline.corners_m, 1.0), 0, frozenset({3}))
    found = wall_strips([outline], [own], GRID, occupied, 2.2)
    assert [(strip.outline, strip.side) for strip in found] == [(0, 0), (0, 1)]
    assert [strip.solid.name for strip in found] == ["wall 1", "wall 2"]
    assert {strip.solid.height_m for strip in found} == {2.2}
    plans = [[[0.0, 2.4], [2.0, 2.5]], [[2.0, 2.5], [2.1, 4.5]]]
    for strip, (low, high) in zip(found, plans, strict=True):
        np.testing.assert_allclose(strip.solid.corners_m.min(axis=0), low)
        np.testing.assert_allclose(strip.solid.corners_m.max(axis=0), high)
    # Of the other of two outlines, the same sides are its own.
    found = wall_strips([square([True] * 4), outline], [own], GRID, occupied, 2.2)
    assert [(s.outline, s.side) for s in found] == [*((0, k) for k in (0, 1, 2)), (1, 0), (1, 1),
                                                    (1, 3)]  # fmt: skip
    assert wall_strips([], [], GRID, occupied, 2.2) == []


@pytest.mark.parametrize("seed", range(3))
def test_depth_in_a_rectangle_is_the_distance_to_its_nearest_side(seed: int) -> None:
    rng = np.random.default_rng(seed)
    box = rectangle_m((1.0, 2.0), (2.0, 1.2), 25.0)
    points: Floats = rng.uniform(0.0, 3.0, (40, 2))
    turn = math.radians(25.0)
    ahead = np.array([math.cos(turn), math.sin(turn)])
    along, across = (points - [1.0, 2.0]) @ ahead, (points - [1.0, 2.0]) @ [-ahead[1], ahead[0]]
    expected = np.minimum(1.0 - np.abs(along), 0.6 - np.abs(across))
    np.testing.assert_allclose(_depth_m(box, points), expected, atol=1e-9)
