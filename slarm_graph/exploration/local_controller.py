# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Local controller: path following with collision avoidance on the present scan."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from slarm_graph.config import DrivingConfig
from slarm_graph.exploration.path_follower import PathFollower
from slarm_graph.geometry import Floats, Pose2
from slarm_graph.readings import LaserScan
from slarm_graph.world import DriveCommand

_LOOK_AHEAD_M: Final = 1.0
"""Of the path that is checked again at every scan: more than braking from 1 m/s takes, 0.2 m, and a
reaction."""
_STUCK_READINGS: Final = 8
"""Blocked readings before backing off: most of a second at 10 Hz."""
_BACK_OFF_READINGS: Final = 10
"""A second at 10 Hz: 0.1 m at the speed below, enough to turn in."""
_BACK_OFF_M_S: Final = -0.1
"""Slow, as the laser may not see behind the robot."""
_ROOM_BEHIND_M: Final = 0.05
"""Half of what is backed off at once has to be free."""
_STILL_M: Final = 0.05
"""Moving less than this is standing still: more than poses jitter, less than any lane is long."""
_STILL_READINGS: Final = 100
"""Ten seconds at 10 Hz: longer than any turn on the spot takes."""
_MAX_STILL: Final = 6
"""A minute of standing still, in which six paths were given up, will not end by itself."""
_GRAZE_M: Final = 0.01
"""Least clearance of the body when it passes obstacles."""
_AHEAD_M: Final = 0.06
"""Free distance beyond the next step: the braking distance from 0.6 m/s at 3 m/s^2."""
_BEARINGS_RAD: Final = np.radians([0, 2, -2, 4, -4, 6, -6, 8, -8, 10, -10])
"""Small deviations first, to either side; beyond ten degrees the planner has to find a path."""
_OUTLIERS: Final = 2
"""Of a scan's thousand points one or two may be outliers; three together are an obstacle."""


class LocalController:
    """Turns a path into commands, one per reading."""

    def __init__(self, config: DrivingConfig) -> None:
        self._config = config
        self.follower = PathFollower(config)
        self._stuck = self._backing = 0
        self._still_at, self._still = Pose2(), 0

    @property
    def is_backing_off(self) -> bool:
        """Whether it is driving backwards from a blocked position."""
        return self._backing > 0

    @property
    def has_given_up(self) -> bool:
        """Whether the robot has stood still for so long that nothing will help."""
        return self._still >= _MAX_STILL * _STILL_READINGS

    def watch(self, pose: Pose2) -> None:
        """Give up a path on which the robot makes no progress."""
        if math.hypot(pose.x - self._still_at.x, pose.y - self._still_at.y) > _STILL_M:
            self._still_at, self._still = pose, 0
        self._still += 1
        if self._still % _STILL_READINGS == 0:
            self.follower.stop()

    def path_ahead(self, pose: Pose2) -> Floats:
        """Return the next stretch of the path (K, 2) [m], from just ahead of the robot."""
        points = self.follower.points_m[1:]
        here = np.array([pose.x, pose.y])
        away = points[0] - here
        length_m = math.hypot(*away)
        first = here + away * min(1.0, 0.1 / max(length_m, 1e-9))
        if length_m > _LOOK_AHEAD_M:
            return np.stack([first, here + away * (_LOOK_AHEAD_M / length_m)])
        steps_m = np.hypot(*np.diff(points, axis=0).T)
        along_m = length_m + np.concatenate([[0.0], np.cumsum(steps_m)])
        count = int(np.searchsorted(along_m, _LOOK_AHEAD_M)) + 1
        return np.concatenate([first[None], points[:count]])

    def command(self, pose: Pose2, scan: LaserScan, dt_s: float) -> DriveCommand:
        """Return the velocity to hold for the next `dt_s` seconds."""
        if self._backing > 0:
            return self._back_off(scan)
        command = self.follower.command(pose, dt_s)
        if command.speed_m_s <= 0.0:
            self._stuck = 0
            return command
        command = self._around(command, scan, dt_s)
        radius_m, bearing_rad = self._config.robot_radius_m, 0.5 * command.turn_rate_rad_s * dt_s
        room_m = min(free_ahead_m(scan, radius_m, bearing_rad=b) for b in (0.0, bearing_rad))
        speed = max(0.0, min(command.speed_m_s, (room_m - _GRAZE_M) / dt_s))
        if speed >= command.speed_m_s:
            self._stuck = 0
            return command
        self.follower.slow_down(speed)
        self._stuck += 1
        if self._stuck > _STUCK_READINGS:
            self._backing, self._stuck = _BACK_OFF_READINGS, 0
        share = speed / command.speed_m_s
        return DriveCommand(speed, command.turn_rate_rad_s * share)

    def _around(self, command: DriveCommand, scan: LaserScan, dt_s: float) -> DriveCommand:
        """Deviate a little where the body would graze an obstacle."""
        radius_m = self._config.robot_radius_m + _GRAZE_M
        middle_rad = 0.5 * command.turn_rate_rad_s * dt_s
        needed_m = command.speed_m_s * dt_s + _AHEAD_M
        bend_rad = clear_bearing_rad(scan, radius_m, middle_rad, needed_m)
        if bend_rad == 0.0:
            return command
        limit = self._config.turn_rate_rad_s
        turn_rate = command.turn_rate_rad_s + bend_rad / dt_s
        return DriveCommand(command.speed_m_s, min(limit, max(-limit, turn_rate)))

    def _back_off(self, scan: LaserScan) -> DriveCommand:
        """Drive backwards a little from a blocked position."""
        self._backing -= 1
        self.follower.stop()
        room_m = free_ahead_m(scan, self._config.robot_radius_m, behind=True)
        return DriveCommand(_BACK_OFF_M_S if room_m > _ROOM_BEHIND_M else 0.0, 0.0)


def free_ahead_m(
    scan: LaserScan, radius_m: float, *, bearing_rad: float = 0.0, behind: bool = False
) -> float:
    """How far a disc can move along a bearing, or back, before it meets a point of the scan [m]."""
    points = scan.points_m() @ _rotation(bearing_rad)
    return float(_room_m(-points if behind else points, radius_m).min(initial=math.inf))


def clear_bearing_rad(
    scan: LaserScan, radius_m: float, bearing_rad: float, needed_m: float
) -> float:
    """Least deviation from a bearing at which a disc can move freely; 0 if there is none [rad].

    Up to two points of the scan in the way are taken for outliers.
    """
    points = scan.points_m()
    points = points[np.hypot(points[:, 0], points[:, 1]) < needed_m + 2.0 * radius_m]
    if len(points) <= _OUTLIERS:
        return 0.0
    for bend_rad in _BEARINGS_RAD:
        turned = points @ _rotation(bearing_rad + bend_rad)
        room_m = _room_m(turned, radius_m)
        if len(room_m) <= _OUTLIERS or np.partition(room_m, _OUTLIERS)[_OUTLIERS] >= needed_m:
            return float(bend_rad)
    return 0.0


def _room_m(points_m: Floats, radius_m: float) -> Floats:
    """How far a disc can move along +x before it meets each of the points in its way [m]."""
    x, y = points_m[:, 0], points_m[:, 1]
    near = (np.abs(y) < radius_m) & (x > 0.0)
    return np.asarray(x[near] - np.sqrt(radius_m**2 - y[near] ** 2))


def _rotation(angle_rad: float) -> Floats:
    """Matrix (2, 2) that turns row vectors by minus an angle."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([[c, -s], [s, c]])
