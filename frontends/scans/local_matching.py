# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Placing a scan on the local map: refine from every prediction, search where that is doubtful."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from slarm_graph.config import MatchingConfig
from slarm_graph.constraint import MatchResult
from slarm_graph.frontends.scans.correlative import search, search_every_pose
from slarm_graph.frontends.scans.gauss_newton import refine_motion
from slarm_graph.frontends.scans.likelihood_grid import LikelihoodGrid
from slarm_graph.frontends.scans.odometry_filter import Prediction
from slarm_graph.frontends.scans.search_pyramid import build_pyramid
from slarm_graph.frontends.scans.small_matrix import invert3
from slarm_graph.geometry import Floats, Pose2, between, compose

_DOUBTFUL_SURPRISE = 16.0
_DOUBTFUL_SHIFT = 0.3
_DOUBTFUL_SHARE = 0.85
_LOST_SHARE = 0.67
_BETTER = 0.02
_PER_SIGMA = 0.02
_MAX_MARGIN = 0.4
_SEARCH_POINTS = 80
_BRUTE_LOOKUPS = 4_000_000
_PLENTY_OF_POINTS = 20
_FROM_PREDICTION = np.empty(0)
_LOST_REACH_M = 3.0
_LOST_SCORE = 0.6
_UNSURE_RAD = 0.5
_ANYWHERE = np.diag([2.0, 2.0, 3.0]) ** 2


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


class LocalMatcher:
    """Matches scans one after the other, and knows how well they usually fit.

    Parameters
    ----------
    config : MatchingConfig
    """

    def __init__(self, config: MatchingConfig) -> None:
        self._config = config
        self._usual_score = 0.0
        self.lost = 0
        """How many scans on end could not be placed."""

    def match(
        self,
        points: Floats,
        grid: LikelihoodGrid | None,
        base: Pose2,
        predictions: tuple[Prediction, ...],
    ) -> MatchResult:
        """Align points with the local map, starting from (and leaning on) what is expected.

        Parameters
        ----------
        points : (K, 2) float64
            Returns in the robot's frame [m].
        grid : LikelihoodGrid or None
            Local map; None before there is one.
        base : Pose2
            Last pose in the map's frame.
        predictions : tuple of Prediction
            Motions since then, the likeliest first.

        Returns
        -------
        MatchResult
            On failure falsy, with the first prediction's pose and covariance.
        """
        if grid is None:
            return _failed(base, predictions[0], "first scan")
        if len(points) < self._config.min_points:
            self.lost += 1
            return _failed(base, predictions[0], f"only {len(points)} returns")
        found: _Refined | None = None
        for prediction in predictions:
            other = self._refine(points, grid, base, prediction)
            if found is None or other.score > found.score + _BETTER:
                found = other
            if not self._is_doubtful(found):
                break
        assert found is not None
        if self._is_doubtful(found):
            found = self._search(points, grid, base, predictions, found)
        if self._is_lost(found, predictions[0]):
            found = self._search_widely(points, grid, base, predictions, found)
        return self._conclude(found, base, predictions)

    def _conclude(
        self, found: _Refined, base: Pose2, predictions: tuple[Prediction, ...]
    ) -> MatchResult:
        if found.score < self._config.min_score:
            self.lost += 1
            return _failed(base, predictions[0], f"score {found.score:.2f} is too low", found)
        self.lost = 0
        usual = self._usual_score or found.score
        self._usual_score = usual + 0.05 * (found.score - usual)
        return MatchResult(
            Pose2.from_array(found.pose),
            self._honest_covariance(found, base, predictions[0]),
            found.score,
            found.inliers,
            found.iterations,
        )

    def _honest_covariance(self, found: _Refined, base: Pose2, prediction: Prediction) -> Floats:
        """Spread a doubtful match over its own place and the predicted one.

        Moments of a mixture of both, the match weighing the less the worse it fits than usual.
        """
        least, usual = self._config.min_score, _DOUBTFUL_SHARE * self._usual_score
        if found.score >= usual:
            return found.covariance
        share = (found.score - least) / (usual - least)
        away = between(found.pose, compose(base.as_array(), prediction.motion))
        between_them = share * (1.0 - share) * np.outer(away, away)
        return share * found.covariance + (1.0 - share) * prediction.covariance + between_them

    def _refine(
        self,
        points: Floats,
        grid: LikelihoodGrid,
        base: Pose2,
        prediction: Prediction,
        start: Floats = _FROM_PREDICTION,
    ) -> _Refined:
        """Refine from the prediction, or from another start (3,) leaning on the prediction."""
        # Between few returns much of the wall is not seen at all; each then says less.
        trust = min(1.0, len(points) / _PLENTY_OF_POINTS)
        return _Refined(
            *refine_motion(
                grid.values,
                grid.origin_x_m,
                grid.origin_y_m,
                grid.resolution_m,
                points,
                base.as_array(),
                prediction.motion,
                prediction.covariance,
                start,
                trust * (grid.sigma_m / self._config.point_sigma_m) ** 2,
                self._config.max_iterations,
                grid.sigma_m,
            )
        )

    def _is_doubtful(self, found: _Refined) -> bool:
        """Whether the scan fits worse than usual, or fits far from where it was expected."""
        usual = max(_DOUBTFUL_SHARE * self._usual_score, self._config.min_score)
        is_far = found.surprise > _DOUBTFUL_SURPRISE and found.shift > _DOUBTFUL_SHIFT
        return found.score < usual or is_far

    def _search(
        self,
        points: Floats,
        grid: LikelihoodGrid,
        base: Pose2,
        predictions: tuple[Prediction, ...],
        found: _Refined,
    ) -> _Refined:
        """Look for a better place in the windows the predictions allow."""
        few = points[:: max(1, len(points) // _SEARCH_POINTS)]
        for prediction in predictions:
            start = _best_in_window(few, grid, base, prediction)
            loose = Prediction(prediction.motion, 4.0 * predictions[-1].covariance)
            other = self._refine(points, grid, base, loose, start)
            found = _better(found, other, base, predictions)
        return found

    def _is_lost(self, found: _Refined, prediction: Prediction) -> bool:
        """Whether a scan fits badly, or after a gap worse than usual: it may be from anywhere."""
        could_be_turned = prediction.covariance[2, 2] > _UNSURE_RAD**2
        share = _DOUBTFUL_SHARE if could_be_turned else _LOST_SHARE
        return found.score < max(share * self._usual_score, self._config.min_score)

    def _search_widely(
        self,
        points: Floats,
        grid: LikelihoodGrid,
        base: Pose2,
        predictions: tuple[Prediction, ...],
        found: _Refined,
    ) -> _Refined:
        """Look all round where the robot should be, and where it last was; rarer when lost long."""
        if self.lost & (self.lost - 1):
            return found
        motion = predictions[0].motion
        expected = base @ Pose2.from_array(motion)
        is_far = math.hypot(motion[0], motion[1]) > 0.5 * _LOST_REACH_M
        pyramid, few = build_pyramid(grid), points[:: max(1, len(points) // _SEARCH_POINTS)]
        for center in (expected, base) if is_far else (expected,):
            hit = search(
                pyramid,
                few,
                center,
                reach_m=_LOST_REACH_M,
                min_score=max(_LOST_SCORE, found.score + _BETTER),
            )
            if hit is None:
                continue
            anywhere = Prediction(motion, _ANYWHERE)
            other = self._refine(points, grid, base, anywhere, hit.grid_from_robot.as_array())
            if self._outweighs(other, found, predictions):
                found = other
            else:
                found = _better(found, other, base, predictions)
        return found

    def _outweighs(
        self, other: _Refined, found: _Refined, predictions: tuple[Prediction, ...]
    ) -> bool:
        """Whether a scan fits as usual elsewhere, however far that is from the predictions.

        Odometry that stands still agrees with whatever wrong place is near, so its distance tells
        nothing. Alone, the one prediction is the velocity of the matches so far, and its does.
        """
        usual = _DOUBTFUL_SHARE * self._usual_score
        return len(predictions) > 1 and other.score > max(found.score, usual)


def _failed(
    base: Pose2, prediction: Prediction, reason: str, found: _Refined | None = None
) -> MatchResult:
    """Report a failed match at the predicted pose."""
    expected = base @ Pose2.from_array(prediction.motion)
    if found is None:
        return MatchResult(expected, prediction.covariance, reason=reason)
    return MatchResult(
        expected, prediction.covariance, found.score, found.inliers, found.iterations, reason
    )


def _better(
    found: _Refined, other: _Refined, base: Pose2, predictions: tuple[Prediction, ...]
) -> _Refined:
    """Choose the other place when it fits better by more than its distance may explain."""
    margin = _BETTER + _margin(other, base, predictions)
    return other if other.score > found.score + margin else found


def _margin(found: _Refined, base: Pose2, predictions: tuple[Prediction, ...]) -> float:
    """Score by which a place must be better, for how far it is from every prediction.

    A passer-by before the laser can make a wrong place fit a little better than the right one.
    """
    least = math.inf
    for prediction in predictions:
        away = between(compose(base.as_array(), prediction.motion), found.pose)
        least = min(least, float(away @ invert3(prediction.covariance) @ away))
    return min(_PER_SIGMA * math.sqrt(least), _MAX_MARGIN)


def _best_in_window(
    points: Floats, grid: LikelihoodGrid, base: Pose2, prediction: Prediction
) -> Floats:
    """Best pose (3,) in a window of four sigmas around the prediction, within bounds."""
    far = max(float(np.percentile(np.hypot(points[:, 0], points[:, 1]), 75)), 1.0)
    sigma = np.sqrt(np.diag(prediction.covariance))
    start = compose(base.as_array(), prediction.motion)
    reach_m = min(max(4.0 * float(sigma[:2].max()), 0.3), 1.0)
    reach_rad = min(max(4.0 * float(sigma[2]), 0.2), 0.7)
    step_rad = grid.resolution_m / far
    cells, turns = math.ceil(reach_m / grid.resolution_m), math.ceil(reach_rad / step_rad)
    if 8 * cells * cells * turns * len(points) > _BRUTE_LOOKUPS:
        hit = search(
            build_pyramid(grid, max_radius_m=far, levels=5),
            points,
            Pose2.from_array(start),
            reach_m=reach_m,
            reach_rad=reach_rad,
        )
        return hit.grid_from_robot.as_array() if hit else start
    turn, col, row, _ = search_every_pose(
        grid.values,
        (start[:2] - [grid.origin_x_m, grid.origin_y_m]) / grid.resolution_m,
        points / grid.resolution_m,
        start[2],
        step_rad,
        cells,
        turns,
    )
    shift = np.array([col * grid.resolution_m, row * grid.resolution_m, turn * step_rad])
    return np.asarray(start + shift, dtype=np.float64)
