# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Pose candidates of a scan, the motion prior on them, and their posterior."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from slarm_graph.frontends.scans.local_map import LocalMap
from slarm_graph.frontends.scans.odometry_filter import MotionMixture, Prediction
from slarm_graph.frontends.scans.scan_fit import FalseMatchFit, TrueMatchFit, patch_count, scan_fit
from slarm_graph.frontends.scans.significance import CHI2_1_PERMILLE
from slarm_graph.frontends.scans.small_matrix import (
    add3,
    invert3,
    matmul3,
    matvec3,
    scaled3,
    subtract3,
    symmetric3,
)
from slarm_graph.frontends.scans.small_pose import (
    BASIN_COVARIANCE,
    between3,
    compose3,
    log_density,
    log_det_2pi,
    log_student_t,
    squared_mahalanobis,
)
from slarm_graph.geometry import Floats
from slarm_graph.kernels import kernel

_KEEPS_INVERTIBLE = np.diag([0.01, 0.01, 0.01])
"""Information of 10 m and 10 rad: what a scan does not constrain stays uncertain, but finite."""
_VAGUE_M, _VAGUE_RAD = 0.1, 0.1
"""Standard deviations from which a prediction is vague: beyond them refinement may converge to
another optimum than the nearest."""
NOTHING_KNOWN = 0.01
"""Prior probability that scans begin to show nothing of the local map: a crowd, a lift, a door
passed."""
_MOST_EVIDENCE = 25.0
"""Cap on one scan's log-likelihood ratio [nat]: walls are alike more often than by chance."""
_SAME_M, _SAME_RAD = 0.1, 0.05
"""Poses nearer than this are merged: twice the fall-off of the likelihood."""


@dataclass(frozen=True, slots=True)
class PoseCandidate:
    """A candidate pose of a scan: a local optimum of the scan match, or a prediction unmatched.

    Parameters
    ----------
    pose : (3,) float64
        In the local map, by the match alone [m, m, rad].
    information : (3, 3) float64
        Of the match, without the prior, in the pose's body frame.
    score : float
        Mean likelihood of the returns, 0 to 1.
    inliers, iterations : int
        0 inliers for a candidate without a match.
    log_posterior : float
        Up to a constant that all candidates of a scan share.
    fit : float or None
        `scan_fit` at the pose; None where it was not computed yet.
    """

    pose: Floats
    information: Floats
    score: float
    inliers: int
    iterations: int
    log_posterior: float = 0.0
    fit: float | None = None
    evidence: float = 0.0

    def scan_fit(self, points: Floats, local_map: LocalMap, true_fit: TrueMatchFit) -> float:
        """Return `scan_fit` of the scan (K, 2) at this pose."""
        return (
            scan_fit(points, self.pose, local_map, true_fit.mean) if self.fit is None else self.fit
        )


@dataclass(frozen=True, slots=True)
class PosePrior:
    """Prior of a scan's pose: a Gaussian mixture of motions, and what is known of the match.

    Parameters
    ----------
    base : (3,) float64
        Last pose in the local map.
    predictions : tuple of Prediction
        Mixture components: motions since then, the last pose's covariance included.
    match_variance_factor : (3,) float64
        Actual over nominal variance of a match, per body axis.
    nothing_known : float
        Probability that the scan shows nothing of the local map.
    false_fit : FalseMatchFit
        Distribution of the scan fit at false matches.
    """

    base: Floats
    predictions: tuple[Prediction, ...]
    match_variance_factor: Floats
    nothing_known: float = NOTHING_KNOWN
    false_fit: FalseMatchFit = field(default_factory=lambda: FalseMatchFit(0.0, 1.0))
    mixture: MotionMixture = field(init=False, compare=False)
    """Base and predictions, for compiled code."""

    def __post_init__(self) -> None:
        predictions = self.predictions
        mixture = MotionMixture(
            self.base,
            np.array([p.motion for p in predictions]),
            np.array([p.covariance for p in predictions]),
            np.array([p.probability for p in predictions]),
            np.array([p.correlated_covariance for p in predictions]),
        )
        object.__setattr__(self, "mixture", mixture)

    def covariance_of(self, information: Floats) -> Floats:
        """Actual covariance (3, 3) of a match of nominal information (3, 3)."""
        return np.asarray(_inflated(information, self.match_variance_factor))


@kernel
def nominal_covariance(information: Floats) -> Floats:
    """Covariance (3, 3) by a match's curvature; 10 m and 10 rad where it is unconstrained."""
    return invert3(add3(information, _KEEPS_INVERTIBLE))


@kernel
def _inflated(information: Floats, factor: Floats) -> Floats:
    """Nominal covariance (3, 3) with its variances scaled by factors (3,)."""
    covariance = nominal_covariance(information)
    for row in range(3):
        for col in range(3):
            covariance[row, col] *= math.sqrt(factor[row]) * math.sqrt(factor[col])
    return covariance


def with_posterior(
    candidate: PoseCandidate,
    points: Floats,
    local_map: LocalMap,
    prior: PosePrior,
    true_fit: TrueMatchFit,
) -> PoseCandidate:
    """Compute a candidate's posterior: the likelihood ratio of its fit times the motion prior.

    A match that is uncertain, such as along a corridor, keeps its covariance only if the scan fits
    as well at the fused pose, between match and prediction; else it is as certain as its basin.
    """
    motion = between3(prior.base, candidate.pose)
    covariance = prior.covariance_of(candidate.information)
    fit = candidate.scan_fit(points, local_map, true_fit)
    fused, _ = _kalman_update(candidate.pose, covariance, prior.mixture)
    if not are_same(candidate.pose, fused):
        loss = fit - scan_fit(points, fused, local_map, true_fit.mean)
        covariance = BASIN_COVARIANCE if loss > true_fit.sigma(patch_count(points)) else covariance
    evidence = true_fit.log_density(fit, patch_count(points)) - prior.false_fit.log_density(fit)
    evidence = min(evidence, _MOST_EVIDENCE)
    posterior = evidence + log_prior(motion, covariance, prior) + math.log1p(-prior.nothing_known)
    return replace(candidate, log_posterior=posterior)


def unmatched_candidate(prediction: Prediction, prior: PosePrior) -> PoseCandidate:
    """Candidate at a predicted pose for a scan that shows nothing of the map: occluded or new."""
    pose = compose3(prior.base, prediction.motion)
    posterior = math.log(prior.nothing_known) + math.log(max(prediction.probability, 1e-12))
    return PoseCandidate(pose, np.zeros((3, 3)), 0.0, 0, 0, posterior)


def is_vague(covariance: Floats) -> bool:
    """Whether a prediction's covariance (3, 3) is too wide to select among local optima."""
    x, y, turn = np.sqrt(covariance.diagonal()).tolist()
    return bool(max(x, y) > _VAGUE_M or turn > _VAGUE_RAD)


def log_prior(motion: Floats, covariance: Floats, prior: PosePrior) -> float:
    """Log prior probability of a matched motion (3,) of a covariance (3, 3), over all components.

    Each component's density is integrated over the basin of poses that fit alike. Where the match
    does not constrain the pose, that is the component's probability.
    """
    return float(_log_prior(motion, covariance, prior.mixture))


@kernel
def _log_prior(motion: Floats, covariance: Floats, mixture: MotionMixture) -> float:
    log_det, total = log_det_2pi(add3(covariance, BASIN_COVARIANCE)), -np.inf
    for k in range(len(mixture.motions)):
        S = add3(mixture.covariances[k], covariance)
        term = math.log(max(mixture.probabilities[k], 1e-12))
        term += 0.5 * (log_det - log_det_2pi(add3(S, BASIN_COVARIANCE)))
        term += log_student_t(squared_mahalanobis(subtract3(mixture.motions[k], motion), S))
        largest = max(total, term)
        total = largest + math.log(math.exp(total - largest) + math.exp(term - largest))
    return total


def are_same(a: Floats, b: Floats) -> bool:
    """Whether two poses (3,) are close enough to be merged."""
    difference = between3(a, b)
    return math.hypot(difference[0], difference[1]) <= _SAME_M and abs(difference[2]) <= _SAME_RAD


def distinct(candidates: Sequence[PoseCandidate], prior: PosePrior) -> list[PoseCandidate]:
    """Non-maximum suppression: sort by posterior, drop what is the same as a likelier one."""
    kept: list[PoseCandidate] = []
    for candidate in sorted(candidates, key=lambda c: -c.log_posterior):
        if not any(_are_same(candidate, k, prior) for k in kept):
            kept.append(candidate)
    return kept


def _are_same(a: PoseCandidate, b: PoseCandidate, prior: PosePrior) -> bool:
    """Whether two candidates are of one pose: a match and the prediction it contradicts are not.

    All that is seen may move along, by less in a scan than poses are merged at.
    """
    if not are_same(a.pose, b.pose):
        return False
    if bool(a.inliers) == bool(b.inliers):
        return True
    match, unmatched = (a, b) if a.inliers else (b, a)
    predicted = likeliest_prediction(unmatched, prior).covariance
    covariance = predicted + prior.covariance_of(match.information)
    innovation = between3(unmatched.pose, match.pose)
    return squared_mahalanobis(innovation, covariance) <= CHI2_1_PERMILLE


def likeliest_prediction(candidate: PoseCandidate, prior: PosePrior) -> Prediction:
    """Return the mixture component that is likeliest given a candidate."""
    match_covariance = prior.covariance_of(candidate.information)
    return prior.predictions[_likeliest(candidate.pose, match_covariance, prior.mixture)]


@kernel
def _likeliest(match_pose: Floats, match_covariance: Floats, mixture: MotionMixture) -> int:
    """Index of the component with the highest posterior given a matched pose (3,)."""
    motion = between3(mixture.base, match_pose)
    likeliest, best = 0, -np.inf
    for k in range(len(mixture.motions)):
        residual = subtract3(mixture.motions[k], motion)
        posterior = log_density(residual, add3(mixture.covariances[k], match_covariance))
        posterior += math.log(max(mixture.probabilities[k], 1e-12))
        if posterior > best:
            likeliest, best = k, posterior
    return likeliest


class PoseUpdate(NamedTuple):
    """A pose updated by a match, and the motion since the last pose with and without the prior.

    Parameters
    ----------
    pose, covariance : (3,), (3, 3) float64
        Posterior (prior and match), the covariance in the body frame.
    motion, motion_covariance : (3,), (3, 3) float64
        Posterior motion since the last pose.
    match_motion, match_covariance : (3,), (3, 3) float64
        Motion by the match alone.
    nominal_variances : (3,) float64
        Of the match, by its curvature.
    """

    pose: Floats
    covariance: Floats
    motion: Floats
    motion_covariance: Floats
    match_motion: Floats
    match_covariance: Floats
    nominal_variances: Floats


def pose_update(candidate: PoseCandidate, prior: PosePrior, covariance: Floats) -> PoseUpdate:
    """Kalman update by a candidate; the covariance (3, 3) is that of the last pose."""
    given = candidate.pose, candidate.information, prior.match_variance_factor
    return PoseUpdate(*_pose_update(*given, covariance, prior.mixture))


@kernel
def _pose_update(
    match_pose: Floats,
    information: Floats,
    variance_factor: Floats,
    covariance: Floats,
    mixture: MotionMixture,
) -> tuple[Floats, Floats, Floats, Floats, Floats, Floats, Floats]:
    nominal, actual = nominal_covariance(information), _inflated(information, variance_factor)
    nominal_variances = np.array([nominal[0, 0], nominal[1, 1], nominal[2, 2]])
    pose, posterior = _kalman_update(match_pose, actual, mixture)
    motion, matched = between3(mixture.base, pose), between3(mixture.base, match_pose)
    of_motion = add3(covariance, posterior)
    return pose, posterior, motion, of_motion, matched, add3(covariance, actual), nominal_variances


@kernel
def _kalman_update(
    match_pose: Floats, match_covariance: Floats, mixture: MotionMixture
) -> tuple[Floats, Floats]:
    """Posterior pose (3,) and covariance (3, 3): Kalman update of the likeliest component.

    The measurement is the matched pose (3,), its noise the actual covariance (3, 3) of matches.
    """
    k = _likeliest(match_pose, match_covariance, mixture)
    predicted = compose3(mixture.base, mixture.motions[k])
    prior = add3(mixture.covariances[k], mixture.correlated_covariances[k])
    innovation = between3(predicted, match_pose)
    gain = matmul3(prior, invert3(add3(prior, match_covariance)))
    pose = compose3(predicted, matvec3(gain, innovation))
    posterior = add3(prior, scaled3(matmul3(gain, prior), -1.0))
    return pose, symmetric3(posterior)
