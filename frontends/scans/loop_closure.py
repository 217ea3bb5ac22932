# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Loop closure in three stages: detect -> refine -> validate.

Detect finds where a keyframe may lie in an old submap: where the graph is sure, that is the
predicted pose itself; where it is not, a correlative search over a window as large as the
uncertainty the path has gathered. Refine aligns the keyframe on the submap's likelihood grid.
Validate asks for agreement with the submap, and on the same side of its walls; for a second,
independent match by a later keyframe, and for both to tell the same story.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from slarm_graph.config import LoopClosureConfig, MatchingConfig
from slarm_graph.frontends.scans.along_walls import SlidMatch, aligned
from slarm_graph.frontends.scans.closures import SIGMAS, Closure, Expectations
from slarm_graph.frontends.scans.correlative import search
from slarm_graph.frontends.scans.likelihood_grid import mean_likelihood
from slarm_graph.frontends.scans.search_pyramid import SearchPyramid, build_pyramid
from slarm_graph.frontends.scans.submaps import Keyframe, Submap, SubmapCache, likelihood_of
from slarm_graph.frontends.scans.wall_faces import aligned_by_faces
from slarm_graph.frontends.scans.wall_sides import own_surfaces, share_from_behind, wall_sides
from slarm_graph.geometry import Floats, Pose2, between, compose, one_per_cell, transform_points

POINT_INFORMATION = 0.3
"""Of a return of a scan in an old submap, over that of one in the grid's own noise: neighbouring
returns of one wall err alike, by what the submap is bent. Half and double move nothing by 0.3 %."""
_LOOSE_INFORMATION = np.diag([1 / 0.5**2, 1 / 0.5**2, 1 / 0.2**2])
"""Of where a search or the graph puts a scan: five cells of 0.1 m and a step of turns."""
_COARSE_GRIDS, _FINE_GRIDS = 64, 24
"""Submaps kept prepared: the result is the same with any number. Half of these fine ones are
prepared again in 2 to 4 % more cases, double in 10 % fewer."""
_QUERY_RANGE_M = 12.0
"""Returns that are searched for: of farther ones a step of turns moves too many past a wall."""
_QUERY_POINTS = 250
"""Of them, evenly: a search takes as long as they are many."""
_LONG_AGO = -1_000_000
"""Keyframe of what never happened."""
_PATIENCE, _MOST_PATIENCE = 1.5, 16.0
"""By what the time to the next search grows with every one in vain, and how much at most: ways
that never come back cost little."""
_MOST_FRUITLESS = 100
"""Counted no further: windows and patience reached their bounds long before, powers stay finite."""
_MOST_FROM_BEHIND = 0.5
"""Share of walls matched from their unknown side: right places have few, the far side of a thin
wall all."""


class LoopCloser:
    """Looks for old places, one keyframe at a time."""

    def __init__(self, config: LoopClosureConfig, matching: MatchingConfig) -> None:
        self._config = config
        self._matching = matching
        coarse = matching.model_copy(
            update={"resolution_m": config.search_resolution_m, "sigma_m": config.search_sigma_m}
        )
        self._fine = SubmapCache(_FINE_GRIDS, partial(likelihood_of, matching=matching))
        self._coarse = SubmapCache(_COARSE_GRIDS, partial(_pyramid, matching=coarse))
        self._sides = SubmapCache(_FINE_GRIDS, wall_sides)
        self._tentative: list[Closure] = []
        self._last_match = self._last_search = _LONG_AGO
        self._fruitless = 0
        self._tried: dict[int, int] = {}

    def forget_prepared(self) -> None:
        """Free what was prepared of submaps; it is prepared again when asked for."""
        for cache in (self._fine, self._coarse, self._sides):
            cache.clear()

    def is_due(self, keyframe: int) -> bool:
        """Whether the keyframe is to be compared with old submaps."""
        since = keyframe - max(self._last_match, self._last_search)
        return since >= min(self._config.match_every, self._config.search_every)

    def confirm(self, keyframes: Sequence[Keyframe], submaps: Sequence[Submap]) -> list[Closure]:
        """Validate: match the newest keyframe where an earlier search's match says it must be.

        Returns
        -------
        list of Closure
            As from `examine`; of a search that is confirmed, both matches.
        """
        k = len(keyframes) - 1
        done: list[Closure] = []
        kept: list[Closure] = []
        for first in self._tentative:
            moved = keyframes[first.keyframe].local_from_robot.between(
                keyframes[k].local_from_robot
            )
            way_m = math.hypot(moved.x, moved.y)
            if way_m < self._config.confirm_m:
                kept.append(first)
                continue
            predicted = compose(first.submap_from_keyframe, moved.as_array())
            second = self._refine(k, first.submap, predicted, keyframes, submaps)
            away = between(predicted, second.submap_from_keyframe)
            reason = second.reason
            if math.hypot(away[0], away[1]) > 0.05 + 0.05 * way_m or abs(away[2]) > 0.035:
                reason = "a second match disagrees"
            if not reason:
                self._fruitless = 0
                done += [first, replace(second, searched=True)]
            else:
                done.append(replace(first, reason=f"not confirmed: {reason}"))
        self._tentative = kept
        return done

    def examine(
        self,
        keyframes: Sequence[Keyframe],
        submaps: Sequence[Submap],
        expected: Expectations,
    ) -> list[Closure]:
        """Compare the newest keyframe with old submaps.

        Parameters
        ----------
        keyframes, submaps : sequences
            All so far.
        expected : Expectations
            Of the newest keyframe.

        Returns
        -------
        list of Closure
            Accepted ones have no reason; those turned down come with one.
        """
        k, done = len(keyframes) - 1, []
        sure = (expected.sigma_m <= self._config.sure_m) & (
            expected.sigma_rad <= self._config.sure_rad
        )
        if sure.any() and k - self._last_match >= self._config.match_every:
            self._last_match = k
            for e in np.flatnonzero(sure)[: self._config.candidates]:
                done.append(self._at_prediction(k, int(e), expected, keyframes, submaps))
        patience = min(_PATIENCE**self._fruitless, _MOST_PATIENCE)
        if not sure.all() and k - self._last_search >= self._config.search_every * patience:
            self._last_search = k
            self._search(k, np.flatnonzero(~sure), expected, keyframes, submaps)
        return done

    def _at_prediction(
        self,
        k: int,
        e: int,
        expected: Expectations,
        keyframes: Sequence[Keyframe],
        submaps: Sequence[Submap],
    ) -> Closure:
        """Refine where the graph expects the keyframe; earlier closures are the second opinion."""
        predicted = expected.submap_from_keyframe[e]
        return self._refine(k, int(expected.submap[e]), predicted, keyframes, submaps)

    def _search(
        self,
        k: int,
        unsure: NDArray[np.int64],
        expected: Expectations,
        keyframes: Sequence[Keyframe],
        submaps: Sequence[Submap],
    ) -> None:
        """Detect: best place of the last few keyframes' points in the nearest submaps' windows."""
        retry = self._config.search_again
        tries = [
            e for e in unsure if k - self._tried.get(int(expected.submap[e]), _LONG_AGO) >= retry
        ][: self._config.searches]
        if not tries:
            return
        query = self._query(k, keyframes)
        windows = [self._window(int(e), expected) for e in tries]
        self._fruitless = min(self._fruitless + 1, _MOST_FRUITLESS)
        for e, (reach_m, reach_rad) in zip(tries, windows, strict=True):
            submap = int(expected.submap[e])
            self._tried[submap] = k
            hit = search(
                self._coarse.of(submaps[submap], keyframes),
                query,
                Pose2.from_array(expected.submap_from_keyframe[e]),
                reach_m=reach_m,
                reach_rad=reach_rad,
                min_score=self._config.search_score,
            )
            if hit is None:
                continue
            found = self._refine(k, submap, hit.grid_from_robot.as_array(), keyframes, submaps)
            if not found.reason:
                self._tentative.append(replace(found, searched=True))

    def _window(self, e: int, expected: Expectations) -> tuple[float, float]:
        """Half the window to search an old submap in, as far as the graph may err [m, rad]."""
        reach_m, reach_rad = SIGMAS * expected.sigma_m[e], SIGMAS * expected.sigma_rad[e]
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
        points, old = keyframes[k].points_m, submaps[submap]
        grid, sides = self._fine.of(old, keyframes), self._sides.of(old, keyframes)
        tries, reach_m = 2 * self._matching.max_iterations, SIGMAS * self._config.sure_m

        def align(scans: Sequence[Floats], near: Floats) -> SlidMatch:
            """Align the keyframe with the submap."""
            how = _LOOSE_INFORMATION, POINT_INFORMATION, tries, reach_m
            return aligned(grid, scans[0], near, *how)

        seen, least = own_surfaces(points), self._matching.min_points
        found, _ = aligned_by_faces(align, sides, [points], [seen], np.zeros((1, 3)), start, least)
        behind = share_from_behind(sides, seen, found.pose)
        score = mean_likelihood(grid, points, found.pose)
        reason = doubt(score, found.information, behind, self._config)
        return Closure(submap, k, found.pose, found.over_reach, score, False, reason)

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


def doubt(score: float, information: Floats, behind: float, config: LoopClosureConfig) -> str:
    """Say what is wrong with a match on its own; empty when nothing is.

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
    return "sees the other side of its walls" if behind > _MOST_FROM_BEHIND else ""


def _pyramid(points: Sequence[Floats], poses: Floats, matching: MatchingConfig) -> SearchPyramid:
    return build_pyramid(likelihood_of(points, poses, matching), max_radius_m=_QUERY_RANGE_M)
