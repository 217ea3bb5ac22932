# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Pose and map for driving, kept consistent with the corrections of the SLAM backend."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from slarm_graph.backend import SlamBackend, SlamResult, position_sds_m
from slarm_graph.config import ExploreConfig, MappingConfig
from slarm_graph.consistency import contradictions
from slarm_graph.exploration.live_map import LiveMap
from slarm_graph.geometry import Floats, Pose2
from slarm_graph.mapping import pose_rates
from slarm_graph.reading_log import ReadingLog
from slarm_graph.readings import Reading
from slarm_graph.trajectory import Trajectory

_JUMP_M: Final = 0.06
"""Correction of the robot's pose that makes the map be rendered anew: two driving cells."""
_JUMP_RAD: Final = math.radians(2.0)
"""At 3 m, the distance of what is driven by, two degrees are 0.1 m: two driving cells."""
_REBUILD_GROWTH: Final = 1.7
"""A geometric series: all renderings together take at most some two and a half times that of all
scans once."""
_REBUILD_READINGS: Final = 150
"""At least so many readings, 15 s at 10 Hz, between two renderings: the robot stops meanwhile."""
_STALE_SHARE: Final = 20
"""One part in so many of a drive is too little to render all of it anew for, jump or end: with it
all renderings take at most twenty times the last one."""
_JUDGED_GROWTH: Final = 1.1
"""A geometric series: all consistency checks together cost eleven times the last one, which takes a
second for 14,000 scans."""
_MAX_RENDERED_SCANS: Final = 10_000
"""With more, every second, third ... is rendered: a place is seen in hundreds of scans, and one
shows its walls."""


class Survey:
    """Localises and maps every reading; renders the map anew when old poses were corrected.

    Parameters
    ----------
    backend : SlamBackend
        Fresh; it sees every reading.
    config : ExploreConfig
    mapping : MappingConfig
    extent_m : (x_min, x_max, y_min, y_max)
        The rough boundary [m].
    start : Pose2
        `world_from_robot` at the first reading.
    log : ReadingLog
        Empty; grows with every reading.
    """

    def __init__(
        self,
        backend: SlamBackend,
        config: ExploreConfig,
        mapping: MappingConfig,
        *,
        extent_m: tuple[float, float, float, float],
        start: Pose2,
        log: ReadingLog,
    ) -> None:
        self._backend, self._start = backend, start
        self.log = log
        self.live = LiveMap(extent_m, config, mapping)
        self.world_from_map = self.pose = start
        self._believed: list[Floats] = []
        self._truth: list[Floats] = []
        self._heard: list[int] = []
        self._last: Reading | None = None
        self.dt_s = 0.0
        self._next_rebuild = _REBUILD_READINGS
        self._last_rebuild = 0
        self._corrected: SlamResult | None = None
        self._has_moved = False
        self.is_torn = False
        """Whether the map was inconsistent at the last check."""
        self._judged = 0

    @property
    def readings(self) -> int:
        """Readings taken so far."""
        return len(self.log)

    @property
    def steps(self) -> int:
        """Number of readings processed; that of the log once it has been read again."""
        return len(self._believed)

    @property
    def truth(self) -> Trajectory:
        """True `world_from_robot`, one pose per reading."""
        return Trajectory(self.log.stamps_ns, np.array(self._truth))

    @property
    def believed(self) -> Trajectory:
        """`world_from_robot` as estimated online, one pose per reading."""
        return Trajectory(self.log.stamps_ns, np.array(self._believed))

    @property
    def is_stale(self) -> bool:
        """Whether rendering the map anew might change it much."""
        since = self.readings - self._last_rebuild
        old = since > max(_REBUILD_READINGS, self.readings // _STALE_SHARE)
        return since > 0 and (self._has_moved or old)

    def kept_state(self) -> dict[str, object]:
        """Exclude from a snapshot what has its own, is read again, or can be made again."""
        kept = {k: v for k, v in vars(self).items() if k not in ("_backend", "log")}
        return {**kept, "_corrected": None}

    def take_in(self, reading: Reading, world_from_robot: Pose2) -> None:
        """Localise a reading and integrate its scan into the map; the true pose is only stored."""
        self._backend.update(reading)
        map_from_robot = self._backend.map_from_robot()
        if self._last is None:
            self.world_from_map = self._start @ map_from_robot.inverse()
        else:
            self.dt_s = (reading.stamp_ns - self._last.stamp_ns) * 1e-9
        before, self.pose = self.pose, self.world_from_map @ map_from_robot
        self._has_moved |= self._jumped(before, reading)
        self._last = reading
        self.log.append(reading)
        if reading.signals:
            self._heard.append(len(self._believed))
            here = [[self.pose.x, self.pose.y]]
            self.live.heard_m = np.concatenate([self.live.heard_m, here])
        self._believed.append(self.pose.as_array())
        self._truth.append(world_from_robot.as_array())
        if self._rebuild_is_due():
            self.rebuild()
        else:
            self.live.add(reading.scan, self.pose, pose_rates(self._latest_motion())[-1])
            self.live.pass_over(np.array([[before.x, before.y], [self.pose.x, self.pose.y]]))
        self.live.stand_by(reading.scan, self.pose)

    def rebuild(self) -> SlamResult:
        """Render map and coverage anew from the backend's corrected trajectory.

        Without a new reading the last result stands.
        """
        if self._corrected is not None and self._last_rebuild == self.readings:
            return self._corrected
        self._has_moved = False
        self._last_rebuild = self.readings
        self._next_rebuild = math.ceil(self.readings * _REBUILD_GROWTH) + _REBUILD_READINGS
        corrected = self._backend.result()
        if self.live.config.slam_rmse_m is None:
            self.live.shrink_by(position_rmse_m(corrected))
        every = max(1, self.readings // _MAX_RENDERED_SCANS)
        trajectory = corrected.trajectory.transformed(self.world_from_map)
        if self.is_torn or self.readings >= _JUDGED_GROWTH * self._judged:
            verdict = contradictions(self.log.scans, trajectory).verdict
            self._judged, self.is_torn = self.readings, verdict == "inconsistent"
        self.live.follow(self.log.scans, trajectory, every)
        self.live.heard_m = trajectory.poses[self._heard, :2]
        self._corrected = corrected
        return corrected

    def _latest_motion(self) -> Trajectory:
        """The last two poses as estimated online; one at first."""
        return Trajectory(self.log.latest_stamps_ns(2), np.array(self._believed[-2:]))

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
        """Whether to render anew: at growing intervals, soon after a jump; total cost is linear."""
        soon = max(_REBUILD_READINGS // 3, self.readings // _STALE_SHARE)
        jump = self._has_moved and self.readings - self._last_rebuild >= soon
        return jump or self.readings >= self._next_rebuild


def position_rmse_m(slam: SlamResult) -> float:
    """Root mean square error of positions by the backend's own covariances; 0 without them [m]."""
    sds_m = position_sds_m(slam)
    return 0.0 if sds_m is None else float(np.sqrt(np.mean(2.0 * sds_m**2)))
