# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Coarse cells over fine ones, cell by cell, and where a robot counts as being."""

from __future__ import annotations

import numpy as np
import pytest

from slarm_graph.exploration.coverage_grid import (
    BLOCKED,
    OPEN,
    VISITED,
    CoverageGrid,
    coverage_grid,
    driving_cell,
    driving_grid,
    known_coverage,
    start_cell,
    tiled,
)
from slarm_graph.exploration.moves import DELTA_COL, DELTA_ROW
from slarm_graph.geometry import Pose2
from slarm_graph.grid import GridGeometry, Mask

Cell = tuple[int, int]


def place(free: Mask, fine: int, visited: Mask, allowed: Mask | None = None) -> CoverageGrid:
    geometry = GridGeometry(-2.0, 3.0, 0.3, free.shape[0] // fine, free.shape[1] // fine)
    nothing = np.zeros_like(free)
    driving = driving_grid(geometry.divided(fine), free, ~free, free, nothing)
    return coverage_grid(geometry, driving, visited, allowed)


def steps(moves: np.ndarray) -> set[tuple[Cell, Cell]]:
    """All pairs of cells between which a step is open."""
    return {
        ((int(r), int(c)), (int(r) + DELTA_ROW[d], int(c) + DELTA_COL[d]))
        for r, c in np.ndindex(moves.shape)
        for d in range(8)
        if moves[r, c] >> d & 1
    }


def joined(one: Cell, other: Cell, free: Mask, fine: int) -> bool:
    """Whether fine cells on both sides of the border of two coarse ones are free."""
    pairs = [
        ((r, c), (r + other[0] - one[0], c + other[1] - one[1]))
        for r in range(one[0] * fine, one[0] * fine + fine)
        for c in range(one[1] * fine, one[1] * fine + fine)
    ]
    beyond = [(a, b) for a, b in pairs if (b[0] // fine, b[1] // fine) == other]
    return any(free[a] and free[b] for a, b in beyond)


@pytest.mark.parametrize("fine", [1, 2, 3])
@pytest.mark.parametrize("seed", range(6))
def test_a_step_is_open_where_fine_cells_touch_and_no_corner_is_cut(seed: int, fine: int) -> None:
    rng = np.random.default_rng(seed)
    rows, cols = 5, 7
    free = rng.random((rows * fine, cols * fine)) < 0.9 - 0.2 * fine * (seed % 2)
    visited, allowed = rng.random((2, rows, cols)) < 0.8
    coverage = place(free, fine, visited, allowed)
    assert coverage.fineness == fine
    cells = [(int(r), int(c)) for r, c in np.ndindex(rows, cols)]
    inside = {
        (r, c)
        for r, c in cells
        if allowed[r, c] and free[r * fine : (r + 1) * fine, c * fine : (c + 1) * fine].any()
    }
    for cell in cells:
        code = VISITED if visited[cell] else OPEN
        assert coverage.codes[cell] == (code if cell in inside else BLOCKED)
    np.testing.assert_array_equal(coverage.values, coverage.codes / 2.0)
    straight = {
        (a, b)
        for a in inside
        for b in inside
        if abs(a[0] - b[0]) + abs(a[1] - b[1]) == 1 and joined(a, b, free, fine)
    }
    across = set()
    for a in inside:
        for b in inside:
            if abs(a[0] - b[0]) == abs(a[1] - b[1]) == 1:
                ways = [(a[0], b[1]), (b[0], a[1])]
                if all((a, w) in straight and (w, b) in straight for w in ways):
                    across.add((a, b))
    assert steps(coverage.moves) == straight | across


@pytest.mark.parametrize("side", [1, 2, 3, 5])
def test_tiles_gather_cells_and_what_is_missing_of_the_last_is_blocked(side: int) -> None:
    rng = np.random.default_rng(side)
    layers = rng.random((4, 7, 11)) < 0.6
    geometry = GridGeometry(-2.0, 3.0, 0.125, 7, 11)
    driving = driving_grid(geometry, *layers)
    tiles = tiled(driving, side)
    rows, cols = -(-7 // side), -(-11 // side)
    assert tiles.geometry == GridGeometry(-2.0, 3.0, 0.125 * side, rows, cols)
    g = tiles.driving.geometry
    assert (g.rows, g.cols, g.resolution_m) == (rows * side, cols * side, 0.125)
    told = (
        tiles.driving.passable,
        tiles.driving.occupied,
        tiles.driving.observed,
        tiles.driving.swept,
    )
    for found, layer, beyond in zip(told, layers, (False, True, False, False), strict=True):
        np.testing.assert_array_equal(found[:7, :11], layer)
        assert (found[7:] == beyond).all()
        assert (found[:, 11:] == beyond).all()
    for row, col in np.ndindex(rows, cols):
        block = layers[0][row * side : row * side + side, col * side : col * side + side]
        assert tiles.codes[row, col] == (OPEN if block.any() else BLOCKED)


def test_a_known_place_begins_at_the_origin() -> None:
    free = np.ones((3, 5), dtype=np.bool_)
    free[1, 2] = False
    coverage = known_coverage(free, 0.5)
    assert coverage.geometry == GridGeometry(0.0, 0.0, 0.5, 3, 5)
    assert coverage.driving.geometry == coverage.geometry
    np.testing.assert_array_equal(coverage.codes, np.where(free, OPEN, BLOCKED))
    np.testing.assert_array_equal(coverage.driving.occupied, ~free)
    np.testing.assert_array_equal(coverage.driving.observed, free)
    assert not coverage.driving.swept.any()
    assert not len(coverage.heard_m)


def test_a_robot_is_where_the_nearest_passable_spot_is() -> None:
    free = np.zeros((12, 12), dtype=np.bool_)
    free[2, 3] = free[9, 9] = True
    coverage = place(free, 3, np.zeros((4, 4), dtype=np.bool_))
    for x, y, spot in [(0.35, 0.25, (2, 3)), (0.55, 0.05, (2, 3)), (0.85, 0.75, (9, 9))]:
        pose = Pose2(x - 2.0, y + 3.0, 0.0)
        assert driving_cell(coverage.driving, pose.x, pose.y) == spot
        assert start_cell(coverage, pose) == (spot[0] // 3, spot[1] // 3)
    assert driving_cell(coverage.driving, -2.0 + 0.95 + 3.8, 3.95) == (9, 9)
    assert start_cell(coverage, Pose2(-2.0 + 0.95 + 4.2, 3.95, 0.0)) is None
    forbidden = np.ones((4, 4), dtype=np.bool_)
    forbidden[0, 1] = False
    elsewhere = place(free, 3, np.zeros((4, 4), dtype=np.bool_), forbidden)
    assert start_cell(elsewhere, Pose2(-1.65, 3.25, 0.0)) == (3, 3)
