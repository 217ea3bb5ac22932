# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Submap-to-submap matching: a submap against the region around another one.

A scan that looks back along a corridor overlaps little with a submap of a few metres that looked
ahead; twelve scans overlap with twelve metres of the path, from whichever side.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from operator import attrgetter

import numpy as np

from slarm_graph.config import LoopClosureConfig, MatchingConfig
from slarm_graph.consistency import View, count_known, evidence_against, view_of
from slarm_graph.frontends.scans.closures import GATE_SIGMAS, Closure
from slarm_graph.frontends.scans.gauss_newton import refine_near
from slarm_graph.frontends.scans.likelihood_grid import LikelihoodGrid, mean_likelihood
from slarm_graph.frontends.scans.line_search import LineSearchMatch, line_search_match
from slarm_graph.frontends.scans.loop_closure import POINT_INFORMATION, rejection_reason
from slarm_graph.frontends.scans.match_information import misfit_discount
from slarm_graph.frontends.scans.place_recognition import PlaceDescriptor, describe_place
from slarm_graph.frontends.scans.significance import DECISIVE_NAT
from slarm_graph.frontends.scans.small_matrix import invert3
from slarm_graph.frontends.scans.static_returns import CONFIRMED_WITHIN, static_returns
from slarm_graph.frontends.scans.submaps import (
    FINE_GRIDS,
    Keyframe,
    Submap,
    SubmapCache,
    joined_returns,
    likelihood_of,
)
from slarm_graph.frontends.scans.wall_faces import align_by_faces
from slarm_graph.frontends.scans.wall_sides import own_surfaces, share_from_behind, wall_sides
from slarm_graph.geometry import Floats, between, compose, one_per_cell

_NEIGHBOURS = 2
"""Submaps to either side in a region: 12 m of path, as far as drift does not blur it."""
_QUERY_POINTS = 600
"""Returns of a submap that are aligned: more are redundant."""
_QUERY_CELL_M = 0.1
"""One return is kept per cell: a wall's likelihood is as wide."""
_START_INFORMATION = np.diag([1 / 1.5**2, 1 / 1.5**2, 1 / 0.6**2])
"""Information of a searched start of a submap: three cells and three angular steps."""
_BASIN_INFORMATION = np.diag([1 / 0.2**2, 1 / 0.2**2, 1 / 0.1**2])
"""Prior information of a scan's pose by the basin of convergence of refinement [m, m, rad].
With it intel.bag's mean error is 0.0160 m in place of 0.0183, with half the distance 0.0163."""
_WIDE_M, _WIDE_CELL_M = 0.35, 0.15
"""Fall-off of the likelihood and cell of the first stage: place recognition is exact to half a cell
of 0.5 m along either axis, beyond the basin of convergence on the fine grid."""
_MISFIT = 4.0
"""Log of the variance of a submap's pose per share of its returns that fit nothing in known space.
In simulated buildings matches that fit 0.9, 0.7, 0.5 and less were 0.9, 2, 2.5 and 2.8 times as far
off (68 %) as curvature said; with 4 all are 0.7 to 1.0. Chosen on buildings of even number, right
for those of odd number, too; half and double leave 1.8 and 0.5."""
_MAX_VIEWS = 1024
"""Cached views of regions: they take a tenth of a megabyte each."""


class SubmapMatcher:
    """Aligns submaps with the regions around others by their static returns.

    Parameters
    ----------
    loops : LoopClosureConfig
    matching : MatchingConfig
    keyframes, submaps : sequences
        All of a recording.
    earlier : SubmapMatcher, optional
        Of the same recording when it was shorter: what still holds is not built again.
    """

    def __init__(
        self,
        loops: LoopClosureConfig,
        matching: MatchingConfig,
        keyframes: Sequence[Keyframe],
        submaps: Sequence[Submap],
        earlier: SubmapMatcher | None = None,
    ) -> None:
        stricter = {"min_score": loops.min_submap_score}
        self._loops, self._matching = loops.model_copy(update=stricter), matching
        self._keyframes, self._submaps = static_returns(keyframes, matching), submaps
        self._all_returns = keyframes
        self._poses = np.array([k.local_from_robot.as_array() for k in keyframes])
        self._grids: SubmapCache[LikelihoodGrid] = SubmapCache(
            FINE_GRIDS, partial(likelihood_of, matching=matching)
        )
        wide = matching.model_copy(update={"resolution_m": _WIDE_CELL_M, "sigma_m": _WIDE_M})
        self._wide_grids: SubmapCache[LikelihoodGrid] = SubmapCache(
            FINE_GRIDS, partial(likelihood_of, matching=wide)
        )
        self._sides = SubmapCache(FINE_GRIDS, wall_sides)
        self._views: SubmapCache[View] = SubmapCache(
            _MAX_VIEWS, _view, attrgetter("points_m", "clear_ends_m")
        )
        self._appearances: dict[tuple[int, int, int], PlaceDescriptor] = {}
        if earlier is not None:
            self._views = earlier._views
            settled = len(earlier._poses) - CONFIRMED_WITHIN
            self._appearances = {k: v for k, v in earlier._appearances.items() if k[1] <= settled}

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
        """Return the static returns (K, 2) of a submap in its frame [m]."""
        members = self._keyframes[submap.first : submap.last]
        return joined_returns([m.points_m for m in members], self._poses_of(submap))

    def appearance(self, submap: int) -> PlaceDescriptor:
        """Describe a submap with its neighbours, about the median of its own static returns."""
        own, region = self.region(submap, 0), self.region(submap)
        key = (region.first, region.last, region.anchor)
        if key not in self._appearances:
            middle = np.median(self.points_of(own), axis=0)
            self._appearances[key] = describe_place(self.points_of(region), middle)
        return self._appearances[key]

    def align(self, query: int, target: int, start: Floats) -> Closure:
        """Align one submap with the region around another.

        Parameters
        ----------
        query, target : int
        start : (3,) float64
            Initial pose of the query's frame in the target's [m, m, rad].

        Returns
        -------
        Closure
            Of the query's first keyframe, with the median score of its keyframes; with a reason
            where it is rejected.
        """
        submap, region = self._submaps[query], self.region(target)
        members, poses = self._keyframes[submap.first : submap.last], self._poses_of(submap)
        scans, settings = [m.points_m for m in members], (_START_INFORMATION, POINT_INFORMATION)
        iterations, reach_m = 2 * self._matching.max_iterations, GATE_SIGMAS * self._loops.sure_m
        grid, sides = (
            self._grids.of(region, self._keyframes),
            self._sides.of(region, self._keyframes),
        )
        wide = self._wide_grids.of(region, self._keyframes)
        thinned, surfaces = _thinned(scans, poses), [own_surfaces(scan) for scan in scans]
        coarse_pose, *_ = refine_near(wide, thinned, start, *settings, iterations)

        def align(chosen: Sequence[Floats], start_pose: Floats) -> LineSearchMatch:
            """Align them with the region."""
            points = thinned if chosen is scans else _thinned(chosen, poses)
            return line_search_match(grid, points, start_pose, *settings, iterations, reach_m)

        min_points = self._matching.min_points
        match, used = align_by_faces(align, sides, scans, surfaces, poses, coarse_pose, min_points)
        pose = match.pose
        discount = misfit_discount(
            self._fit_where_known(grid, joined_returns(used, poses), target, pose), _MISFIT
        )
        scan_poses = compose(pose, poses)
        # Of all returns: a wall's other face is left out of aligning, but still counts against it.
        placed = zip(scans, scan_poses, strict=True)
        score = float(np.median([mean_likelihood(grid, *scan) for scan in placed]))
        views = zip(surfaces, scan_poses, strict=True)
        behind = float(np.median([share_from_behind(sides, *view) for view in views]))
        reason = rejection_reason(score, discount * match.information, behind, self._loops)
        reason = reason or self._contradiction(query, target, pose)
        marginal_information = discount * match.marginal_information
        return Closure(target, submap.anchor, pose, marginal_information, score, True, reason)

    def better_fit(self, points: Floats, submap: int, start: Floats) -> tuple[Floats, Floats]:
        """Refine a scan from a start in the region around a submap.

        Parameters
        ----------
        points : (K, 2) float64
            Returns in the robot's frame [m].
        submap : int
        start : (3,) float64
            The robot's pose in the submap's frame [m, m, rad], within the basin of convergence.

        Returns
        -------
        (3,) float64
            The refined pose; the start where the scan fits no better.
        (3, 3) float64
            Covariance in the robot's frame, by the scan; zero for the start [m^2, m^2, rad^2].
        """
        grid = self._grids.of(self.region(submap), self._keyframes)
        iterations = 2 * self._matching.max_iterations
        settings = (_BASIN_INFORMATION, POINT_INFORMATION)
        pose, information, score, *_ = refine_near(grid, points, start, *settings, iterations)
        if score <= mean_likelihood(grid, points, start):
            return start, np.zeros((3, 3))
        return pose, invert3(information + _BASIN_INFORMATION)

    def _fit_where_known(
        self, grid: LikelihoodGrid, points: Floats, target: int, pose: Floats
    ) -> float:
        """Mean likelihood of those points (K, 2) that lie in known space at a pose (3,)."""
        view = self._views.of(self.region(target), self._all_returns)
        known = count_known(points, pose, view.states, view.low)
        return mean_likelihood(grid, points, pose) * len(points) / max(known, 1)

    def _contradiction(self, query: int, target: int, pose: Floats) -> str:
        """Return the reason where walls and free space do not support a pose (3,); else empty."""
        if self.evidence_against(query, target, pose, _NEIGHBOURS) < -DECISIVE_NAT:
            return ""
        return "walls and free space of the two places do not support it"

    def evidence_against(self, query: int, target: int, pose: Floats, neighbours: int = 0) -> float:
        """Return the evidence of both submaps' views against a relative pose (3,) [nat]."""
        regions = (self.region(k, neighbours) for k in (query, target))
        own, other = (self._views.of(region, self._all_returns) for region in regions)
        return evidence_against(own, other, pose)

    def _poses_of(self, submap: Submap) -> Floats:
        return between(self._poses[submap.anchor], self._poses[submap.first : submap.last])


def _thinned(scans: Sequence[Floats], poses: Floats) -> Floats:
    """Join scans, each (K, 2) [m], at poses (M, 3), and thin the returns."""
    thinned = one_per_cell(joined_returns(scans, poses), _QUERY_CELL_M)
    return np.ascontiguousarray(thinned[:: 1 + len(thinned) // _QUERY_POINTS])


def _view(scans: Sequence[tuple[Floats, Floats]], poses: Floats) -> View:
    """Walls and free space seen by scans at poses (M, 3).

    Parameters
    ----------
    scans : sequence of ((K, 2), (L, 2)) float64
        Returns, and how far beams reach that have met nothing, in the robot's frame [m].
    poses : (M, 3) float64
    """
    parts = []
    for points in zip(*scans, strict=True):
        ends = np.cumsum([len(part) for part in points])[:-1]
        parts.append(np.split(joined_returns(points, poses), ends))
    returns, clear_ends = parts
    return view_of(returns, poses[:, :2], clear_ends)
