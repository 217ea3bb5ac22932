# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The closed loop: read, localise, map, decide, drive, until everything reachable is known."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from slarm_graph.backend import Heartbeat, SlamBackend, SlamResult, silent
from slarm_graph.config import ExploreConfig
from slarm_graph.exploration.coverage_grid import CoverageGrid, driving_cell
from slarm_graph.exploration.drive_report import DriveReport, drive_report
from slarm_graph.exploration.explorer import Explorer, Finished, Leg
from slarm_graph.exploration.live_map import LiveMap
from slarm_graph.exploration.path_follower import PathFollower, free_ahead_m
from slarm_graph.exploration.searches import reachable
from slarm_graph.exploration.ways import way_between
from slarm_graph.geographic import Coverage
from slarm_graph.geometry import Floats, Pose2
from slarm_graph.grid import GridGeometry
from slarm_graph.readings import LaserScan, Reading
from slarm_graph.trajectory import Trajectory
from slarm_graph.world import DriveCommand, World

_JUMP_M: Final = 0.06
_JUMP_RAD: Final = math.radians(2.0)
_REBUILD_GROWTH: Final = 1.7
_REBUILD_READINGS: Final = 150
_MAX_RENDERED_SCANS: Final = 1500
_LOOK_AHEAD_M: Final = 1.0
_STUCK_READINGS: Final = 8
_BACK_OFF_READINGS: Final = 10
_BACK_OFF_M_S: Final = -0.1
_BEAT_READINGS: Final = 100
_MAX_ASKS: Final = 50
_STILL_M: Final = 0.05
_STILL_READINGS: Final = 100
_MAX_STILL: Final = 6


@dataclass(frozen=True, slots=True)
class Exploration:
    """What came out of a closed loop.

    Parameters
    ----------
    slam : SlamResult
        As the backend gives it, in its own map frame.
    world_from_map : Pose2
        From the known start pose; nothing else is aligned.
    trajectory : Trajectory
        `world_from_robot` as estimated, one pose per reading.
    truth : Trajectory
        `world_from_robot` in truth, one pose per reading.
    scans : tuple of LaserScan
    geometry : GridGeometry
        Of the coverage.
    coverage : Coverage
        From the corrected trajectory.
    finished : Finished
        Why it ended.
    report : DriveReport
    """

    slam: SlamResult
    world_from_map: Pose2
    trajectory: Trajectory
    truth: Trajectory
    scans: tuple[LaserScan, ...]
    geometry: GridGeometry
    coverage: Coverage
    finished: Finished
    report: DriveReport


def explore(
    world: World,
    backend: SlamBackend,
    explorer: Explorer,
    config: ExploreConfig,
    *,
    extent_m: tuple[float, float, float, float],
    start: Pose2,
    heartbeat: Heartbeat = silent,
) -> Exploration:
    """Let a robot explore a world that it does not know.

    Parameters
    ----------
    world : World
    backend : SlamBackend
        Fresh; it sees every reading.
    explorer : Explorer
        Fresh.
    config : ExploreConfig
    extent_m : (x_min, x_max, y_min, y_max)
        The rough boundary [m].
    start : Pose2
        `world_from_robot` at the beginning, which the robot is told.
    heartbeat : Heartbeat
    """
    loop = ClosedLoop(world, backend, explorer, config, extent_m=extent_m, start=start)
    while loop.step():
        if loop.readings % _BEAT_READINGS == 0:
            heartbeat(f"{loop.readings} readings, {loop.driven_s:.0f} s driven")
    return loop.outcome()


class ClosedLoop:
    """The state of an exploration, one reading at a time."""

    def __init__(
        self,
        world: World,
        backend: SlamBackend,
        explorer: Explorer,
        config: ExploreConfig,
        *,
        extent_m: tuple[float, float, float, float],
        start: Pose2,
    ) -> None:
        self._world, self._backend, self._explorer = world, backend, explorer
        self._config, self._start = config, start
        self.live = LiveMap(extent_m, config)
        self.follower = PathFollower(config.driving)
        self.world_from_map = start
        self._scans: list[LaserScan] = []
        self._stamps_ns: list[int] = []
        self._truth: list[Floats] = []
        self._last: Reading | None = None
        self.pose = start
        self._leg = Leg(np.empty((0, 2)))
        self._leg_age_s = self._dt_s = 0.0
        self._next_rebuild = _REBUILD_READINGS
        self._last_rebuild = 0
        self._moved = False
        self._stuck = self._backing = 0
        self._going_home = False
        self._still_at, self._still = start, 0
        self.finished: Finished | None = None

    @property
    def readings(self) -> int:
        """Readings taken so far."""
        return len(self._scans)

    @property
    def driven_s(self) -> float:
        """Simulated time since the first reading [s]."""
        return (self._stamps_ns[-1] - self._stamps_ns[0]) * 1e-9 if self._stamps_ns else 0.0

    def step(self) -> bool:
        """Take one reading and drive until the next; False when exploration has ended."""
        self._sense(self._world.read())
        self._decide()
        if self.finished is not None:
            return False
        self._world.drive(self._command())
        return True

    def outcome(self) -> Exploration:
        """Return what has been learnt so far."""
        slam = self._rebuild()
        trajectory = slam.trajectory.transformed(self.world_from_map)
        coverage = Coverage(self.live.observed(), self.live.visited, self.live.footprint())
        truth = Trajectory(np.array(self._stamps_ns), np.array(self._truth))
        return Exploration(
            slam,
            self.world_from_map,
            trajectory,
            truth,
            tuple(self._scans),
            self.live.geometry,
            coverage,
            self.finished or Finished("interrupted"),
            drive_report(truth, self.live.geometry, self._world.collisions()),
        )

    def _sense(self, reading: Reading) -> None:
        """Localise, and put what is seen into the map."""
        self._backend.update(reading)
        map_from_robot = self._backend.map_from_robot()
        if self._last is None:
            self.world_from_map = self._start @ map_from_robot.inverse()
        else:
            self._dt_s = (reading.stamp_ns - self._last.stamp_ns) * 1e-9
        before, self.pose = self.pose, self.world_from_map @ map_from_robot
        self._moved |= self._jumped(before, reading)
        self._last = reading
        self._scans.append(reading.scan)
        self._stamps_ns.append(reading.stamp_ns)
        self._truth.append(self._world.truth().as_array())
        if self._rebuild_is_due():
            self._rebuild()
        else:
            self.live.add(reading.scan, self.pose)
            self.live.pass_over(np.array([[before.x, before.y], [self.pose.x, self.pose.y]]))
        self.live.stand_by(reading.scan, self.pose)

    def _jumped(self, before: Pose2, reading: Reading) -> bool:
        """Whether the backend moved the robot by more than it drove."""
        if self._last is None or self._last.odom_from_robot is None:
            return False
        if reading.odom_from_robot is None:
            return False
        step = self._last.odom_from_robot.between(reading.odom_from_robot)
        apart = (before @ step).between(self.pose)
        return math.hypot(apart.x, apart.y) > _JUMP_M or abs(apart.theta) > _JUMP_RAD

    def _rebuild_is_due(self) -> bool:
        """Now and then, and soon after a jump; the total cost stays linear in the readings."""
        soon = max(_REBUILD_READINGS // 3, self.readings // 20)
        jump = self._moved and self.readings - self._last_rebuild >= soon
        return jump or self.readings >= self._next_rebuild

    def _rebuild(self) -> SlamResult:
        """Make the map and what was covered anew from the corrected trajectory."""
        self._moved = False
        self._last_rebuild = self.readings
        self._next_rebuild = math.ceil(self.readings * _REBUILD_GROWTH) + _REBUILD_READINGS
        slam = self._backend.result()
        poses = slam.trajectory.transformed(self.world_from_map).poses
        self.live.clear()
        every = max(1, len(poses) // _MAX_RENDERED_SCANS)
        for scan, pose in zip(self._scans[::every], poses[::every], strict=True):
            self.live.add(scan, Pose2.from_array(pose))
        self.live.pass_over(poses[:, :2])
        return slam

    def _decide(self) -> None:
        """Ask for a new leg where the present one ends, is blocked or has grown old."""
        limit_s = self._config.mission_time_s
        if limit_s is not None and self.driven_s >= limit_s:
            self.finished = Finished("the mission time is over")
            return
        self._leg_age_s += self._dt_s
        self._watch()
        if self._backing > 0:
            return
        blocked = not self.follower.done and not self.live.is_clear(self._near_way())
        if self.follower.done or blocked or self._leg_age_s >= self._leg.review_s:
            self._ask(self.pose, self.live.coverage(), go_on=False)
        elif self._leg.more and self.follower.remaining_m(self.pose) < self._braking_m():
            way = np.concatenate([[[self.pose.x, self.pose.y]], self.follower.points_m[1:]])
            heading = math.atan2(*(way[-1] - way[-2])[::-1])
            end = Pose2(way[-1, 0], way[-1, 1], heading)
            self._ask(end, self.live.coverage(way), go_on=True)

    def _watch(self) -> None:
        """Give a leg up on which the robot does not get on."""
        moved_m = math.hypot(self.pose.x - self._still_at.x, self.pose.y - self._still_at.y)
        if moved_m > _STILL_M:
            self._still_at, self._still = self.pose, 0
        self._still += 1
        if self._still % _STILL_READINGS == 0:
            self.follower.stop()
        if self._still >= _MAX_STILL * _STILL_READINGS:
            self.finished = Finished("the robot does not get on")

    def _ask(self, pose: Pose2, coverage: CoverageGrid, *, go_on: bool) -> None:
        goal = self._goal(coverage, pose)
        if isinstance(goal, Finished) and not go_on:
            goal = self._squeeze(coverage, pose) or goal
        if isinstance(goal, Finished):
            self._leg = Leg(np.empty((0, 2)), more=False)
            if not go_on:
                self._finish(goal, coverage)
            return
        self._leg, self._leg_age_s = goal, 0.0
        if len(goal.points_m) < 2:
            self._leg = Leg(np.empty((0, 2)), more=False)
            if not go_on:
                self.follower.stop()
        elif go_on:
            self.follower.extend(goal.points_m)
        else:
            self.follower.follow(goal.points_m)

    def _squeeze(self, coverage: CoverageGrid, pose: Pose2) -> Leg | None:
        """Look for a way through a gap that the body just fits through, into a part unknown."""
        tight = self.live.coverage(tight=True)
        start = driving_cell(coverage.driving, pose.x, pose.y)
        if start is None or self._going_home:
            return None
        beyond = reachable(tight.driving.moves, start) & ~reachable(coverage.driving.moves, start)
        # A rim one cell or two wide all along the walls is no part of its own.
        rim = np.ones((5, 5), dtype=np.uint8)
        if not cv2.morphologyEx(beyond.astype(np.uint8), cv2.MORPH_OPEN, rim).any():
            return None
        goal = self._goal(tight, pose)
        return goal if isinstance(goal, Leg) and len(goal.points_m) > 1 else None

    def _goal(self, coverage: CoverageGrid, pose: Pose2) -> Leg | Finished:
        """Ask until there is a way to drive, for a goal may turn out to have none."""
        if self._going_home:
            return Finished("everything is known, back at the start")
        for _ in range(_MAX_ASKS):
            goal = self._explorer.next_goal(coverage, pose)
            if isinstance(goal, Finished) or len(goal.points_m) > 1:
                return goal
        return Leg(np.empty((0, 2)), more=False)

    def _finish(self, goal: Finished, coverage: CoverageGrid) -> None:
        """End here, or after one more look at the corrected map, or back at the start."""
        self.follower.stop()
        if self._last_rebuild != self.readings and not self._going_home:
            self._next_rebuild = self.readings
            if self._moved or self._last_rebuild < self.readings - _REBUILD_READINGS:
                self._rebuild()
                self._ask(self.pose, self.live.coverage(), go_on=False)
                return
        home = np.array([self._start.x, self._start.y])
        away_m = math.hypot(*(home - (self.pose.x, self.pose.y)))
        if self._config.return_to_start and not self._going_home and away_m > 0.05:
            way = way_between(coverage.driving, np.array([self.pose.x, self.pose.y]), home)
            if way is not None:
                self._going_home = True
                self.follower.follow(way)
                return
        self.finished = goal

    def _near_way(self) -> Floats:
        """The next stretch of the way (K, 2) [m], without where the robot is already."""
        points = self.follower.points_m[1:]
        here = np.array([self.pose.x, self.pose.y])
        away = points[0] - here
        length_m = math.hypot(*away)
        first = here + away * min(1.0, 0.1 / max(length_m, 1e-9))
        if length_m > _LOOK_AHEAD_M:
            return np.stack([first, here + away * (_LOOK_AHEAD_M / length_m)])
        along_m = length_m + np.concatenate(
            [[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))]
        )
        count = int(np.searchsorted(along_m, _LOOK_AHEAD_M)) + 1
        return np.concatenate([first[None], points[:count]])

    def _braking_m(self) -> float:
        speed, brakes = self._config.driving.speed_m_s, self._config.driving.acceleration_m_s2
        return speed * speed / (2.0 * brakes) + 2.0 * speed * self._dt_s

    def _command(self) -> DriveCommand:
        """Follow the way, but never into what the present scan shows."""
        assert self._last is not None
        dt_s = self._dt_s or 0.1
        if self._backing > 0:
            return self._back_off()
        command = self.follower.command(self.pose, dt_s)
        if command.speed_m_s <= 0.0:
            self._stuck = 0
            return command
        room_m = free_ahead_m(self._last.scan, self._config.driving.robot_radius_m)
        speed = max(0.0, min(command.speed_m_s, room_m / dt_s))
        if speed >= command.speed_m_s:
            self._stuck = 0
            return command
        self.follower.slow_down(speed)
        self._stuck += 1
        if self._stuck > _STUCK_READINGS:
            self._backing, self._stuck = _BACK_OFF_READINGS, 0
        share = speed / command.speed_m_s
        return DriveCommand(speed, command.turn_rate_rad_s * share)

    def _back_off(self) -> DriveCommand:
        """Drive back a little from where the map led astray."""
        assert self._last is not None
        self._backing -= 1
        self.follower.stop()
        room_m = free_ahead_m(self._last.scan, self._config.driving.robot_radius_m, behind=True)
        return DriveCommand(_BACK_OFF_M_S if room_m > 0.05 else 0.0, 0.0)
