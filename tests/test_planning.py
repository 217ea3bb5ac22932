# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Searches on cells against scipy's Dijkstra and brute force."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from slarm_graph.exploration.coverage_grid import driving_grid
from slarm_graph.exploration.moves import DELTA_COL, DELTA_ROW, clearance_m, moves_within
from slarm_graph.exploration.paths import drivable, path_between
from slarm_graph.exploration.searches import (
    distances_between,
    distances_from,
    path_to_nearest,
    reachable,
    shortest_path,
)
from slarm_graph.exploration.visibility import sees
from slarm_graph.grid import GridGeometry, Mask

seeds = st.integers(0, 2**32 - 1)


def path_length(cells: np.ndarray) -> float:
    """Length of a path (K, 2) [cells]."""
    return float(np.hypot(*np.diff(cells, axis=0).T).sum()) if len(cells) > 1 else 0.0


def random_floor(seed: int, shape: tuple[int, int] = (17, 23), blocked: float = 0.3) -> Mask:
    """Cells free at random; the first is always free."""
    free = np.random.default_rng(seed).uniform(size=shape) > blocked
    free[0, 0] = True
    return free


def dijkstra_lengths(free: Mask, start: int) -> np.ndarray:
    """Distances by scipy on an 8-connected graph without cut corners, built independently."""
    rows, cols = free.shape
    edges = []
    for r, c in np.argwhere(free):
        for dr in (-1, 0, 1):
            for dc in (-1, 0, 1):
                a, b = r + dr, c + dc
                inside = 0 <= a < rows and 0 <= b < cols
                if (dr or dc) and inside and free[a, b] and free[r, b] and free[a, c]:
                    edges.append((r * cols + c, a * cols + b, math.hypot(dr, dc)))
    i, j, w = zip(*edges, strict=True) if edges else ((), (), ())
    graph = coo_matrix((w, (i, j)), shape=(free.size, free.size)).tocsr()
    return dijkstra(graph, indices=start)


@given(seeds)
@settings(max_examples=40, deadline=None)
def test_astar_is_as_short_as_dijkstra(seed: int) -> None:
    free = random_floor(seed)
    moves, truth = moves_within(free), dijkstra_lengths(free, 0)
    for goal in np.argwhere(free)[:: max(1, free.sum() // 12)]:
        path = shortest_path(moves, (0, 0), (int(goal[0]), int(goal[1])))
        length = truth[goal[0] * free.shape[1] + goal[1]]
        if path is None:
            assert math.isinf(length)
        else:
            assert path_length(path) == pytest.approx(length)
            assert tuple(path[0]) == (0, 0)
            assert tuple(path[-1]) == tuple(goal)


@given(seeds)
@settings(max_examples=40, deadline=None)
def test_wavefronts_agree_with_dijkstra(seed: int) -> None:
    free = random_floor(seed)
    moves, truth = moves_within(free), dijkstra_lengths(free, 0).reshape(free.shape)
    np.testing.assert_allclose(distances_from(moves, (0, 0)), truth)
    np.testing.assert_array_equal(reachable(moves, (0, 0)), np.isfinite(truth))
    near = distances_from(moves, (0, 0), limit=7.5)
    np.testing.assert_allclose(near, np.where(truth <= 7.5, truth, np.inf))


@given(seeds)
@settings(max_examples=20, deadline=None)
def test_distances_between_cells_agree_with_dijkstra(seed: int) -> None:
    free = random_floor(seed)
    cells = np.argwhere(free)[::17]
    flat = cells[:, 0] * free.shape[1] + cells[:, 1]
    truth = [dijkstra_lengths(free, start)[flat] for start in flat]
    np.testing.assert_allclose(distances_between(moves_within(free), cells), truth)
    near = distances_between(moves_within(free), cells, 6.5)
    np.testing.assert_allclose(near, np.where(np.less_equal(truth, 6.5), truth, np.inf))


@given(seeds)
@settings(max_examples=40, deadline=None)
def test_nearest_wanted_cell_and_its_tie_break(seed: int) -> None:
    free = random_floor(seed)
    wanted = free & (np.random.default_rng(seed + 1).uniform(size=free.shape) < 0.1)
    wanted[0, 0] = False
    path = path_to_nearest(moves_within(free), wanted, (0, 0))
    lengths = np.where(wanted, dijkstra_lengths(free, 0).reshape(free.shape), np.inf)
    if path is None:
        assert np.isinf(lengths).all()
        return
    assert path_length(path) == pytest.approx(lengths.min())
    first = np.flatnonzero(lengths.ravel() < lengths.min() + 1e-6)[0]
    assert path[-1, 0] * free.shape[1] + path[-1, 1] == first


@given(seeds)
@settings(max_examples=25, deadline=None)
def test_paths_step_between_free_cells_and_cut_no_corner(seed: int) -> None:
    free = random_floor(seed)
    target = np.zeros_like(free)
    target[-4:, -4:] = free[-4:, -4:]
    path = path_to_nearest(moves_within(free), target, (0, 0))
    if path is None:
        return
    assert free[path[:, 0], path[:, 1]].all()
    steps = {tuple(s) for s in np.diff(path, axis=0)}
    assert steps <= set(zip(DELTA_ROW, DELTA_COL, strict=True))
    for (r, c), (dr, dc) in zip(path[:-1], np.diff(path, axis=0), strict=True):
        assert free[r + dr, c]
        assert free[r, c + dc]


@given(seeds, st.floats(0.05, 0.35))
@settings(max_examples=30, deadline=None)
def test_legs_never_touch_the_expansion_of_obstacles(seed: int, radius_m: float) -> None:
    rng = np.random.default_rng(seed)
    occupied = random_floor(seed, (60, 80), 0.01) == 0
    geometry = GridGeometry(-1.0, 2.0, 0.05, 60, 80)
    passable = clearance_m(occupied, 0.05) >= radius_m
    nothing = np.zeros_like(occupied)
    driving = driving_grid(geometry, passable, occupied, ~occupied, nothing)
    spots = np.argwhere(passable)
    if len(spots) < 2:
        return
    ends = geometry.center_of(spots[rng.integers(len(spots), size=2)])
    path = path_between(driving, ends[0], ends[1])
    if path is None:
        return
    dense = np.concatenate([np.linspace(a, b, 200) for a, b in itertools.pairwise(path)] or [path])
    cells = geometry.cell_of(dense)
    assert passable[cells[:, 0], cells[:, 1]].all()
    blocked = geometry.center_of(np.argwhere(occupied))
    if len(blocked):
        apart = np.linalg.norm(dense[:, None] - blocked[None], axis=-1).min()
        assert apart >= radius_m - math.hypot(0.025, 0.025)


def test_pulled_paths_are_no_longer_than_the_cells_they_come_from() -> None:
    free = random_floor(3, (40, 40), 0.15)
    driving = driving_grid(GridGeometry(0, 0, 1.0, 40, 40), free, ~free, free, ~free)
    spots = np.argwhere(reachable(driving.moves, (0, 0)))
    for goal in spots[::97]:
        cells = shortest_path(driving.moves, (0, 0), (int(goal[0]), int(goal[1])))
        assert cells is not None
        path = drivable(driving, np.array([0.5, 0.5]), cells)
        assert np.hypot(*np.diff(path, axis=0).T).sum() <= path_length(cells) + 1e-9


def test_the_path_leaves_from_the_robot_not_from_the_centre_of_its_cell() -> None:
    free = np.ones((6, 20), dtype=np.bool_)
    free[2:, 10] = False
    driving = driving_grid(GridGeometry(0, 0, 1.0, 6, 20), free, ~free, free, ~free)
    begin, end = np.array([2.9, 1.1]), np.array([15.5, 4.5])
    path = path_between(driving, begin, end)
    assert path is not None
    np.testing.assert_allclose(path[0], begin)
    assert (np.diff(path[:, 0]) > 0).all(), "first a step back"


def test_out_of_an_expansion_the_path_begins_at_the_nearest_passable_cell() -> None:
    free = np.ones((6, 20), dtype=np.bool_)
    free[:2, :4] = False
    driving = driving_grid(GridGeometry(0, 0, 1.0, 6, 20), free, ~free, free, ~free)
    begin = np.array([2.5, 1.9])
    path = path_between(driving, begin, np.array([15.5, 0.5]))
    assert path is not None
    np.testing.assert_allclose(path[:2], [begin, [2.5, 2.5]])


@given(seeds)
@settings(max_examples=60, deadline=None)
def test_visibility_touches_only_free_cells(seed: int) -> None:
    rng = np.random.default_rng(seed)
    free = random_floor(seed, (12, 12), 0.1)
    a, b = rng.uniform(0, 12, size=(2, 2))
    dense = np.linspace(a, b, 4000)
    crossed = free[dense[:, 1].astype(int), dense[:, 0].astype(int)].all()
    # Sampling may step over the tip of a cell, so it can only be too generous.
    assert crossed or not sees(free, a, b)
    if sees(free, a, b):
        assert sees(free, b, a)


def test_clearance_is_the_distance_to_the_nearest_blocked_centre() -> None:
    blocked = ~random_floor(7, (9, 14), 0.05)
    spots = np.argwhere(np.pad(blocked, 1, constant_values=True)) - 1
    every = np.stack(np.indices(blocked.shape), axis=-1)
    brute = np.linalg.norm(every[:, :, None] - spots[None, None], axis=-1).min(axis=-1)
    np.testing.assert_allclose(clearance_m(blocked, 0.1), 0.1 * brute, rtol=1e-5)
