# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Scripted drives through a world: a source of readings with known truth, and bags made of it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np

from slarm_graph.config import SimulationConfig
from slarm_graph.frontends.simulation.simulator import SimulatedWorld
from slarm_graph.frontends.simulation.tour import tour_waypoints_m
from slarm_graph.geometry import Floats, Pose2, wrap_angle
from slarm_graph.readings import Reading, ScanStatus, SourceInfo
from slarm_graph.trajectory import Trajectory
from slarm_graph.world import DriveCommand, WorldMap

Script = Callable[[SimulatedWorld], Iterator[DriveCommand]]

_ARRIVED_M = 0.10
"""A third of the distance between two waypoints; half makes the driver circle around some, double
cuts corners."""
_TURN_IN_PLACE_RAD = 0.7
"""40 degrees off, an arc at 0.6 m/s and 1.5 rad/s is wider than a corridor."""
_TURN_GAIN_PER_S = 2.5
"""Time constant of 0.4 s: below the 0.1 s of a command by far, so that it does not oscillate."""
_STUCK_STEPS = 300
"""Half a minute at ten commands a second without reaching the next waypoint."""


class SourceFromWorld:
    """A scripted drive as a `slarm_graph.readings.Source`; every iteration drives it anew.

    Parameters
    ----------
    world : WorldMap
    config : SimulationConfig
    seed : int
        The same seed gives the same readings; they are independent of numbers drawn from the same
        seed elsewhere.
    script : callable, optional
        Yields commands for a simulated world; by default the robot tours the whole world.
    """

    def __init__(
        self,
        world: WorldMap,
        config: SimulationConfig | None = None,
        *,
        seed: int = 0,
        script: Script | None = None,
    ) -> None:
        self.map = world
        self.config = config or SimulationConfig()
        self._seed = seed
        self._script = script or tour(world, self.config)
        self._stamps_ns: list[int] = []
        self._truth: list[Floats] = []
        self._collisions = 0

    def info(self) -> SourceInfo:
        """Describe the drive."""
        notices: tuple[str, ...] = ()
        if self._collisions:
            notices = (f"the robot ran into solids {self._collisions} times",)
        description = f"simulated drive through {self.map.name}"
        return SourceInfo(description, None, notices, self.truth())

    def scan_statuses(self) -> tuple[ScanStatus, ...]:
        """Return every scan so far; none is lost in a simulation."""
        return tuple(ScanStatus(stamp) for stamp in self._stamps_ns)

    def truth(self) -> Trajectory:
        """Return `world_from_robot` at every reading so far."""
        return Trajectory(np.array(self._stamps_ns, dtype=np.int64), np.array(self._truth))

    def __iter__(self) -> Iterator[Reading]:
        """Drive, yielding the readings."""
        (rng,) = np.random.default_rng(self._seed).spawn(1)
        simulated = SimulatedWorld(self.map, self.config, rng)
        self._stamps_ns, self._truth, self._collisions = [], [], 0
        yield self._read(simulated)
        for command in self._script(simulated):
            simulated.drive(command)
            yield self._read(simulated)

    def _read(self, simulated: SimulatedWorld) -> Reading:
        reading = simulated.read()
        self._stamps_ns.append(reading.stamp_ns)
        self._truth.append(simulated.truth_of_reading().as_array())
        self._collisions = simulated.collisions()
        return reading


def waypoints(points_m: Floats, *, speed_m_s: float = 0.6, turn_rate_rad_s: float = 1.5) -> Script:
    """Script that visits points (N, 2) [m] of the world one after the other.

    The controller uses the true pose: it scripts a drive, it does not navigate.
    """
    targets = np.asarray(points_m, dtype=np.float64)

    def script(world: SimulatedWorld) -> Iterator[DriveCommand]:
        """Steer to one target after the other, and give up those not reached."""
        for target in targets:
            for _ in range(_STUCK_STEPS):
                command = _steer(world.truth(), target, speed_m_s, turn_rate_rad_s)
                if command is None:
                    break
                yield command

    return script


def tour(world: WorldMap, config: SimulationConfig, *, speed_m_s: float = 0.6) -> Script:
    """Script that drives through every part of a world and comes back to its start."""
    return waypoints(tour_waypoints_m(world, config.body_radius_m), speed_m_s=speed_m_s)


def _steer(
    pose: Pose2, target: Floats, speed_m_s: float, turn_rate_rad_s: float
) -> DriveCommand | None:
    """Proportional controller of the heading towards the target; None on arrival."""
    dx, dy = float(target[0]) - pose.x, float(target[1]) - pose.y
    distance = math.hypot(dx, dy)
    if distance < _ARRIVED_M:
        return None
    heading_error = wrap_angle(math.atan2(dy, dx) - pose.theta)
    turn = max(-turn_rate_rad_s, min(turn_rate_rad_s, _TURN_GAIN_PER_S * heading_error))
    if abs(heading_error) > _TURN_IN_PLACE_RAD:
        return DriveCommand(0.0, turn)
    speed_factor = min(1.0, 0.25 + distance) * math.cos(heading_error) ** 3
    return DriveCommand(speed_m_s * speed_factor, turn)
