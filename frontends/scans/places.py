# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Poses that a scan may have, and what speaks for each: the scan itself, and the way there."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from slarm_graph.frontends.scans.fits import ChanceFit, UsualFit, fit, pieces
from slarm_graph.frontends.scans.keyframes import LocalMap
from slarm_graph.frontends.scans.odometry_filter import Expectation, Prediction
from slarm_graph.frontends.scans.small_matrix import (
    invert3,
    less3,
    product3,
    scaled3,
    sum3,
    symmetric3,
    times3,
)
from slarm_graph.frontends.scans.small_pose import (
    BASIN,
    between3,
    compose3,
    log_density,
    log_tails,
    log_volume,
    squared_sigmas,
)
from slarm_graph.geometry import Floats
from slarm_graph.kernels import kernel

_KEEPS_INVERTIBLE = np.diag([0.01, 0.01, 0.01])
"""Information of 10 m and 10 rad: what a scan does not fix stays unknown, but finite."""
_VAGUE_M, _VAGUE_RAD = 0.1, 0.1
"""Standard deviations of a prediction from which it agrees with anything: beyond them refinement
may find another place than the nearest."""
_NOTHING_KNOWN = 0.01
"""Probability that a scan shows nothing of the local map: a crowd, a lift, a door passed."""
_MOST_EVIDENCE = 25.0
"""Of one scan, in nats: walls are alike more often than chance would have it."""
_SAME_M, _SAME_RAD = 0.1, 0.05
"""Places nearer than this are one: twice the fall-off of the likelihood."""


@dataclass(frozen=True, slots=True)
class Place:
    """A pose that a scan may have.

    Parameters
    ----------
    pose : (3,) float64
        In the local map, where the scan fits best [m, m, rad].
    information : (3, 3) float64
        Of the scan alone, in the pose's body frame.
    score : float
        Mean agreement of the returns, 0 to 1.
    inliers, iterations : int
    log_posterior : float
        Up to a constant that all places of a scan share.
    fits : float or None
        How well the scan fits there, where that is known already.
    evidence : float
        What the scan alone says for it [nat]: part of `log_posterior`.
    is_vague : bool
        Whether the robot may as well be anywhere about.
    walked : tuple of float, int
        Probability that small things which fit elsewhere have walked there, and how many.
    """

    pose: Floats
    information: Floats
    score: float
    inliers: int
    iterations: int
    log_posterior: float = 0.0
    fits: float | None = None
    evidence: float = 0.0
    is_vague: bool = False
    walked: tuple[float, int] = (0.0, 0)

    def fit_of(self, points: Floats, local_map: LocalMap, usual: UsualFit) -> float:
        """How well the scan (K, 2) that has this place fits there."""
        return fit(points, self.pose, local_map, usual.mean) if self.fits is None else self.fits


@dataclass(frozen=True, slots=True)
class Outlook:
    """What is expected of a scan before it is looked at.

    Parameters
    ----------
    base : (3,) float64
        Last pose in the local map.
    predictions : tuple of Prediction
        Motions since then, uncertainty of the last pose included.
    match_excess : (3,) float64
        Variance of a match over that which its points alone would have, per body axis.
    chance : ChanceFit
        How well the scan fits where it does not belong.
    walkers : tuple of float, int
        Probability that small things walk as they did a scan ago, and how many they are.
    """

    base: Floats
    predictions: tuple[Prediction, ...]
    match_excess: Floats
    chance: ChanceFit = field(default_factory=lambda: ChanceFit(0.0, 1.0))
    walkers: tuple[float, int] = (0.0, 0)
    expectation: Expectation = field(init=False, compare=False)
    """Base and predictions, for compiled code."""

    def __post_init__(self) -> None:
        told = self.predictions
        expectation = Expectation(
            self.base,
            np.array([p.motion for p in told]),
            np.array([p.covariance for p in told]),
            np.array([p.probability for p in told]),
            np.array([p.unlearned for p in told]),
        )
        object.__setattr__(self, "expectation", expectation)

    def covariance_of(self, information: Floats) -> Floats:
        """Covariance (3, 3) of a match whose points alone have an information (3, 3)."""
        return np.asarray(_inflated(information, self.match_excess))


@kernel
def claimed_covariance(information: Floats) -> Floats:
    """Covariance (3, 3) of a match by its points alone; 10 m and 10 rad where they say nothing."""
    return invert3(sum3(information, _KEEPS_INVERTIBLE))


@kernel
def _inflated(information: Floats, excess: Floats) -> Floats:
    """Covariance (3, 3) of a match whose variances are so much more than claimed."""
    covariance = claimed_covariance(information)
    for row in range(3):
        for col in range(3):
            covariance[row, col] *= math.sqrt(excess[row]) * math.sqrt(excess[col])
    return covariance


def judged(
    place: Place, points: Floats, local_map: LocalMap, outlook: Outlook, usual: UsualFit
) -> Place:
    """Give a place its posterior: how much the fit speaks for it, and how probable the way was.

    A place whose match is unsure reaches towards the prediction, such as along a corridor: as far
    as the scan fits there as well. Where it does not, the place is where it was found.
    """
    motion = between3(outlook.base, place.pose)
    spread = outlook.covariance_of(place.information)
    fits = place.fit_of(points, local_map, usual)
    believed, _ = _fused(place.pose, spread, outlook.expectation)
    if not are_same(place.pose, believed):
        lost = fits - fit(points, believed, local_map, usual.mean)
        spread = BASIN if lost > usual.sigma(pieces(points)) else spread
    evidence = usual.log_density(fits, pieces(points)) - outlook.chance.log_density(fits)
    evidence = min(evidence, _MOST_EVIDENCE)
    posterior = evidence + log_prior(motion, spread, outlook)
    return replace(place, log_posterior=posterior, evidence=evidence)


def unmatched(prediction: Prediction, outlook: Outlook) -> Place:
    """Where a prediction puts a scan that shows nothing of the map: all hidden or all new."""
    pose = compose3(outlook.base, prediction.motion)
    evidence = math.log(_NOTHING_KNOWN)
    posterior = evidence + math.log(max(prediction.probability, 1e-12))
    is_open = is_vague(prediction.covariance)
    return Place(pose, np.zeros((3, 3)), 0.0, 0, 0, posterior, evidence=evidence, is_vague=is_open)


def is_vague(covariance: Floats) -> bool:
    """Whether a prediction of this covariance (3, 3) agrees with anything."""
    x, y, turn = np.sqrt(covariance.diagonal()).tolist()
    return bool(max(x, y) > _VAGUE_M or turn > _VAGUE_RAD)


def log_prior(motion: Floats, covariance: Floats, outlook: Outlook) -> float:
    """Log probability of getting to a place, by all stories together.

    Every story's density, integrated over the place: a motion (3,) known to within a covariance,
    and what lies around it and fits alike. Where the scan says nothing of the pose, that is the
    probability of the story.
    """
    return float(_log_prior(motion, covariance, outlook.expectation))


@kernel
def _log_prior(motion: Floats, covariance: Floats, expected: Expectation) -> float:
    own, total = log_volume(sum3(covariance, BASIN)), -np.inf
    for k in range(len(expected.motions)):
        spread = sum3(expected.covariances[k], covariance)
        told = math.log(max(expected.probabilities[k], 1e-12))
        told += 0.5 * (own - log_volume(sum3(spread, BASIN)))
        told += log_tails(squared_sigmas(less3(expected.motions[k], motion), spread))
        most = max(total, told)
        total = most + math.log(math.exp(total - most) + math.exp(told - most))
    return total


def are_same(a: Floats, b: Floats) -> bool:
    """Whether two poses (3,) are one place."""
    away = between3(a, b)
    return math.hypot(away[0], away[1]) <= _SAME_M and abs(away[2]) <= _SAME_RAD


def distinct(places: Sequence[Place]) -> list[Place]:
    """Sort by posterior and leave out what is the same place as a likelier one."""
    kept: list[Place] = []
    for place in sorted(places, key=lambda p: -p.log_posterior):
        if not any(are_same(place.pose, k.pose) for k in kept):
            kept.append(place)
    return kept


def best_story(place: Place, outlook: Outlook) -> Prediction:
    """Return the prediction that explains a place best."""
    spread = outlook.covariance_of(place.information)
    return outlook.predictions[_likeliest(place.pose, spread, outlook.expectation)]


@kernel
def _likeliest(found: Floats, spread: Floats, expected: Expectation) -> int:
    """Which prediction explains best a pose (3,) that was found with a covariance (3, 3)."""
    motion = between3(expected.base, found)
    likeliest, best = 0, -np.inf
    for k in range(len(expected.motions)):
        apart = less3(expected.motions[k], motion)
        told = log_density(apart, sum3(expected.covariances[k], spread))
        told += math.log(max(expected.probabilities[k], 1e-12))
        if told > best:
            likeliest, best = k, told
    return likeliest


class Step(NamedTuple):
    """A step to where a scan was placed: by that alone, and by prediction and match together.

    Parameters
    ----------
    pose, covariance : (3,), (3, 3) float64
        By both together, and its covariance in the body frame.
    moved, moved_covariance : (3,), (3, 3) float64
        Motion since the last pose by both, and its covariance.
    found, found_covariance : (3,), (3, 3) float64
        Motion by the match alone.
    claimed : (3,) float64
        Variances of the match by its points alone.
    """

    pose: Floats
    covariance: Floats
    moved: Floats
    moved_covariance: Floats
    found: Floats
    found_covariance: Floats
    claimed: Floats


def step_to(place: Place, outlook: Outlook, covariance: Floats) -> Step:
    """Take the step to a place from a pose of a covariance (3, 3)."""
    given = place.pose, place.information, outlook.match_excess
    return Step(*_step(*given, covariance, outlook.expectation))


@kernel
def _step(
    found: Floats, information: Floats, excess: Floats, covariance: Floats, expected: Expectation
) -> tuple[Floats, Floats, Floats, Floats, Floats, Floats, Floats]:
    claim, spread = claimed_covariance(information), _inflated(information, excess)
    claimed = np.array([claim[0, 0], claim[1, 1], claim[2, 2]])
    pose, both = _fused(found, spread, expected)
    moved, seen = between3(expected.base, pose), between3(expected.base, found)
    more = sum3(covariance, both)
    return pose, both, moved, more, seen, sum3(covariance, spread), claimed


@kernel
def _fused(found: Floats, spread: Floats, expected: Expectation) -> tuple[Floats, Floats]:
    """Pose (3,) and covariance (3, 3) by a match and the likeliest story together.

    A Kalman update whose measurement is the pose (3,) that was found, with as much noise (3, 3) as
    matches have shown.
    """
    k = _likeliest(found, spread, expected)
    predicted = compose3(expected.base, expected.motions[k])
    prior = sum3(expected.covariances[k], expected.unlearned[k])
    innovation = between3(predicted, found)
    gain = product3(prior, invert3(sum3(prior, spread)))
    pose = compose3(predicted, times3(gain, innovation))
    rest = sum3(prior, scaled3(product3(gain, prior), -1.0))
    return pose, symmetric3(rest)
