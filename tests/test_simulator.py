# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The simulator against brute force, closed formulas and its own noiseless self."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slarm_graph.config import LidarConfig, SimulationConfig, WheelConfig
from slarm_graph.errors import BadInput
from slarm_graph.files.worlds import load_world, world_from_yaml
from slarm_graph.frontends.simulation.random_worlds import random_world
from slarm_graph.frontends.simulation.segment_grid import build_segment_grid, cast_rays, is_near
from slarm_graph.frontends.simulation.simulator import SimulatedWorld, visible_segments
from slarm_graph.geometry import Pose2, compose, transform_points
from slarm_graph.polygons import contains, edges_m
from slarm_graph.world import DriveCommand, WorldMap

EXACT_WHEELS = WheelConfig(
    wheel_base_error=0.0, left_slip=0.0, right_slip=0.0, random_slip_m_per_sqrt_m=0.0
)
NOISELESS = SimulationConfig(lidar=LidarConfig(sigma_m=0.0), wheels=EXACT_WHEELS)

MOUNTINGS = {
    "plain": LidarConfig(sigma_m=0.0),
    "clockwise": LidarConfig(sigma_m=0.0, clockwise=True),
    "rear": LidarConfig(sigma_m=0.0, x_m=-0.15, yaw_rad=math.pi, field_of_view_rad=4.7),
    "upside_down": LidarConfig(sigma_m=0.0, x_m=0.1, y_m=0.05, upside_down=True),
    "all_at_once": LidarConfig(
        sigma_m=0.0, y_m=-0.1, yaw_rad=2.0, upside_down=True, clockwise=True
    ),
}


def simulated(
    world: WorldMap, config: SimulationConfig = NOISELESS, seed: int = 0
) -> SimulatedWorld:
    return SimulatedWorld(world, config, np.random.default_rng(seed))


def all_edges(world: WorldMap, above_m: float = 0.0) -> np.ndarray:
    tall = [s.corners_m for s in world.solids if s.height_m > above_m]
    return np.concatenate([edges_m(c) for c in (world.boundary_m, *tall)])


def brute_force_ranges(edges: np.ndarray, origin: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Solve every ray against every segment as a 2 x 2 system."""
    best = np.full(len(angles), np.inf)
    for n, angle in enumerate(angles):
        ray = np.array([math.cos(angle), math.sin(angle)])
        for x1, y1, x2, y2 in edges:
            matrix = np.array([ray, [x1 - x2, y1 - y2]]).T
            if abs(np.linalg.det(matrix)) < 1e-12:
                continue
            t, u = np.linalg.solve(matrix, np.array([x1, y1]) - origin)
            if t >= 0 and -1e-9 <= u <= 1 + 1e-9:
                best[n] = min(best[n], t)
    return best


def distance_to_edges(edges: np.ndarray, points: np.ndarray) -> np.ndarray:
    start, step = edges[:, :2], edges[:, 2:] - edges[:, :2]
    rel = points[:, None] - start
    share = np.clip((rel * step).sum(-1) / (step * step).sum(-1), 0.0, 1.0)
    return np.linalg.norm(rel - share[..., None] * step, axis=-1).min(axis=1)


@pytest.mark.parametrize("seed", range(4))
def test_ray_casting_equals_brute_force(seed: int) -> None:
    rng = np.random.default_rng(seed)
    world = random_world(rng, obstacles=int(rng.integers(1, 20)))
    grid = visible_segments(world, 0.2)
    angles = rng.uniform(-math.pi, math.pi, 60)
    origin = np.array([world.start.x, world.start.y])
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    got = cast_rays(grid, np.array([[*origin, 0.0]]), directions, 100.0)
    np.testing.assert_allclose(got, brute_force_ranges(all_edges(world, 0.2), origin, angles))


def test_no_ray_slips_between_segments_that_share_a_corner() -> None:
    corners = np.array([[math.cos(a), math.sin(a)] for a in np.linspace(0, 2 * math.pi, 37)[:-1]])
    grid = build_segment_grid(edges_m(5.0 * corners))
    ranges = cast_rays(grid, np.zeros((1, 3)), corners, 100.0)
    np.testing.assert_allclose(ranges, 5.0, rtol=1e-9)


def test_range_ends_at_the_limit() -> None:
    square = np.array([[-4.0, -4.0], [4.0, -4.0], [4.0, 4.0], [-4.0, 4.0]])
    grid = build_segment_grid(edges_m(square))
    ahead, pose = np.array([[1.0, 0.0]]), np.zeros((1, 3))
    assert cast_rays(grid, pose, ahead, 3.999)[0] == math.inf
    assert cast_rays(grid, pose, ahead, 4.001)[0] == pytest.approx(4.0)


def test_clearance_equals_brute_force() -> None:
    rng = np.random.default_rng(5)
    edges = rng.uniform(-5, 5, (40, 4))
    grid = build_segment_grid(edges)
    for x, y, radius in rng.uniform([-6, -6, 0.01], [6, 6, 2.0], (300, 3)):
        want = distance_to_edges(edges, np.array([[x, y]]))[0] < radius
        assert is_near(grid, x, y, radius) == want


def test_a_noiseless_robot_knows_where_it_is() -> None:
    world = load_world("paper_room")
    robot = simulated(world)
    rng = np.random.default_rng(3)
    for _ in range(200):
        robot.drive(DriveCommand(0.1, float(rng.uniform(-1, 1))))
    step = robot.truth().between(robot.read().odom_from_robot)
    np.testing.assert_allclose(step.as_array(), 0.0, atol=1e-12)
    assert robot.collisions() == 0


def test_driving_follows_the_arc() -> None:
    robot = simulated(load_world("paper_room"))
    for _ in range(10):
        robot.drive(DriveCommand(0.5, 0.8))
    radius = 0.5 / 0.8
    want = Pose2(-4.5 + radius * math.sin(0.8), -3.0 + radius * (1 - math.cos(0.8)), 0.8)
    np.testing.assert_allclose(robot.truth().as_array(), want.as_array(), atol=1e-12)


@pytest.mark.parametrize("mounting", MOUNTINGS)
def test_returns_lie_on_walls_however_the_laser_is_mounted(mounting: str) -> None:
    world = load_world("paper_room")
    robot = simulated(world, SimulationConfig(lidar=MOUNTINGS[mounting], wheels=EXACT_WHEELS))
    robot.drive(DriveCommand(0.5, 0.7))
    points = transform_points(robot.truth().as_array(), robot.read().scan.points_m())
    assert len(points) > 100
    assert distance_to_edges(all_edges(world), points).max() < 1e-5


def test_upside_down_and_clockwise_reverse_the_sense() -> None:
    world = load_world("paper_room")
    for lidar, sign in (
        (LidarConfig(), 1),
        (LidarConfig(clockwise=True), -1),
        (LidarConfig(upside_down=True), -1),
        (LidarConfig(upside_down=True, clockwise=True), 1),
    ):
        scan = simulated(world, SimulationConfig(lidar=lidar)).read().scan
        assert math.copysign(1, scan.angle_increment_rad) == sign
        assert len(scan.ranges_m) == 360


def test_a_sweep_sees_walls_from_where_each_beam_was() -> None:
    world = load_world("paper_room")
    lidar = LidarConfig(sigma_m=0.0, sweep_s=0.08, x_m=0.1)
    robot = simulated(world, SimulationConfig(lidar=lidar, wheels=EXACT_WHEELS))
    before = robot.truth()
    command = DriveCommand(0.6, 1.2)
    robot.drive(command)
    reading = robot.read()
    at_stamp = before @ Pose2.exp([0.6 * 0.02, 0.0, 1.2 * 0.02])
    np.testing.assert_allclose(robot.truth_of_reading().as_array(), at_stamp.as_array(), atol=1e-9)
    scan = reading.scan
    assert scan.time_increment_s == pytest.approx(0.08 / 360)
    when = np.arange(360) * scan.time_increment_s
    twists = np.outer(when, [0.6, 0.0, 1.2])
    poses = np.array([(at_stamp @ Pose2.exp(t)).as_array() for t in twists])
    lasers = compose(poses, scan.robot_from_laser.as_array())
    angles = lasers[:, 2] + scan.angles_rad()
    rays = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    points = (lasers[:, :2] + scan.ranges_m[:, None] * rays)[scan.is_return()]
    edges = all_edges(world)
    assert distance_to_edges(edges, points).max() < 1e-5
    frozen = transform_points(at_stamp.as_array(), scan.points_m())
    assert distance_to_edges(edges, frozen).max() > 0.05


def test_odometry_drifts_as_the_wheels_say() -> None:
    """Heading and distance errors over 2 m have the mean and spread of the wheel model."""
    world = world_from_yaml(
        "{name: hall, ceiling_m: 3, boundary_m: [[-9,-9],[9,-9],[9,9],[-9,9]],"
        " start: {x_m: 0, y_m: 0}}"
    )
    wheels = WheelConfig(left_slip=0.01, right_slip=-0.005, random_slip_m_per_sqrt_m=0.01)
    config = SimulationConfig(lidar=LidarConfig(beams=1), wheels=wheels)
    headings, distances = [], []
    for seed in range(400):
        robot = simulated(world, config, seed)
        for _ in range(20):
            robot.drive(DriveCommand(1.0, 0.0))
        headings.append(robot.truth().theta)
        distances.append(np.hypot(robot.truth().x, robot.truth().y))
    base_m = wheels.wheel_base_m * (1 + wheels.wheel_base_error)
    spread_m = 0.01 * math.sqrt(2.0)
    mean_error = 4.0 / math.sqrt(400)
    assert np.mean(headings) == pytest.approx(
        2.0 * 0.015 / base_m, abs=mean_error * math.sqrt(2) * spread_m / base_m
    )
    assert np.std(headings) == pytest.approx(math.sqrt(2) * spread_m / base_m, rel=0.15)
    assert np.std(distances) == pytest.approx(spread_m / math.sqrt(2), rel=0.2)


def test_range_noise_has_its_sigma() -> None:
    world = load_world("paper_room")
    exact = simulated(world).read().scan.ranges_m
    seen = exact < 7.5
    noisy = simulated(world, SimulationConfig())
    errors = np.concatenate([noisy.read().scan.ranges_m[seen] - exact[seen] for _ in range(100)])
    assert np.mean(errors) == pytest.approx(0.0, abs=3e-4)
    assert np.std(errors) == pytest.approx(0.01, rel=0.02)


def test_too_close_and_too_far_follow_rep_117() -> None:
    lidar = LidarConfig(sigma_m=0.0, range_min_m=0.6, range_max_m=3.0)
    scan = simulated(load_world("paper_room"), SimulationConfig(lidar=lidar)).read().scan
    assert np.isneginf(scan.ranges_m).any()
    assert np.isposinf(scan.ranges_m).any()
    seen = scan.ranges_m[np.isfinite(scan.ranges_m)]
    assert seen.min() >= 0.6
    assert seen.max() <= 3.0


def test_the_laser_looks_over_low_things_but_the_body_does_not() -> None:
    text = (
        "{name: sill, ceiling_m: 3, boundary_m: [[0,0],[6,0],[6,4],[0,4]],"
        " start: {x_m: 1, y_m: 2}, boxes: [{center_m: [3,2], size_m: [0.2,2], height_m: 0.1}]}"
    )
    robot = simulated(world_from_yaml(text))
    scan = robot.read().scan
    assert scan.ranges_m[180] == pytest.approx(5.0)
    for _ in range(60):
        robot.drive(DriveCommand(0.6, 0.0))
    assert robot.collisions() == 1
    assert robot.truth().x == pytest.approx(2.9 - 0.18, abs=0.006)
    assert robot.read().odom_from_robot.x > 4.0


def test_the_body_never_enters_a_solid() -> None:
    world = random_world(np.random.default_rng(11), obstacles=15)
    robot = simulated(world, SimulationConfig(), seed=1)
    rng = np.random.default_rng(2)
    edges = all_edges(world)
    for _ in range(300):
        robot.drive(DriveCommand(float(rng.uniform(-1, 2)), float(rng.uniform(-2, 2))))
        here = np.array([[robot.truth().x, robot.truth().y]])
        assert distance_to_edges(edges, here)[0] >= 0.18
        assert contains(world.boundary_m, here)[0]
    assert robot.collisions() > 0


def test_the_same_seed_gives_the_same_readings() -> None:
    one, two, other = (simulated(load_world("office"), SimulationConfig(), s) for s in (7, 7, 8))
    for robot in (one, two, other):
        for _ in range(20):
            robot.drive(DriveCommand(0.4, 0.1))
    a, b, c = one.read(), two.read(), other.read()
    np.testing.assert_array_equal(a.scan.ranges_m, b.scan.ranges_m)
    assert one.truth() == two.truth()
    assert one.truth() != other.truth()
    assert not np.array_equal(a.scan.ranges_m, c.scan.ranges_m)


def test_a_start_inside_a_solid_is_refused() -> None:
    text = (
        "{name: stuck, ceiling_m: 3, boundary_m: [[0,0],[6,0],[6,4],[0,4]],"
        " start: {x_m: 3.0, y_m: 2}, boxes: [{center_m: [3,2], size_m: [1,1], height_m: 1}]}"
    )
    with pytest.raises(BadInput, match=r"start: \(3, 2\) m lies inside box"):
        simulated(world_from_yaml(text))
