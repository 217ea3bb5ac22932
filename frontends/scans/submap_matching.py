# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Matching a whole submap in what was seen around another: surer than a scan in a submap.

A scan that looks back along a corridor shares little with a submap of a few metres that looked
ahead; twelve scans share something with twelve metres of the way, from whichever side.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from slarm_graph.config import LoopClosureConfig, MatchingConfig
from slarm_graph.consistency import View, count_known, evidence_against, view_of
from slarm_graph.frontends.scans.along_walls import SlidMatch, aligned
from slarm_graph.frontends.scans.closures import SIGMAS, Closure
from slarm_graph.frontends.scans.gauss_newton import refine_near
from slarm_graph.frontends.scans.likelihood_grid import LikelihoodGrid, mean_likelihood
from slarm_graph.frontends.scans.loop_closure import POINT_INFORMATION, doubt
from slarm_graph.frontends.scans.match_certainty import of_misfit
from slarm_graph.frontends.scans.small_matrix import invert3
from slarm_graph.frontends.scans.standing import standing
from slarm_graph.frontends.scans.submaps import (
    Keyframe,
    Submap,
    SubmapCache,
    joined_returns,
    likelihood_of,
)
from slarm_graph.frontends.scans.wall_faces import aligned_by_faces
from slarm_graph.frontends.scans.wall_sides import own_surfaces, share_from_behind, wall_sides
from slarm_graph.geometry import Floats, between, compose, one_per_cell

_NEIGHBOURS = 2
"""Submaps to either side that a region reaches: 12 m of way, as far as drift does not blur it."""
_QUERY_POINTS = 600
"""Returns of a submap that are aligned: more repeat each other."""
_QUERY_CELL_M = 0.1
"""One return is kept per cell: a wall's likelihood is as wide."""
_LOOSE_INFORMATION = np.diag([1 / 1.5**2, 1 / 1.5**2, 1 / 0.6**2])
"""Of where a search puts a submap: three cells and three steps of the turn that it tries."""
_AS_FAR_AS_IT_SEES = np.diag([1 / 0.2**2, 1 / 0.2**2, 1 / 0.1**2])
"""Information about a scan's place from where refinement still finds the right one [m, m, rad].
With it intel.bag's mean error is 0.0160 m in place of 0.0183, with half the distance 0.0163."""
_WIDE_M, _WIDE_CELL_M = 0.35, 0.15
"""Fall-off of the likelihood at first, and cell: places are found to half a cell of 0.5 m along
either axis, from where refinement on the fine grid alone ends beside the place."""
_MISFIT = 4.0
"""Log of the variance of a submap's place per share of its returns that fit nothing where others
looked. In simulated buildings places that fit 0.9, 0.7, 0.5 and less were 0.9, 2, 2.5 and 2.8 times
as far off (68 %) as curvature said; with 4 all are 0.7 to 1.0. Chosen on buildings of even number,
right for those of odd number, too; half and double leave 1.8 and 0.5."""
_SPEAKS_FOR_NAT = -5.0
"""Evidence against a placement from which it is believed [nat]: odds of 150 to 1 for it, by what
either place's walls and free space say of the other. From -1 to -5 nothing moves by more than 1 %;
with -10 fewer true finds of sparse recordings pass, with -20 fewer of a hall of pillars seen 5.6 m
deep (0.26, 0.41 and 0.28 m in place of 0.16, 0.25 and 0.14), with or without a bar of the score."""
_MOST_GRIDS = 24
"""Regions kept prepared: the neighbours of a place are asked for one after the other. Half of these
are prepared again in a tenth more cases, double in a quarter fewer."""
_MOST_VIEWS = 256
"""What was seen from regions, of a tenth of a megabyte each, is kept for more of them."""


class SubmapMatcher:
    """Aligns submaps with the regions around others, by what stands.

    Parameters
    ----------
    loops : LoopClosureConfig
    matching : MatchingConfig
    keyframes, submaps : sequences
        All of a recording.
    """

    def __init__(
        self,
        loops: LoopClosureConfig,
        matching: MatchingConfig,
        keyframes: Sequence[Keyframe],
        submaps: Sequence[Submap],
    ) -> None:
        bar = {"min_score": loops.min_submap_score}
        self._loops, self._matching = loops.model_copy(update=bar), matching
        self._keyframes, self._submaps = standing(keyframes, matching), submaps
        self._all_returns = keyframes
        self._poses = np.array([k.local_from_robot.as_array() for k in keyframes])
        self._grids: SubmapCache[LikelihoodGrid] = SubmapCache(
            _MOST_GRIDS, partial(likelihood_of, matching=matching)
        )
        wide = matching.model_copy(update={"resolution_m": _WIDE_CELL_M, "sigma_m": _WIDE_M})
        self._wide: SubmapCache[LikelihoodGrid] = SubmapCache(
            _MOST_GRIDS, partial(likelihood_of, matching=wide)
        )
        self._sides = SubmapCache(_MOST_GRIDS, wall_sides)
        self._views: SubmapCache[View] = SubmapCache(_MOST_VIEWS, _view)

    def region(self, submap: int, neighbours: int = _NEIGHBOURS) -> Submap:
        """Return the run of keyframes of a submap and its neighbours, in its frame."""
        own, last = self._submaps[submap], len(self._submaps) - 1
        return Submap(
            self._submaps[max(submap - neighbours, 0)].first,
            self._submaps[min(submap + neighbours, last)].last,
            own.anchor,
            own.center_m,
        )

    def points_of(self, submap: Submap) -> Floats:
        """Return all returns (K, 2) of a submap in its frame [m]."""
        members = self._keyframes[submap.first : submap.last]
        return joined_returns([m.points_m for m in members], self._poses_of(submap))

    def align(self, query: int, target: int, start: Floats) -> Closure:
        """Align one submap with the region around another.

        Parameters
        ----------
        query, target : int
        start : (3,) float64
            Where the query's frame may lie in the target's [m, m, rad].

        Returns
        -------
        Closure
            Of the query's first keyframe, with the median score of its keyframes; with a reason
            where it is not good enough.
        """
        submap, region = self._submaps[query], self.region(target)
        members, poses = self._keyframes[submap.first : submap.last], self._poses_of(submap)
        scans, loosely = [m.points_m for m in members], (_LOOSE_INFORMATION, POINT_INFORMATION)
        tries, reach_m = 2 * self._matching.max_iterations, SIGMAS * self._loops.sure_m
        grid, sides = (
            self._grids.of(region, self._keyframes),
            self._sides.of(region, self._keyframes),
        )
        wide = self._wide.of(region, self._keyframes)
        every, seen = _thinned(scans, poses), [own_surfaces(scan) for scan in scans]
        roughly, *_ = refine_near(wide, every, start, *loosely, tries)

        def align(some: Sequence[Floats], near: Floats) -> SlidMatch:
            """Align them with the region."""
            points = every if some is scans else _thinned(some, poses)
            return aligned(grid, points, near, *loosely, tries, reach_m)

        least = self._matching.min_points
        found, kept = aligned_by_faces(align, sides, scans, seen, poses, roughly, least)
        pose = found.pose
        certain = of_misfit(self._fits(grid, joined_returns(kept, poses), target, pose), _MISFIT)
        at = compose(pose, poses)
        # Of all returns: a wall's other face, left out of aligning, is no sign of the place either.
        placed = zip(scans, at, strict=True)
        score = float(np.median([mean_likelihood(grid, *scan) for scan in placed]))
        looks = zip(seen, at, strict=True)
        behind = float(np.median([share_from_behind(sides, *look) for look in looks]))
        reason = doubt(score, certain * found.information, behind, self._loops)
        reason = reason or self._contradiction(query, target, pose)
        over_reach = certain * found.over_reach
        return Closure(target, submap.anchor, pose, over_reach, score, True, reason)

    def better_fit(self, points: Floats, submap: int, start: Floats) -> tuple[Floats, Floats]:
        """Return where a scan fits best near a start, in the region around a submap.

        Parameters
        ----------
        points : (K, 2) float64
            Returns in the robot's frame [m].
        submap : int
        start : (3,) float64
            The robot's pose in the submap's frame [m, m, rad], as far off as refinement sees.

        Returns
        -------
        (3,) float64
            The start where the scan fits there as well.
        (3, 3) float64
            Covariance in the robot's frame, by the scan; zero for the start [m^2, m^2, rad^2].
        """
        grid = self._grids.of(self.region(submap), self._keyframes)
        tries = 2 * self._matching.max_iterations
        loosely = (_AS_FAR_AS_IT_SEES, POINT_INFORMATION)
        pose, information, score, *_ = refine_near(grid, points, start, *loosely, tries)
        if score <= mean_likelihood(grid, points, start):
            return start, np.zeros((3, 3))
        return pose, invert3(information + _AS_FAR_AS_IT_SEES)

    def _fits(self, grid: LikelihoodGrid, points: Floats, target: int, pose: Floats) -> float:
        """Mean likelihood of points (K, 2) at a pose (3,), of those where others looked."""
        view = self._views.of(self.region(target), self._all_returns)
        known = count_known(points, pose, view.states, view.low)
        return mean_likelihood(grid, points, pose) * len(points) / max(known, 1)

    def _contradiction(self, query: int, target: int, pose: Floats) -> str:
        """Say so when what either place saw does not speak for a pose (3,) of one in the other."""
        if self.evidence_against(query, target, pose, _NEIGHBOURS) < _SPEAKS_FOR_NAT:
            return ""
        return "walls and free space of the two places do not speak for it"

    def evidence_against(self, query: int, target: int, pose: Floats, neighbours: int = 0) -> float:
        """Return what either place saw says against a pose (3,) of one in the other [nat]."""
        regions = (self.region(k, neighbours) for k in (query, target))
        seen, old = (self._views.of(region, self._all_returns) for region in regions)
        return evidence_against(seen, old, pose)

    def _poses_of(self, submap: Submap) -> Floats:
        return between(self._poses[submap.anchor], self._poses[submap.first : submap.last])


def _thinned(scans: Sequence[Floats], poses: Floats) -> Floats:
    """Join scans, each (K, 2) [m], at poses (M, 3); of the returns some are kept."""
    kept = one_per_cell(joined_returns(scans, poses), _QUERY_CELL_M)
    return np.ascontiguousarray(kept[:: 1 + len(kept) // _QUERY_POINTS])


def _view(points: Sequence[Floats], poses: Floats) -> View:
    """What scans (each (K, 2) [m] in the robot's frame) at poses (M, 3) saw."""
    ends = np.cumsum([len(part) for part in points])[:-1]
    return view_of(np.split(joined_returns(points, poses), ends), poses[:, :2])
