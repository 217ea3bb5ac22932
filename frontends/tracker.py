# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Lidar odometry: every scan matched against a local map of the last keyframes."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from slarm_graph.config import FrontendConfig
from slarm_graph.constraint import MatchResult
from slarm_graph.frontends.correlative import search_every_pose
from slarm_graph.frontends.gauss_newton import refine_motion
from slarm_graph.frontends.keyframes import LocalMap
from slarm_graph.frontends.odometry_filter import OdometryFilter, Prediction
from slarm_graph.frontends.scan_filter import points_for_matching
from slarm_graph.geometry import Floats, Pose2, compose
from slarm_graph.readings import Reading

_DOUBTFUL_SURPRISE = 16.0
_DOUBTFUL_SHIFT = 0.1
_DOUBTFUL_SHARE = 0.8
_BETTER = 0.02
_MAX_DESKEW_S = 1.0
_SEARCH_POINTS = 80
_FROM_PREDICTION = np.empty(0)


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


@dataclass(frozen=True, slots=True)
class _Refined:
    """A refined pose (3,) and its covariance (3, 3), compared with the prediction.

    `surprise` is in squared sigmas, `shift` the distance [m] plus the angle [rad].
    """

    pose: Floats
    covariance: Floats
    score: float
    inliers: int
    iterations: int
    surprise: float
    shift: float


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
        self._local_from_robot = Pose2()
        self._last_stamp_ns: int | None = None
        self._usual_score = 0.0

    def track(self, reading: Reading) -> TrackedScan:
        """Follow the robot to the next reading."""
        first = self._last_stamp_ns is None
        span_s = (reading.stamp_ns - (self._last_stamp_ns or reading.stamp_ns)) * 1e-9
        predictions = self._filter.predict(span_s, reading.odom_from_robot)
        rate = predictions[0].motion / span_s if 0.0 < span_s < _MAX_DESKEW_S else np.zeros(3)
        points = points_for_matching(reading.scan, self._config, rate)
        match = self._match(points, predictions)
        motion = self._local_from_robot.between(match.target_from_source)
        if not first:
            self._filter.correct(span_s, motion, match.covariance)
        self._local_from_robot = match.target_from_source
        self._last_stamp_ns = reading.stamp_ns
        is_keyframe = len(points) >= self._config.matching.min_points and self._map.wants(
            self._local_from_robot
        )
        if is_keyframe:
            self._map.add(points, self._local_from_robot)
        return TrackedScan(
            reading.stamp_ns,
            points,
            self._local_from_robot,
            motion,
            match.covariance,
            match,
            reading.odom_from_robot,
            is_keyframe,
        )

    def _match(self, points: Floats, predictions: tuple[Prediction, ...]) -> MatchResult:
        """Align points with the local map, starting from (and leaning on) what is expected."""
        settings = self._config.matching
        best = predictions[0]
        if self._map.grid is None:
            return MatchResult(self._local_from_robot, best.covariance, reason="first scan")
        if len(points) < settings.min_points:
            expected = self._local_from_robot @ Pose2.from_array(best.motion)
            return MatchResult(expected, best.covariance, reason=f"only {len(points)} returns")
        found: _Refined | None = None
        for prediction in predictions:
            other = self._refine(points, prediction)
            if found is None or other.score > found.score + _BETTER:
                found = other
            if not self._is_doubtful(found):
                break
        assert found is not None
        if self._is_doubtful(found):
            found = self._search(points, predictions, found)
        return self._conclude(found, predictions)

    def _conclude(self, found: _Refined, predictions: tuple[Prediction, ...]) -> MatchResult:
        if found.score < self._config.matching.min_score:
            best = predictions[0]
            expected = self._local_from_robot @ Pose2.from_array(best.motion)
            return MatchResult(
                expected,
                best.covariance,
                found.score,
                found.inliers,
                found.iterations,
                f"score {found.score:.2f} is too low",
            )
        usual = self._usual_score or found.score
        self._usual_score = usual + 0.05 * (found.score - usual)
        return MatchResult(
            Pose2.from_array(found.pose),
            found.covariance,
            found.score,
            found.inliers,
            found.iterations,
        )

    def _refine(
        self, points: Floats, prediction: Prediction, start: Floats | None = None
    ) -> _Refined:
        """Refine from the prediction, or from another start (3,) leaning on the prediction."""
        grid, settings = self._map.grid, self._config.matching
        assert grid is not None
        return _Refined(
            *refine_motion(
                grid.values,
                grid.origin_x_m,
                grid.origin_y_m,
                grid.resolution_m,
                points,
                self._local_from_robot.as_array(),
                prediction.motion,
                prediction.covariance,
                _FROM_PREDICTION if start is None else start,
                (grid.sigma_m / settings.point_sigma_m) ** 2,
                settings.max_iterations,
                grid.sigma_m,
            )
        )

    def _is_doubtful(self, found: _Refined) -> bool:
        """Whether the scan fits worse than usual, or fits far from where it was expected."""
        usual = max(_DOUBTFUL_SHARE * self._usual_score, self._config.matching.min_score)
        is_far = found.surprise > _DOUBTFUL_SURPRISE and found.shift > _DOUBTFUL_SHIFT
        return found.score < usual or is_far

    def _search(
        self, points: Floats, predictions: tuple[Prediction, ...], found: _Refined
    ) -> _Refined:
        """Look for a better place in the windows the predictions allow."""
        grid = self._map.grid
        assert grid is not None
        few = points[:: max(1, len(points) // _SEARCH_POINTS)]
        far = max(float(np.percentile(np.hypot(few[:, 0], few[:, 1]), 75)), 1.0)
        for prediction in predictions:
            sigma = np.sqrt(np.diag(prediction.covariance))
            start = compose(self._local_from_robot.as_array(), prediction.motion)
            reach_m = min(max(4.0 * float(sigma[:2].max()), 0.3), 1.0)
            reach_rad = min(max(4.0 * float(sigma[2]), 0.2), 0.7)
            step_rad = grid.resolution_m / far
            turn, col, row, _ = search_every_pose(
                grid.values,
                (start[:2] - [grid.origin_x_m, grid.origin_y_m]) / grid.resolution_m,
                few / grid.resolution_m,
                start[2],
                step_rad,
                math.ceil(reach_m / grid.resolution_m),
                math.ceil(reach_rad / step_rad),
            )
            start += [col * grid.resolution_m, row * grid.resolution_m, turn * step_rad]
            loose = Prediction(prediction.motion, 4.0 * predictions[-1].covariance)
            other = self._refine(points, loose, start)
            if other.score > found.score + _BETTER:
                found = other
        return found
