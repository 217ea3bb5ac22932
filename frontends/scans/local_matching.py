# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Finding the places on the local map that a scan may have.

Refinement from the likeliest prediction proposes a place. Where that is surprising, others are
proposed beside it: the prediction itself, the same leaning on the prediction as far as a scan's
evidence really goes, refinement from the other predictions, and searches of the windows that they
allow; for a scan that fits nowhere of these, a search all round.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from slarm_graph.config import MatchingConfig
from slarm_graph.frontends.scans.correlative import search
from slarm_graph.frontends.scans.fits import UNSEEN, UsualFit, chance_fit, drawn_to, pieces
from slarm_graph.frontends.scans.grid_match import match_on_grid
from slarm_graph.frontends.scans.keyframes import LocalMap
from slarm_graph.frontends.scans.match_certainty import of_misfit
from slarm_graph.frontends.scans.odometry_filter import Prediction
from slarm_graph.frontends.scans.places import (
    Outlook,
    Place,
    are_same,
    distinct,
    is_vague,
    judged,
    unmatched,
)
from slarm_graph.frontends.scans.refinement import Refinement
from slarm_graph.frontends.scans.search_pyramid import build_pyramid
from slarm_graph.frontends.scans.significance import CHI2_1_PERMILLE, SIGMAS_1_PERCENT
from slarm_graph.frontends.scans.small_pose import BASIN, between3, compose3, squared_sigmas
from slarm_graph.frontends.scans.window_search import (
    LOST_REACH_M,
    best_in_window,
    far_m,
)
from slarm_graph.geometry import Floats, Pose2

_LOST = 4.0
"""Standard deviations below the usual fit at which a scan is looked for all round."""
_SEARCH_POINTS = 80
"""Returns looked up in a search: more repeat each other."""
_PLENTY_OF_POINTS = 20
"""Between fewer returns much of the walls is not seen at all; each then says less."""
_ANYWHERE = np.diag([2.0, 2.0, 3.0]) ** 2
"""Of a pose that a search has found [m^2, m^2, rad^2]: within its reach, at any heading."""
_FIRST_FITS, _LEAST_FIT = 5.0, 0.01
"""Scans after which the usual fit means something, and the least that it is taken for."""
_SEES = 6.0
"""Standard deviations of the likelihood's fall-off that refinement sees: three to either side,
where the slope is a twentieth of the steepest. Half of it leaves edmonton (0.67 m for 0.64, means
of draws) and turns dec13's last seconds, which are a draw, the wrong way. Half as much again does
not."""
_FROM_PREDICTION = np.empty(0)
"""Stands for a start of its own where there is none, and has no numbers."""


class LocalMatcher:
    """Matches scans one after the other, and knows how well they usually fit.

    Parameters
    ----------
    config : MatchingConfig
    refine_by : callable, optional
        Refines in place of the likelihood grid.
    """

    def __init__(self, config: MatchingConfig, refine_by: Refinement | None = None) -> None:
        self._config, self._refine_by = config, refine_by
        self.usual = UsualFit()

    def places(
        self, points: Floats, local_map: LocalMap, outlook: Outlook, *, all_round: bool, alone: bool
    ) -> list[Place]:
        """Return the places a scan may have, the likeliest first, with their posteriors.

        Parameters
        ----------
        points : (K, 2) float64
            Returns in the robot's frame [m].
        local_map : LocalMap
        outlook : Outlook
            The likeliest prediction first.
        all_round : bool
            Whether to search all round, where nothing fits near the predictions.
        alone : bool
            Whether there is no other story to weigh a usual place against.
        """
        grid, prediction = local_map.grid, outlook.predictions[0]
        if grid is None or len(points) < self._config.min_points:
            return [unmatched(prediction, outlook)]
        near = self._near(points, local_map, outlook)
        is_usual = len(near) == 1 and self._is_usual(near[0], points, local_map, outlook)
        if is_usual and alone:
            return near
        expected = compose3(outlook.base, prediction.motion)
        chance = chance_fit(points, local_map, expected, self.usual.mean)
        outlook = replace(outlook, chance=chance)
        if is_usual:
            return [judged(near[0], points, local_map, outlook, self.usual)]
        return self._proposals(near, points, local_map, outlook, all_round)

    def _near(self, points: Floats, local_map: LocalMap, outlook: Outlook) -> list[Place]:
        """Refine from the prediction, and where that is vaguer than refinement sees, search too."""
        grid, prediction = local_map.grid, outlook.predictions[0]
        assert grid is not None
        loose = _loosened(prediction)
        place = self._refine(points, local_map, outlook, loose)
        sigma = np.sqrt(prediction.covariance.diagonal())
        if math.hypot(sigma[0], sigma[1], far_m(points) * sigma[2]) < _SEES * grid.sigma_m:
            return [place]
        few = points[:: max(1, len(points) // _SEARCH_POINTS)]
        start = best_in_window(
            few, grid, outlook.base, prediction, local_map.levels, least=(0.0, 0.0)
        )
        other = self._refine(points, local_map, outlook, loose, start)
        if are_same(place.pose, other.pose):
            return [max(place, other, key=lambda p: p.score)]
        return [place, other] if other.inliers else [place]

    def _is_usual(
        self, place: Place, points: Floats, local_map: LocalMap, outlook: Outlook
    ) -> bool:
        """Whether a scan fits as others do, near where all agree that it should be."""
        if place.score < self._config.min_score or not _agree(outlook.predictions):
            return False
        if len(outlook.predictions) > 1 and is_vague(outlook.predictions[0].covariance):
            return False
        if self._below(place, points, local_map) > SIGMAS_1_PERCENT:
            return False
        expected = outlook.predictions[0]
        away = between3(outlook.base, place.pose) - expected.motion
        spread = expected.covariance + outlook.covariance_of(place.information)
        return squared_sigmas(away, spread) <= CHI2_1_PERMILLE

    def _below(self, place: Place, points: Floats, local_map: LocalMap) -> float:
        fits = place.fit_of(points, local_map, self.usual)
        return self.usual.below(fits, pieces(points))

    def _proposals(
        self,
        near: Sequence[Place],
        points: Floats,
        local_map: LocalMap,
        outlook: Outlook,
        all_round: bool,
    ) -> list[Place]:
        """Propose places beside those near the prediction and judge all, the likeliest first."""
        grid, base, predictions = local_map.grid, outlook.base, outlook.predictions
        assert grid is not None
        found = list(near)
        evidence = pieces(points) / len(points)
        few = points[:: max(1, len(points) // _SEARCH_POINTS)]
        for prediction in predictions:
            leaning = self._refine(points, local_map, outlook, prediction, evidence=evidence)
            if not any(are_same(leaning.pose, place.pose) for place in near):
                found.append(leaning)
            if prediction is not predictions[0]:
                found.append(self._refine(points, local_map, outlook, _loosened(prediction)))
        places = [judged(p, points, local_map, outlook, self.usual) for p in found if p.inliers]
        places += [unmatched(p, outlook) for p in predictions]
        best = max(places, key=lambda p: p.log_posterior)
        below = min(self._below(p, points, local_map) for p in found)
        if below <= SIGMAS_1_PERCENT and any(
            np.array_equal(best.pose, place.pose) for place in near
        ):
            return distinct(places)
        found = []
        for some, prediction in product(_samples(points), predictions):
            start = best_in_window(some, grid, base, prediction, local_map.levels)
            loose = Prediction(prediction.motion, 4.0 * predictions[-1].covariance)
            found.append(self._refine(points, local_map, outlook, loose, start))
            below = min(below, self._below(found[-1], points, local_map))
        if all_round and below > _LOST:
            found += self._all_round(points, few, local_map, outlook)
        places += self._judged_as_searched(found, points, local_map, outlook)
        return distinct(places)

    def _judged_as_searched(
        self, found: Sequence[Place], points: Floats, local_map: LocalMap, outlook: Outlook
    ) -> list[Place]:
        """Judge places by how well the scan fits at others that refinement leads to.

        Such a place is the best of many, and the others are what it was the best of. That near a
        prediction was not chosen for its fit.
        """
        expected = compose3(outlook.base, outlook.predictions[0].motion)
        drawn = drawn_to(points, local_map, expected, self.usual.mean)
        places = []
        for place in found:
            if place.inliers:
                elsewhere = replace(outlook, chance=drawn.chance_of(place.pose))
                places.append(judged(place, points, local_map, elsewhere, self.usual))
        return places

    def _refine(
        self,
        points: Floats,
        local_map: LocalMap,
        outlook: Outlook,
        prediction: Prediction,
        start: Floats = _FROM_PREDICTION,
        evidence: float = 1.0,
    ) -> Place:
        """Refine from the prediction, or from another start (3,) leaning on the prediction."""
        if self._refine_by is not None:
            return self._refine_by(points, outlook.base, prediction, start, evidence)
        grid = local_map.grid
        assert grid is not None
        trust = evidence * min(1.0, len(points) / _PLENTY_OF_POINTS)
        pose, information, score, inliers, used, agreement = match_on_grid(
            grid.lattice,
            local_map.seen,
            local_map.seen_step,
            points,
            outlook.expectation,
            prediction.motion,
            prediction.covariance,
            start,
            trust * (grid.sigma_m / self._config.point_sigma_m) ** 2,
            evidence,
            UNSEEN * self.usual.mean,
            self._config.max_iterations,
        )
        if self.usual.count < _FIRST_FITS:
            return Place(pose, information, score, inliers, used)
        fits = agreement / len(points)
        left = of_misfit(fits / max(self.usual.mean, _LEAST_FIT))
        return Place(pose, left * information, score, inliers, used, fits=fits)

    def _all_round(
        self,
        points: Floats,
        few: Floats,
        local_map: LocalMap,
        outlook: Outlook,
    ) -> list[Place]:
        """Look all round where the robot should be, and where it last was."""
        grid, base, motion = local_map.grid, outlook.base, outlook.predictions[0].motion
        assert grid is not None
        expected = compose3(base, motion)
        is_far = math.hypot(motion[0], motion[1]) > 0.5 * LOST_REACH_M
        pyramid = build_pyramid(grid)
        found = []
        for center in (expected, base) if is_far else (expected,):
            hit = search(
                pyramid,
                few,
                Pose2.from_array(center),
                reach_m=LOST_REACH_M,
                min_score=self._config.min_score,
            )
            if hit is not None:
                anywhere = Prediction(motion, _ANYWHERE)
                start = hit.grid_from_robot.as_array()
                found.append(self._refine(points, local_map, outlook, anywhere, start))
        return found


def _samples(points: Floats) -> list[Floats]:
    """Two samples of returns (K, 2), alike and yet different: in one alone chance may win."""
    step = max(1, len(points) // _SEARCH_POINTS)
    return [points[::step], points[step // 2 :: step]] if step > 1 else [points]


def _loosened(prediction: Prediction) -> Prediction:
    """Widen a prediction, so that what the scan says is found; both are weighed afterwards."""
    return Prediction(prediction.motion, prediction.covariance + BASIN)


def _agree(predictions: tuple[Prediction, ...]) -> bool:
    """Whether all stories tell of the same motion."""
    one = predictions[0]
    return all(
        squared_sigmas(one.motion - other.motion, one.covariance + other.covariance)
        < CHI2_1_PERMILLE
        for other in predictions[1:]
    )
