# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Moving objects: the fresh end of a trail moves with what was looked through behind it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.random import default_rng
from test_moving_returns import BEAMS, NOTHING, grid_at, points_of, scan_of

from slarm_graph.backends.gmapping import GmappingBackend
from slarm_graph.backends.pose_graph import PoseGraphBackend
from slarm_graph.config import FrontendConfig, KeyframeConfig, MatchingConfig
from slarm_graph.frontends.scans.local_map import LocalMap
from slarm_graph.frontends.scans.moving_objects import NO_TRAILS, trail_cells
from slarm_graph.frontends.scans.moving_returns import clear_sectors
from slarm_graph.frontends.scans.scan_filter import points_for_matching
from slarm_graph.frontends.scans.tracker import ScanTracker
from slarm_graph.geometry import Floats, Pose2
from slarm_graph.readings import Reading

PILLARS = np.array([[2.0, 2.0, 0.25], [2.0, -2.0, 0.25], [4.0, 2.4, 0.25]])


def trail(first_m: float, count: int, y: float = 0.1) -> Floats:
    """Returns a sixth of a metre apart along x (K, 2) [m]."""
    return np.stack([first_m + np.arange(count) / 6.0, np.full(count, y)], axis=1)


def test_the_fresh_end_of_a_trail_moves_with_the_rest_and_what_stands_apart_does_not() -> None:
    gone = np.arange(16) < 10
    pillar = np.array([[1.0, 1.1]])
    cells = trail_cells(np.vstack([trail(0.0, 16), pillar]), np.append(gone, False))
    assert cells.contain(trail(0.0, 16)).all()
    assert cells.contain(trail(16.0 / 6.0, 1)).all()
    assert not cells.contain(pillar).any()
    beside = np.array(
        [[1.0, 0.1], [1.0, 0.3], [1.0, 0.49], [1.0, 0.51], [1.0, -0.24], [1.0, -0.26]]
    )
    assert cells.contain(beside).tolist() == [True, True, True, False, True, False]


@pytest.mark.parametrize(("gone", "moves"), [(0, False), (8, False), (9, True), (16, True)])
def test_a_trail_moves_if_most_of_it_was_looked_through(gone: int, moves: bool) -> None:
    points = trail(-1.0, 16)
    assert (trail_cells(points, np.arange(16) < gone).contain(points) == moves).all()


def test_a_trail_may_lead_anywhere() -> None:
    """Neighbours are those across a corner, too, and none but neighbours hang together."""
    across = 0.25 * np.arange(-2, 3)[:, None] * [1.0, -1.0] + 0.1
    gone = np.arange(5) < 3
    assert trail_cells(across, gone).contain(across).all()
    apart = across * [2.0, 2.0]
    assert trail_cells(apart, gone).contain(apart).tolist() == gone.tolist()


def test_what_was_looked_through_nowhere_leaves_no_trail() -> None:
    cells = trail_cells(trail(0.0, 5), np.zeros(5, dtype=bool))
    assert cells is NO_TRAILS and not cells.contain(trail(0.0, 5)).any()


def test_what_stands_beside_a_trail_is_no_part_of_it() -> None:
    """The trail ends a cell before a pillar that most scans have seen where it is."""
    pillar = np.tile([[3.1, 0.1]], (40, 1))
    points = np.vstack([trail(0.0, 15), pillar])
    cells = trail_cells(points, np.arange(len(points)) < 12)
    assert cells.contain(trail(0.0, 13)).all()
    assert not cells.contain(pillar).any()


def test_who_walks_ahead_joins_neither_the_map_nor_the_scan() -> None:
    """Behind his back nothing was ever seen, nor looked through."""
    local_map = LocalMap(KeyframeConfig(), MatchingConfig())
    for k in range(12):
        ahead = [2.0 + 0.15 * k, 0.0, 0.25]
        seen = scan_of(np.vstack([PILLARS, ahead]), NOTHING, np.zeros(3), np.zeros(len(BEAMS)))
        local_map.add(points_of(seen), Pose2(), clear_sectors(seen, 30.0))
    backs = [grid_at(local_map, 1.75 + 0.15 * k, 0.0) for k in range(12)]
    assert max(backs) < 0.1
    assert grid_at(local_map, 2.0, 1.75) > 0.9
    points = points_of(seen)
    static = local_map.static(points, np.zeros(3), 5.0)
    assert 0 < len(static) < len(points)
    assert np.hypot(*(static - ahead[:2]).T).min() > 0.5
    assert len(local_map.static(points, np.zeros(3), 3.0)) == len(points)
    # What was looked through once has moved, whatever later scans see of it.
    for _ in range(5):
        local_map.add(static, Pose2())
    assert len(local_map.static(points, np.zeros(3), 5.0)) == len(static)


def test_every_keyframe_counts_once_for_what_it_has_met() -> None:
    """By the sets of blocks that the returns of each lie in; whoever has left counts no more."""
    local_map, rng = LocalMap(KeyframeConfig(), MatchingConfig()), np.random.default_rng(0)
    walls = np.array([[-3.0, -3.0, 3.0, -3.0], [3.0, -3.0, 3.0, 3.0]])
    for k in range(6):
        pose = np.array([0.2 * k, 0.1 * k, 0.3 * k])
        things = np.vstack([PILLARS, [0.0, 1.7, 0.25]])[: 4 if k == 3 else 3]
        seen = scan_of(things, walls, pose, rng.normal(0.0, 0.02, len(BEAMS)))
        local_map.add(points_of(seen), Pose2.from_array(pose), clear_sectors(seen, 30.0))
    assert local_map.grid is not None
    corner = np.array([local_map.grid.origin_x_m, local_map.grid.origin_y_m])
    expected = np.zeros_like(local_map.met)
    for last in range(1, 7):
        later = len(local_map.latest_points(last - 1)) if last > 1 else 0
        ends = local_map.latest_points(last)
        met = np.floor((ends[: len(ends) - later] - corner) / 0.2).astype(int)
        for column, row in {(int(x), int(y)) for x, y in met}:
            expected[row, column] += 1
    assert expected.max() == 6
    np.testing.assert_array_equal(local_map.met, expected)


@pytest.mark.parametrize(
    ("ways_m", "most_m"), [((0.1, 0.09), 0.6), ((0.16, 0.15), 0.4), ((0.2, 0.1), 0.4)]
)
def test_two_who_walk_ahead_drag_no_robot_along(ways_m: tuple[float, float], most_m: float) -> None:
    """Two walls do not tell how far the robot has driven, and what does goes on ahead.

    Four metres are 1.4 m short where only one who walks alone is taken for what may move.
    """
    walls = np.array([[-50.0, 3.0, 50.0, 3.0], [-50.0, -3.0, 50.0, -3.0]])
    for seed in range(4):
        rng = np.random.default_rng(seed)
        tracker, off_m, odometry_m = ScanTracker(FrontendConfig()), 0.0, 0.0
        for k in range(100):
            two = np.array([[4.3, 0.8, 0.25], [3.8, -0.9, 0.25]])
            two[:, 0] += max(0, k - 30) * np.array(ways_m)
            truth = np.array([0.06 * k, 0.0, 0.0])
            scan = scan_of(two[: 2 * (k >= 30)], walls, truth, rng.normal(0.0, 0.02, len(BEAMS)))
            odometry = Pose2(odometry_m, 0.0, 0.0)
            tracked = tracker.track(Reading((k + 1) * 200_000_000, scan, odometry))
            off = tracked.local_from_robot.as_array() - truth
            off_m = max(off_m, float(np.hypot(*off[:2])))
            odometry_m += 0.06 + rng.normal(0.0, 0.001)
        assert off_m < most_m


@pytest.mark.parametrize("time_increment_s", [0.0, 1e-4])
def test_returns_left_out_are_counted_once_a_scan(time_increment_s: float) -> None:
    """Also where a scan is deskewed again; without anybody nothing is left out."""
    walls = np.array([[-5.0, 3.0, 9.0, 3.0], [-5.0, -3.0, 9.0, -3.0], [9.0, -3.0, 9.0, 3.0]])
    config, nobody = FrontendConfig(), ScanTracker(FrontendConfig())
    tracker, every, matched = ScanTracker(config), 0, 0
    assert tracker.moving_share == 0.0
    for k in range(40):
        somebody = np.array([[5.0, 2.0 - 0.15 * k, 0.25]])
        for who, things in ((tracker, somebody), (nobody, somebody[:0])):
            pose = np.array([0.05 * k, 0.0, 0.03 * k])
            scan = scan_of(things, walls, pose, np.zeros(len(BEAMS)))
            scan = replace(scan, time_increment_s=time_increment_s)
            reading = Reading((k + 1) * 200_000_000, scan, Pose2.from_array(pose))
            tracked = who.track(reading)
            if who is tracker:
                every += len(points_for_matching(scan, config, np.zeros(3), 0.0))
                matched += len(tracked.points_m)
    assert tracker.moving_share == pytest.approx(1.0 - matched / every, abs=0.003)
    assert 0.01 < tracker.moving_share < 0.1
    assert nobody.moving_share == 0.0


@pytest.mark.parametrize("backend", [PoseGraphBackend, GmappingBackend])
def test_a_result_says_what_share_was_left_out(
    backend: type[PoseGraphBackend] | type[GmappingBackend],
) -> None:
    """And the graph's keyframes know where their beams met nothing."""
    walls = np.array([[-5.0, 3.0, 9.0, 3.0], [-5.0, -3.0, 9.0, -3.0], [-5.0, -3.0, -5.0, 3.0]])
    config = FrontendConfig()
    tracker, made = ScanTracker(config), backend(backend.settings(), config, default_rng(0))
    for k in range(30):
        pose = np.array([0.05 * k, 0.0, 0.0])
        scan = scan_of(np.array([[4.0, 2.0 - 0.15 * k, 0.25]]), walls, pose, np.zeros(len(BEAMS)))
        reading = Reading((k + 1) * 200_000_000, scan, Pose2.from_array(pose))
        tracker.track(reading)
        made.update(reading)
    assert made.result().moving_share == tracker.moving_share > 0.0
    if isinstance(made, PoseGraphBackend):
        keyframes = made._builder._graph.keyframes
        assert {len(k.clear_ends_m) > 0 for k in keyframes} == {True}
