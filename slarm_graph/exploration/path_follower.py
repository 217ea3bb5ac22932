# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Pure-pursuit path following of a polyline with a differential drive."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from slarm_graph.config import DrivingConfig
from slarm_graph.geometry import Floats, Pose2, wrap_angle
from slarm_graph.world import DriveCommand

_SHARP_RAD: Final = math.radians(30.0)
"""Bends sharper than this are turned on the spot, on which a round body needs no room."""
_ALIGNED_RAD: Final = math.radians(3.0)
"""Heading error at which a turn on the spot ends; half a lane's width is missed only after 2 m."""
_LOST_RAD: Final = math.radians(50.0)
"""With a greater heading error an arc back would leave the lane by more than a body's width: it
turns on the spot."""
_ARRIVED_M: Final = 0.008
"""A stop at a sharp corner comes this near to it: less than a cell, more than a step of control at
the crawl of arrival."""
_MIN_STEP_M: Final = 0.015
"""Pieces shorter than this have no direction of their own: below a cell of 0.025 m."""
_LOOKAHEAD_S: Final = 0.3
"""Of pure pursuit (Coulter 1992): three commands at 10 Hz; nearer it oscillates, farther it cuts
corners."""
_MIN_LOOKAHEAD_M: Final = 0.12
"""Of pure pursuit at a crawl: less than a body's radius, more than its tracking error by ten."""


class PathFollower:
    """Steers along a polyline by pure pursuit (Coulter 1992), one command per reading.

    It slows down so that no bend asks for more than the turn rate, brakes in time for sharp
    corners and for the end, and turns on the spot there.
    """

    def __init__(self, config: DrivingConfig) -> None:
        self._config = config
        self._speed_m_s = 0.0
        self._turning = False
        self.stop()

    @property
    def done(self) -> bool:
        """Whether the end has been reached, or there is no path."""
        return self._segment >= len(self._points) - 1

    @property
    def points_m(self) -> Floats:
        """Corners (K, 2) still ahead, beginning with the one behind the robot [m]."""
        return self._points[self._segment :]

    def follow(self, points_m: Floats) -> None:
        """Begin a new path (K, 2) at its first point."""
        points_m = _without_tiny_steps(points_m)
        self._points = points_m
        self._segment = 0
        self._along_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points_m, axis=0).T))])
        self._stops = np.append(np.flatnonzero(_is_sharp(points_m)) + 1, len(points_m) - 1)

    def extend(self, points_m: Floats) -> None:
        """Continue along points (K, 2), of which the first is the present end."""
        self.follow(np.concatenate([self.points_m, points_m[1:]]))

    def stop(self) -> None:
        """Forget the path."""
        self._turning = False
        self.follow(np.empty((0, 2)))

    def remaining_m(self, pose: Pose2) -> float:
        """Distance to drive to the end [m]."""
        if self.done:
            return 0.0
        end = self._points[self._segment + 1]
        rest_m = self._along_m[-1] - self._along_m[self._segment + 1]
        return math.hypot(end[0] - pose.x, end[1] - pose.y) + float(rest_m)

    def command(self, pose: Pose2, dt_s: float) -> DriveCommand:
        """Return the velocity to hold for the next `dt_s` seconds."""
        self._pass_corners(pose)
        if self.done:
            self._speed_m_s = 0.0
            return DriveCommand(0.0, 0.0)
        aim_x, aim_y, straight_m = self._aim(pose)
        bearing = wrap_angle(math.atan2(aim_y - pose.y, aim_x - pose.x) - pose.theta)
        if self._must_turn(bearing):
            self._speed_m_s = 0.0
            limit = self._config.turn_rate_rad_s
            return DriveCommand(0.0, min(limit, max(-limit, bearing / dt_s)))
        distance = math.hypot(aim_x - pose.x, aim_y - pose.y)
        curvature = 2.0 * math.sin(bearing) / max(distance, _MIN_LOOKAHEAD_M)
        self._speed_m_s = self._allowed_speed(curvature, straight_m, dt_s)
        return DriveCommand(self._speed_m_s, self._speed_m_s * curvature)

    def slow_down(self, speed_m_s: float) -> None:
        """Record that a slower speed than the last command's is driven."""
        self._speed_m_s = min(self._speed_m_s, speed_m_s)

    def _allowed_speed(self, curvature: float, straight_m: float, dt_s: float) -> float:
        c = self._config
        return max(
            0.0,
            min(
                c.speed_m_s,
                self._speed_m_s + c.acceleration_m_s2 * dt_s,
                math.sqrt(2.0 * c.acceleration_m_s2 * max(0.0, straight_m)),
                straight_m / dt_s,
                c.turn_rate_rad_s / max(abs(curvature), 1e-9),
            ),
        )

    def _must_turn(self, bearing: float) -> bool:
        if self._turning:
            self._turning = abs(bearing) > _ALIGNED_RAD
        elif abs(bearing) > _LOST_RAD:
            self._turning = True
        return self._turning

    def _pass_corners(self, pose: Pose2) -> None:
        """Move on to the next segment where the end of the present one has been reached."""
        while not self.done:
            corner = self._segment + 1
            sharp = corner in self._stops
            left_m = self._along_m[corner] - self._progress_m(pose)
            if left_m > (_ARRIVED_M if sharp else 0.0):
                return
            self._turning = self._turning or (sharp and corner + 1 < len(self._points))
            self._segment += 1

    def _progress_m(self, pose: Pose2) -> float:
        begin, end = self._points[self._segment], self._points[self._segment + 1]
        along = _unit(begin, end)
        done_m = (pose.x - begin[0]) * along[0] + (pose.y - begin[1]) * along[1]
        return float(self._along_m[self._segment] + done_m)

    def _aim(self, pose: Pose2) -> tuple[float, float, float]:
        """Look-ahead point [m], and the distance to the next sharp corner or the end [m].

        Before a sharp corner the point lies on the straight line beyond it.
        """
        progress_m = self._progress_m(pose)
        look_m = progress_m + max(_MIN_LOOKAHEAD_M, _LOOKAHEAD_S * self._speed_m_s)
        stop = int(self._stops[np.searchsorted(self._stops, self._segment, side="right")])
        stop_m = float(self._along_m[stop])
        segment = min(int(np.searchsorted(self._along_m, look_m, side="right")), stop) - 1
        begin, end = self._points[segment], self._points[segment + 1]
        along, past_m = _unit(begin, end), look_m - float(self._along_m[segment])
        x, y = float(begin[0]), float(begin[1])
        return x + past_m * along[0], y + past_m * along[1], stop_m - progress_m


def _without_tiny_steps(points: Floats) -> Floats:
    """Drop corners that are too near to the previous one to steer by."""
    kept = [0] if len(points) else []
    for i in range(1, len(points)):
        step = points[i] - points[kept[-1]]
        if math.hypot(step[0], step[1]) >= _MIN_STEP_M:
            kept.append(i)
    return points[kept]


def _is_sharp(points: Floats) -> NDArray[np.bool_]:
    """Which inner corners (K - 2,) of a polyline (K, 2) bend too much to be driven through."""
    if len(points) < 3:
        return np.zeros(0, dtype=np.bool_)
    step = np.diff(points, axis=0)
    dot = (step[1:] * step[:-1]).sum(axis=1)
    length = np.hypot(*step.T)
    return np.asarray(dot < math.cos(_SHARP_RAD) * length[1:] * length[:-1])


def _unit(begin: Floats, end: Floats) -> tuple[float, float]:
    dx, dy = float(end[0] - begin[0]), float(end[1] - begin[1])
    length = math.hypot(dx, dy)
    return (dx / length, dy / length) if length > 0.0 else (1.0, 0.0)
