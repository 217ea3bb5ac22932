# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Lidar odometry: every scan matched against a local map of the last keyframes.

A scan that takes time is matched in the middle of its sweep, where an error of the velocity it was
deskewed with cancels; the pose at its first beam follows from the velocity that comes out.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from slarm_graph.config import FrontendConfig
from slarm_graph.constraint import MatchResult
from slarm_graph.frontends.scans.keyframes import LocalMap
from slarm_graph.frontends.scans.local_matching import LocalMatcher
from slarm_graph.frontends.scans.odometry_filter import OdometryFilter
from slarm_graph.frontends.scans.scan_filter import points_for_matching
from slarm_graph.geometry import Floats, Pose2
from slarm_graph.readings import LaserScan, Reading

_MAX_SWEEP_S = 1.0
_MISTIMED_M = 0.01
_MISTIMED_RAD = 0.01
_GIVE_UP = 5


@dataclass(frozen=True, slots=True)
class TrackedScan:
    """A scan with its place in the smooth local frame.

    Parameters
    ----------
    stamp_ns : int
    points_m : (K, 2) float64
        Returns in the robot's frame at the stamp, range-filtered, deskewed and thinned [m].
    local_from_robot : Pose2
        Lidar odometry: drifts, never jumps.
    motion : Pose2
        Previous scan's robot frame from this one's.
    motion_covariance : (3, 3) float64
        Of `motion`, in this scan's body frame.
    match : MatchResult
        Falsy with a reason when the scan was not matched and the prediction was kept.
    odom_from_robot : Pose2 or None
        As given.
    is_keyframe : bool
        Whether the scan joined the local map.
    """

    stamp_ns: int
    points_m: Floats
    local_from_robot: Pose2
    motion: Pose2
    motion_covariance: Floats
    match: MatchResult
    odom_from_robot: Pose2 | None
    is_keyframe: bool


class ScanTracker:
    """Follows the robot by matching every scan against the last keyframes.

    Parameters
    ----------
    config : FrontendConfig
    """

    def __init__(self, config: FrontendConfig) -> None:
        self._config = config
        self._filter = OdometryFilter()
        self._map = LocalMap(config.keyframes, config.matching)
        self._matcher = LocalMatcher(config.matching)
        self._local_from_robot = Pose2()
        self._local_from_middle = Pose2()
        self._last_stamp_ns: int | None = None

    def track(self, reading: Reading) -> TrackedScan:
        """Follow the robot to the next reading."""
        scan, previous, base = reading.scan, self._local_from_robot, self._local_from_middle
        span_s = (reading.stamp_ns - (self._last_stamp_ns or reading.stamp_ns)) * 1e-9
        sweep_s = self._sweep_s(scan)
        predictions = self._filter.predict(span_s, reading.odom_from_robot, 0.5 * sweep_s)
        rate = self._filter.rate(predictions[0].motion, span_s)
        middle = 0.5 * (len(scan.ranges_m) - 1) if sweep_s else 0.0
        points = points_for_matching(scan, self._config, rate, middle)
        match = self._matcher.match(points, self._map.grid, base, predictions)
        if sweep_s and match:
            found = self._filter.rate(base.between(match.target_from_source).as_array(), span_s)
            off = np.abs(found - rate) * sweep_s
            rate = found
            if max(off[0], off[1]) > _MISTIMED_M or off[2] > _MISTIMED_RAD:
                points = points_for_matching(scan, self._config, rate, middle)
                match = self._matcher.match(points, self._map.grid, base, predictions)
        if match:
            moved = base.between(match.target_from_source)
            self._filter.correct(span_s, moved, match.covariance)
        elif self._last_stamp_ns is not None:
            self._filter.coast()
        self._local_from_middle = match.target_from_source
        if sweep_s:
            match, points = self._at_first_beam(scan, match, rate, middle)
            unsure = self._filter.lag_covariance(0.5 * sweep_s)
            match = replace(match, covariance=match.covariance + unsure)
        self._local_from_robot = match.target_from_source
        self._last_stamp_ns = reading.stamp_ns
        return TrackedScan(
            reading.stamp_ns,
            points,
            self._local_from_robot,
            previous.between(self._local_from_robot),
            match.covariance,
            match,
            reading.odom_from_robot,
            self._keep(points),
        )

    def _sweep_s(self, scan: LaserScan) -> float:
        """Time from the first beam to the last [s]; 0 where it is unknown or not to be undone."""
        sweep_s = max(len(scan.ranges_m) - 1, 0) * scan.time_increment_s
        return sweep_s if self._config.deskew and 0.0 < sweep_s < _MAX_SWEEP_S else 0.0

    def _at_first_beam(
        self, scan: LaserScan, match: MatchResult, rate: Floats, middle: float
    ) -> tuple[MatchResult, Floats]:
        """Carry a match in the middle of the sweep back to the scan's stamp."""
        back = Pose2.from_array(-rate * scan.time_increment_s * middle)
        pose = match.target_from_source @ back
        points = back.inverse().transform(points_for_matching(scan, self._config, rate, middle))
        return replace(match, target_from_source=pose), points

    def _keep(self, points: Floats) -> bool:
        """Add the scan to the local map when the robot has moved on since the last one.

        What was not placed is not added; after several such scans a new map is begun.
        """
        if len(points) < self._config.matching.min_points:
            return False
        if self._matcher.lost >= _GIVE_UP:
            self._map.clear()
            self._matcher.lost = 0
        if self._matcher.lost or not self._map.wants(self._local_from_robot):
            return False
        self._map.add(points, self._local_from_robot)
        return True
