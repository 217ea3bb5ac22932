# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Scan-to-map matching: the pose candidates of a scan on the local map.

Refinement from the likeliest prediction gives one candidate. Where it fails the gate, more are
generated: the unmatched prediction; refinement with the points downweighted to their effective
number; refinement from the other predictions; correlative search of the predictions' windows; and
relocalisation at any heading for a scan that fits none of these.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from slarm_graph.config import MatchingConfig
from slarm_graph.frontends.scans.correlative import search
from slarm_graph.frontends.scans.grid_match import match_on_grid
from slarm_graph.frontends.scans.local_map import LocalMap
from slarm_graph.frontends.scans.match_information import misfit_discount
from slarm_graph.frontends.scans.odometry_filter import Prediction
from slarm_graph.frontends.scans.pose_candidates import (
    PoseCandidate,
    PosePrior,
    are_same,
    distinct,
    is_vague,
    unmatched_candidate,
    with_posterior,
)
from slarm_graph.frontends.scans.refinement import Refinement
from slarm_graph.frontends.scans.scan_fit import (
    UNKNOWN_FIT,
    TrueMatchFit,
    false_match_fit,
    local_optima,
    patch_count,
)
from slarm_graph.frontends.scans.search_pyramid import build_pyramid
from slarm_graph.frontends.scans.significance import CHI2_1_PERMILLE, SIGMAS_1_PERCENT
from slarm_graph.frontends.scans.small_pose import (
    BASIN_COVARIANCE,
    between3,
    compose3,
    squared_mahalanobis,
)
from slarm_graph.frontends.scans.window_search import LOST_REACH_M, best_in_window, far_range_m
from slarm_graph.geometry import Floats, Pose2

_LOST = 4.0
"""Standard deviations below the mean fit of true matches at which a scan is relocalised."""
_SEARCH_POINTS = 80
"""Returns of a scan used in a search: more are redundant."""
_PLENTY_OF_POINTS = 20
"""Fewer returns leave much of the walls unseen and get less weight each."""
_ANYWHERE = np.diag([2.0, 2.0, 3.0]) ** 2
"""Prior covariance of a relocalised pose [m^2, m^2, rad^2]: within reach, at any heading."""
_FIRST_FITS, _LEAST_FIT = 5.0, 0.01
"""Scans after which the mean fit of true matches is used, and its lower bound."""
_SEES = 6.0
"""Basin of convergence of refinement, in sigmas of the likelihood's fall-off: three to either side,
where the slope is a twentieth of the steepest. Half of it leaves edmonton 0.67 m for 0.64 (means of
draws) and turns dec13's last seconds, which are a draw, the wrong way. Half as much again does
not."""
_FROM_PREDICTION = np.empty(0)
"""Empty initial guess: start at the prediction."""


class LocalMatcher:
    """Matches scans against the local map; learns the fit of true matches.

    Parameters
    ----------
    config : MatchingConfig
    refine_by : callable, optional
        Replaces refinement on the likelihood grid.
    """

    def __init__(self, config: MatchingConfig, refine_by: Refinement | None = None) -> None:
        self._config, self._refine_by = config, refine_by
        self.true_fit = TrueMatchFit()

    def candidates(
        self,
        points: Floats,
        local_map: LocalMap,
        prior: PosePrior,
        *,
        relocalise: bool,
        single: bool,
    ) -> list[PoseCandidate]:
        """Return the pose candidates of a scan with their posteriors, the likeliest first.

        Parameters
        ----------
        points : (K, 2) float64
            Returns in the robot's frame [m].
        local_map : LocalMap
        prior : PosePrior
            The likeliest prediction first.
        relocalise : bool
            Whether to search at any heading where nothing fits near the predictions.
        single : bool
            Whether there is one hypothesis only: a match that passes the gate needs no posterior.
        """
        grid, prediction = local_map.grid, prior.predictions[0]
        if grid is None or len(points) < self._config.min_points:
            return [unmatched_candidate(prediction, prior)]
        near = self._near_prediction(points, local_map, prior)
        passes_gate = len(near) == 1 and self._passes_gate(near[0], points, local_map, prior)
        if passes_gate and single:
            return near
        expected = compose3(prior.base, prediction.motion)
        false_fit = false_match_fit(points, local_map, expected, self.true_fit.mean)
        prior = replace(prior, false_fit=false_fit)
        if passes_gate:
            return [with_posterior(near[0], points, local_map, prior, self.true_fit)]
        return self._proposed(near, points, local_map, prior, relocalise)

    def _near_prediction(
        self, points: Floats, local_map: LocalMap, prior: PosePrior
    ) -> list[PoseCandidate]:
        """Refine from the prediction; search its window, too, where it exceeds the basin."""
        grid, prediction = local_map.grid, prior.predictions[0]
        assert grid is not None
        wide = _widened(prediction)
        match = self._refine(points, local_map, prior, wide)
        sigma = np.sqrt(prediction.covariance.diagonal())
        if math.hypot(sigma[0], sigma[1], far_range_m(points) * sigma[2]) < _SEES * grid.sigma_m:
            return [match]
        sample = points[:: max(1, len(points) // _SEARCH_POINTS)]
        start = best_in_window(
            sample, grid, prior.base, prediction, local_map.levels, min_window=(0.0, 0.0)
        )
        other = self._refine(points, local_map, prior, wide, start)
        if are_same(match.pose, other.pose):
            return [max(match, other, key=lambda c: c.score)]
        return [match, other] if other.inliers else [match]

    def _passes_gate(
        self, match: PoseCandidate, points: Floats, local_map: LocalMap, prior: PosePrior
    ) -> bool:
        """Whether a match fits as true matches do and lies within the gate of all predictions."""
        if match.score < self._config.min_score or not _agree(prior.predictions):
            return False
        if len(prior.predictions) > 1 and is_vague(prior.predictions[0].covariance):
            return False
        if self._sigmas_below(match, points, local_map) > SIGMAS_1_PERCENT:
            return False
        expected = prior.predictions[0]
        innovation = between3(prior.base, match.pose) - expected.motion
        covariance = expected.covariance + prior.covariance_of(match.information)
        return squared_mahalanobis(innovation, covariance) <= CHI2_1_PERMILLE

    def _sigmas_below(self, match: PoseCandidate, points: Floats, local_map: LocalMap) -> float:
        fit = match.scan_fit(points, local_map, self.true_fit)
        return self.true_fit.sigmas_below(fit, patch_count(points))

    def _proposed(
        self,
        near: Sequence[PoseCandidate],
        points: Floats,
        local_map: LocalMap,
        prior: PosePrior,
        relocalise: bool,
    ) -> list[PoseCandidate]:
        """Generate further candidates and return all with posteriors, the likeliest first."""
        grid, base, predictions = local_map.grid, prior.base, prior.predictions
        assert grid is not None
        matches = list(near)
        share = patch_count(points) / len(points)
        sample = points[:: max(1, len(points) // _SEARCH_POINTS)]
        for prediction in predictions:
            downweighted = self._refine(points, local_map, prior, prediction, effective_share=share)
            if not any(are_same(downweighted.pose, c.pose) for c in near):
                matches.append(downweighted)
            if prediction is not predictions[0]:
                matches.append(self._refine(points, local_map, prior, _widened(prediction)))
        candidates = [
            with_posterior(c, points, local_map, prior, self.true_fit) for c in matches if c.inliers
        ]
        candidates += [unmatched_candidate(p, prior) for p in predictions]
        best = max(candidates, key=lambda c: c.log_posterior)
        sigmas_below = min(self._sigmas_below(c, points, local_map) for c in matches)
        if sigmas_below <= SIGMAS_1_PERCENT and any(
            np.array_equal(best.pose, c.pose) for c in near
        ):
            return distinct(candidates, prior)
        matches = []
        for half, prediction in product(_subsamples(points), predictions):
            start = best_in_window(half, grid, base, prediction, local_map.levels)
            wide = Prediction(prediction.motion, 4.0 * predictions[-1].covariance)
            matches.append(self._refine(points, local_map, prior, wide, start))
            sigmas_below = min(sigmas_below, self._sigmas_below(matches[-1], points, local_map))
        if relocalise and sigmas_below > _LOST:
            matches += self._relocalised(points, sample, local_map, prior)
        candidates += self._with_search_posterior(matches, points, local_map, prior)
        return distinct(candidates, prior)

    def _with_search_posterior(
        self,
        matches: Sequence[PoseCandidate],
        points: Floats,
        local_map: LocalMap,
        prior: PosePrior,
    ) -> list[PoseCandidate]:
        """Compute posteriors of searched candidates against the fit at the other local optima.

        A searched candidate is the best of many local optima, which are its false matches. One near
        a prediction was not selected for its fit.
        """
        expected = compose3(prior.base, prior.predictions[0].motion)
        optima = local_optima(points, local_map, expected, self.true_fit.mean)
        candidates = []
        for match in matches:
            if match.inliers:
                searched = replace(prior, false_fit=optima.false_fit_excluding(match.pose))
                candidates.append(with_posterior(match, points, local_map, searched, self.true_fit))
        return candidates

    def _refine(
        self,
        points: Floats,
        local_map: LocalMap,
        prior: PosePrior,
        prediction: Prediction,
        start: Floats = _FROM_PREDICTION,
        effective_share: float = 1.0,
    ) -> PoseCandidate:
        """Refine with the prediction as prior, from an initial guess (3,) or the prediction.

        The points count by their effective share.
        """
        if self._refine_by is not None:
            return self._refine_by(points, prior.base, prediction, start, effective_share)
        grid = local_map.grid
        assert grid is not None
        weight = effective_share * min(1.0, len(points) / _PLENTY_OF_POINTS)
        pose, information, score, inliers, iterations, agreement = match_on_grid(
            grid.lattice,
            local_map.observed,
            local_map.observed_step,
            local_map.met,
            points,
            prior.mixture,
            prediction.motion,
            prediction.covariance,
            start,
            weight * (grid.sigma_m / self._config.point_sigma_m) ** 2,
            effective_share,
            UNKNOWN_FIT * self.true_fit.mean,
            self._config.max_iterations,
        )
        if self.true_fit.count < _FIRST_FITS:
            return PoseCandidate(pose, information, score, inliers, iterations)
        fit = agreement / len(points)
        discount = misfit_discount(fit / max(self.true_fit.mean, _LEAST_FIT))
        return PoseCandidate(pose, discount * information, score, inliers, iterations, fit=fit)

    def _relocalised(
        self, points: Floats, sample: Floats, local_map: LocalMap, prior: PosePrior
    ) -> list[PoseCandidate]:
        """Search at any heading around the predicted pose and around the last one."""
        grid, base, motion = local_map.grid, prior.base, prior.predictions[0].motion
        assert grid is not None
        expected = compose3(base, motion)
        is_far = math.hypot(motion[0], motion[1]) > 0.5 * LOST_REACH_M
        pyramid = build_pyramid(grid)
        matches = []
        for center in (expected, base) if is_far else (expected,):
            hit = search(
                pyramid,
                sample,
                Pose2.from_array(center),
                reach_m=LOST_REACH_M,
                min_score=self._config.min_score,
            )
            if hit is not None:
                anywhere = Prediction(motion, _ANYWHERE)
                start = hit.grid_from_robot.as_array()
                matches.append(self._refine(points, local_map, prior, anywhere, start))
        return matches


def _subsamples(points: Floats) -> list[Floats]:
    """Two disjoint subsamples of returns (K, 2): in one alone a false optimum may win by chance."""
    step = max(1, len(points) // _SEARCH_POINTS)
    return [points[::step], points[step // 2 :: step]] if step > 1 else [points]


def _widened(prediction: Prediction) -> Prediction:
    """Widen a prediction by the basin: the match decides, the prior is weighed afterwards."""
    return Prediction(prediction.motion, prediction.covariance + BASIN_COVARIANCE)


def _agree(predictions: tuple[Prediction, ...]) -> bool:
    """Whether the first prediction and each other one lie within a common gate."""
    one = predictions[0]
    return all(
        squared_mahalanobis(one.motion - other.motion, one.covariance + other.covariance)
        < CHI2_1_PERMILLE
        for other in predictions[1:]
    )
