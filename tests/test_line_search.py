# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The line search along the least certain axis, and its marginal information."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from slarm_graph.frontends.scans.gauss_newton import refine_near
from slarm_graph.frontends.scans.likelihood_grid import (
    LikelihoodGrid,
    build_likelihood_grid,
    mean_likelihood,
)
from slarm_graph.frontends.scans.line_search import (
    LineSearchMatch,
    _marginalised,
    line_search_match,
)
from slarm_graph.geometry import Floats, between, compose, transform_points

REACH_M = 1.1
LOOSELY = np.diag([4.0, 4.0, 25.0]), 0.3, 40
WALLS = ((-9.0, 1.0, 9.0, 1.0), (-9.0, -1.0, 9.0, -1.0))
NICHE = ((1.0, 1.0, 1.0, 1.4), (1.0, 1.4, 1.9, 1.4), (1.9, 1.4, 1.9, 1.0))
CORNERS = ((-2.0, -1.0), (2.0, -1.0), (2.0, 3.0), (-2.0, 3.0), (-2.0, -1.0))
ROOM = tuple((*a, *b) for a, b in pairwise(CORNERS))


def grid_of(walls: tuple[tuple[float, ...], ...]) -> LikelihoodGrid:
    return build_likelihood_grid(np.array(walls), resolution_m=0.05, sigma_m=0.05, margin_m=1.0)


def seen_from(pose: Floats, walls: tuple[tuple[float, ...], ...], reach_m: float = 4.0) -> Floats:
    """Points every 5 cm of the walls within reach, in the frame of a pose and in beam order."""
    parts = [
        np.linspace(w[:2], w[2:], max(int(np.hypot(w[2] - w[0], w[3] - w[1]) / 0.05), 2))
        for w in map(np.array, walls)
    ]
    points = between(pose, np.column_stack([np.concatenate(parts), np.zeros(sum(map(len, parts)))]))
    points = points[np.hypot(points[:, 0], points[:, 1]) < reach_m, :2]
    return np.ascontiguousarray(points[np.argsort(np.arctan2(points[:, 1], points[:, 0]))])


def sigmas_m(found: LineSearchMatch) -> Floats:
    """Standard deviations (2,) of the position, along the corridor and across."""
    return np.sqrt(np.diag(np.linalg.inv(found.marginal_information + 1e-9 * np.eye(3)))[:2])


@pytest.mark.parametrize("off_m", [-1.0, -0.9, 0.8, 1.0])
@pytest.mark.parametrize("heading", [0.0, 1.0])
def test_a_niche_is_found_from_beside_it(off_m: float, heading: float) -> None:
    """Refinement alone stays where it began: the walls fit everywhere, one niche is no slope."""
    walls = (*WALLS, *NICHE)
    true = np.array([0.3, 0.1, heading])
    points, grid = seen_from(true, walls), grid_of(walls)
    start = true + np.array([off_m, 0.02, 0.01])
    alone, *_ = refine_near(grid, points, start, *LOOSELY)
    found = line_search_match(grid, points, start, *LOOSELY, REACH_M)
    assert abs(alone[0] - true[0]) > 0.3
    assert np.abs(found.pose - true) == pytest.approx(0.0, abs=0.02)
    assert found.score == pytest.approx(mean_likelihood(grid, points, found.pose))
    assert sigmas_m(found).max() < 0.2


def test_of_a_bare_corridor_nothing_is_known_along_it() -> None:
    """Every place within reach fits alike: at least a uniform distribution. Across it is sure."""
    start = np.array([0.0, 0.05, 0.0])
    found = line_search_match(
        grid_of(WALLS), seen_from(np.zeros(3), WALLS), start, *LOOSELY, REACH_M
    )
    along_m, across_m = sigmas_m(found)
    assert along_m > 0.95 * REACH_M / np.sqrt(3.0)
    assert across_m < 0.02
    assert found.pose[1] == pytest.approx(0.0, abs=0.01)


def test_in_a_room_the_curvature_says_it_all() -> None:
    true = np.array([0.2, 0.7, 0.3])
    start = compose(true, np.array([0.05, -0.04, 0.02]))
    found = line_search_match(grid_of(ROOM), seen_from(true, ROOM), start, *LOOSELY, REACH_M)
    assert np.abs(found.pose - true) == pytest.approx(0.0, abs=0.01)
    ratio = np.linalg.det(found.marginal_information) / np.linalg.det(found.information)
    assert 0.1 < ratio <= 1.0


@pytest.mark.parametrize(("deeper_m", "open_m"), [(0.0, 0.5), (0.05, 0.3)])
def test_two_niches_leave_both_open_as_far_as_they_are_alike(
    deeper_m: float, open_m: float
) -> None:
    """What is seen of one fits the other: the spread is what brute force over the steps has."""
    deep = {1.4: 1.4 + deeper_m}
    other = tuple((a - 0.9, deep.get(b, b), c - 0.9, deep.get(d, d)) for a, b, c, d in NICHE)
    walls = (*WALLS, *NICHE, *other)
    points = seen_from(np.zeros(3), (*WALLS, *NICHE))
    grid = grid_of(walls)
    found = line_search_match(grid, points, np.zeros(3), *LOOSELY, REACH_M)
    steps_m = np.linspace(-REACH_M, REACH_M, 221)
    fits = np.array(
        [
            len(points) * mean_likelihood(grid, points, found.pose + np.array([d, 0.0, 0.0]))
            for d in steps_m
        ]
    )
    shares = np.exp(LOOSELY[1] * (fits - fits.max()))
    brute_m = float(np.sqrt((shares * steps_m**2).sum() / shares.sum()))
    assert brute_m > open_m
    assert sigmas_m(found)[0] == pytest.approx(brute_m, rel=0.1)


def test_loosening_adds_a_variance_along_an_axis_and_nothing_else() -> None:
    rng = np.random.default_rng(4)
    root = rng.normal(size=(3, 3))
    information, turn = root @ root.T + np.eye(3), 0.7
    axis = np.array([np.cos(turn), np.sin(turn)])
    along = np.append(axis, 0.0)
    held = 1.0 / float(along @ information @ along)
    added = np.linalg.inv(_marginalised(information, axis, held + 0.4)) - np.linalg.inv(information)
    assert added == pytest.approx(0.4 * np.outer(along, along))
    assert _marginalised(information, axis, 0.9 * held) is information
    assert _marginalised(np.zeros((3, 3)), axis, 1.0) == pytest.approx(np.zeros((3, 3)))


def test_what_the_points_show_is_where_they_are() -> None:
    """The fixture itself: points carried to the pose lie on the walls."""
    pose = np.array([0.3, -0.2, 0.5])
    points = seen_from(pose, ROOM)
    assert mean_likelihood(grid_of(ROOM), points, pose) > 0.95
    there = transform_points(pose, points)
    assert np.minimum(2.0 - np.abs(there[:, 0]), 2.0 - np.abs(there[:, 1] - 1.0)) == pytest.approx(
        0.0, abs=1e-9
    )
