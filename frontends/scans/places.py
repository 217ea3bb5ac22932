# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Poses that a scan may have, and what speaks for each: the scan itself, and the way there."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numba import njit
from numpy.typing import NDArray

from slarm_graph.frontends.scans.keyframes import LocalMap
from slarm_graph.frontends.scans.likelihood_grid import Lattice, interpolate
from slarm_graph.frontends.scans.odometry_filter import Prediction
from slarm_graph.frontends.scans.small_matrix import invert3
from slarm_graph.frontends.scans.small_pose import (
    between3,
    compose3,
    log_density,
    log_tails,
    log_volume,
    squared_sigmas,
)
from slarm_graph.geometry import Floats

_UNSEEN = 0.5
"""What a return counts where nobody looked yet, in usual returns: neither for nor against."""
_PIECE_M = 1.0
"""Length of wall whose returns agree or disagree together: a passer-by, a door, a cupboard."""
_TAILS = 4.0
"""Degrees of freedom of the fit of right places: crowds and new furniture come now and then."""
_MEMORY = 0.05
"""Of the usual fit, per scan: places change within some 20 scans."""
_LEAST_SPREAD = 0.08
"""Of the usual fit: that of 30 independent pieces of surroundings."""
_KEEPS_INVERTIBLE = np.diag([0.01, 0.01, 0.01])
"""Information of 10 m and 10 rad: what a scan does not fix stays unknown, but finite."""
BASIN = np.diag([0.05, 0.05, 0.025]) ** 2
"""Of a place: poses so near fit alike [m, m, rad]. The fall-off of the likelihood, at 2 m."""
_NOTHING_KNOWN = 0.01
"""Probability that a scan shows nothing of the local map: a crowd, a lift, a door passed."""
_MOST_EVIDENCE = 25.0
"""Of one scan, in nats: walls are alike more often than chance would have it."""
_CHANCE_POINTS = 60
"""Returns looked up at places where a scan does not belong: the mean needs no more."""
_LEAST_CHANCE = 0.08
"""Spread of the fit at such places at least: that of 30 independent pieces."""
_ELSEWHERE = np.random.default_rng(1).uniform([-1.5, -1.5, -0.8], [1.5, 1.5, 0.8], (64, 3))
"""Poses around the expected one: the window that is searched."""
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
    """

    pose: Floats
    information: Floats
    score: float
    inliers: int
    iterations: int
    log_posterior: float = 0.0


@dataclass(frozen=True, slots=True)
class ChanceFit:
    """How well a scan fits at places where it does not belong, by chance or by alikeness.

    Parameters
    ----------
    mean, sigma : float
        Of the fit at poses all over the window around what is expected.
    """

    mean: float
    sigma: float

    def log_density(self, fits: float) -> float:
        """Log density of a fit at such a place, relative to the most frequent one."""
        return -0.5 * (max(0.0, fits - self.mean) / self.sigma) ** 2


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
    """

    base: Floats
    predictions: tuple[Prediction, ...]
    match_excess: Floats
    chance: ChanceFit = field(default_factory=lambda: ChanceFit(0.0, 1.0))

    def covariance_of(self, information: Floats) -> Floats:
        """Covariance (3, 3) of a match whose points alone have an information (3, 3)."""
        inflated = np.sqrt(self.match_excess)
        return np.asarray(claimed_covariance(information) * np.outer(inflated, inflated))


def claimed_covariance(information: Floats) -> Floats:
    """Covariance (3, 3) of a match by its points alone; 10 m and 10 rad where they say nothing."""
    return np.asarray(invert3(information + _KEEPS_INVERTIBLE))


def judged(
    place: Place, points: Floats, local_map: LocalMap, outlook: Outlook, usual: UsualFit
) -> Place:
    """Give a place its posterior: how much the fit speaks for it, and how probable the way was."""
    motion = between3(outlook.base, place.pose)
    spread = outlook.covariance_of(place.information)
    fits = fit(points, place.pose, local_map, usual.mean)
    evidence = usual.log_density(fits, pieces(points)) - outlook.chance.log_density(fits)
    return replace(
        place, log_posterior=min(evidence, _MOST_EVIDENCE) + log_prior(motion, spread, outlook)
    )


def unmatched(prediction: Prediction, outlook: Outlook) -> Place:
    """Where a prediction puts a scan that shows nothing of the map: all hidden or all new."""
    pose = compose3(outlook.base, prediction.motion)
    chance = math.log(_NOTHING_KNOWN) + math.log(max(prediction.probability, 1e-12))
    return Place(pose, np.zeros((3, 3)), 0.0, 0, 0, chance)


def chance_fit(points: Floats, local_map: LocalMap, center: Floats, usual: float) -> ChanceFit:
    """Measure how well a scan (K, 2) fits elsewhere around a pose (3,)."""
    few = points[:: max(1, len(points) // _CHANCE_POINTS)]
    around = np.array([compose3(center, away) for away in _ELSEWHERE])
    fits = _fits(few, around, local_map, usual)
    return ChanceFit(float(fits.mean()), max(float(fits.std()), _LEAST_CHANCE))


def fit(points: Floats, pose: Floats, local_map: LocalMap, usual: float) -> float:
    """Mean agreement of a scan (K, 2) at a pose (3,), what lies in the unseen being neutral."""
    if local_map.grid is None or not len(points):
        return 0.0
    return float(_fits(points, pose[None], local_map, usual)[0])


def _fits(points: Floats, poses: Floats, local_map: LocalMap, usual: float) -> Floats:
    """Return `fit` at many poses (N, 3)."""
    assert local_map.grid is not None
    seen = local_map.seen, local_map.seen_step
    agreement = _agreement(local_map.grid.lattice, *seen, points, poses, _UNSEEN * usual)
    return np.asarray(agreement / len(points))


@dataclass(slots=True)
class UsualFit:
    """How well scans fit where they belong, learned from those whose place was beyond doubt.

    Parameters
    ----------
    mean, variance : float
        Of the fit.
    count : float
        Scans it was learned from.
    """

    mean: float = 0.0
    variance: float = 0.1**2
    count: float = 0.0

    def learn(self, fits: float) -> None:
        """Take in the fit of one more scan."""
        rate = max(_MEMORY, 1.0 / (self.count + 1.0))
        self.count += 1.0
        if self.count > 1.0:
            self.variance += _MEMORY * ((fits - self.mean) ** 2 - self.variance)
        self.mean += rate * (fits - self.mean)

    def below(self, fits: float, count: float) -> float:
        """Standard deviations that a fit of so many pieces lies below the usual one; at least 0."""
        of_few = self.mean * (1.0 - self.mean) / max(count, 1.0)
        return max(0.0, self.mean - fits) / math.sqrt(max(self.variance, of_few, _LEAST_SPREAD**2))

    def log_density(self, fits: float, count: float) -> float:
        """Log density of a fit at the right place, relative to the usual one: Student's t."""
        return -0.5 * (_TAILS + 1.0) * math.log1p(self.below(fits, count) ** 2 / _TAILS)


def log_prior(motion: Floats, covariance: Floats, outlook: Outlook) -> float:
    """Log probability of getting to a place, by all stories together.

    Every story's density, integrated over the place: a motion (3,) known to within a covariance,
    and what lies around it and fits alike. Where the scan says nothing of the pose, that is the
    probability of the story.
    """
    own = log_volume(covariance + BASIN)
    stories = [
        math.log(max(p.probability, 1e-12))
        + 0.5 * (own - log_volume(p.covariance + covariance + BASIN))
        + log_tails(squared_sigmas(p.motion - motion, p.covariance + covariance))
        for p in outlook.predictions
    ]
    return float(np.logaddexp.reduce(stories))


def is_same(a: Place, b: Place) -> bool:
    """Whether two poses are one place."""
    away = between3(a.pose, b.pose)
    return math.hypot(away[0], away[1]) <= _SAME_M and abs(away[2]) <= _SAME_RAD


def distinct(places: Sequence[Place]) -> list[Place]:
    """Sort by posterior and leave out what is the same place as a likelier one."""
    kept: list[Place] = []
    for place in sorted(places, key=lambda p: -p.log_posterior):
        if not any(is_same(place, k) for k in kept):
            kept.append(place)
    return kept


def best_story(place: Place, outlook: Outlook) -> Prediction:
    """Return the prediction that explains a place best."""
    motion = between3(outlook.base, place.pose)
    spread = outlook.covariance_of(place.information)
    return max(
        outlook.predictions,
        key=lambda p: (
            math.log(max(p.probability, 1e-12))
            + log_density(p.motion - motion, p.covariance + spread)
        ),
    )


def fused(place: Place, outlook: Outlook) -> tuple[Floats, Floats]:
    """Pose (3,) and covariance (3, 3) by the match and the likeliest story together.

    A Kalman update whose measurement is the place, with as much noise as matches have shown.
    """
    story = best_story(place, outlook)
    spread = outlook.covariance_of(place.information)
    predicted = compose3(outlook.base, story.motion)
    innovation = between3(predicted, place.pose)
    prior = story.covariance + story.unlearned
    gain = prior @ invert3(prior + spread)
    pose = compose3(predicted, gain @ innovation)
    covariance = prior - gain @ prior
    return pose, 0.5 * (covariance + covariance.T)


@njit(cache=True, nogil=True)
def pieces(points: Floats) -> float:
    """How many independent pieces of surroundings a scan (K, 2) in beam order shows."""
    count = 0.0
    for i in range(len(points)):
        step = _PIECE_M
        if i > 0:
            step = math.hypot(points[i, 0] - points[i - 1, 0], points[i, 1] - points[i - 1, 1])
        count += min(step, _PIECE_M) / _PIECE_M
    return count


@njit(cache=True, nogil=True)
def _agreement(
    lattice: Lattice,
    seen: NDArray[np.bool_],
    seen_step: int,
    points: Floats,
    poses: Floats,
    neutral: float,
) -> Floats:
    """Sum (N,) of the agreement of points (K, 2) at poses (N, 3); `neutral` in the unseen."""
    sums = np.empty(len(poses))
    for k in range(len(poses)):
        c, s = math.cos(poses[k, 2]), math.sin(poses[k, 2])
        total, unseen = 0.0, 0
        for i in range(len(points)):
            x = poses[k, 0] + c * points[i, 0] - s * points[i, 1]
            y = poses[k, 1] + s * points[i, 0] + c * points[i, 1]
            value, _, _ = interpolate(lattice, x, y)
            if value > 0.01:
                total += value
                continue
            col = math.floor((x - lattice.origin_x) / lattice.resolution) // seen_step
            row = math.floor((y - lattice.origin_y) / lattice.resolution) // seen_step
            is_inside = row >= 0 and col >= 0 and row < seen.shape[0] and col < seen.shape[1]
            if not is_inside or not seen[row, col]:
                unseen += 1
        sums[k] = total + neutral * unseen
    return sums
