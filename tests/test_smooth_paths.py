# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Smoothing of paths, part by part, against loops over points."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slarm_graph.exploration.coverage_grid import DrivingGrid, driving_grid
from slarm_graph.exploration.smooth_paths import (
    _averaged,
    _grown,
    _is_passable,
    _resampled,
    _steps_to_corner,
    smooth_path,
)
from slarm_graph.geometry import Floats
from slarm_graph.grid import GridGeometry, Mask


def floor(free: Mask | None = None) -> DrivingGrid:
    """Five metres square whose lower-left corner is at (-1, -1) [m]."""
    free = np.ones((200, 200), dtype=np.bool_) if free is None else free
    geometry = GridGeometry(-1.0, -1.0, 0.025, 200, 200)
    return driving_grid(geometry, free, ~free, free, np.zeros_like(free))


def bent(degrees: float, steps: int = 30) -> Floats:
    """Points 0.02 m apart that go along x and bend to the left in the middle."""
    ways = np.radians(np.repeat([0.0, degrees], steps))
    moved = 0.02 * np.stack([np.cos(ways), np.sin(ways)], axis=1)
    return np.concatenate([np.zeros((1, 2)), np.cumsum(moved, axis=0)])


@pytest.mark.parametrize("seed", range(10))
def test_averages_and_marks_are_those_of_loops(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points, reach = rng.normal(size=(40, 2)), rng.integers(0, 12, 40)
    marks, grow = rng.random(40) < 0.1, int(rng.integers(0, 6))
    for k, mean in enumerate(_averaged(points, reach)):
        fits = min(reach[k], k, 39 - k)
        np.testing.assert_allclose(mean, points[k - fits : k + fits + 1].mean(axis=0))
    expected = [marks[max(k - grow, 0) : k + grow + 1].any() for k in range(40)]
    assert _grown(marks, grow).tolist() == expected


def test_points_are_a_step_apart_and_know_of_links() -> None:
    pieces = [
        (np.array([[0.0, 0.0], [1.0, 0.0]]), True),
        (np.array([[1.0, 0.0], [1.0, 0.5], [1.5, 0.5]]), False),
    ]
    points, is_link = _resampled(pieces)
    assert len(points) == 101
    assert is_link.tolist() == [True] * 51 + [False] * 50
    np.testing.assert_allclose(np.hypot(*np.diff(points, axis=0).T), 0.02)
    np.testing.assert_allclose(points[[0, 50, 75, 100]], [[0, 0], [1, 0], [1, 0.5], [1.5, 0.5]])
    odd, _ = _resampled([(np.array([[0.0, 0.0], [0.05, 0.0]]), False)])
    np.testing.assert_allclose(odd[:, 0], [0.0, 0.05 / 3, 0.1 / 3, 0.05])


@pytest.mark.parametrize(("degrees", "is_corner"), [(58.0, False), (62.0, True), (-90.0, True)])
def test_corners_are_bends_of_sixty_degrees(degrees: float, is_corner: bool) -> None:
    points, every = bent(degrees), np.ones(61, dtype=np.bool_)
    away = np.abs(np.arange(61) - 30)
    expected = away if is_corner else np.full(61, 61)
    np.testing.assert_array_equal(_steps_to_corner(points, every), expected)
    elsewhere = every.copy()
    elsewhere[30] = False
    np.testing.assert_array_equal(_steps_to_corner(points, elsewhere), np.full(61, 61))


def test_the_nearest_of_several_corners_counts() -> None:
    ways = np.radians(np.repeat([0.0, 90.0, 0.0, -90.0], 25))
    moved = 0.02 * np.stack([np.cos(ways), np.sin(ways)], axis=1)
    points = np.concatenate([np.zeros((1, 2)), np.cumsum(moved, axis=0)])
    expected = np.abs(np.arange(101)[:, None] - [25, 50, 75]).min(axis=1)
    found = _steps_to_corner(points, np.ones(101, dtype=np.bool_))
    np.testing.assert_array_equal(found, expected)


def test_passable_is_told_by_cells_and_nothing_outside_is() -> None:
    free = np.ones((200, 200), dtype=np.bool_)
    free[40, 80] = False
    points = np.array([[1.01, 0.01], [1.01, 0.03], [1.03, 0.01], [-1.01, 0.0], [0.0, 4.01]])
    assert _is_passable(points, floor(free)).tolist() == [False, True, True, False, False]


def test_a_lane_keeps_its_corner_a_link_is_rounded() -> None:
    """Over 0.18 m to either side a right angle is passed at a quarter of that, by both axes."""
    corner = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
    lane = smooth_path([(corner, False)], floor())
    np.testing.assert_allclose(lane, corner, atol=1e-9)
    link = smooth_path([(corner, True)], floor())
    # The mean of 9 points before the corner, itself and 9 after it, each 0.02 m on.
    off = 0.02 * sum(range(10)) / 19
    near = link[np.linalg.norm(link - [1.0, 0.0], axis=1).argmin()]
    np.testing.assert_allclose(near, [1.0 - off, off], atol=1e-9)
    np.testing.assert_allclose(link[[0, -1]], corner[[0, -1]])


def test_the_stairs_of_a_lane_are_gone() -> None:
    """Steps of 0.05 m along a diagonal: all of it within a millimetre or two of straight."""
    k = np.arange(60)
    stairs = 0.05 * np.stack([(k + 1) // 2, k // 2], axis=1)
    path = smooth_path([(stairs, False)], floor())
    inner = path[(path[:, 0] > 0.15) & (path[:, 0] < 1.3)]
    away = (inner[:, 0] - inner[:, 1] - 0.025) / math.sqrt(2.0)
    assert len(inner) > 10
    assert np.abs(away).max() < 0.004


def test_a_link_that_would_cut_a_wall_is_rounded_less_or_not_at_all() -> None:
    corner = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
    for room_m, is_round in ((0.0, False), (0.2, True)):
        free = np.ones((200, 200), dtype=np.bool_)
        inside = floor().geometry.cell_of(np.array([0.97 - room_m, 0.03 + room_m]))
        free[inside[0] : 160, 20 : inside[1] + 1] = False
        path = smooth_path([(corner, True)], floor(free))
        assert _is_passable(path, floor(free)).all()
        away = np.linalg.norm(path - [1.0, 0.0], axis=1).min()
        assert (away > 0.04) == is_round


def test_of_one_place_nothing_is_to_be_smoothed() -> None:
    spot = np.array([[0.5, 0.5], [0.5, 0.5]])
    np.testing.assert_array_equal(smooth_path([(spot, True)], floor()), spot[:1])
