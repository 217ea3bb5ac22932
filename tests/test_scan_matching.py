# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Kernels of scan matching against brute force, numerical derivatives and known poses."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from slarm_graph.frontends.scans.correlative import search
from slarm_graph.frontends.scans.gauss_newton import refine
from slarm_graph.frontends.scans.icp import line_normals
from slarm_graph.frontends.scans.likelihood_grid import (
    LikelihoodGrid,
    add_segments,
    build_likelihood_grid,
    interpolate,
    scan_segments,
)
from slarm_graph.frontends.scans.search_pyramid import SearchPyramid, build_pyramid
from slarm_graph.frontends.scans.search_window import search_every_pose, window_of
from slarm_graph.frontends.scans.small_matrix import invert3
from slarm_graph.frontends.scans.wall_tangents import wall_tangents
from slarm_graph.geometry import Floats, Pose2


def room_points(pose: Pose2, rng: np.random.Generator | None = None, beams: int = 180) -> Floats:
    """Returns of a 5 x 4 m room with a pillar, seen from `room_from_robot`, in beam order."""
    angles = np.linspace(-math.pi, math.pi, beams, endpoint=False)
    direction = angles + pose.theta
    c, s = np.cos(direction), np.sin(direction)
    with np.errstate(divide="ignore"):
        across = np.where(c > 0, (3.0 - pose.x) / c, (-2.0 - pose.x) / c)
        up = np.where(s > 0, (2.5 - pose.y) / s, (-1.5 - pose.y) / s)
    ranges = np.minimum(np.abs(across), np.abs(up))
    to_x, to_y = 1.5 - pose.x, 1.2 - pose.y
    along = to_x * c + to_y * s
    off2 = to_x**2 + to_y**2 - along**2
    hits = (along > 0) & (off2 < 0.09)
    ranges = np.where(hits, along - np.sqrt(np.where(hits, 0.09 - off2, 0.0)), ranges)
    if rng is not None:
        ranges = ranges + rng.normal(0.0, 0.01, beams)
    return np.stack([ranges * np.cos(angles), ranges * np.sin(angles)], axis=-1)


def room_grid(resolution_m: float = 0.05, sigma_m: float = 0.04) -> LikelihoodGrid:
    views = [Pose2(), Pose2(0.3, 0.2, 0.4)]
    segments = [scan_segments(room_points(v, beams=360), v.as_array(), 0.5) for v in views]
    return build_likelihood_grid(
        np.concatenate(segments), resolution_m=resolution_m, sigma_m=sigma_m
    )


def brute_force_score(
    pyramid: SearchPyramid, grid: LikelihoodGrid, points: Floats, center: Pose2, reach: float
) -> float:
    near = points[np.hypot(points[:, 0], points[:, 1]) <= pyramid.max_radius_m]
    values = pyramid.cells[: grid.values.size].reshape(grid.values.shape)
    window = window_of(pyramid, near, center, pyramid.step_rad, reach, reach)
    *_, total = search_every_pose(values, window)
    return total / 255.0 / len(near)


def test_segments_join_near_neighbours_only() -> None:
    points = np.array([[0.0, 0.0], [0.1, 0.0], [0.2, 0.0], [2.0, 0.0], [4.0, 0.0], [4.1, 0.0]])
    segments = scan_segments(points, np.array([1.0, 0.0, math.pi / 2]), 0.3)
    expected = [[1, 0, 1, 0.1], [1, 0.1, 1, 0.2], [1, 2, 1, 2], [1, 4, 1, 4.1]]
    np.testing.assert_allclose(segments, expected, atol=1e-12)


def test_grid_holds_the_gaussian_of_the_distance_to_the_wall() -> None:
    grid = build_likelihood_grid(np.array([[0.0, 0.0, 1.0, 0.0]]), resolution_m=0.02, sigma_m=0.04)
    for off in (-0.05, 0.0, 0.03, 0.08):
        value, _, slope = interpolate(grid.lattice, 0.5, off)
        expected = math.exp(-0.5 * (off / 0.04) ** 2)
        assert value == pytest.approx(expected, abs=0.01)
        assert slope == pytest.approx(-off / 0.04**2 * expected, abs=1.0)


@pytest.mark.parametrize("sigma_m", [0.04, 0.3])
@pytest.mark.parametrize("seed", range(3))
def test_every_cell_has_the_gaussian_of_its_distance_to_the_nearest_wall(
    seed: int, sigma_m: float
) -> None:
    """By brute force, of walls that are short against the fall-off and long; one is a dot."""
    rng = np.random.default_rng(seed)
    begin, way = rng.uniform(-1.0, 1.0, (8, 2)), rng.uniform(-0.6, 0.6, (8, 2))
    way[0] = way[1, 0] = way[2, 1] = 0.0
    grid = build_likelihood_grid(
        np.hstack([begin, begin + way]), resolution_m=0.05, sigma_m=sigma_m
    )
    row, col = np.indices(grid.values.shape)
    x, y = grid.origin_x_m + 0.05 * col, grid.origin_y_m + 0.05 * row
    to = np.stack([x, y], axis=-1)[..., None, :] - begin
    length2 = (way**2).sum(axis=1)
    along = np.clip((to * way).sum(axis=-1) / np.where(length2 > 0.0, length2, 1.0), 0.0, 1.0)
    away_m = np.linalg.norm(to - along[..., None] * way, axis=-1).min(axis=-1)
    expected = np.where(away_m < 3.0 * sigma_m, np.exp(-0.5 * (away_m / sigma_m) ** 2), 0.0)
    np.testing.assert_allclose(grid.values, expected, atol=0.003)


@given(x=st.floats(-1.9, 2.9), y=st.floats(-1.4, 2.4))
@example(x=1.25, y=1.25)
@settings(max_examples=50, deadline=None)
def test_interpolated_gradient_is_the_derivative_of_the_value(x: float, y: float) -> None:
    grid = room_grid()
    here = grid.lattice
    _, along_x, along_y = interpolate(here, x, y)
    step = 1e-8  # the second derivative jumps at cell centres
    by_x = (interpolate(here, x + step, y)[0] - interpolate(here, x - step, y)[0]) / (2 * step)
    by_y = (interpolate(here, x, y + step)[0] - interpolate(here, x, y - step)[0]) / (2 * step)
    np.testing.assert_allclose([along_x, along_y], [by_x, by_y], atol=1e-5)


def test_adding_segments_equals_building_with_them() -> None:
    near, far = np.array([[0.0, 0.0, 1.0, 0.3]]), np.array([[0.5, -0.5, 0.6, 0.7]])
    grown = build_likelihood_grid(near, resolution_m=0.05, sigma_m=0.04, margin_m=1.0)
    assert add_segments(grown, far)
    whole = build_likelihood_grid(np.vstack([near, far]), resolution_m=0.05, sigma_m=0.04)
    for x, y in ((0.5, 0.1), (0.55, 0.6), (0.0, 0.05)):
        values = [interpolate(g.lattice, x, y)[0] for g in (grown, whole)]
        assert values[0] == pytest.approx(values[1], abs=0.02)
    assert not add_segments(grown, np.array([[50.0, 0.0, 51.0, 0.0]]))


def test_refinement_finds_the_pose_of_a_noiseless_scan() -> None:
    grid, truth = room_grid(), Pose2(0.2, -0.1, 0.15)
    start = (truth @ Pose2(0.06, -0.05, 0.04)).as_array()
    pose, information, score, inliers, _ = refine(
        grid.lattice,
        room_points(truth),
        wall_tangents(room_points(truth)),
        start,
        start,
        np.diag([1.0, 1.0, 1.0]),
        16.0,
        40,
    )
    error = truth.between(Pose2.from_array(pose)).as_array()
    assert np.hypot(error[0], error[1]) < 0.003
    assert abs(error[2]) < 0.002
    assert score > 0.9
    assert inliers > 170
    assert np.all(np.linalg.eigvalsh(information) > 0)


def test_a_strong_prior_holds_the_pose() -> None:
    grid, start = room_grid(), np.array([0.05, 0.05, 0.0])
    prior = np.diag([1e10, 1e10, 1e10])
    points = room_points(Pose2())
    pose, *_ = refine(grid.lattice, points, wall_tangents(points), start, start, prior, 16.0, 40)
    np.testing.assert_allclose(pose, start, atol=1e-4)


def test_walls_have_tangents_and_corners_have_none() -> None:
    wall = np.stack([np.arange(0.0, 2.0, 0.05), np.full(40, 1.0)], axis=-1)
    np.testing.assert_allclose(np.abs(wall_tangents(wall)), [[1.0, 0.0]] * 40, atol=1e-9)
    down = np.stack([np.full(40, 2.0), 1.0 - np.arange(0.0, 2.0, 0.05)], axis=-1)
    tangents = wall_tangents(np.vstack([wall, down]))
    assert np.hypot(*tangents[40]) == 0.0
    np.testing.assert_allclose(np.abs(tangents[60]), [0.0, 1.0], atol=1e-9)
    assert not wall_tangents(np.array([[1.0, 0.0]])).any()


def test_normals_are_across_the_wall() -> None:
    wall = np.stack([np.arange(0.0, 2.0, 0.05), 0.5 * np.arange(0.0, 2.0, 0.05)], axis=-1)
    across = np.array([-0.5, 1.0]) / math.hypot(0.5, 1.0)
    np.testing.assert_allclose(np.abs(line_normals(wall, 0.3) @ across), 1.0, atol=1e-9)
    assert not line_normals(np.array([[0.0, 0.0], [5.0, 0.0]]), 0.3).any()


@given(seed=st.integers(0, 10_000))
@settings(max_examples=25, deadline=None)
def test_branch_and_bound_finds_what_trying_everything_finds(seed: int) -> None:
    rng = np.random.default_rng(seed)
    grid = room_grid(resolution_m=0.1, sigma_m=0.1)
    pyramid = build_pyramid(grid, max_radius_m=float(rng.uniform(2.0, 6.0)))
    truth = Pose2(*rng.uniform(-0.5, 0.5, 3))
    points = room_points(truth, rng, beams=60)
    center = Pose2(*(truth.as_array() + rng.uniform(-0.6, 0.6, 3)))
    reach = float(rng.uniform(0.1, 0.7))
    hit = search(pyramid, points, center, reach_m=reach, reach_rad=reach)
    assert hit is not None
    expected = brute_force_score(pyramid, grid, points, center, reach)
    assert hit.score == pytest.approx(expected, abs=1e-9)


def test_search_finds_a_pose_anywhere_on_the_circle() -> None:
    pyramid = build_pyramid(room_grid(), max_radius_m=6.0)
    truth = Pose2(0.4, 0.3, 2.8)
    points = room_points(truth)
    hit = search(pyramid, points, Pose2(), reach_m=1.0, min_score=0.5)
    assert hit is not None
    error = truth.between(hit.grid_from_robot).as_array()
    assert np.all(np.abs(error) < [0.05, 0.05, 0.02])
    assert search(pyramid, points, Pose2(), reach_m=1.0, min_score=1.0) is None
    assert search(pyramid, np.zeros((0, 2)), Pose2(), reach_m=1.0) is None


@given(seed=st.integers(0, 10_000))
@settings(max_examples=50, deadline=None)
def test_small_inverse_is_numpys(seed: int) -> None:
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(3, 3)) * 10.0 ** rng.uniform(-3, 3, 3)[:, None]
    matrix = root @ root.T + np.diag(np.diag(root @ root.T)) * 1e-3
    np.testing.assert_allclose(invert3(matrix) @ matrix, np.eye(3), atol=1e-6)
