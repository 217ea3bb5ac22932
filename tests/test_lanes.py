# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Lanes of `ggmr+`: they cover the floor, and their order costs little."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from slarm_graph.config import DrivingConfig
from slarm_graph.exploration.contour_lanes import contour_lanes
from slarm_graph.exploration.coverage_grid import driving_grid
from slarm_graph.exploration.lane_order import order_lanes
from slarm_graph.exploration.live_map import mark_swept
from slarm_graph.exploration.smooth_paths import smooth_path
from slarm_graph.exploration.tour import _or_opt, short_tour, worthwhile
from slarm_graph.geometry import Floats, Pose2
from slarm_graph.grid import GridGeometry, Mask
from slarm_graph.raster.thinning import pruned, thinned, traced

EIGHT = np.ones((3, 3), dtype=np.bool_)
seeds = st.integers(0, 2**32 - 1)


def blobs(seed: int, shape: tuple[int, int] = (60, 80)) -> Mask:
    """Smooth random islands."""
    noise = np.random.default_rng(seed).standard_normal(shape)
    return np.asarray(ndimage.gaussian_filter(noise, 3.0) > 0.02)


@given(seeds)
@settings(max_examples=25, deadline=None)
def test_thinning_keeps_what_hangs_together_apart_and_together(seed: int) -> None:
    mask = blobs(seed)
    thin = thinned(mask)
    assert not (thin & ~mask).any()
    labels, count = ndimage.label(mask, EIGHT)
    # Zhang and Suen may lose an island of two by two cells.
    large = [i for i in range(1, count + 1) if np.sum(labels == i) > 4]
    assert set(large) <= set(np.unique(labels[thin]))
    parts = ndimage.label(thin, EIGHT)[1]
    assert parts <= count
    # No cell is left inside.
    assert not ndimage.binary_erosion(thin, EIGHT).any()


@given(seeds)
@settings(max_examples=25, deadline=None)
def test_traced_chains_hold_every_cell_once_and_step_to_neighbours(seed: int) -> None:
    lines = thinned(blobs(seed))
    chains = traced(lines)
    for chain in chains:
        steps = np.diff(np.stack(np.divmod(chain, lines.shape[1])), axis=1)
        assert np.abs(steps).max(initial=0) <= 1
    open_chains = [c[:-1] if len(c) > 3 and c[0] == c[-1] else c for c in chains]
    cells = np.concatenate(open_chains) if chains else np.empty(0, dtype=np.int64)
    np.testing.assert_array_equal(np.sort(cells), np.flatnonzero(lines))


def test_pruning_shortens_a_line_at_both_ends_and_keeps_rings_and_points() -> None:
    lines = np.zeros((12, 30), dtype=np.bool_)
    lines[2, 3:20] = True
    lines[6, 4:7] = True
    lines[9, 20] = lines[8, 21] = lines[10, 21] = lines[9, 22] = True
    short = pruned(lines, 4)
    assert np.flatnonzero(short[2]).tolist() == list(range(7, 16))
    assert short[6].sum() == 1
    assert short[8:].sum() == 4


@pytest.mark.parametrize("seed", range(4))
def test_lanes_cover_nearly_all_that_the_disc_can_reach(seed: int) -> None:
    radius = 7.0
    rng = np.random.default_rng(seed)
    free = np.zeros((240, 320), dtype=np.bool_)
    free[2:-2, 2:-2] = True
    for row, col, height, width in rng.integers((20, 20, 5, 5), (200, 280, 40, 40), (6, 4)):
        free[row : row + height, col : col + width] = False
    passable = ndimage.distance_transform_edt(free) > radius
    wanted = ndimage.distance_transform_edt(~passable) <= radius
    lanes = contour_lanes(wanted, passable, radius, 100.0)
    swept = np.zeros(free.shape, dtype=np.bool_)
    for lane in lanes:
        cells = lane.points.astype(int)
        assert passable[cells[:, 1], cells[:, 0]].all()
        mark_swept(swept, lane.points, radius)
    assert swept[wanted].mean() > 0.985
    length = sum(len(lane.points) for lane in lanes)
    assert length < 1.15 * wanted.sum() / (2.0 * radius)
    assert sum(lane.area_cells for lane in lanes) == pytest.approx(wanted.sum(), rel=0.05)


def cost(tour: list[int], between: Floats, first: Floats) -> float:
    """Price of a tour, by its definition."""
    links = sum(between[a ^ 1, b] for a, b in itertools.pairwise(tour))
    return float(first[tour[0]] + links) if tour else 0.0


def random_links(seed: int, count: int) -> tuple[Floats, Floats]:
    spots = np.random.default_rng(seed).uniform(0, 10, (2 * count + 1, 2))
    apart = np.linalg.norm(spots[:, None] - spots[None], axis=-1)
    return apart[1:, 1:], apart[0, 1:]


@given(seeds)
@settings(max_examples=30, deadline=None)
def test_no_turn_or_move_of_a_stretch_makes_a_tour_shorter(seed: int) -> None:
    between, first = random_links(seed, 7)
    tour = short_tour(between, first).tolist()
    assert sorted(end // 2 for end in tour) == list(range(7))
    length = cost(tour, between, first)
    for i, j in itertools.combinations(range(8), 2):
        turned = [end ^ 1 for end in tour[i:j][::-1]]
        assert cost(tour[:i] + turned + tour[j:], between, first) >= length - 1e-5
        rest = tour[:i] + tour[j:]
        for k in range(len(rest) + 1):
            for stretch in (tour[i:j], turned):
                moved = rest[:k] + stretch + rest[k:]
                assert cost(moved, between, first) >= length - 1e-5


@pytest.mark.parametrize(("ahead", "behind"), [(1, 17), (8, 10), (9, 9), (10, 8)])
def test_up_to_eight_lanes_are_moved_together(ahead: int, behind: int) -> None:
    """Two rows of lanes, each without gaps, in the wrong order: the other saves a second."""
    between = np.ones((36, 36))
    follow = [(lane, lane + 1) for lane in range(17) if lane != ahead - 1] + [(17, 0)]
    for one, next_one in follow:
        between[2 * one + 1, 2 * next_one] = between[2 * next_one, 2 * one + 1] = 0.0
    tour = np.arange(0, 36, 2)
    is_moved = _or_opt(tour, between, np.ones(36))
    right_order = [*range(ahead, 18), *range(ahead)]
    assert is_moved == (min(ahead, behind) <= 8)
    assert tour.tolist() == [2 * lane for lane in (right_order if is_moved else range(18))]


def test_long_tours_are_much_shorter_than_greedy_ones() -> None:
    between, first = random_links(0, 60)
    tour = short_tour(between, first).tolist()
    greedy, left = [], set(range(120))
    costs = first
    while left:
        end = min(left, key=lambda e: costs[e])
        greedy.append(end)
        left -= {end, end ^ 1}
        costs = between[end ^ 1]
    assert sorted(end // 2 for end in tour) == list(range(60))
    assert cost(tour, between, first) < 0.9 * cost(greedy, between, first)


@given(seeds)
@settings(max_examples=30, deadline=None)
def test_no_stretch_of_a_tour_costs_more_than_it_is_worth(seed: int) -> None:
    between, first = random_links(seed, 7)
    worth = np.random.default_rng(seed + 1).uniform(0, 8, 7)
    tour = worthwhile(short_tour(between, first), between, first, worth).tolist()

    def value(some: list[int]) -> float:
        return float(sum(worth[end // 2] for end in some)) - cost(some, between, first)

    for i, j in itertools.combinations(range(len(tour) + 1), 2):
        assert value(tour) >= value(tour[:i] + tour[j:]) - 1e-6


def test_smooth_ways_round_links_and_keep_the_corners_of_lanes() -> None:
    free = np.ones((200, 200), dtype=np.bool_)
    driving = driving_grid(GridGeometry(0.0, 0.0, 0.025, 200, 200), free, ~free, free, ~free)
    link = np.array([[1.0, 1.0], [3.0, 1.0]])
    lane = np.array([[3.0, 1.0], [3.0, 3.0], [1.0, 3.0]])
    path = smooth_path([(link, True), (lane, False)], driving)
    np.testing.assert_allclose(path[[0, -1]], [[1.0, 1.0], [1.0, 3.0]])
    assert np.linalg.norm(path - (3.0, 3.0), axis=1).min() < 1e-6
    assert np.linalg.norm(path - (3.0, 1.0), axis=1).min() > 0.04
    free[41:, :79] = False
    walled = driving_grid(GridGeometry(0.0, 0.0, 0.025, 200, 200), free, ~free, free, ~free)
    around = np.array([[1.0, 1.0], [2.0, 1.0], [2.0, 2.0]])
    path = smooth_path([(around, True)], walled)
    cells = walled.geometry.cell_of(path)
    assert walled.passable[cells[:, 0], cells[:, 1]].all()
    assert np.linalg.norm(path - (2.0, 1.0), axis=1).min() < 0.04


def test_a_robot_too_near_to_a_wall_for_its_tile_still_finds_all_lanes() -> None:
    passable = np.zeros((80, 80), dtype=np.bool_)
    passable[18:70, 18:70] = True
    geometry = GridGeometry(0.0, 0.0, 0.05, 80, 80)
    driving = driving_grid(geometry, passable, ~passable, passable, np.zeros_like(passable))
    lanes = contour_lanes(passable, passable, 3.4, 60.0)
    inside, outside = Pose2(2.0, 2.0, 0.0), Pose2(0.7, 2.0, 0.0)
    for pose in (inside, outside):
        tour, rest = order_lanes(lanes, driving, pose, DrivingConfig(), 1e6)
        assert len(tour) == len(lanes)
        assert rest == []
