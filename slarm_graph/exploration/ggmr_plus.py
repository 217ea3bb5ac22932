# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""GGMR+: coverage by contour lanes in the order of a tour, exploration by frontiers.

Unlike the literal algorithm: cells that the laser has seen free need not be visited only to be
known; lanes are a body's width apart instead of a cell's, and follow the walls; their order is a
tour of little time, turns included, that is replanned as the map grows. Left-over floor is covered
where the tour passes by, and given up where it would cost more time than it is worth.
"""

from __future__ import annotations

from collections import Counter
from typing import ClassVar, Final, Literal

import numpy as np

from slarm_graph.config import DrivingConfig, Stage
from slarm_graph.exploration.contour_lanes import Lane, contour_lanes
from slarm_graph.exploration.coverage_grid import CoverageGrid, DrivingGrid, driving_cell
from slarm_graph.exploration.explorer import Finished, Leg
from slarm_graph.exploration.frontier import FrontierSelector
from slarm_graph.exploration.lane_order import order_lanes
from slarm_graph.exploration.paths import path_between
from slarm_graph.exploration.searches import reachable
from slarm_graph.exploration.smooth_paths import smooth_path
from slarm_graph.geometry import Floats, Pose2
from slarm_graph.grid import Mask
from slarm_graph.raster.distance import distance_to

_TRACKING_M: Final = 0.01
"""How far from its lane the robot may be."""
_LANE_M: Final = 3.0
"""Length of the pieces of lanes that the tour orders: that of a room. The time to order them goes
with the square of their number."""
_MIN_LANE_M2: Final = 0.01
"""A square of 0.1 m: smaller remainders between cells are not floor."""
_PRICE_S_M2: Final = 200.0
"""Time that a square metre is worth: some forty times what it costs on a straight lane."""
_LEG_M: Final = 4.0
"""Length of a leg before the tour is consulted again: some seconds, in which the map changes
little."""
_NEWS_M2: Final = 0.25
"""Newly observed floor that makes replanning worth its time: a square of half a metre."""
_MAX_TRIES: Final = 4
"""Times a lane is driven before it is given up: free on the map, but the robot finds it is not."""
_SAME_PLACE_M: Final = 0.1
"""Lanes whose middles share a square of this side are the same on two maps: half the distance
between lanes and less."""


class GgmrPlusConfig(Stage):
    """The explorer `ggmr+`."""

    goal: Literal["observed", "footprint"] = "footprint"
    """To see everything, or to pass over everything."""


class GgmrPlus:
    """Coverage by contour lanes in the order of a short tour: what `ggmr` covers, in less time."""

    settings: ClassVar[type[Stage]] = GgmrPlusConfig

    def __init__(self, settings: GgmrPlusConfig, driving: DrivingConfig) -> None:
        self._driving = driving
        self._goal = settings.goal
        self._tries: Counter[tuple[int, int]] = Counter()
        self._tour: list[Floats] = []
        self._rest: list[Lane] = []
        self._planned_on: Mask | None = None
        self._selector = FrontierSelector()

    def next_goal(self, coverage: CoverageGrid, pose: Pose2) -> Leg | Finished:
        """Cover the next part of the known free floor, or else drive to a frontier."""
        driving = coverage.driving
        start = driving_cell(driving, pose.x, pose.y)
        if start is None:
            return Finished("no free cell near the robot")
        if self._goal == "footprint":
            leg = self._cover(driving, start, pose)
            if leg is not None:
                return leg
        near = reachable(driving.moves, start)
        leg = self._selector.leg_to_frontier(driving, near, pose)
        return leg or Finished("everything reachable is known")

    def _cover(self, driving: DrivingGrid, start: tuple[int, int], pose: Pose2) -> Leg | None:
        """Continue the tour; replan it where floor was observed since, and when it ends."""
        if self._has_learnt(driving):
            self._plan(driving, start, pose)
        fresh = self._planned_on is driving.observed
        leg = self._next_leg(driving, pose)
        if leg is None and not fresh:
            self._plan(driving, start, pose)
            leg = self._next_leg(driving, pose)
        return leg

    def _plan(self, driving: DrivingGrid, start: tuple[int, int], pose: Pose2) -> None:
        near = reachable(driving.moves, start)
        lanes = lanes_to_cover(driving, near, self._driving.robot_radius_m)
        self._rest = [n for n in lanes if self._tries[_place(n.points, driving)] < _MAX_TRIES]
        self._tour = []
        self._planned_on = driving.observed

    def _has_learnt(self, driving: DrivingGrid) -> bool:
        """Whether enough floor was observed since the last plan."""
        if self._planned_on is driving.observed:
            return False
        if self._planned_on is None or self._planned_on.shape != driving.observed.shape:
            return True
        news = np.count_nonzero(driving.observed & ~self._planned_on)
        return bool(news * driving.geometry.resolution_m**2 > _NEWS_M2)

    def _next_leg(self, driving: DrivingGrid, pose: Pose2) -> Leg | None:
        """Take the next few metres of lanes from the tour."""
        g = driving.geometry
        here = np.array([pose.x, pose.y])
        pieces: list[tuple[Floats, bool]] = []
        length_m = 0.0
        while self._rest and not self._tour:
            self._tour, self._rest = order_lanes(
                self._rest, driving, pose, self._driving, _PRICE_S_M2
            )
        while self._tour and length_m < _LEG_M:
            lane = self._tour.pop(0)
            self._tries[_place(lane, driving)] += 1
            points_m = lane * g.resolution_m + (g.origin_x_m, g.origin_y_m)
            link_m = path_between(driving, here, points_m[0])
            if link_m is None:
                continue
            pieces += [(link_m, True), (points_m, False)]
            length_m += len(lane) * g.resolution_m
            here = points_m[-1]
        path_m = smooth_path(pieces, driving) if pieces else np.empty((0, 2))
        return Leg(path_m) if len(path_m) > 1 else None


def lanes_to_cover(driving: DrivingGrid, near: Mask, radius_m: float) -> list[Lane]:
    """Lanes over the free floor that the body could pass over and has not.

    Parameters
    ----------
    driving : DrivingGrid
    near : (rows, cols) bool
        Driving cells that can be reached.
    radius_m : float
        Of the body [m].
    """
    cell_m = driving.geometry.resolution_m
    passable = driving.passable & near
    in_reach = distance_to(passable) <= radius_m / cell_m
    wanted = driving.observed & in_reach & ~driving.swept
    radius = max(0.5, (radius_m - _TRACKING_M) / cell_m)
    lanes = contour_lanes(np.asarray(wanted), passable, radius, _LANE_M / cell_m)
    return [lane for lane in lanes if lane.area_cells * cell_m**2 >= _MIN_LANE_M2]


def _place(points: Floats, driving: DrivingGrid) -> tuple[int, int]:
    """Square of a lane's midpoint, coarse enough to identify the lane on another map."""
    x, y = points[len(points) // 2] * (driving.geometry.resolution_m / _SAME_PLACE_M)
    return int(x), int(y)
