# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The physics world: its rays and ours agree, its wheels roll, its contacts count."""

from __future__ import annotations

import math
import sys

import numpy as np
import pytest

from slarm_graph.config import LidarConfig, SimulationConfig, WheelConfig
from slarm_graph.errors import BadInput
from slarm_graph.files.worlds import load_world, shipped_worlds
from slarm_graph.frontends.simulation.random_worlds import random_world
from slarm_graph.frontends.simulation.simulator import SimulatedWorld, make_world
from slarm_graph.geometry import Pose2
from slarm_graph.world import DriveCommand, World, WorldMap

EVEN_WHEELS = WheelConfig(left_slip=0.0, right_slip=0.0, wheel_base_error=0.0)
SHARP = LidarConfig(sigma_m=0.0, x_m=0.05, y_m=-0.03, yaw_rad=0.4)


@pytest.fixture(autouse=True)
def _needs_mujoco() -> None:
    pytest.importorskip("mujoco", reason="the extra `physics` is not installed")


def physics(world: WorldMap, **settings: object) -> World:
    config = SimulationConfig.model_validate({"engine": "mujoco", **settings})
    return make_world(world, config, np.random.default_rng(0))


def rays_agree(world: WorldMap) -> None:
    ours = SimulatedWorld(world, SimulationConfig(lidar=SHARP), np.random.default_rng(0)).read()
    theirs = physics(world, lidar=SHARP).read()
    a, b = ours.scan.ranges_m, theirs.scan.ranges_m
    both = np.isfinite(a) & np.isfinite(b)
    assert both.sum() > 90
    # Where a ray grazes a corner one may just miss it; everywhere else they are equal.
    assert np.mean(np.abs(a[both] - b[both]) > 1e-4) < 0.01
    assert np.mean(np.isfinite(a) != np.isfinite(b)) < 0.01
    assert ours.scan.angle_min_rad == theirs.scan.angle_min_rad


@pytest.mark.parametrize("name", shipped_worlds())
def test_rays_equal_ours_in_every_shipped_world(name: str) -> None:
    rays_agree(load_world(name))


@pytest.mark.parametrize("seed", range(5))
def test_rays_equal_ours_in_random_worlds(seed: int) -> None:
    rays_agree(random_world(np.random.default_rng(seed)))


def test_wheels_roll_where_they_are_sent() -> None:
    robot = physics(load_world("paper_room"), wheels=EVEN_WHEELS)
    for _ in range(40):
        robot.drive(DriveCommand(0.5, 0.0))
    assert robot.truth().x == pytest.approx(-4.5 + 2.0, abs=0.06)
    assert robot.truth().y == pytest.approx(-3.0, abs=0.01)
    step = robot.truth().between(robot.read().odom_from_robot)
    np.testing.assert_allclose(step.as_array(), 0.0, atol=0.02)
    for _ in range(20):
        robot.drive(DriveCommand(0.0, 0.8))
    # Wheels of some width scrub while turning: the ground passes by about 2 % less.
    turned = robot.read().odom_from_robot.theta
    assert turned == pytest.approx(1.6, abs=0.15)
    assert 0.95 < robot.truth().theta / turned < 1.0
    assert robot.collisions() == 0


def test_slip_of_the_configuration_turns_the_robot() -> None:
    wheels = WheelConfig(left_slip=0.02, right_slip=-0.02, wheel_base_error=0.0)
    robot = physics(load_world("paper_room"), wheels=wheels)
    for _ in range(20):
        robot.drive(DriveCommand(0.5, 0.0))
    travelled = robot.read().odom_from_robot.x + 4.5
    unseen = robot.truth().theta - robot.read().odom_from_robot.theta
    assert unseen == pytest.approx(0.04 * travelled / 0.3, rel=0.1)


def test_walls_stop_the_body_and_count() -> None:
    robot = physics(load_world("paper_room"))
    for _ in range(30):
        robot.drive(DriveCommand(-0.5, 0.0))
    assert robot.collisions() >= 1
    assert robot.truth().x == pytest.approx(-5.0 + 0.18, abs=0.01)


def test_the_same_drive_gives_the_same_readings() -> None:
    one, two = (physics(load_world("cluttered")) for _ in range(2))
    for robot in (one, two):
        for _ in range(10):
            robot.drive(DriveCommand(0.4, 0.3))
    assert one.truth() == two.truth()
    np.testing.assert_array_equal(one.read().scan.ranges_m, two.read().scan.ranges_m)
    assert one.read().stamp_ns == 1_001_000_000_000


def test_odometry_can_start_at_zero() -> None:
    robot = physics(load_world("paper_room"), wheels=WheelConfig(start_known=False))
    assert robot.read().odom_from_robot == Pose2()


def test_a_sweeping_laser_is_refused() -> None:
    with pytest.raises(BadInput, match=r"simulation\.lidar\.sweep_s"):
        physics(load_world("paper_room"), lidar=LidarConfig(sweep_s=0.05))


def test_a_start_inside_a_solid_is_refused() -> None:
    room = load_world("paper_room")
    stuck = WorldMap(
        room.name, room.solids, room.boundary_m, room.ceiling_m, (), Pose2(-3.3, 0.0, math.pi)
    )
    with pytest.raises(BadInput, match="touches a solid"):
        physics(stuck)


def test_without_mujoco_the_error_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(ImportError, match=r"pip install slarm-graph\[physics\]"):
        physics(load_world("paper_room"))
