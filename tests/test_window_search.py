# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Where a prediction has a scan searched for, and what a matcher's answer counts beside it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from test_scan_matching import room_grid, room_points

from slarm_graph.config import FrontendConfig, KeyframeConfig, MatchingConfig
from slarm_graph.constraint import MatchResult
from slarm_graph.frontends.scans import BUILT_IN
from slarm_graph.frontends.scans.likelihood_grid import build_likelihood_grid
from slarm_graph.frontends.scans.local_map import LocalMap
from slarm_graph.frontends.scans.odometry_filter import Prediction
from slarm_graph.frontends.scans.refinement import chosen_refinement
from slarm_graph.frontends.scans.search_pyramid import build_pyramid
from slarm_graph.frontends.scans.submaps import (
    Keyframe,
    SubmapCache,
    joined_returns,
    make_submap,
    view_center,
)
from slarm_graph.frontends.scans.window_search import best_in_window, far_range_m
from slarm_graph.geometry import Floats, Pose2, between, compose, transform_points

BASE, MOTION = np.array([0.2, -0.1, 0.3]), np.array([0.3, 0.1, -0.2])
EXPECTED = compose(BASE, MOTION)


def found(off: tuple[float, float, float], sigmas: Floats, beams: int = 180) -> Floats:
    """How far off (3,) the best pose is, where the truth is off from what is predicted."""
    truth = Pose2.from_array(EXPECTED) @ Pose2(*off)
    prediction = Prediction(MOTION, np.diag(sigmas) ** 2)
    points = room_points(truth, beams=beams)
    grid = room_grid()
    best = best_in_window(points, grid, BASE, prediction, lambda: build_pyramid(grid))
    return between(truth.as_array(), best)


@pytest.mark.parametrize("beams", [90, 720])
@pytest.mark.parametrize(
    ("off", "sigmas"),
    [
        ((0.0, 0.0, 0.0), (0.01, 0.01, 0.01)),
        ((0.25, -0.2, 0.15), (0.01, 0.01, 0.01)),
        ((-0.7, 0.5, 0.1), (0.05, 0.2, 0.01)),
        ((0.2, 0.1, -1.0), (0.01, 0.01, 0.3)),
        ((-0.6, 0.5, 2.8), (0.2, 0.2, 1.0)),
    ],
)
def test_the_place_is_found_within_four_sigmas(
    off: tuple[float, float, float], sigmas: tuple[float, float, float], beams: int
) -> None:
    """0.3 m and 0.2 rad at least; by whichever way of searching is the quicker."""
    away = found(off, np.array(sigmas), beams)
    assert np.abs(away[:2]).max() < 0.08
    assert abs(away[2]) < 0.03


def test_what_lies_beyond_the_window_is_not_found() -> None:
    for off, sigmas in [((0.9, 0.0, 0.0), (0.1, 0.1, 0.01)), ((0.0, 0.0, 0.8), (0.01, 0.01, 0.1))]:
        assert np.abs(found(off, np.array(sigmas))).max() > 0.3


def test_most_returns_are_three_quarters_and_a_metre_at_least() -> None:
    ranges = np.array([8.0, 2.0, 4.0, 6.0, 100.0])
    bearings = np.arange(5.0)
    points = ranges[:, None] * np.stack([np.cos(bearings), np.sin(bearings)], axis=1)
    assert far_range_m(points) == pytest.approx(8.0)
    assert far_range_m(0.05 * points) == 1.0


@pytest.mark.parametrize("seed", range(4))
def test_levels_of_a_pyramid_are_maxima_over_blocks(seed: int) -> None:
    """Brute force; no block of the grid is left out, whatever a search asks for."""
    ends = np.random.default_rng(seed).uniform(0.0, 1.2, (6, 4))
    grid = build_likelihood_grid(ends, resolution_m=0.05, sigma_m=0.05, margin_m=0.1)
    pyramid = build_pyramid(grid, levels=4)
    base = np.rint(255.0 * np.clip(grid.values, 0.0, 1.0))
    rows, cols = base.shape
    windows = [1, 4, 8, 17]
    for level, (start, height, width, stride, padding) in enumerate(pyramid.layout.tolist()):
        cells = pyramid.cells[start : start + height * width].reshape(height, width)
        covered = np.zeros_like(base)
        for row, col in np.ndindex(height, width):
            low = np.array([row, col]) * stride - padding
            r, c = (slice(max(k, 0), max(k + windows[level], 0)) for k in low)
            assert cells[row, col] == base[r, c].max(initial=0)
            covered[r, c] = 1
        assert covered.all()
        assert -padding + windows[level] <= stride or level == 0
        assert (height - 1) * stride - padding < rows
        assert (width - 1) * stride - padding < cols
    assert pyramid.step_rad == pytest.approx(0.05 / 15.0)


ANSWER = Pose2(0.6, 0.3, 0.15)
SURE = np.array([[0.02, 0.005, 0.001], [0.005, 0.03, -0.002], [0.001, -0.002, 0.004]])


class Knowing:
    """A matcher that has one answer, and keeps what it was asked."""

    asked: tuple[Floats, Pose2] | None = None

    def __init__(self, settings: object, matching: object) -> None:
        del settings, matching

    def match(self, source: Floats, target: Floats, *, target_from_source: Pose2) -> MatchResult:
        del source
        Knowing.asked = target, target_from_source
        return MatchResult(ANSWER, SURE, score=0.7, inliers=33, iterations=4)


@pytest.mark.parametrize("effective_share", [1.0, 0.25])
def test_an_answer_and_the_prediction_are_one_normal_density(
    effective_share: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the frame of what was expected; the answer counts by the share of its evidence."""
    monkeypatch.setitem(BUILT_IN, "knowing", f"{__name__}:Knowing")
    local_map = LocalMap(KeyframeConfig(), MatchingConfig())
    views = [Pose2(0.1 * k, 0.0, 0.0) for k in range(5)]
    for view in views:
        local_map.add(room_points(view), view)
    refinement = chosen_refinement(FrontendConfig(matcher="knowing"), local_map)
    assert refinement is not None
    prediction = Prediction(MOTION, np.diag([0.1, 0.05, 0.02]) ** 2)
    place = refinement(room_points(ANSWER), BASE, prediction, np.empty(0), effective_share)
    away = between(EXPECTED, ANSWER.as_array())
    mine = effective_share * np.linalg.inv(SURE)
    both = np.linalg.inv(mine + np.linalg.inv(prediction.covariance))
    np.testing.assert_allclose(place.pose, compose(EXPECTED, both @ mine @ away), atol=1e-9)
    np.testing.assert_allclose(place.information, np.linalg.inv(SURE), rtol=1e-9)
    assert (place.score, place.inliers, place.iterations) == (0.7, 33, 4)
    assert Knowing.asked is not None
    target, guess = Knowing.asked
    np.testing.assert_allclose(guess.as_array(), EXPECTED)
    np.testing.assert_array_equal(target, local_map.latest_points(3))
    start = np.array([0.4, 0.4, 0.4])
    refinement(room_points(ANSWER), BASE, prediction, start, effective_share)
    np.testing.assert_allclose(Knowing.asked[1].as_array(), start)


def keyframes(count: int) -> list[Keyframe]:
    poses = [Pose2(0.5 * k, 0.1 * k, 0.3 * k) for k in range(count)]
    seen = [room_points(pose, beams=40 + k) for k, pose in enumerate(poses)]
    every = zip(seen, poses, strict=True)
    return [Keyframe(k, s, p, np.eye(3), view_center(s)) for k, (s, p) in enumerate(every)]


def test_a_submap_is_seen_from_its_anchor() -> None:
    way = keyframes(6)
    submap = make_submap(way, 1, 5, 2)
    anchor = way[2].local_from_robot.inverse()
    centers = [anchor @ k.local_from_robot for k in way[1:5]]
    told = [c.transform(k.view_center_m) for c, k in zip(centers, way[1:5], strict=True)]
    np.testing.assert_allclose(submap.center_m, np.mean(told, axis=0))
    poses = np.array([c.as_array() for c in centers])
    joined = joined_returns([k.points_m for k in way[1:5]], poses)
    parts = [transform_points(p, k.points_m) for p, k in zip(poses, way[1:5], strict=True)]
    np.testing.assert_allclose(joined, np.concatenate(parts), atol=1e-12)
    near = np.array([[1.0, 0.0], [3.0, 2.0], [9.0, 0.0], [0.0, 8.1]])
    np.testing.assert_allclose(view_center(near), [2.0, 1.0])
    assert not view_center(near[2:]).any()


def test_of_submaps_the_latest_used_are_kept() -> None:
    way, made = keyframes(8), []

    def prepare(points: object, poses: Floats) -> int:
        del points
        made.append(poses)
        return len(made)

    cache = SubmapCache(2, prepare)
    submaps = [make_submap(way, k, k + 3, k + 1) for k in range(3)]
    order = [0, 1, 0, 2, 0, 1]
    assert [cache.of(submaps[k], way) for k in order] == [1, 2, 1, 3, 1, 4]
    anchor, members = way[1].local_from_robot.as_array(), way[:3]
    expected = [between(anchor, m.local_from_robot.as_array()) for m in members]
    np.testing.assert_allclose(made[0], expected, atol=1e-12)
    wider = replace(submaps[0], last=5)
    assert [cache.of(s, way) for s in (submaps[0], wider, submaps[0])] == [1, 5, 1]
    assert len(made[4]) == 5
    cache.clear()
    assert cache.of(submaps[1], way) == 6
    assert math.isclose(made[5][1, 2], 0.0, abs_tol=1e-12)


def test_the_pyramid_of_a_local_map_is_that_of_its_present_grid() -> None:
    local_map = LocalMap(KeyframeConfig(), MatchingConfig())
    for start in (Pose2(), Pose2(0.6, 0.2, 0.4)):
        local_map.add(room_points(start), start)
        assert local_map.grid is not None
        present = build_pyramid(local_map.grid, levels=5)
        assert np.array_equal(local_map.levels().cells, present.cells)
    assert local_map.levels() is local_map.levels()
    assert local_map.kept_state()["_levels"] is None
