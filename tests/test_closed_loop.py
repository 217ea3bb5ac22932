# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Contract of every explorer, in small random worlds with the true pose as backend."""

from __future__ import annotations

import math

import numpy as np
import pytest
from benchmark_scripts import script

from slarm_graph import parts
from slarm_graph.access_points import AccessPoint
from slarm_graph.config import (
    DrivingConfig,
    ExploreConfig,
    RunConfig,
    SignalConfig,
    SimulationConfig,
)
from slarm_graph.exploration.closed_loop import ClosedLoop, Exploration
from slarm_graph.exploration.coverage_grid import BLOCKED
from slarm_graph.exploration.drive_report import count_turns, revisit_share
from slarm_graph.exploration.live_map import LiveMap
from slarm_graph.exploration.local_controller import (
    LocalController,
    clear_bearing_rad,
    free_ahead_m,
)
from slarm_graph.exploration.path_follower import PathFollower
from slarm_graph.frontends.simulation.simulator import SimulatedWorld
from slarm_graph.geometry import Pose2
from slarm_graph.grid import GridGeometry
from slarm_graph.readings import LaserScan
from slarm_graph.trajectory import Trajectory
from slarm_graph.truth_map import truth_map
from slarm_graph.world import DriveCommand, Solid, WorldMap

TruthBackend = script("known_pose").TruthBackend


def box(name: str, x: float, y: float, width: float, depth: float) -> Solid:
    corners = np.array([[x, y], [x + width, y], [x + width, y + depth], [x, y + depth]])
    return Solid(name, corners, 1.0)


def random_room(seed: int) -> WorldMap:
    """A room of 4 x 3 m with two boxes that leave at least 0.5 m everywhere."""
    rng = np.random.default_rng(seed)
    solids = (
        box("low", rng.uniform(0.9, 1.4), 0.0, rng.uniform(0.3, 0.8), rng.uniform(0.5, 1.2)),
        box("high", rng.uniform(2.3, 2.7), 1.9, rng.uniform(0.3, 0.6), 1.1),
    )
    boundary = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 3.0], [0.0, 3.0]])
    heard = (AccessPoint("ap", 3.8, 2.8, 2.2),)
    return WorldMap(f"room {seed}", solids, boundary, 2.5, heard, Pose2(0.4, 0.4, 0.3))


def explored(
    room: WorldMap, config: ExploreConfig, seed: int = 0, **sections: object
) -> Exploration:
    simulation = SimulationConfig(signals=SignalConfig(rate_hz=5.0))
    world = SimulatedWorld(room, simulation, np.random.default_rng(seed))
    whole, extent = RunConfig(explore=config, **sections), room.extent_m()
    explorer = parts.make("explorer", config.explorer, whole, config.driving)
    backend = TruthBackend(world)
    loop = ClosedLoop(world, backend, explorer, config, extent_m=extent, start=room.start)
    while loop.step():
        pass
    return loop.outcome()


def share_of_reachable(room: WorldMap, outcome: Exploration) -> tuple[float, float]:
    """Observed and footprint coverage of cells at least a cell away from anything solid."""
    truth = truth_map(room, outcome.geometry.resolution_m, "touched")
    reached = truth.reachable
    return (
        float(outcome.coverage.observed[reached].mean()),
        float(outcome.coverage.footprint[reached].mean()),
    )


@pytest.mark.parametrize("name", parts.registered("explorer"))
@pytest.mark.parametrize("seed", [1])
def test_explorers_end_by_themselves_see_everything_and_touch_nothing(name: str, seed: int) -> None:
    room = random_room(seed)
    sure = {"radio-survey": {"certainty_db": 1.0, "model_sd_db": 0.0}}
    outcome = explored(room, ExploreConfig(explorer=name, resolution_m=0.2), seed, **sure)
    assert outcome.report.collisions == 0
    observed, footprint = share_of_reachable(room, outcome)
    assert observed >= 0.97
    # Who only wants to see or to listen does best to drive little.
    assert footprint >= 0.85 or name in ("frontier", "radio-survey")
    assert "interrupted" not in outcome.finished.reason


def test_ggmr_visits_all_cells_that_the_body_can_enter() -> None:
    room = random_room(3)
    outcome = explored(room, ExploreConfig(explorer="ggmr", resolution_m=0.15))
    truth = truth_map(room, 0.15, "touched")
    nearest = np.linalg.norm(
        truth.geometry.centers()[:, :, None] - truth.geometry.centers()[truth.blocked], axis=-1
    )
    # Beyond the body, its margin and what a blocked cell's centre may lie behind its edge.
    roomy = truth.reachable & (np.min(nearest, axis=2, initial=9.0) > 0.42)
    edge = truth.geometry.centers()
    inside = (np.abs(edge - (2.0, 1.5)) < (2.0 - 0.3, 1.5 - 0.3)).all(axis=-1)
    wanted = roomy & inside
    assert outcome.coverage.visited[wanted].mean() >= 0.99


@pytest.mark.parametrize("speed_m_s", [0.2, 1.0])
def test_no_speed_makes_the_robot_touch_anything(speed_m_s: float) -> None:
    driving = DrivingConfig(speed_m_s=speed_m_s)
    config = ExploreConfig(explorer="ggmr+", resolution_m=0.1, driving=driving)
    settings = {"ggmr+": {"goal": "observed"}}
    assert explored(random_room(4), config, **settings).report.collisions == 0


def test_keep_out_area_and_path_home() -> None:
    room = random_room(5)
    keep_out = (((2.0, 1.2), (2.6, 1.2), (2.6, 1.7), (2.0, 1.7)),)
    config = ExploreConfig(
        resolution_m=0.1, keep_out=keep_out, area=(0.0, 3.4, 0.0, 3.0), return_to_start=True
    )
    outcome = explored(room, config)
    x, y = outcome.truth.poses[:, 0], outcome.truth.poses[:, 1]
    assert x.max() < 3.4 - 0.17
    beside = np.hypot(x - np.clip(x, 2.0, 2.6), y - np.clip(y, 1.2, 1.7))
    assert beside.min() > 0.165
    assert math.hypot(x[-1] - room.start.x, y[-1] - room.start.y) < 0.1


def test_mission_time_ends_the_drive() -> None:
    config = ExploreConfig(resolution_m=0.1, mission_time_s=5.0)
    outcome = explored(random_room(1), config)
    assert outcome.report.drive_time_s == pytest.approx(5.0, abs=0.11)
    assert "mission time" in outcome.finished.reason


def test_same_seed_gives_the_same_drive() -> None:
    config = ExploreConfig(resolution_m=0.1, mission_time_s=15.0)
    first, second = (explored(random_room(1), config, 7).truth.poses for _ in range(2))
    np.testing.assert_array_equal(first, second)


def test_coverage_follows_the_corrected_trajectory() -> None:
    live = LiveMap((0.0, 4.0, 0.0, 3.0), ExploreConfig(resolution_m=0.1))
    live.pass_over(np.array([[1.0, 1.05], [3.0, 1.05]]))
    assert live.visited[10, 10:30].all()
    assert live.visited.sum() == 21
    assert live.footprint()[10, 9:31].all()
    assert not live.footprint()[14].any()
    away = np.array([[1.0, 2.05, 0.0], [3.0, 2.05, 0.0]])
    scans = [LaserScan(np.full(4, np.nan), 0.0, 1.0, 0.1, 5.0)] * 2
    live.follow(scans, Trajectory(np.array([1, 2]), away))
    assert live.visited[20, 10:30].all()
    assert live.visited.sum() == 21
    assert not live.footprint()[10].any()


@pytest.mark.parametrize("speed_m_s", [0.2, 0.6, 1.0])
def test_follower_keeps_to_its_path(speed_m_s: float) -> None:
    path = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 0.05], [0.0, 0.05], [0.0, 1.0], [1.0, 2.0]])
    follower = PathFollower(DrivingConfig(speed_m_s=speed_m_s))
    follower.follow(path)
    pose, off, steps = Pose2(), [], 0
    while not follower.done and steps < 2000:
        command = follower.command(pose, 0.1)
        assert 0.0 <= command.speed_m_s <= speed_m_s
        assert abs(command.turn_rate_rad_s) <= DrivingConfig().turn_rate_rad_s + 1e-9
        pose = pose @ Pose2.exp([0.1 * command.speed_m_s, 0.0, 0.1 * command.turn_rate_rad_s])
        rel, step = np.array([pose.x, pose.y]) - path[:-1], np.diff(path, axis=0)
        share = np.clip((rel * step).sum(axis=1) / (step**2).sum(axis=1), 0, 1)
        off.append(np.hypot(*(rel - share[:, None] * step).T).min())
        steps += 1
    assert math.hypot(pose.x - 1.0, pose.y - 2.0) < 0.02
    assert max(off) < 0.012


def test_free_ahead_is_the_gap_of_a_disc() -> None:
    ranges = np.array([1.0, 1.0, 1.0, 1.0])
    scan = LaserScan(ranges, 0.0, math.pi / 2, 0.1, 5.0)
    assert free_ahead_m(scan, 0.2) == pytest.approx(0.8)
    assert free_ahead_m(scan, 0.3, behind=True) == pytest.approx(0.7)


def test_the_local_controller_stops_short_of_what_it_sees_by_more_than_the_noise() -> None:
    controller = LocalController(DrivingConfig())
    controller.follower.follow(np.array([[0.0, 0.0], [1.0, 0.0]]))
    x_m, readings = 0.0, []
    for _ in range(60):
        ahead_m = 0.6 - x_m
        scan = LaserScan(np.array([9.0, ahead_m, 9.0]), -0.5, 0.5, 0.1, 5.0)
        speed = controller.command(Pose2(x_m, 0.0, 0.0), scan, 0.1).speed_m_s
        x_m += 0.1 * speed
        readings.append(ahead_m)
    assert min(readings) == pytest.approx(DrivingConfig().robot_radius_m + 0.01)


def one_return(bearing_rad: float, range_m: float) -> LaserScan:
    return LaserScan(np.array([range_m]), bearing_rad, 1.0, 0.1, 20.0)


def test_ten_seconds_on_the_spot_cost_the_path_and_a_minute_everything() -> None:
    """At 10 Hz; within 5 cm it stands still, by more it has moved and all begins anew."""
    controller, path = LocalController(DrivingConfig()), np.array([[0.0, 0.0], [1.0, 0.0]])
    for x_m, readings in ((0.0, 599), (1.0, 600)):
        for k in range(1, readings + 1):
            controller.follower.follow(path)
            controller.watch(Pose2(x_m, 0.05 * (k % 2), 0.0))
            assert controller.follower.done == (k % 100 == 0)
            assert controller.has_given_up == (k == 600)
    controller.watch(Pose2(1.0, -0.01, 0.0))
    assert not controller.has_given_up


def test_blocked_for_eight_readings_it_backs_off_for_a_second_where_there_is_room() -> None:
    controller, radius_m = LocalController(DrivingConfig()), DrivingConfig().robot_radius_m
    controller.follower.follow(np.array([[0.0, 0.0], [1.0, 0.0]]))
    for _ in range(9):
        assert not controller.is_backing_off
        command = controller.command(Pose2(), one_return(0.0, radius_m), 0.1)
        assert command == DriveCommand(0.0, 0.0)
    for room_m in (0.04, 0.06) * 5:
        assert controller.is_backing_off
        command = controller.command(Pose2(), one_return(math.pi, radius_m + room_m), 0.1)
        assert command == DriveCommand(-0.1 if room_m > 0.05 else 0.0, 0.0)
        assert controller.follower.done
    assert not controller.is_backing_off


def test_the_next_metre_of_the_path_is_looked_at_from_a_decimetre_ahead() -> None:
    """And where it bends, to the corner after that metre."""
    controller, path = LocalController(DrivingConfig()), [[0.5, 0.0], [0.5, 0.4], [0.5, 2.0]]
    controller.follower.follow(np.array([[0.0, 0.0], *path, [3.0, 2.0]]))
    np.testing.assert_allclose(controller.path_ahead(Pose2()), [[0.1, 0.0], *path])
    controller.follower.follow(np.array([[0.0, 0.0], [0.0, 3.0]]))
    np.testing.assert_allclose(controller.path_ahead(Pose2()), [[0.0, 0.1], [0.0, 1.0]])
    np.testing.assert_allclose(controller.path_ahead(Pose2(0.0, 2.95, 0.0)), [[0.0, 3.0]] * 2)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_corner_is_passed_on_its_free_side(side: float) -> None:
    corner = np.linspace(0.19, 0.2, 8)
    beams = np.arctan2(side * 0.17, corner) / (2.0 * math.pi) * 7200
    full = np.full(7200, np.inf)
    full[np.round(beams).astype(int) + 3600] = np.hypot(corner, 0.17)
    scan = LaserScan(full, -math.pi, 2 * math.pi / 7200, 0.1, 5.0)
    bend = clear_bearing_rad(scan, 0.19, 0.0, 0.12)
    assert -math.radians(10.0) <= side * bend < 0.0
    assert free_ahead_m(turned(scan, bend), 0.19) >= 0.12 > free_ahead_m(scan, 0.19)


def test_two_stray_points_bend_nothing() -> None:
    full = np.full(360, np.inf)
    full[[170, 200]] = 0.25
    scan = LaserScan(full, -math.pi, 2 * math.pi / 360, 0.1, 5.0)
    assert clear_bearing_rad(scan, 0.19, 0.0, 0.12) == 0.0


def turned(scan: LaserScan, angle: float) -> LaserScan:
    """The scan of a robot that has turned."""
    first = scan.angle_min_rad - angle
    limits = (scan.range_min_m, scan.range_max_m)
    return LaserScan(scan.ranges_m, first, scan.angle_increment_rad, *limits)


def test_turns_and_revisits_of_a_square() -> None:
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]], dtype=float) + 0.05
    poses = []
    for k in range(4):
        for share in np.linspace(0, 1, 11):
            at = corners[k] + share * (corners[k + 1] - corners[k])
            poses.append([*at, k * math.pi / 2])
    driven = Trajectory(np.arange(1, len(poses) + 1) * 10**8, np.array(poses))
    assert count_turns(driven) == 3
    geometry = GridGeometry(0.0, 0.0, 0.1, 12, 12)
    assert revisit_share(driven, geometry) == pytest.approx(1 / 41)


def test_noise_beside_a_known_wall_does_not_close_a_gap() -> None:
    live = LiveMap((0.0, 4.0, 0.0, 3.0), ExploreConfig(resolution_m=0.1))
    g = live.driving_geometry
    wall = g.cell_of([[2.0, 0.0], [2.0, 1.0], [2.0, 1.5], [2.0, 2.99]])
    rows = [*range(wall[0, 0], wall[1, 0]), *range(wall[2, 0], wall[3, 0])]
    for x, y in g.center_of([(row, wall[0, 1]) for row in rows]):
        one_beam = LaserScan(np.array([x - 1.0]), 0.0, 1.0, 0.1, 8.0)
        live.add(one_beam, Pose2(1.0, y, 0.0))
    # 0.03 m into the gap of 0.5 m from both sides, as the present scan has it.
    noise = np.array([[2.01, 1.03], [2.01, 1.47]])
    bearings = np.arctan2(noise[:, 1] - 1.25, noise[:, 0] - 1.0)
    ranges = np.hypot(noise[:, 0] - 1.0, noise[:, 1] - 1.25)
    scan = LaserScan(ranges, bearings[0], bearings[1] - bearings[0], 0.1, 8.0)
    live.stand_by(scan, Pose2(1.0, 1.25, 0.0))
    assert live.is_clear(np.array([[1.5, 1.25], [2.5, 1.25]]))
    news = LaserScan(np.array([1.0]), 0.0, 0.1, 0.1, 8.0)
    live.stand_by(news, Pose2(1.0, 1.25, 0.0))
    assert not live.is_clear(np.array([[1.5, 1.25], [2.5, 1.25]]))


def blocked_m(live: LiveMap) -> tuple[float, float, float, float]:
    """Least distance of passable cells from the four sides of a rough boundary 4 m x 3 m [m]."""
    coverage = live.coverage()
    centers = live.geometry.centers()[coverage.codes != BLOCKED]
    (x_min, y_min), (x_max, y_max) = centers.min(axis=0), centers.max(axis=0)
    return x_min, 4.0 - x_max, y_min, 3.0 - y_max


@pytest.mark.parametrize("rmse_m", [0.0, 0.3, 0.6])
def test_the_rough_boundary_shrinks_by_half_the_error_on_each_side(rmse_m: float) -> None:
    """What is left is brute force: cells farther from a side than body, margin and error."""
    driving = DrivingConfig(robot_radius_m=0.2, margin_m=0.1)
    live = LiveMap((0.0, 4.0, 0.0, 3.0), ExploreConfig(resolution_m=0.05, driving=driving))
    g = live.driving_geometry
    # The same lattice goes on beyond the boundary, where everything is in the way.
    x, y = np.meshgrid(*(g.resolution_m * (np.arange(-9, n + 9) + 0.5) for n in g.shape[::-1]))
    for known_m in (rmse_m, 0.0, rmse_m):
        live.shrink_by(known_m)
        inset = 0.5 * known_m
        outside = (x < inset) | (x > 4.0 - inset) | (y < inset) | (y > 3.0 - inset)
        walls = np.column_stack([x[outside], y[outside]])
        across = [(x_m, 1.5) for x_m in np.arange(0.05, 4.0, 0.07)]
        for path in (*across, *((2.0, y_m) for y_m in np.arange(0.05, 3.0, 0.07))):
            away_m = np.hypot(*(walls - path).T).min()
            fits = away_m > 0.2 + 0.5 * g.resolution_m + 0.04
            if fits or away_m < 0.2 - 0.04:
                assert live.is_clear(np.array([path, path])) == fits


def test_planning_keeps_the_margin_that_a_tight_gap_and_a_path_do_without() -> None:
    reach = {}
    for margin_m in (0.0, 0.15):
        driving = DrivingConfig(robot_radius_m=0.2, margin_m=margin_m)
        config = ExploreConfig(resolution_m=0.05, driving=driving, slam_rmse_m=0.4)
        reach[margin_m] = blocked_m(LiveMap((0.0, 4.0, 0.0, 3.0), config))
    for without_m, with_m in zip(reach[0.0], reach[0.15], strict=True):
        assert with_m - without_m == pytest.approx(0.15, abs=0.051)


@pytest.mark.parametrize("speed_m_s", [0.6, 1.0])
def test_the_follower_never_drives_faster_than_it_can_brake(speed_m_s: float) -> None:
    """v^2 <= 2 a s before every stop, from where the robot is and not from where it was."""
    config = DrivingConfig(speed_m_s=speed_m_s, acceleration_m_s2=0.4)
    follower, pose, fastest = PathFollower(config), Pose2(), 0.0
    follower.follow(np.array([[0.0, 0.0], [1.7, 0.0]]))
    while not follower.done:
        left_m = 1.7 - pose.x
        speed = follower.command(pose, 0.05).speed_m_s
        assert speed**2 <= 2.0 * 0.4 * left_m + 1e-9
        assert speed <= speed_m_s
        fastest = max(fastest, speed)
        pose = Pose2(pose.x + 0.05 * speed, 0.0, 0.0)
    assert fastest == pytest.approx(min(speed_m_s, math.sqrt(0.4 * 1.7)), abs=0.05)


@pytest.mark.parametrize("gap_m", [0.42, 0.5])
def test_a_gap_that_the_body_just_fits_through_is_passed_when_nothing_else_is_left(
    gap_m: float,
) -> None:
    """However often the goal is looked at on the way, it is not given up for the gap."""
    walls = (box("low", 1.6, 0.0, 0.3, 0.3), box("high", 1.6, 0.3 + gap_m, 0.3, 2.1 - gap_m))
    boundary = np.array([[0.0, 0.0], [3.4, 0.0], [3.4, 2.4], [0.0, 2.4]])
    heard = (AccessPoint("ap", 3.0, 2.2, 2.2),)
    room = WorldMap("gap", walls, boundary, 2.5, heard, Pose2(0.6, 1.6, 0.0))
    driving = DrivingConfig(margin_m=0.1)
    config = ExploreConfig(explorer="frontier", resolution_m=0.1, driving=driving)
    outcome = explored(room, config)
    assert outcome.truth.poses[:, 0].max() > 1.9
    assert share_of_reachable(room, outcome)[0] > 0.99
    assert outcome.report.collisions == 0
