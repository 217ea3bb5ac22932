# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The line of a wall: which returns are its own, their fit, its direction, which walls share it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from test_walls import CELL_M, ROOM, returns_on, wall

from slarm_graph.recovery.returns import Returns
from slarm_graph.recovery.wall_lines import (
    Wall,
    _inliers,
    _least_squares,
    _weighted_median,
    wall_between,
)
from slarm_graph.recovery.walls import _same_line, _snapped, main_direction_rad


def at_angle(deg: float, length_m: float = 1.0, *, fitted: bool = True) -> Wall:
    """A wall about (2, 1)."""
    half = 0.5 * length_m * np.array([math.cos(math.radians(deg)), math.sin(math.radians(deg))])
    return wall([2.0 - half[0], 1.0 - half[1]], [2.0 + half[0], 1.0 + half[1]], fitted=fitted)


@pytest.mark.parametrize(("share", "fitted"), [(0.45, False), (0.6, True)])
def test_a_wall_is_seen_along_half_of_its_length(share: float, *, fitted: bool) -> None:
    """From either of its ends, whatever lies beyond the other."""
    start, end = np.array([1.0, 1.0]), np.array([3.0, 1.0])
    for first in (1.0, 3.0 - 2.0 * share):
        x = np.arange(first, first + 2.0 * share, 0.01)
        seen = Returns.of(np.column_stack([x, np.full(len(x), 1.02)]), np.ones(len(x)))
        found = wall_between(start, end, seen, CELL_M)
        assert found.fitted == fitted
        assert found.anchor[1] == pytest.approx(1.02 if fitted else 1.0)


@pytest.mark.parametrize(("off_m", "fitted"), [(0.09, True), (-0.09, True), (0.11, False)])
def test_returns_within_two_cells_are_a_walls_own(off_m: float, *, fitted: bool) -> None:
    x = np.arange(0.5, 3.5, 0.01)
    beside = Returns.of(np.column_stack([x, np.full(len(x), 1.0 + off_m)]), np.ones(len(x)))
    found = wall_between(np.array([1.0, 1.0]), np.array([3.0, 1.0]), beside, CELL_M)
    assert found.fitted == fitted


def test_a_stretch_too_short_for_a_direction_is_not_fitted() -> None:
    returns = returns_on(ROOM)
    for length_m, fitted in ((0.29, False), (0.31, True)):
        end = ROOM[0] + [1.0 + length_m, 0.0]
        assert wall_between(ROOM[0] + [1.0, 0.0], end, returns, CELL_M).fitted == fitted


def test_the_other_wall_of_a_corner_and_what_stands_before_do_not_bend_a_line() -> None:
    x = np.arange(0.0, 2.0, 0.01)
    own = np.column_stack([x, 0.1 * x])
    # A third of the returns is from something 7 cm before its middle; the corner's is square.
    before = own[60:120] + np.array([-0.007, 0.07])
    other = own[-1] + np.arange(0.0, 1.0, 0.01)[:, None] * [-0.1, 1.0]
    points = np.concatenate([own, before, other])
    found = wall_between(own[0], own[-1], Returns.of(points, np.ones(len(points))), CELL_M)
    np.testing.assert_allclose(found.off_m(own), 0.0, atol=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_a_line_is_the_weighted_points_principal_axis(seed: int) -> None:
    """The oracle is the covariance's eigenvector."""
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(30, 2)) @ rng.normal(size=(2, 2)) + rng.uniform(-5.0, 5.0, 2)
    weights = rng.integers(1, 9, 30).astype(np.float64)
    ahead = rng.normal(size=2)
    found = _least_squares(points, weights, ahead)
    axis = np.linalg.eigh(np.cov(points.T, aweights=weights))[1][:, -1]
    np.testing.assert_allclose(found[2:], axis * np.sign(axis @ ahead))
    np.testing.assert_allclose(found[:2], np.average(points, axis=0, weights=weights))


@pytest.mark.parametrize("seed", range(20))
def test_a_weighted_median_is_that_of_every_value_as_often_as_it_weighs(seed: int) -> None:
    rng = np.random.default_rng(seed)
    values, weights = rng.normal(size=7), rng.integers(1, 5, 7)
    values[seed % 7] = values[3]  # two returns as far off
    every = np.sort(np.repeat(values, weights))
    found = _weighted_median(values, weights.astype(np.float64))
    assert found == every[(len(every) - 1) // 2]


def test_inliers_lie_within_two_and_a_half_spreads_but_within_a_lasers_noise() -> None:
    """Bounds of 1.5 and 4 cm about the median, and the spread's own between them."""
    for spread_m, bound_m in ((0.001, 0.015), (0.008, 2.5 * 1.4826 * 0.008), (0.05, 0.04)):
        off_m = 0.3 + np.repeat([-spread_m, 0.0, spread_m], [40, 20, 40])
        tried = 0.3 + bound_m * np.array([-1.01, -0.99, 0.99, 1.01])
        found = _inliers(np.append(off_m, tried), np.append(np.ones(100), np.full(4, 1e-6)))
        assert found[-4:].tolist() == [False, True, True, False]


def test_one_line_is_told_by_direction_and_by_how_far_apart_stretches_lie() -> None:
    """By 3 degrees, and 0.6 cells at the middle of the other."""
    a = wall([0.0, 0.0], [1.0, 0.0])
    for deg, same in ((0.0, True), (2.9, True), (-2.9, True), (3.1, False), (180.0, False)):
        rad = math.radians(deg)
        other = wall([1.5 - 0.5 * math.cos(rad), -0.5 * math.sin(rad)],
                     [1.5 + 0.5 * math.cos(rad), 0.5 * math.sin(rad)])  # fmt: skip
        assert _same_line(a, other, CELL_M) == same
    for off_m, same in ((0.029, True), (-0.029, True), (0.031, False), (-0.031, False)):
        assert _same_line(a, wall([2.0, off_m], [3.0, off_m]), CELL_M) == same
    assert not _same_line(a, wall([1.0, 0.0], [2.0, 0.0], fitted=False), CELL_M)
    assert not _same_line(wall([1.0, 0.0], [2.0, 0.0], fitted=False), a, CELL_M)
    # Its own middle counts, not where the line happens to have its anchor.
    slow = wall([0.0, 0.0], [8.0, 8.0 * math.tan(math.radians(2.0))])
    assert not _same_line(a, slow, CELL_M)


def test_what_lies_just_on_a_bound_is_on_one_line() -> None:
    a, limit = wall([0.0, 0.0], [1.0, 0.0]), math.radians(3.0)
    edge = np.array([math.cos(limit), math.sin(limit)])
    assert _same_line(a, Wall(np.zeros(2), np.zeros(2), np.zeros(2), edge, fitted=True), CELL_M)
    assert _same_line(a, wall([2.0, 0.6], [3.0, 0.6]), 1.0)


@pytest.mark.parametrize("quarter", range(4))
@pytest.mark.parametrize(
    ("off_deg", "length_m", "is_snapped"),
    [(1.5, 0.6, True), (-1.5, 0.6, True), (3.9, 0.4, True), (4.1, 0.3, False), (1.5, 1.3, False),
     (0.5, 3.0, True), (0.5, 4.0, False), (40.0, 0.3, False)],
)  # fmt: skip
def test_a_wall_that_turning_hardly_moves_becomes_parallel(
    quarter: int, off_deg: float, length_m: float, *, is_snapped: bool
) -> None:
    """By less than 4 degrees and 1.5 cm at its ends, which is 0.3 cells."""
    main = 12.0 + 90.0 * quarter
    before = at_angle(main + off_deg, length_m)
    found = _snapped(before, math.radians(12.0), CELL_M)
    goal = math.radians(main if is_snapped else main + off_deg)
    np.testing.assert_allclose(found.direction, [math.cos(goal), math.sin(goal)], atol=1e-12)
    assert found.anchor is before.anchor
    assert _snapped(before, None, CELL_M) is before
    loose = at_angle(main + off_deg, length_m, fitted=False)
    assert _snapped(loose, math.radians(12.0), CELL_M) is loose


@pytest.mark.parametrize("main_deg", [0.3, 1.0, 30.0, 45.0, 89.5])
def test_the_main_direction_is_that_of_most_of_the_walls(main_deg: float) -> None:
    """Of walls within a degree it is their mean by length, and other walls have no say."""
    near = [(-0.6, 2.0), (90.4, 3.0), (180.2, 1.0), (269.9, 4.0)]
    walls = [at_angle(main_deg + off, length) for off, length in near]
    fourfold = sum(m * np.exp(4j * math.radians(main_deg + off)) for off, m in near)
    expected = math.degrees(np.angle(fourfold) / 4.0) % 90.0
    walls += [at_angle(main_deg + 30.0, 4.5), at_angle(main_deg + 50.0, 4.5)]
    walls += [at_angle(main_deg + 20.0, 99.0, fitted=False)]
    found = main_direction_rad(walls)
    assert found is not None
    assert math.degrees(found) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("main_deg", [3.0, 40.0, 84.0])
def test_walls_within_four_degrees_are_meant_to_be_parallel(main_deg: float) -> None:
    walls = [
        at_angle(main_deg + off, length) for off, length in ((-1.0, 1.0), (0.0, 8.0), (1.0, 1.0))
    ]
    for off_deg, counts in ((3.9, True), (-3.9, True), (4.1, False), (-4.1, False)):
        found = main_direction_rad([*walls, at_angle(main_deg + off_deg, 2.0)])
        assert found is not None
        off = math.radians(off_deg if counts else 0.0)
        mean = 8.0 + 2.0 * math.cos(math.radians(4.0)) + 2.0 * counts * np.exp(4j * off)
        assert math.degrees(found) - main_deg == pytest.approx(math.degrees(np.angle(mean)) / 4.0)


def test_less_than_a_metre_of_walls_has_no_direction() -> None:
    assert main_direction_rad([at_angle(10.0, 0.5), at_angle(10.0, 0.49)]) is None
    assert main_direction_rad([at_angle(10.0, 0.5), at_angle(10.0, 0.51)]) is not None
    assert main_direction_rad([at_angle(10.0, 5.0, fitted=False)]) is None
    assert main_direction_rad([]) is None
