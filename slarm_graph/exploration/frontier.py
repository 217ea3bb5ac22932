# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Frontier-based exploration (Yamauchi 1997): drive to the border of known space."""

from __future__ import annotations

import math
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from slarm_graph.config import DrivingConfig, Stage
from slarm_graph.exploration.coverage_grid import CoverageGrid, DrivingGrid, driving_cell
from slarm_graph.exploration.explorer import Finished, Leg
from slarm_graph.exploration.paths import path_to_wanted, without_collinear_points
from slarm_graph.exploration.searches import reachable
from slarm_graph.geometry import Floats, Pose2
from slarm_graph.grid import Cells, Mask
from slarm_graph.raster.patches import larger_than

_REVIEW_S: Final = 1.0
"""Time after which a goal is looked at again: ten scans of a laser of 10 Hz, 0.6 m of driving."""
_MIN_PATCH_CELLS: Final = 3
"""Smaller components of unknown cells are gaps between beams, not worth a visit."""
_STRIP_M: Final = 0.2
"""Gaps between the beams of a laser of 1 degree at 11 m, which close by themselves as the robot
comes nearer."""
_SAME_PLACE_M: Final = 0.3
"""A frontier moves by so much from one map to the next without being another place."""
_ARRIVED_M: Final = 0.1
"""Half a robot's radius: nearer it sees no more than from here."""
_NEIGHBOURHOOD_M: Final = 0.5
"""About a robot's width and a half: a view from next to a goal shows no more than from it."""
_VAIN_NEIGHBOURHOOD_M: Final = 1.5
"""Neighbourhood of goals given up unseen, about that of a shelf: all its sides look into the same
hollow."""
_MAX_TRIES: Final = 3
"""Two tries may fail because the map was about to change; a third one does not."""
_NEARER_M: Final = 0.1
"""Less than half a robot's radius is no progress but noise of the path."""
_MAX_LOOKS: Final = 30
"""A goal that comes no nearer for so many replans is given up: paths to it open and close in
turn."""


class NearestFrontier:
    """Baseline: drive to the nearest frontier until none is left; what was seen counts as known."""

    def __init__(self, settings: Stage, driving: DrivingConfig) -> None:
        del settings, driving
        self._selector = FrontierSelector()

    def next_goal(self, coverage: CoverageGrid, pose: Pose2) -> Leg | Finished:
        """Drive to the nearest frontier."""
        start = driving_cell(coverage.driving, pose.x, pose.y)
        if start is None:
            return Finished("no free cell near the robot")
        near = reachable(coverage.driving.moves, start)
        leg = self._selector.leg_to_frontier(coverage.driving, near, pose)
        return leg or Finished("everything reachable has been seen")


class FrontierSelector:
    """Selects the nearest frontier as goal, with hysteresis.

    A goal is kept until it has been seen, as the nearest frontier changes with every step where a
    narrow gap appears open and closed in turn. Places chosen several times are excluded, and so are
    wide neighbourhoods that were left unseen several times, such as the hollow inside of a shelf.
    Strips between far beams come last: they close by themselves as the robot comes nearer.
    """

    def __init__(self) -> None:
        self._goal_m: Floats | None = None
        self._away_m, self._looks = math.inf, 0
        self._tried_m: list[Floats] = []
        self._vain_m: list[Floats] = []

    def leg_to_frontier(self, driving: DrivingGrid, near: Mask, pose: Pose2) -> Leg | None:
        """Continue to the goal chosen before, or to the nearest frontier; None where none is left.

        Parameters
        ----------
        driving : DrivingGrid
        near : (rows, cols) bool
            Driving cells that can be reached.
        pose : Pose2
        """
        here = pose.as_array()[:2]
        cells = self._candidates(frontier(driving, _STRIP_M) & near, driving)
        if not len(cells):
            cells = self._candidates(frontier(driving) & near, driving)
        kept = cells[self._is_at_goal(driving.geometry.center_of(cells))]
        if not len(kept) or self._has_arrived(here) or self._looks >= _MAX_LOOKS:
            self._let_goal_be(driving)
            kept = kept[:0]
        wanted = np.zeros(driving.passable.shape, dtype=np.bool_)
        wanted[tuple((kept if len(kept) else cells).T)] = True
        path = path_to_wanted(driving, here, wanted) if len(cells) else None
        if path is None:
            return None
        if self._goal_m is None:
            self._goal_m = path[-1]
            self._tried_m.append(path[-1])
        self._note_progress(path)
        path = without_collinear_points(path)
        return Leg(path, review_s=_REVIEW_S) if len(path) > 1 else None

    def _note_progress(self, path_m: Floats) -> None:
        """Count the replans since the path (K, 2) [m] to the goal last grew shorter."""
        away_m = float(np.hypot(*np.diff(path_m, axis=0).T).sum())
        self._looks += 1
        if away_m < self._away_m - _NEARER_M:
            self._away_m, self._looks = away_m, 0

    def _has_arrived(self, here_m: Floats) -> bool:
        """Whether the robot is at the goal."""
        return self._goal_m is not None and float(np.hypot(*(self._goal_m - here_m))) < _ARRIVED_M

    def _candidates(self, edge: Mask, driving: DrivingGrid) -> Cells:
        """Cells (N, 2) of a frontier (rows, cols) outside neighbourhoods chosen too often."""
        cells = np.argwhere(edge)
        return np.asarray(cells[self._is_worth_trying(driving.geometry.center_of(cells))])

    def _let_goal_be(self, driving: DrivingGrid) -> None:
        """Drop the goal, and record it where it is given up unseen."""
        if self._goal_m is not None:
            unseen_m = driving.geometry.center_of(np.argwhere(frontier(driving)))
            if self._is_at_goal(unseen_m).any():
                self._vain_m.append(self._goal_m)
        self._goal_m, self._away_m, self._looks = None, math.inf, 0

    def _is_at_goal(self, points_m: Floats) -> Mask:
        """Which of points (N, 2) [m] lie near the present goal."""
        if self._goal_m is None:
            return np.zeros(len(points_m), dtype=np.bool_)
        return np.asarray(np.abs(points_m - self._goal_m).max(axis=1) <= _SAME_PLACE_M)

    def _is_worth_trying(self, points_m: Floats) -> Mask:
        """Which of points (N, 2) [m] lie outside neighbourhoods that were chosen too often."""
        hopeless = _count_near(points_m, self._tried_m, _NEIGHBOURHOOD_M) >= _MAX_TRIES
        hopeless |= _count_near(points_m, self._vain_m, _VAIN_NEIGHBOURHOOD_M) >= _MAX_TRIES
        return np.asarray(~hopeless)


def frontier(driving: DrivingGrid, width_m: float = 0.0) -> Mask:
    """Frontier: passable cells (rows, cols) on both sides of the border of unknown space.

    Parameters
    ----------
    driving : DrivingGrid
    width_m : float
        Unknown strips narrower than this are ignored, such as those between far beams.
    """
    free = ~(driving.observed | driving.occupied) & driving.passable
    side = max(1, round(width_m / driving.geometry.resolution_m))
    strip = np.ones((side, side), dtype=np.uint8)
    unknown = cv2.morphologyEx(free.astype(np.uint8), cv2.MORPH_OPEN, strip)
    unknown = larger_than(unknown > 0, _MIN_PATCH_CELLS - 1).astype(np.uint8)
    around = np.ones((3, 3), dtype=np.uint8)
    rim = cv2.dilate(unknown, around) > cv2.erode(unknown, around, borderValue=0)
    return np.asarray(rim & driving.passable)


def _count_near(points_m: Floats, places_m: list[Floats], radius_m: float) -> NDArray[np.int64]:
    """Number (N,) of places within a radius of each of points (N, 2)."""
    if len(places_m) < _MAX_TRIES or not len(points_m):
        return np.zeros(len(points_m), dtype=np.int64)
    found = cKDTree(places_m).query_ball_point(points_m, radius_m, return_length=True)
    return np.asarray(found, dtype=np.int64)
