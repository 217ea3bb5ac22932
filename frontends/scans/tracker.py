# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Lidar odometry: every scan matched against a local map of the last keyframes.

A scan that takes time is matched in the middle of its sweep, where an error of the velocity it was
deskewed with cancels; the pose at its first beam follows from the velocity that comes out.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from slarm_graph.config import FrontendConfig
from slarm_graph.consistency import clear_beams
from slarm_graph.constraint import MatchResult
from slarm_graph.counts import count_of
from slarm_graph.frontends.scans.hypotheses import PathHypothesis, branch, is_unambiguous, prune
from slarm_graph.frontends.scans.local_map import LocalMap
from slarm_graph.frontends.scans.local_matching import LocalMatcher
from slarm_graph.frontends.scans.moving_returns import (
    certain_within_m,
    clear_sectors,
)
from slarm_graph.frontends.scans.pose_candidates import PoseCandidate, PosePrior
from slarm_graph.frontends.scans.refinement import chosen_refinement
from slarm_graph.frontends.scans.scan_filter import points_for_matching
from slarm_graph.frontends.scans.scan_fit import scan_fit
from slarm_graph.frontends.scans.small_pose import between3, compose3
from slarm_graph.frontends.scans.wheel_motion import WheelMotion
from slarm_graph.geometry import Floats, Pose2
from slarm_graph.readings import LaserScan, Reading

_MAX_SWEEP_S = 1.0
"""Longer sweeps are no laser's (10 to 200 ms): their stamps are wrong."""
_MISTIMED_M, _MISTIMED_RAD = 0.01, 0.01
"""Change of the sweep's motion [m, rad] above which it is deskewed again: half a laser's noise of
0.02 m, and twice that 4 m away."""
_MAX_UNMATCHED = 5
"""Unmatched scans in a row after which the local map is restarted: half a second at 10 Hz, in which
somebody may have passed close by."""
_COMMIT_WITHIN_M = 1.0
"""Distance driven after which the tracker commits to the best hypothesis: beyond, the local map no
longer covers what is seen. The shortest of all hypotheses' distances counts, lest a jump decide for
itself by its length. Twice as much makes a flat 19 % worse (mean of four) and a ward of identical
rooms 34 % (of two); five others stay."""


@dataclass(frozen=True, slots=True)
class TrackedScan:
    """A scan with its pose in the smooth local frame (odom, not map).

    Parameters
    ----------
    stamp_ns : int
    points_m : (K, 2) float64
        Returns in the robot's frame at the stamp, range-filtered, deskewed and thinned, without
        small objects where keyframes have looked through [m].
    local_from_robot : Pose2
        Lidar odometry: drifts, never jumps.
    motion : Pose2
        Previous scan's robot frame from this one's.
    local_covariance : (3, 3) float64
        Of `local_from_robot` on the present local map, in the body frame: that of the last match,
        plus the motion uncertainty accumulated since.
    match : MatchResult
        Falsy with a reason when the scan was not matched and the prediction was kept.
    odom_from_robot : Pose2 or None
        As given.
    is_keyframe : bool
        Whether the scan joined the local map.
    wheels : WheelMotion or None
        `motion` by odometry alone, calibrated.
    revised : tuple of R (3,) float64
        Corrected `local_from_robot` of the R scans before: none as a rule, some where this scan has
        made another hypothesis the best.
    lag_covariance : (3, 3) float64
        Of the motion from the stamp to the middle of the sweep, where `points_m` were matched.
        Independent per scan: it does not accumulate along a path.
    is_ambiguous : bool
        Whether the scan has several probable pose candidates, which later scans may decide between.
    clear_ends_m : (M, 2) float64
        Of a keyframe: how far beams reach that have met nothing, in the frame of `points_m` [m].
    """

    stamp_ns: int
    points_m: Floats
    local_from_robot: Pose2
    motion: Pose2
    local_covariance: Floats
    match: MatchResult
    odom_from_robot: Pose2 | None
    is_keyframe: bool
    wheels: WheelMotion | None = None
    revised: tuple[Floats, ...] = ()
    lag_covariance: Floats = field(default_factory=lambda: np.zeros((3, 3)))
    is_ambiguous: bool = False
    clear_ends_m: Floats = field(default_factory=lambda: np.zeros((0, 2)))


class ScanTracker:
    """Lidar odometry by multi-hypothesis scan-to-map matching against the last keyframes."""

    def __init__(self, config: FrontendConfig) -> None:
        self._config = config
        self._map = LocalMap(config.keyframes, config.matching)
        self._matcher = LocalMatcher(config.matching, chosen_refinement(config, self._map))
        self._hypotheses = [PathHypothesis()]
        self._last_stamp_ns: int | None = None
        self._unmatched_scans = 0
        self._ambiguous_m = 0.0
        self._last_history: list[Floats] = []
        self._revised: tuple[Floats, ...] = ()
        self._previous_pose: Floats | None = None
        self._is_ambiguous = False
        self._returns = np.zeros(2, dtype=np.int64)

    @property
    def moving_share(self) -> float:
        """Share of the returns that were not matched, being on something that moves."""
        every, moving = self._returns.tolist()
        return moving / every if every else 0.0

    def track(self, reading: Reading) -> TrackedScan:
        """Track the robot's pose to the next reading."""
        scan, best = reading.scan, self._hypotheses[0]
        last_ns = reading.stamp_ns if self._last_stamp_ns is None else self._last_stamp_ns
        span_s = (reading.stamp_ns - last_ns) * 1e-9
        sweep_s = self._sweep_s(scan)
        middle = 0.5 * (len(scan.ranges_m) - 1) if sweep_s else 0.0
        priors = [
            h.predict(span_s, reading.odom_from_robot, 0.5 * sweep_s) for h in self._hypotheses
        ]
        rate = best.odometry.rate(priors[0].predictions[0].motion, span_s)
        expected, certain_m = self._expected(priors)
        points, returns = self._points(scan, rate, middle, expected, certain_m)
        candidates = self._candidates(points, priors)
        if sweep_s:
            motion = between3(priors[0].base, candidates[0][0].pose)
            new_rate = best.odometry.rate(motion, span_s)
            change = np.abs(new_rate - rate) * sweep_s
            rate = new_rate
            if max(change[0], change[1]) > _MISTIMED_M or change[2] > _MISTIMED_RAD:
                points, returns = self._points(scan, rate, middle, expected, certain_m)
                candidates = self._candidates(points, priors)
        self._update_hypotheses(candidates, priors, span_s)
        self._last_stamp_ns = reading.stamp_ns
        if sweep_s:
            pose = self._hypotheses[0].pose
            points, returns = self._points(scan, rate, middle, pose, certain_m)
        self._returns += [returns, returns - len(points)]
        return self._tracked(reading, points, rate if sweep_s else None, middle)

    def _expected(self, priors: Sequence[PosePrior]) -> tuple[Floats, float]:
        """Return the likeliest pose, and the range [m] up to which it says what moves."""
        first, *others = priors
        pose = compose3(first.base, first.predictions[0].motion)
        return pose, 0.0 if others else certain_within_m(first.predictions)

    def _points(
        self, scan: LaserScan, rate: Floats, middle: float, pose: Floats, certain_m: float
    ) -> tuple[Floats, int]:
        """Return the thinned returns without what has moved, and how many they are with it."""
        points = points_for_matching(scan, self._config, rate, middle)
        static = self._map.static(points, pose, certain_m) if certain_m > 0.0 else points
        return static, len(points)

    def _candidates(self, points: Floats, priors: Sequence[PosePrior]) -> list[list[PoseCandidate]]:
        """Pose candidates by hypothesis; relocalise after 0, 1, 2, 4, 8, ... unmatched scans."""
        relocalise = not self._unmatched_scans & (self._unmatched_scans - 1)
        single = len(priors) == 1
        return [
            self._matcher.candidates(points, self._map, p, relocalise=relocalise, single=single)
            for p in priors
        ]

    def _update_hypotheses(
        self,
        candidates: Sequence[Sequence[PoseCandidate]],
        priors: Sequence[PosePrior],
        span_s: float,
    ) -> None:
        """Branch every hypothesis into its candidates, prune; commit if unambiguous or too far."""
        branches: list[PathHypothesis] = []
        for hypothesis, own, prior in zip(self._hypotheses, candidates, priors, strict=True):
            branches += branch(hypothesis, own, prior, span_s)
        self._is_ambiguous = len(branches) > 1
        self._hypotheses = prune(branches)
        best = self._hypotheses[0]
        changed = any(map(_differ, best.history[:-1], self._last_history))
        self._revised = tuple(best.history[:-1]) if changed else ()
        self._unmatched_scans = 0 if best.candidate else self._unmatched_scans + 1
        unambiguous = is_unambiguous(self._hypotheses)
        if not unambiguous:
            self._ambiguous_m += min(map(_last_step_m, self._hypotheses))
        if unambiguous or self._ambiguous_m > _COMMIT_WITHIN_M:
            self._commit()
        self._last_history = list(best.history)

    def _commit(self) -> None:
        """Keep the best hypothesis only; the spread of the others is added to its covariance."""
        best = self._hypotheses[0]
        if len(self._hypotheses) > 1:
            spread = sum(
                math.exp(h.log_weight) * np.outer(d, d)
                for h in self._hypotheses[1:]
                for d in (between3(best.pose, h.pose),)
            )
            ambiguity = spread / sum(math.exp(h.log_weight) for h in self._hypotheses)
            best.covariance = best.covariance + ambiguity
            best.mixture_covariance = best.mixture_covariance + ambiguity
        self._hypotheses = [best]
        best.history, best.log_weight, self._ambiguous_m = [best.pose], 0.0, 0.0

    def _tracked(
        self, reading: Reading, points: Floats, rate: Floats | None, middle: float
    ) -> TrackedScan:
        best, scan = self._hypotheses[0], reading.scan
        pose, lag = Pose2.from_array(best.pose), np.zeros((3, 3))
        if rate is not None:
            middle_from_first = Pose2.from_array(-rate * scan.time_increment_s * middle)
            pose = pose @ middle_from_first
            points = middle_from_first.inverse().transform(points)
            lag = best.odometry.lag_covariance(middle * scan.time_increment_s)
        current = pose.as_array()
        previous = self._revised[-1] if self._revised else self._previous_pose
        self._previous_pose = current
        candidate = best.candidate
        match = MatchResult(
            pose,
            best.covariance,
            candidate.score if candidate else 0.0,
            candidate.inliers if candidate else 0,
            candidate.iterations if candidate else 0,
            ""
            if candidate
            else _failure_reason(self._map, points, self._config.matching.min_points),
        )
        is_keyframe = self._add_keyframe(points, pose, candidate, scan, rate)
        clear = (
            points_for_matching(clear_beams(scan), self._config, rate)
            if is_keyframe
            else points[:0]
        )
        return TrackedScan(
            reading.stamp_ns,
            points,
            pose,
            Pose2.from_array(between3(current if previous is None else previous, current)),
            best.mixture_covariance,
            match,
            reading.odom_from_robot,
            is_keyframe,
            best.odometry.wheel_motion(),
            self._revised,
            lag,
            self._is_ambiguous,
            clear,
        )

    def _sweep_s(self, scan: LaserScan) -> float:
        """Time from the first beam to the last [s]; 0 where it is unknown or not to be deskewed."""
        sweep_s = max(len(scan.ranges_m) - 1, 0) * scan.time_increment_s
        return sweep_s if self._config.deskew and 0.0 < sweep_s < _MAX_SWEEP_S else 0.0

    def _add_keyframe(
        self,
        points: Floats,
        pose: Pose2,
        candidate: PoseCandidate | None,
        scan: LaserScan,
        rate: Floats | None,
    ) -> bool:
        """Add the scan to the local map when the robot has moved enough since the last keyframe.

        Unmatched and ambiguous scans are not added; after several unmatched scans in a row the
        local map is restarted. Every unambiguous match updates the fit model.
        """
        if len(points) < self._config.matching.min_points:
            return False
        if self._unmatched_scans >= _MAX_UNMATCHED:
            self._commit()
            self._map.clear()
            self._unmatched_scans = 0
        if self._map.grid is None:
            self._hypotheses[0].shows_map = True
        else:
            if candidate is None or len(self._hypotheses) > 1:
                return False
            fit = scan_fit(points, pose.as_array(), self._map, self._matcher.true_fit.mean)
            self._matcher.true_fit.learn(fit)
            if not self._map.is_keyframe_due(pose):
                return False
        self._map.add(points, pose, clear_sectors(scan, self._config.max_range_m, rate))
        return True


def _last_step_m(hypothesis: PathHypothesis) -> float:
    """Distance between a hypothesis' last two poses [m]; 0 where it has one only."""
    if len(hypothesis.history) < 2:
        return 0.0
    x, y, _ = (hypothesis.history[-1] - hypothesis.history[-2]).tolist()
    return math.hypot(x, y)


def _differ(a: Floats, b: Floats) -> bool:
    return a is not b and not np.array_equal(a, b)


def _failure_reason(local_map: LocalMap, points: Floats, min_points: int) -> str:
    if local_map.grid is None:
        return "first scan"
    if len(points) < min_points:
        return f"only {count_of(len(points), 'return')}"
    return "fits at no pose that is possible"
