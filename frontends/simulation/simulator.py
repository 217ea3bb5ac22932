# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""A 2.5D simulator: a differential-drive robot with slipping wheels and a planar laser."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from slarm_graph.config import LidarConfig, SimulationConfig
from slarm_graph.errors import BadInput
from slarm_graph.frontends.simulation.receiver import SimulatedReceiver
from slarm_graph.frontends.simulation.segment_grid import (
    SegmentGrid,
    build_segment_grid,
    cast_rays,
    is_near,
)
from slarm_graph.geometry import Floats, Pose2, compose
from slarm_graph.polygons import contains, edges_m
from slarm_graph.readings import LaserScan, Reading
from slarm_graph.world import DriveCommand, World, WorldMap

# Stamps of zero mean "latest" to tf; the simulated clock starts well after.
START_NS: Final = 1_000 * 10**9
_SWEEP_STEP_M: Final = 0.005
"""Collisions are looked for every 5 mm of a step: a corner may be cut by 0.02 mm at a radius of
0.18 m."""


def make_world(world: WorldMap, config: SimulationConfig, rng: np.random.Generator) -> World:
    """Put a robot into a world, moved by `config.engine`.

    Raises
    ------
    ImportError
        When the engine's package is not installed; says how to install it.
    BadInput
        When the robot would start inside a solid.
    """
    if config.engine == "mujoco":
        from slarm_graph.frontends.simulation.mujoco_world import MujocoWorld

        return MujocoWorld(world, config, rng)
    return SimulatedWorld(world, config, rng)


class SimulatedWorld:
    """A robot in a known world; implements `slarm_graph.world.World`.

    Wheel encoders report what the wheels turn; the ground passes by that travel less a systematic
    and a random slip, so odometry drifts from the truth as a real robot's does. The body is a disc
    that stops at solids and at the boundary while its wheels turn on.

    Parameters
    ----------
    world : WorldMap
    config : SimulationConfig
    rng : numpy.random.Generator
        Source of all noise; two worlds with equal generators behave alike.

    Raises
    ------
    BadInput
        When the robot would stand in a solid at the start.
    """

    def __init__(self, world: WorldMap, config: SimulationConfig, rng: np.random.Generator) -> None:
        self.map = world
        self.config = config
        self._rng = rng
        self._visible_edges = visible_segments(world, config.lidar.height_m)
        self._solid_edges = visible_segments(world, 0.0)
        self._directions = beam_directions(config.lidar)
        self._period_ns = round(1e9 / config.lidar.rate_hz)
        self._stamp_ns = START_NS
        self._pose = self._previous = world.start
        self._odom = world.start if config.wheels.start_known else Pose2()
        self._previous_odom = self._odom
        self._touching = False
        self._collisions = 0
        self._check_start()
        self.receiver = SimulatedReceiver(world, config.signals, rng)

    @property
    def period_s(self) -> float:
        """Time between readings [s]."""
        return self._period_ns * 1e-9

    def read(self) -> Reading:
        """Return the scan that is complete at the present instant.

        With a sweep time the reading's stamp and odometry are those of its first beam, one sweep
        before the present instant.
        """
        lidar = self.config.lidar
        share = min(1.0, lidar.sweep_s * 1e9 / self._period_ns)
        scan = scan_from_ranges(lidar, self._exact_ranges_m(share), self._rng)
        odom = _between(self._previous_odom, self._odom, 1.0 - share)
        stamp_ns = self._stamp_ns - round(lidar.sweep_s * 1e9)
        signals = self.receiver.at(stamp_ns, self.truth_of_reading())
        return Reading(stamp_ns, scan, odom, signals)

    def truth_of_reading(self) -> Pose2:
        """Return `world_from_robot` at the stamp of what `read` returns now."""
        share = min(1.0, self.config.lidar.sweep_s * 1e9 / self._period_ns)
        return _between(self._previous, self._pose, 1.0 - share)

    def drive(self, command: DriveCommand) -> None:
        """Hold the command until the next reading is due."""
        wheels, dt_s = self.config.wheels, self.period_s
        turn = 0.5 * wheels.wheel_base_m * command.turn_rate_rad_s
        left = (command.speed_m_s - turn) * dt_s
        right = (command.speed_m_s + turn) * dt_s
        self._previous, self._previous_odom = self._pose, self._odom
        self._odom = self._odom @ _arc(left, right, wheels.wheel_base_m)
        noise = wheels.random_slip_m_per_sqrt_m * self._rng.standard_normal(2)
        ground_left = left * (1.0 - wheels.left_slip) + noise[0] * math.sqrt(abs(left))
        ground_right = right * (1.0 - wheels.right_slip) + noise[1] * math.sqrt(abs(right))
        true_base_m = wheels.wheel_base_m * (1.0 + wheels.wheel_base_error)
        self._move(_arc(ground_left, ground_right, true_base_m))
        self._stamp_ns += self._period_ns

    def truth(self) -> Pose2:
        """Return `world_from_robot` at the present instant."""
        return self._pose

    def collisions(self) -> int:
        """Return how often the body has run into a solid so far."""
        return self._collisions

    def _move(self, step: Pose2) -> None:
        """Move along an arc, up to the first contact."""
        radius, length = self.config.body_radius_m, math.hypot(step.x, step.y)
        start, end = self._pose, self._pose @ step
        if length == 0.0 or not is_near(self._solid_edges, start.x, start.y, radius + length):
            self._pose, self._touching = end, False
            return
        pieces = math.ceil(length / _SWEEP_STEP_M)
        twist = step.log()
        for piece in range(1, pieces + 1):
            pose = start @ Pose2.exp(twist * (piece / pieces))
            if is_near(self._solid_edges, pose.x, pose.y, radius):
                self._pose = Pose2(self._pose.x, self._pose.y, end.theta)
                self._collisions += not self._touching
                self._touching = True
                return
            self._pose = pose
        self._touching = False

    def _exact_ranges_m(self, share: float) -> Floats:
        """Distances (B,) along the beams taken over the last `share` of the drive."""
        lidar = self.config.lidar
        poses = np.asarray(self._pose.as_array()[None])
        if share > 0.0:
            shares = (1.0 - share) + share * np.arange(lidar.beams) / lidar.beams
            poses = _along(self._previous, self._pose, shares)
        mount = np.array([lidar.x_m, lidar.y_m, lidar.yaw_rad])
        return cast_rays(
            self._visible_edges, compose(poses, mount), self._directions, lidar.range_max_m
        )

    def _check_start(self) -> None:
        start, where = self.map.start, np.array([[self.map.start.x, self.map.start.y]])
        is_blocked = not contains(self.map.boundary_m, where)[0]
        is_blocked |= any(contains(s.corners_m, where)[0] for s in self.map.solids)
        if is_blocked or is_near(self._solid_edges, start.x, start.y, self.config.body_radius_m):
            raise BadInput(
                f"{self.map.name}: start: the robot (radius {self.config.body_radius_m} m) touches"
                f" a solid at ({start.x:.3f}, {start.y:.3f})"
            )


def visible_segments(world: WorldMap, height_m: float) -> SegmentGrid:
    """Edges of the boundary and of all solids that rise above a height [m]."""
    polygons = [s.corners_m for s in world.solids if s.height_m > height_m]
    return build_segment_grid(
        np.concatenate([edges_m(corners) for corners in [world.boundary_m, *polygons]])
    )


def scan_from_ranges(lidar: LidarConfig, exact_m: Floats, rng: np.random.Generator) -> LaserScan:
    """Return the scan of a laser that adds its noise to exact distances (B,) [m]."""
    ranges = exact_m + lidar.sigma_m * rng.standard_normal(lidar.beams)
    ranges[ranges > lidar.range_max_m] = np.inf
    ranges[ranges < lidar.range_min_m] = -np.inf
    return LaserScan(
        ranges.astype(np.float32),
        *_angles(lidar),
        lidar.range_min_m,
        lidar.range_max_m,
        Pose2(lidar.x_m, lidar.y_m, lidar.yaw_rad),
        lidar.sweep_s / lidar.beams,
    )


def laser_angles(lidar: LidarConfig) -> tuple[float, float]:
    """First angle and increment [rad] as the laser itself reports them, in its own frame."""
    circle = lidar.field_of_view_rad >= 2.0 * math.pi - 1e-9
    gaps = lidar.beams if circle else max(1, lidar.beams - 1)
    first, increment = -0.5 * lidar.field_of_view_rad, lidar.field_of_view_rad / gaps
    return (-first, -increment) if lidar.clockwise else (first, increment)


def _angles(lidar: LidarConfig) -> tuple[float, float]:
    """First angle and increment in the laser's frame projected to the plane.

    Upside down the same beams turn the other way (a rotation by pi about the forward axis).
    """
    first, increment = laser_angles(lidar)
    return (-first, -increment) if lidar.upside_down else (first, increment)


def beam_directions(lidar: LidarConfig) -> Floats:
    """Unit vectors (B, 2) of the beams in the laser's frame projected to the plane."""
    first, increment = _angles(lidar)
    angles = first + increment * np.arange(lidar.beams)
    return np.stack([np.cos(angles), np.sin(angles)], axis=1)


def _arc(left_m: float, right_m: float, wheel_base_m: float) -> Pose2:
    """Motion of the robot while its wheels roll on an arc."""
    return Pose2.exp([0.5 * (left_m + right_m), 0.0, (right_m - left_m) / wheel_base_m])


def _between(start: Pose2, end: Pose2, share: float) -> Pose2:
    """Return the pose on the arc from `start` to `end`."""
    if share >= 1.0:
        return end
    return start @ Pose2.exp(share * start.between(end).log())


def _along(start: Pose2, end: Pose2, shares: Floats) -> Floats:
    """Poses (B, 3) on the arc from `start` to `end`."""
    vx, vy, w = start.between(end).log()
    angle = shares * w
    with np.errstate(invalid="ignore", divide="ignore"):
        a = np.where(np.abs(angle) < 1e-9, 1.0, np.sin(angle) / angle) * shares
        b = np.where(np.abs(angle) < 1e-9, 0.5 * angle, (1.0 - np.cos(angle)) / angle) * shares
    relative = np.stack([a * vx - b * vy, b * vx + a * vy, angle], axis=1)
    return compose(start.as_array(), relative)
