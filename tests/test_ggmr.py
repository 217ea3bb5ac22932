# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Algorithm 1 on floors small enough to walk by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from slarm_graph.exploration.algorithm_1 import ggmr_path
from slarm_graph.exploration.coverage_grid import (
    BLOCKED,
    OPEN,
    VISITED,
    CoverageGrid,
    known_coverage,
)
from slarm_graph.exploration.searches import distances_from, reachable

Place = tuple[int, int]


def floor(drawing: str) -> CoverageGrid:
    """Read a floor as drawn, highest row first; `#` is blocked."""
    rows = [line.strip() for line in drawing.strip().splitlines()]
    return known_coverage(np.array([[c != "#" for c in row] for row in rows[::-1]]))


def walked(coverage: CoverageGrid, start: tuple[int, int] = (0, 0)) -> list[tuple[int, int]]:
    return [(int(r), int(c)) for r, c in ggmr_path(coverage, start).cells]


def test_empty_room_is_swept_to_and_fro() -> None:
    path = ggmr_path(floor("...\n..."), (0, 0))
    assert path.cells.tolist() == [[0, 0], [0, 1], [0, 2], [1, 2], [1, 1], [1, 0]]
    assert path.facing.tolist() == [0, 1, 1, 0, -1, -1]
    assert path.counts.turns == 2
    assert path.counts.restarts == path.counts.revisits == 0
    assert path.complete


def test_comparisons_are_counted_one_by_one() -> None:
    # At the start: +x (0). Then ahead: 0, 0. Last cell: ahead is off the grid, then up, up-ahead
    # and up-behind are no cells: 1 + 3. Nothing is left.
    assert ggmr_path(floor("..."), (0, 0)).counts.comparisons == 1 + 2 + 4


def test_plus_x_comes_before_minus_x_and_the_rest_needs_a_restart() -> None:
    assert walked(floor("....."), (0, 2)) == [
        (0, 2),
        (0, 3),
        (0, 4),
        (0, 3),
        (0, 2),
        (0, 1),
        (0, 0),
    ]
    counts = ggmr_path(floor("....."), (0, 2)).counts
    assert (counts.restarts, counts.revisits) == (1, 2)


def test_minus_x_where_plus_x_is_blocked() -> None:
    assert walked(floor("..#"), (0, 1)) == [(0, 1), (0, 0)]


def test_a_diagonal_is_two_moves_through_the_free_side_cell() -> None:
    # From (0, 1) up is blocked and up-behind is open: it goes through (0, 0).
    path = ggmr_path(floor(".#\n.."), (0, 0))
    assert path.cells.tolist() == [[0, 0], [0, 1], [0, 0], [1, 0]]
    assert path.counts.restarts == 0
    assert path.counts.revisits == 1


def test_restart_goes_to_the_cheapest_cell_lowest_row_first() -> None:
    # From the centre of the top row both wings hang down equally far.
    path = walked(floor("...\n.#."), (1, 0))
    assert path[:3] == [(1, 0), (1, 1), (1, 2)]
    assert path[3] == (0, 2)


def test_enclosed_cells_are_left_and_reported_apart() -> None:
    coverage = floor("...#.\n...#.")
    path = ggmr_path(coverage, (0, 0))
    assert path.complete
    assert len(path.cells) == 6
    assert np.sum((coverage.codes == OPEN) & ~reachable(coverage.moves, (0, 0))) == 2


def test_going_on_gives_the_same_path_as_going_at_once() -> None:
    coverage = floor(".......\n..#....\n.....#.\n.......")
    whole = ggmr_path(coverage, (0, 3))
    first = ggmr_path(coverage, (0, 3), max_cells=6)
    assert not first.complete
    np.testing.assert_array_equal(whole.cells[: len(first.cells)], first.cells)


def random_floor(
    rng: np.random.Generator, least: int, most: int, blocked: float
) -> NDArray[np.bool_]:
    """Free cells of a floor of random size, the first one among them."""
    free = rng.uniform(size=rng.integers(least, most, 2)) > blocked
    free[0, 0] = True
    return np.asarray(free)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=40, deadline=None)
def test_every_reachable_cell_is_visited_and_no_blocked_one(seed: int) -> None:
    free = random_floor(np.random.default_rng(seed), 1, 20, 0.25)
    coverage = known_coverage(free)
    path = ggmr_path(coverage, (0, 0))
    visited = np.zeros_like(free)
    visited[path.cells[:, 0], path.cells[:, 1]] = True
    np.testing.assert_array_equal(visited, reachable(coverage.moves, (0, 0)))
    assert (coverage.codes[path.cells[:, 0], path.cells[:, 1]] != BLOCKED).all()
    assert np.abs(np.diff(path.cells, axis=0)).max(initial=0) <= 1


def next_by_the_rules(codes: NDArray[np.uint8], here: Place, facing: int) -> list[Place]:
    """Second implementation of a step: ahead, up, up-ahead, up-behind; empty: a restart."""

    def code(place: Place) -> int:
        row, col = place
        inside = 0 <= row < codes.shape[0] and 0 <= col < codes.shape[1]
        return int(codes[place]) if inside else BLOCKED

    row, col = here
    if facing == 0:
        facing = 1 if code((row, col + 1)) == OPEN or code((row, col - 1)) != OPEN else -1
    for place in ((row, col + facing), (row + 1, col)):
        if code(place) == OPEN:
            return [place]
    for side in (facing, -facing):
        for via in ((row + 1, col), (row, col + side)):
            if code(via) != BLOCKED and code((row + 1, col + side)) == OPEN:
                return [via, (row + 1, col + side)]
    return []


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=60, deadline=None)
def test_every_step_is_the_one_that_the_rules_ask_for(seed: int) -> None:
    """On floors of which parts are passed over already, as they are after a restart."""
    rng = np.random.default_rng(seed)
    free = random_floor(rng, 2, 12, 0.2)
    coverage = known_coverage(free)
    codes = coverage.codes.copy()
    codes[free & (rng.uniform(size=free.shape) < 0.3)] = VISITED
    path = ggmr_path(replace(coverage, codes=codes.copy()), (0, 0))
    cells = [(int(row), int(col)) for row, col in path.cells]
    at, restarts = 0, 0
    codes[cells[0]] = VISITED
    while True:
        steps = next_by_the_rules(codes, cells[at], int(path.facing[at]))
        if not steps:
            open_cells = [(int(row), int(col)) for row, col in np.argwhere(codes == OPEN)]
            away = distances_from(coverage.moves, cells[at])
            within = [cell for cell in open_cells if np.isfinite(away[cell])]
            if not within:
                break
            restarts += 1
            goal = min(within, key=lambda cell: (round(away[cell], 6), cell))
            steps = cells[at + 1 : cells.index(goal, at) + 1]
        assert cells[at + 1 : at + 1 + len(steps)] == steps
        at += len(steps)
        codes[cells[at]] = VISITED
    assert at == len(cells) - 1
    assert restarts == path.counts.restarts


def test_comparisons_per_cell_of_an_empty_floor_are_nearly_one() -> None:
    counts = ggmr_path(known_coverage(np.ones((50, 50), dtype=np.bool_)), (0, 0)).counts
    assert counts.comparisons / 2500 == pytest.approx(1.08, abs=0.05)
