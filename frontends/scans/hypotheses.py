# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Multi-hypothesis tracking of the robot's pose: one hypothesis as a rule, several in doubt.

A hypothesis is a sequence of matched poses together with the odometry filter they imply. Every scan
branches each hypothesis into its pose candidates; hypotheses that meet in one pose are merged,
improbable ones are pruned. So a slip or a jump is accepted when later scans agree with it, and a
false match to a crowd before the laser is not, since it contradicts itself.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from slarm_graph.frontends.scans.odometry_filter import (
    OdometryFilter,
    Prediction,
    mixture_covariance,
)
from slarm_graph.frontends.scans.pose_candidates import (
    NOTHING_KNOWN,
    PoseCandidate,
    PosePrior,
    are_same,
    likeliest_prediction,
    pose_update,
)
from slarm_graph.frontends.scans.significance import CHI2_1_PERMILLE
from slarm_graph.frontends.scans.small_pose import between3, squared_mahalanobis, transported3
from slarm_graph.geometry import Floats, Pose2

_PRUNE_LOG_ODDS = 30.0
"""Log odds against the best at which a hypothesis is pruned: more than the one scan of a slip or a
jump costs."""
_COMMIT_LOG_ODDS = math.log(100.0)
"""Log odds at which the best hypothesis is the right one but for one in a hundred."""
_MAX_HYPOTHESES = 4
"""Hypotheses kept: two candidates after each of two doubtful scans."""
STAYS_UNKNOWN = 0.8
"""Probability that after a scan that showed nothing of the local map the next one does not, either:
what hides it lasts for some scans. With 0.6 and 0.9 halls 103, 121 and ward 3 stay (0.043 to
0.052 m), hall 19 is 0.093 in place of 0.06; with 0.6 hall 115 is lost in one of two draws."""


@dataclass(slots=True)
class PathHypothesis:
    """One hypothesis of the robot's path.

    Parameters
    ----------
    odometry : OdometryFilter
        Velocity, odometry calibration and reliability under this hypothesis.
    pose : (3,) float64
        Last pose in the local map [m, m, rad].
    covariance : (3, 3) float64
        Of the pose, in the body frame, by the likeliest motion mode alone.
    mixture_covariance : (3, 3) float64
        Of the pose over all motion modes: while nothing is matched, odometry may have failed
        unnoticed.
    log_weight : float
        Unnormalised log posterior of the hypothesis.
    candidate : PoseCandidate or None
        The last scan's match; None where it was not matched.
    matched_pose : (3,) float64 or None
        Pose by the last match alone, without the prior.
    shows_map : bool
        Whether the last scan showed some of the local map.
    history : list of (3,) float64
        Poses since the hypotheses branched, the last one included.
    """

    odometry: OdometryFilter = field(default_factory=OdometryFilter)
    pose: Floats = field(default_factory=lambda: np.zeros(3))
    covariance: Floats = field(default_factory=lambda: np.zeros((3, 3)))
    mixture_covariance: Floats = field(default_factory=lambda: np.zeros((3, 3)))
    log_weight: float = 0.0
    candidate: PoseCandidate | None = None
    matched_pose: Floats | None = None
    shows_map: bool = True
    history: list[Floats] = field(default_factory=list)

    def predict(self, span_s: float, odom_from_robot: Pose2 | None, lag_s: float) -> PosePrior:
        """Predict the next scan's pose: the predicted motions, last pose's covariance included."""
        predictions = []
        for mode in self.odometry.predict(span_s, odom_from_robot, lag_s):
            covariance = mode.covariance + transported3(self.covariance, mode.motion)
            predictions.append(
                Prediction(mode.motion, covariance, mode.probability, mode.correlated_covariance)
            )
        factor = self.odometry.wheels.noise.match_variance_factor
        nothing_known = NOTHING_KNOWN if self.shows_map else STAYS_UNKNOWN
        return PosePrior(self.pose, tuple(predictions), factor, nothing_known)

    def branched(self) -> PathHypothesis:
        """Return an independent copy."""
        return replace(self, odometry=self.odometry.branched(), history=list(self.history))

    def update(self, candidate: PoseCandidate, prior: PosePrior, span_s: float) -> None:
        """Move to a pose candidate; update covariance, odometry filter and weight."""
        is_match = candidate.inliers > 0
        if is_match:
            updated = pose_update(candidate, prior, self.covariance)
            self.pose, self.covariance = updated.pose, updated.covariance
            self.mixture_covariance = self.covariance
            self.odometry.update_reliability(updated.match_motion, updated.match_covariance)
            if self.matched_pose is not None:
                motion = between3(self.matched_pose, candidate.pose)
                self.odometry.calibrate(motion, updated.nominal_variances)
            self.odometry.correct(span_s, updated.motion, updated.motion_covariance)
        else:
            motion = between3(self.pose, candidate.pose)
            excess = self.mixture_covariance - self.covariance
            self.pose = candidate.pose
            self.covariance = likeliest_prediction(candidate, prior).covariance
            spread = mixture_covariance(motion, prior.predictions)
            self.mixture_covariance = spread + transported3(excess, motion)
            self.odometry.wheels.interrupt()
            self.odometry.coast()
        self.shows_map = is_match
        self.candidate = candidate if is_match else None
        self.matched_pose = candidate.pose if is_match else None
        self.log_weight += candidate.log_posterior
        self.history.append(self.pose)


def branch(
    hypothesis: PathHypothesis, candidates: Sequence[PoseCandidate], prior: PosePrior, span_s: float
) -> list[PathHypothesis]:
    """Branch a hypothesis into its probable pose candidates (likeliest first), one each."""
    best = candidates[0].log_posterior
    probable = [c for c in candidates[:_MAX_HYPOTHESES] if c.log_posterior > best - _PRUNE_LOG_ODDS]
    branches = [hypothesis, *(hypothesis.branched() for _ in probable[1:])]
    for one, candidate in zip(branches, probable, strict=True):
        one.update(candidate, prior, span_s)
    return branches


def prune(hypotheses: Sequence[PathHypothesis]) -> list[PathHypothesis]:
    """Merge equal poses, drop improbable hypotheses; likeliest first, with a log weight of 0."""
    ranked = sorted(hypotheses, key=lambda h: -h.log_weight)
    best = ranked[0].log_weight
    kept: list[PathHypothesis] = []
    for hypothesis in ranked:
        if hypothesis.log_weight > best - _PRUNE_LOG_ODDS and not any(
            _are_same(hypothesis, k) for k in kept
        ):
            hypothesis.log_weight -= best
            kept.append(hypothesis)
    return kept[:_MAX_HYPOTHESES]


def _are_same(a: PathHypothesis, b: PathHypothesis) -> bool:
    """Whether two hypotheses are of one pose, and none takes for false what the other matched."""
    if not are_same(a.pose, b.pose):
        return False
    if a.shows_map == b.shows_map:
        return True
    apart = squared_mahalanobis(between3(a.pose, b.pose), a.covariance + b.covariance)
    return apart <= CHI2_1_PERMILLE


def is_unambiguous(hypotheses: Sequence[PathHypothesis]) -> bool:
    """Whether only one hypothesis (of those sorted by weight) is still probable."""
    return len(hypotheses) == 1 or hypotheses[1].log_weight < -_COMMIT_LOG_ODDS
