# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Moving returns: what another scan has looked through, and a local map without it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from slarm_graph.config import FrontendConfig, KeyframeConfig, MatchingConfig
from slarm_graph.frontends.scans.likelihood_grid import likelihoods
from slarm_graph.frontends.scans.local_map import LocalMap
from slarm_graph.frontends.scans.moving_returns import (
    FARTHEST_M,
    ClearSectors,
    certain_within_m,
    clear_sectors,
    seen_through,
)
from slarm_graph.frontends.scans.odometry_filter import Prediction
from slarm_graph.frontends.scans.tracker import ScanTracker
from slarm_graph.geometry import Floats, Pose2, transform_points
from slarm_graph.readings import LaserScan, Reading

BEAMS = np.linspace(-math.pi, math.pi, 361)
NOTHING = np.zeros((0, 4))
SILENT = np.zeros(361)
ROOM = np.array([[-4.0, -4.0, 4.0, -4.0], [4.0, -4.0, 4.0, 4.0], [4.0, 4.0, -4.0, 4.0]])
"""Open to the left, where nothing returns."""
BESIDE, AHEAD = [0.0, 1.5, 0.25], [2.0, 0.0, 0.25]


def scan_of(discs: Floats, walls: Floats, pose: Floats, noise_m: Floats) -> LaserScan:
    """Scan within 5.6 m of discs (D, 3) of x, y, radius and walls (W, 4), from a pose (3,) [m]."""
    bearings = pose[2] + BEAMS
    ways = np.stack([np.cos(bearings), np.sin(bearings)], axis=1)
    ranges_m = np.full(len(BEAMS), np.inf)
    for x, y, radius in discs:
        to = np.array([x, y]) - pose[:2]
        along = ways @ to
        half = radius**2 - (to @ to - along**2)
        hit = np.where((half > 0) & (along > 0), along - np.sqrt(np.maximum(half, 0)), np.inf)
        ranges_m = np.minimum(ranges_m, hit)
    for x0, y0, x1, y1 in walls:
        d, to = np.array([x1 - x0, y1 - y0]), np.array([x0, y0]) - pose[:2]
        across = ways[:, 0] * d[1] - ways[:, 1] * d[0]
        with np.errstate(divide="ignore"):
            far = (to[0] * d[1] - to[1] * d[0]) / across
            at = (to[0] * ways[:, 1] - to[1] * ways[:, 0]) / across
        ranges_m = np.minimum(ranges_m, np.where((far > 0) & (at >= 0) & (at <= 1), far, np.inf))
    ranges_m = np.where(ranges_m < 5.6, ranges_m + noise_m, np.inf)
    return LaserScan(ranges_m, -math.pi, BEAMS[1] - BEAMS[0], 0.1, 5.6)


def points_of(scan: LaserScan) -> Floats:
    seen = np.isfinite(scan.ranges_m)
    ways = np.stack([np.cos(BEAMS), np.sin(BEAMS)], axis=1)
    return np.ascontiguousarray(ways[seen] * scan.ranges_m[seen, None])


def scan(discs: list[list[float]], walls: Floats = ROOM, x: float = 0.0) -> LaserScan:
    around = np.array(discs, dtype=np.float64).reshape(-1, 3)
    return scan_of(around, walls, np.array([x, 0.0, 0.0]), SILENT)


def through(points: Floats, looked: ClearSectors, at: Floats, within_m: float = 15.0) -> Floats:
    return seen_through(points, at, looked.laser, looked.ranges_m, within_m)


@pytest.mark.parametrize("seed", range(5))
def test_every_beam_that_passes_beside_goes_on(seed: int) -> None:
    """Between brute force at 0.25 m aside, and at as much plus a sector of two degrees."""
    rng = np.random.default_rng(seed)
    looks = scan_of(rng.uniform(-4.0, 4.0, (6, 3)) * [1, 1, 0.1], ROOM, np.zeros(3), SILENT)
    ranges_m = np.where(np.isinf(looks.ranges_m), looks.ranges_m[looks.is_return()].max(), 0.0)
    ranges_m = np.where(looks.is_return(), looks.ranges_m, ranges_m)
    pose = rng.uniform(-0.5, 0.5, 3)
    points = rng.uniform(-5.0, 5.0, (400, 2))
    found = through(points, clear_sectors(looks, 30.0), pose)
    inner, outer = np.zeros((2, len(points)), dtype=bool)
    for k, (x, y) in enumerate(transform_points(pose, points)):
        r = math.hypot(x, y)
        turn = np.abs((looks.angles_rad() - math.atan2(y, x) + math.pi) % (2 * math.pi) - math.pi)
        half = math.asin(min(1.0, 0.25 / r))
        for told, aside in ((outer, half), (inner, half + math.radians(2.0))):
            told[k] = r > 0.25 and (ranges_m[turn <= aside] >= r + 0.4).all()
    assert (found <= outer).all() and (inner <= found).all()
    assert inner.sum() > 20 and outer.sum() < 0.7 * len(points)


def test_without_a_return_a_beam_looks_as_far_as_the_farthest_one() -> None:
    looks = clear_sectors(scan([[0.0, 3.0, 0.25]], NOTHING), 30.0)
    points = np.array([[-2.0, 0.0], [-2.3, 0.0], [-2.7, 0.0], [-3.0, 0.0]])
    assert through(points, looks, np.zeros(3)).tolist() == [True, True, False, False]
    assert not through(points, clear_sectors(scan([], NOTHING), 30.0), np.zeros(3)).any()


@pytest.mark.parametrize("code", [math.nan, -math.inf, 5.7])
def test_a_beam_that_says_nothing_looks_nowhere(code: float) -> None:
    looks = scan([])
    ranges_m = np.array(looks.ranges_m)
    ranges_m[180] = code
    ahead = np.array([[2.0, 0.0], [0.0, 2.0]])
    assert through(ahead, clear_sectors(looks, 30.0), np.zeros(3)).all()
    spoilt = clear_sectors(replace(looks, ranges_m=ranges_m), 30.0)
    assert through(ahead, spoilt, np.zeros(3)).tolist() == [False, True]


def test_what_old_logs_write_for_no_return_says_nothing() -> None:
    looks = scan([])
    ranges_m = np.where(np.abs(looks.angles_rad()) < 0.3, 81.83, looks.ranges_m)
    coded = replace(looks, ranges_m=ranges_m, range_max_m=81.83)
    ahead = np.array([[2.0, 0.0], [0.0, 2.0]])
    assert through(ahead, clear_sectors(coded, 30.0), np.zeros(3)).tolist() == [False, True]
    assert through(ahead, clear_sectors(coded, 90.0), np.zeros(3)).all()


def test_between_beams_that_are_far_apart_nobody_is_seen_through() -> None:
    whole = scan([])
    for every, reach_m in ((3, 4.77), (10, 1.43)):
        sparse = replace(
            whole,
            ranges_m=whole.ranges_m[::every] * 3.0,
            angle_increment_rad=every * whole.angle_increment_rad,
            range_max_m=20.0,
        )
        points = np.array([[reach_m - 0.02, 0.0], [reach_m + 0.02, 0.0]])
        assert through(points, clear_sectors(sparse, 30.0), np.zeros(3)).tolist() == [True, False]


def test_nothing_is_known_beside_the_view_nor_beyond_its_use() -> None:
    whole = scan([])
    half = replace(whole, ranges_m=whole.ranges_m[180:], angle_min_rad=0.0)
    points = np.array([[0.0, 2.0], [0.0, -2.0], [2.0, 0.0]])
    assert through(points, clear_sectors(half, 30.0), np.zeros(3)).tolist() == [True, False, False]
    assert not through(points, clear_sectors(half, 30.0), np.zeros(3), within_m=1.9).any()


def test_sectors_are_the_robots_whatever_the_mounting() -> None:
    """A laser 0.3 m ahead, turned by a quarter, clockwise, and 120 beams in place of 361."""
    whole = scan([BESIDE], x=0.3)
    point = np.array([[-0.5, 3.0], [2.0, 0.0], [0.0, -3.0], [-1.0, 2.4], [0.6, 2.4]])
    mounted = replace(
        whole,
        ranges_m=np.roll(np.array(whole.ranges_m)[::-1][:-1], 90)[::3],
        angle_min_rad=math.pi,
        angle_increment_rad=-3.0 * whole.angle_increment_rad,
        robot_from_laser=Pose2(0.3, 0.0, math.pi / 2),
    )
    for looks in (replace(whole, robot_from_laser=Pose2(0.3, 0.0, 0.0)), mounted):
        told = through(point, clear_sectors(looks, 30.0), np.zeros(3)).tolist()
        assert told == [False, True, True, True, True]


def test_a_turn_within_the_sweep_is_undone() -> None:
    """By the beam in the middle it has turned left by 18 degrees, and so is what it meets."""
    looks = replace(scan([AHEAD]), time_increment_s=1e-3)
    left, right = (2.8 * np.array([math.cos(b), math.sin(b)]) for b in np.radians([18.0, -18.0]))
    turning = np.array([0.0, 0.0, math.radians(0.1) / 1e-3])
    points = np.stack([left, right, [2.8, 0.0]])
    for rate, told in ((None, [True, True, False]), (turning, [False, True, True])):
        assert through(points, clear_sectors(looks, 30.0, rate), np.zeros(3)).tolist() == told


def test_a_prediction_tells_as_far_as_its_turn_moves_a_return_by_the_tolerance() -> None:
    def prediction(x_m: float, sigma_m: float, sigma_rad: float) -> Prediction:
        return Prediction(np.array([x_m, 0.0, 0.0]), np.diag([sigma_m, sigma_m, sigma_rad]) ** 2)

    assert certain_within_m([prediction(0.0, 0.0, 0.025)]) == pytest.approx(10.0)
    sure = prediction(0.0, 0.0, 0.0)
    assert certain_within_m([sure]) == FARTHEST_M
    assert certain_within_m([sure, prediction(0.24, 9.0, 9.0)]) == FARTHEST_M
    assert certain_within_m([sure, prediction(0.26, 9.0, 9.0)]) < 0.0
    assert certain_within_m([prediction(0.0, 0.18, 0.01)]) < 0.0
    apart = [prediction(0.0, 0.05, 0.01), prediction(-0.1, 0.0, 0.0)]
    assert certain_within_m(apart) == pytest.approx((0.25 - math.hypot(0.15, 0.05)) / 0.01)
    assert certain_within_m([prediction(0.0, 0.01, 0.01), prediction(0.3, 0.0, 0.0)]) < 0.0


def grid_at(local_map: LocalMap, x: float, y: float) -> float:
    """Likelihood of a return there [m]."""
    assert local_map.grid is not None
    return float(likelihoods(local_map.grid.lattice, np.array([[x, y]]), np.zeros(3))[0])


@pytest.mark.parametrize("walls", [ROOM, ROOM[:2]])
def test_a_local_map_forgets_who_has_left_and_takes_in_nobody_who_came(walls: Floats) -> None:
    """Before a wall, and before nothing within range."""
    for one, other in (([BESIDE], []), ([], [BESIDE])):
        local_map = LocalMap(KeyframeConfig(), MatchingConfig())
        for k, around in enumerate((one, other)):
            seen = scan(around, walls, x=0.1 * k)
            local_map.add(points_of(seen), Pose2(0.1 * k, 0.0, 0.0), clear_sectors(seen, 30.0))
        assert grid_at(local_map, 0.0, 1.25) < 0.01
        assert grid_at(local_map, 4.0, 0.5) > 0.9


def test_who_came_is_left_out_wherever_the_robot_is() -> None:
    local_map, poses = (
        LocalMap(KeyframeConfig(), MatchingConfig()),
        ([0.0, 0.0, 0.0], [1.0, -1.0, 0.7]),
    )
    for pose, around in zip(np.array(poses), ([], [BESIDE]), strict=True):
        seen = scan_of(np.array(around).reshape(-1, 3), ROOM, pose, SILENT)
        points = points_of(seen)
        local_map.add(points, Pose2.from_array(pose), clear_sectors(seen, 30.0))
    near = np.hypot(*(transform_points(pose, points) - BESIDE[:2]).T) < 0.3
    assert near.sum() > 5
    assert len(local_map.latest_points(1)) == len(points) - near.sum()


def test_a_local_map_keeps_who_stays_and_what_is_hidden() -> None:
    local_map = LocalMap(KeyframeConfig(), MatchingConfig())
    behind = [0.0, 3.0, 0.15]
    for k, around in enumerate(([BESIDE], [BESIDE], [BESIDE, behind], [BESIDE])):
        seen = scan(around, x=0.1 * k)
        local_map.add(points_of(seen), Pose2(0.1 * k, 0.0, 0.0), clear_sectors(seen, 30.0))
    assert grid_at(local_map, 0.0, 1.25) > 0.9


@pytest.mark.parametrize("beyond", [False, True])
def test_silence_removes_no_wall_but_returns_from_beyond_it_do(beyond: bool) -> None:
    local_map = LocalMap(KeyframeConfig(), MatchingConfig())
    wall, far = np.array([[2.0, -2.0, 2.0, 2.0]]), ROOM if beyond else ROOM[[0, 2]]
    for walls in (np.vstack([wall, far]), far):
        seen = scan([], walls)
        local_map.add(points_of(seen), Pose2(), clear_sectors(seen, 30.0))
    assert (grid_at(local_map, 2.0, 0.02) < 0.01) == beyond


def test_a_keyframe_of_which_nothing_would_stay_is_kept() -> None:
    """Where all has gone it is the poses that are wrong, or only somebody was seen at all."""
    local_map = LocalMap(KeyframeConfig(), MatchingConfig())
    for around in ([[0.0, 1.5, 0.25], [0.0, -5.0, 0.3]], [[0.0, -1.5, 0.25], [0.0, 5.0, 0.3]]):
        seen = scan(around, NOTHING)
        local_map.add(points_of(seen), Pose2(), clear_sectors(seen, 30.0))
    assert min(grid_at(local_map, 0.0, 1.25), grid_at(local_map, 0.0, -1.25)) > 0.9


def test_small_things_that_came_are_left_out_of_a_scan_but_no_wall() -> None:
    local_map = LocalMap(KeyframeConfig(), MatchingConfig())
    for k in range(3):
        seen = scan([], x=0.1 * k)
        local_map.add(points_of(seen), Pose2(0.1 * k, 0.0, 0.0), clear_sectors(seen, 30.0))
    pose = np.array([0.2, 0.0, 0.0])
    wall = np.array([[2.0, -1.0, 2.0, 1.0]])
    points = points_of(scan([BESIDE], np.vstack([ROOM, wall]), x=0.2))
    static = local_map.static(points, pose, FARTHEST_M)
    near = np.hypot(*(transform_points(pose, points) - [0.0, 1.5]).T) < 0.3
    assert near.sum() > 10
    assert len(static) == len(points) - near.sum()
    assert len(local_map.static(points, pose, 1.0)) == len(points)


def test_a_tracker_leaves_out_who_has_come_and_says_what_is_left() -> None:
    tracker = ScanTracker(FrontendConfig())
    for k in range(8):
        x = 0.1 * k
        came = [BESIDE] if k == 7 else []
        tracked = tracker.track(Reading((k + 1) * 200_000_000, scan(came, x=x), Pose2(x, 0.0, 0.0)))
    ends = transform_points(tracked.local_from_robot.as_array(), tracked.points_m)
    assert len(ends) > 200
    assert np.hypot(*(ends - BESIDE[:2]).T).min() > 0.5


@pytest.mark.parametrize("way_m", [0.16, 0.2])
def test_who_overtakes_drags_no_robot_along(way_m: float) -> None:
    """A robot that sees a pillar or two is overtaken by somebody, in twelve draws of the noise."""
    runs = [overtaken(way_m, seed) for seed in range(12)]
    off_m, ambiguous = np.array(runs).T
    # 0.9 to 2.2 m where whoever comes joins the map and the scan.
    assert np.median(off_m) < 0.2
    assert np.mean(off_m < 0.3) > 0.8
    assert off_m.max() < 0.7
    assert (ambiguous < 30).all()


def overtaken(way_m: float, seed: int) -> tuple[float, int]:
    """Most that the robot was off by [m], and its ambiguous scans."""
    rng = np.random.default_rng(seed)
    pillars = np.array([[x, 2.5, 0.3] for x in np.arange(-4.0, 40.0, 6.0)])
    tracker, truth, off_m, ambiguous = ScanTracker(FrontendConfig()), np.zeros(3), 0.0, 0
    for k in range(100):
        somebody = [-7.0 + way_m * k, -1.2, 0.25]
        noise_m = rng.normal(0.0, 0.03, len(BEAMS))
        scan = scan_of(np.vstack([pillars, somebody]), NOTHING, truth.copy(), noise_m)
        odometry = Pose2(truth[0] * 1.002, 0.0, 0.0)
        tracked = tracker.track(Reading((k + 1) * 200_000_000, scan, odometry))
        off_m = max(off_m, math.hypot(*(tracked.local_from_robot.as_array() - truth)[:2]))
        ambiguous += tracked.is_ambiguous
        truth += [0.06, 0.0, 0.0]
    return off_m, ambiguous
