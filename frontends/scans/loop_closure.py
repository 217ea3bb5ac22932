# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Loop closure in three stages: detect -> refine -> validate.

Detect proposes poses of a keyframe in an old submap: the predicted pose where the graph is certain,
else a correlative search over a window as large as the uncertainty accumulated along the path.
Refine aligns the keyframe on the submap's likelihood grid. Validate demands a good fit, on the same
side of the submap's walls, and for a searched closure a second, independent match by a later
keyframe that is consistent with the first.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from slarm_graph.config import LoopClosureConfig, MatchingConfig
from slarm_graph.frontends.scans.closures import GATE_SIGMAS, Closure, ClosureCandidates
from slarm_graph.frontends.scans.correlative import search
from slarm_graph.frontends.scans.likelihood_grid import mean_likelihood
from slarm_graph.frontends.scans.line_search import LineSearchMatch, line_search_match
from slarm_graph.frontends.scans.search_pyramid import SearchPyramid, build_pyramid
from slarm_graph.frontends.scans.submaps import (
    FINE_GRIDS,
    Keyframe,
    Submap,
    SubmapCache,
    likelihood_of,
)
from slarm_graph.frontends.scans.wall_faces import align_by_faces
from slarm_graph.frontends.scans.wall_sides import own_surfaces, share_from_behind, wall_sides
from slarm_graph.geometry import Floats, Pose2, between, compose, one_per_cell, transform_points

POINT_INFORMATION = 0.3
"""Weight of a return of a scan in an old submap, relative to the grid's own noise: neighbouring
returns of one wall have correlated errors, by the submap's distortion. Half and double move nothing
by 0.3 %."""
_START_INFORMATION = np.diag([1 / 0.5**2, 1 / 0.5**2, 1 / 0.2**2])
"""Information of a searched or predicted start: five cells of 0.1 m and an angular step."""
_COARSE_GRIDS = 64
"""Submaps cached for searches: the result is the same with any number."""
_QUERY_RANGE_M = 12.0
"""Range of the returns used in a search: an angular step moves farther ones past a wall."""
_QUERY_POINTS = 250
"""Number of returns in a search, evenly thinned: its time is proportional."""
_NEVER = -1_000_000
"""Keyframe index that stands for never."""
_BACKOFF, _MAX_BACKOFF = 1.5, 16.0
"""Factor on the time to the next search per failed one, and its bound: paths that never return cost
little."""
_AGREE_M, _AGREE_PER_M, _AGREE_RAD = 0.05, 0.05, 0.035
"""Two matches of a search agree within a cell, 5 % of the way between them, and two degrees. Half
and double move nothing (mit-csail plain and with hard_1_of_2, edmonton, seattle, a ward) but a hall
by -4 and -17 %; without it the ward is 20 % worse."""
_MAX_FROM_BEHIND = 0.5
"""Largest share of walls matched from their unknown side: true closures have few, the far side of a
thin wall all."""


class LoopCloser:
    """Detects loop closures with old submaps, one keyframe at a time."""

    def __init__(self, config: LoopClosureConfig, matching: MatchingConfig) -> None:
        self._config = config
        self._matching = matching
        coarse = matching.model_copy(
            update={"resolution_m": config.search_resolution_m, "sigma_m": config.search_sigma_m}
        )
        self._fine = SubmapCache(FINE_GRIDS, partial(likelihood_of, matching=matching))
        self._coarse = SubmapCache(_COARSE_GRIDS, partial(_pyramid, matching=coarse))
        self._sides = SubmapCache(FINE_GRIDS, wall_sides)
        self._tentative: list[Closure] = []
        self._last_match = self._last_search = _NEVER
        self._backoff = 1.0
        self._tried: dict[int, int] = {}

    def forget_prepared(self) -> None:
        """Clear the caches of submaps; they are rebuilt on demand."""
        for cache in (self._fine, self._coarse, self._sides):
            cache.clear()

    def is_due(self, keyframe: int) -> bool:
        """Whether the keyframe is to be matched with old submaps."""
        since = keyframe - max(self._last_match, self._last_search)
        return since >= min(self._config.match_every, self._config.search_every)

    def confirm(self, keyframes: Sequence[Keyframe], submaps: Sequence[Submap]) -> list[Closure]:
        """Validate pending searched closures by a second match of the newest keyframe.

        Returns
        -------
        list of Closure
            As from `examine`; of a confirmed search both matches.
        """
        k = len(keyframes) - 1
        closures: list[Closure] = []
        pending: list[Closure] = []
        for first in self._tentative:
            moved = keyframes[first.keyframe].local_from_robot.between(
                keyframes[k].local_from_robot
            )
            distance_m = math.hypot(moved.x, moved.y)
            if distance_m < self._config.confirm_m:
                pending.append(first)
                continue
            predicted = compose(first.submap_from_keyframe, moved.as_array())
            second = self._refine(k, first.submap, predicted, keyframes, submaps)
            residual = between(predicted, second.submap_from_keyframe)
            reason = second.reason
            if (
                math.hypot(residual[0], residual[1]) > _AGREE_M + _AGREE_PER_M * distance_m
                or abs(residual[2]) > _AGREE_RAD
            ):
                reason = "a second match disagrees"
            if not reason:
                self._backoff = 1.0
                closures += [first, replace(second, searched=True)]
            else:
                closures.append(replace(first, reason=f"not confirmed: {reason}"))
        self._tentative = pending
        return closures

    def examine(
        self,
        keyframes: Sequence[Keyframe],
        submaps: Sequence[Submap],
        candidates: ClosureCandidates,
    ) -> list[Closure]:
        """Match the newest keyframe with the candidate submaps.

        Parameters
        ----------
        keyframes, submaps : sequences
            All so far.
        candidates : ClosureCandidates
            Of the newest keyframe.

        Returns
        -------
        list of Closure
            Accepted ones have no reason, rejected ones have one. Searched ones wait for `confirm`.
        """
        k, closures = len(keyframes) - 1, []
        is_certain = (candidates.sigma_m <= self._config.sure_m) & (
            candidates.sigma_rad <= self._config.sure_rad
        )
        if is_certain.any() and k - self._last_match >= self._config.match_every:
            self._last_match = k
            for e in np.flatnonzero(is_certain)[: self._config.candidates]:
                closures.append(self._at_prediction(k, int(e), candidates, keyframes, submaps))
        if (
            not is_certain.all()
            and k - self._last_search >= self._config.search_every * self._backoff
        ):
            self._last_search = k
            self._search(k, np.flatnonzero(~is_certain), candidates, keyframes, submaps)
        return closures

    def _at_prediction(
        self,
        k: int,
        e: int,
        candidates: ClosureCandidates,
        keyframes: Sequence[Keyframe],
        submaps: Sequence[Submap],
    ) -> Closure:
        """Refine from the predicted pose; earlier closures stand for the second match."""
        predicted = candidates.submap_from_keyframe[e]
        return self._refine(k, int(candidates.submap[e]), predicted, keyframes, submaps)

    def _search(
        self,
        k: int,
        uncertain: NDArray[np.int64],
        candidates: ClosureCandidates,
        keyframes: Sequence[Keyframe],
        submaps: Sequence[Submap],
    ) -> None:
        """Detect: correlative search of the last keyframes' points in the nearest submaps."""
        retry = self._config.search_again
        attempts = [
            e for e in uncertain if k - self._tried.get(int(candidates.submap[e]), _NEVER) >= retry
        ][: self._config.searches]
        if not attempts:
            return
        query = self._query(k, keyframes)
        windows = [self._window(int(e), candidates) for e in attempts]
        self._backoff = min(_BACKOFF * self._backoff, _MAX_BACKOFF)
        for e, (reach_m, reach_rad) in zip(attempts, windows, strict=True):
            submap = int(candidates.submap[e])
            self._tried[submap] = k
            hit = search(
                self._coarse.of(submaps[submap], keyframes),
                query,
                Pose2.from_array(candidates.submap_from_keyframe[e]),
                reach_m=reach_m,
                reach_rad=reach_rad,
                min_score=self._config.search_score,
            )
            if hit is None:
                continue
            match = self._refine(k, submap, hit.grid_from_robot.as_array(), keyframes, submaps)
            if not match.reason:
                self._tentative.append(replace(match, searched=True))

    def _window(self, e: int, candidates: ClosureCandidates) -> tuple[float, float]:
        """Half the search window by the gate of the predicted pose, bounded [m, rad]."""
        reach_m, reach_rad = (
            GATE_SIGMAS * candidates.sigma_m[e],
            GATE_SIGMAS * candidates.sigma_rad[e],
        )
        return (
            min(float(reach_m), self._config.window_m),
            min(float(reach_rad), self._config.window_rad),
        )

    def _refine(
        self,
        k: int,
        submap: int,
        start: Floats,
        keyframes: Sequence[Keyframe],
        submaps: Sequence[Submap],
    ) -> Closure:
        points, target = keyframes[k].points_m, submaps[submap]
        grid, sides = self._fine.of(target, keyframes), self._sides.of(target, keyframes)
        iterations, reach_m = 2 * self._matching.max_iterations, GATE_SIGMAS * self._config.sure_m

        def align(scans: Sequence[Floats], start_pose: Floats) -> LineSearchMatch:
            """Align the keyframe with the submap."""
            settings = _START_INFORMATION, POINT_INFORMATION, iterations, reach_m
            return line_search_match(grid, scans[0], start_pose, *settings)

        surfaces, min_points = own_surfaces(points), self._matching.min_points
        match, _ = align_by_faces(
            align, sides, [points], [surfaces], np.zeros((1, 3)), start, min_points
        )
        behind = share_from_behind(sides, surfaces, match.pose)
        score = mean_likelihood(grid, points, match.pose)
        reason = rejection_reason(score, match.information, behind, self._config)
        return Closure(submap, k, match.pose, match.marginal_information, score, False, reason)

    def _query(self, k: int, keyframes: Sequence[Keyframe]) -> Floats:
        """Points (Q, 2) of the last keyframes in the newest one's frame, one per coarse cell."""
        here = keyframes[k].local_from_robot
        parts = [
            transform_points(here.between(f.local_from_robot).as_array(), f.points_m)
            for f in keyframes[max(0, k - self._config.query_keyframes + 1) : k + 1]
        ]
        points = np.concatenate(parts)
        points = points[np.hypot(points[:, 0], points[:, 1]) < _QUERY_RANGE_M]
        thinned = one_per_cell(points, self._config.search_resolution_m)
        return np.ascontiguousarray(thinned[:: 1 + len(thinned) // _QUERY_POINTS])


def rejection_reason(
    score: float, information: Floats, behind: float, config: LoopClosureConfig
) -> str:
    """Return the reason to reject a match by itself; empty when there is none.

    Parameters
    ----------
    score : float
    information : (3, 3) float64
    behind : float
        Share of the walls matched that are seen from their unknown side.
    config : LoopClosureConfig
    """
    if score < config.min_score:
        return f"score {score:.2f}"
    if np.linalg.eigvalsh(information[:2, :2])[0] < 1.0 / config.max_sigma_m**2:
        return "slides along a wall"
    return "sees the other side of its walls" if behind > _MAX_FROM_BEHIND else ""


def _pyramid(points: Sequence[Floats], poses: Floats, matching: MatchingConfig) -> SearchPyramid:
    return build_pyramid(likelihood_of(points, poses, matching), max_radius_m=_QUERY_RANGE_M)
