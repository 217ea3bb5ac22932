# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""GGMR+: cover with the body, see with the laser, and turn as little as possible.

Against the literal algorithm: what the laser has seen free need not be driven to only to be known;
lanes lie a body's width apart instead of a cell's; they run along the longer side of every part of
the floor and hug its walls; turns between lanes are driven as arcs; and the order of the parts is
planned anew on every map.
"""

from __future__ import annotations

import itertools
import math
from collections import Counter
from dataclasses import dataclass
from typing import Final, Literal

import cv2
import numpy as np

from slarm_graph.config import ExploreConfig
from slarm_graph.exploration.explorer import (
    OPEN,
    CoverageGrid,
    DrivingGrid,
    Finished,
    Leg,
    driving_cell,
    way_between,
    without_straight_points,
)
from slarm_graph.exploration.frontier import look_at_unknown, unseen_cells
from slarm_graph.exploration.lanes import Part, coverable, split_into_parts
from slarm_graph.exploration.planning import distances_from, reachable, sees, shortcut
from slarm_graph.geometry import Floats, Pose2, wrap_angle
from slarm_graph.grid import Mask

_TRACKING_M: Final = 0.01
_MIN_PART_M2: Final = 0.01
_WORTH_S_M2: Final = 200.0
_FIRST_REACH: Final = 64.0
_MIN_WIDTH_M: Final = 0.025
_ARC_WIDTHS_M: Final = (0.16, 0.6)
_MAX_TRIES: Final = 4
_SAME_PLACE_M: Final = 0.1
_ARC_STEP_RAD: Final = math.radians(15.0)


class GgmrPlus:
    """Ours: the same seam as `ggmr`, less driving.

    Parameters
    ----------
    config : ExploreConfig
    """

    def __init__(self, config: ExploreConfig) -> None:
        self._config = config
        self._goal: Literal["observed", "footprint"] = config.goal
        self._tries: Counter[tuple[int, int]] = Counter()
        self._parts: list[Part] = []
        self._planned_on: Mask | None = None

    def next_goal(self, coverage: CoverageGrid, pose: Pose2) -> Leg | Finished:
        """Cover the next part of what is known to be free, or else look at the unknown."""
        driving = coverage.driving
        start = driving_cell(driving, pose.x, pose.y)
        if start is None:
            return Finished("no free cell near the robot", int(np.sum(coverage.codes == OPEN)))
        if self._goal == "footprint":
            leg = self._cover(driving, start, pose)
            if leg is not None:
                return leg
        near = reachable(driving.moves, start)
        leg = look_at_unknown(driving, near, pose)
        return leg or Finished("everything reachable is known", unseen_cells(coverage, near))

    def _cover(self, driving: DrivingGrid, start: tuple[int, int], pose: Pose2) -> Leg | None:
        """Go over the next part; plan anew where floor was seen since, and once more at the end."""
        if not self._parts or self._has_learnt(driving):
            self._plan(driving, start)
        fresh = self._planned_on is driving.observed
        leg = self._next_part(driving, start, pose)
        if leg is None and not fresh:
            self._plan(driving, start)
            leg = self._next_part(driving, start, pose)
        return leg

    def _plan(self, driving: DrivingGrid, start: tuple[int, int]) -> None:
        near = reachable(driving.moves, start)
        self._parts = parts_to_cover(driving, near, self._config.driving.robot_radius_m)
        self._planned_on = driving.observed

    def _has_learnt(self, driving: DrivingGrid) -> bool:
        """Whether floor was seen since the last plan that it does not know of."""
        if self._planned_on is None or self._planned_on.shape != driving.observed.shape:
            return True
        return bool(np.any(driving.observed & ~self._planned_on))

    def _next_part(self, driving: DrivingGrid, start: tuple[int, int], pose: Pose2) -> Leg | None:
        while self._parts:
            choice = _best_start(self._parts, driving, start, pose, self._config)
            if choice is None:
                return None
            self._parts.remove(choice.part)
            way = _way_over(choice, driving, pose)
            if len(way) > 1 and self._is_worth_a_try(choice, driving):
                return Leg(way)
        return None

    def _is_worth_a_try(self, choice: _Start, driving: DrivingGrid) -> bool:
        """Whether a part has not been begun from the same place in vain before."""
        x, y = choice.entry() * (driving.geometry.resolution_m / _SAME_PLACE_M)
        self._tries[int(x), int(y)] += 1
        return self._tries[int(x), int(y)] <= _MAX_TRIES


@dataclass(frozen=True, slots=True)
class _Start:
    """A part and the corner to begin it from."""

    part: Part
    last_lane_first: bool
    backwards: bool

    def entry(self) -> Floats:
        """Where the first lane begins, x, y [cells]."""
        lane = self.part.lanes[-1 if self.last_lane_first else 0]
        return np.asarray(lane[-1 if self.backwards else 0])

    def heading(self) -> float:
        """Direction of the first lane [rad]."""
        lane = self.part.lanes[-1 if self.last_lane_first else 0]
        begin, end = (lane[-1], lane[0]) if self.backwards else (lane[0], lane[-1])
        return math.atan2(end[1] - begin[1], end[0] - begin[0])


def parts_to_cover(driving: DrivingGrid, near: Mask, radius_m: float) -> list[Part]:
    """Parts of the free floor that the body could pass over and has not."""
    cell_m = driving.geometry.resolution_m
    radius = radius_m / cell_m
    reach = coverable(driving.passable & near, radius)
    wanted = driving.observed & reach & ~driving.swept
    width = max(1, round(_MIN_WIDTH_M / cell_m))
    kernel = np.ones((width, width), dtype=np.uint8)
    wanted = cv2.morphologyEx(wanted.astype(np.uint8), cv2.MORPH_OPEN, kernel) > 0
    least = max(1, round(_MIN_PART_M2 / cell_m**2))
    lane_radius = max(0.5, (radius_m - _TRACKING_M) / cell_m)
    return split_into_parts(wanted, driving.passable & near, lane_radius, least)


def _best_start(
    parts: list[Part],
    driving: DrivingGrid,
    start: tuple[int, int],
    pose: Pose2,
    config: ExploreConfig,
) -> _Start | None:
    """Take the part, and the corner of it, that costs the least time to begin.

    A remnant is worth a way in proportion to its area.
    """
    corners = [(last, back) for last in (False, True) for back in (False, True)]
    starts = [_Start(part, *corner) for part in parts for corner in corners]
    entries = np.array([s.entry() for s in starts]).astype(np.int64)
    turn_rad = np.array([abs(wrap_angle(s.heading() - pose.theta)) for s in starts])
    turn_s = turn_rad / config.driving.turn_rate_rad_s
    cell_m2 = driving.geometry.resolution_m**2
    worth_s = _WORTH_S_M2 * cell_m2 * np.array([s.part.area_cells for s in starts])
    per_cell_s = driving.geometry.resolution_m / config.driving.speed_m_s
    limit = _FIRST_REACH
    while True:
        # No farther than what could still be the best.
        away = distances_from(driving.moves, start, limit)[entries[:, 1], entries[:, 0]]
        cost_s = away * per_cell_s + turn_s
        cost_s[cost_s > worth_s] = np.inf
        least = int(np.argmin(cost_s))
        if cost_s[least] <= limit * per_cell_s or limit > driving.passable.size:
            return starts[least] if np.isfinite(cost_s[least]) else None
        limit *= 4.0


def _way_over(start: _Start, driving: DrivingGrid, pose: Pose2) -> Floats:
    """Drive all lanes of a part to and fro, with arcs between them where there is room."""
    g = driving.geometry
    origin = np.array([g.origin_x_m, g.origin_y_m])
    lanes = start.part.lanes[::-1] if start.last_lane_first else start.part.lanes
    pieces = [np.array([[pose.x, pose.y]])]
    backwards = start.backwards
    for lane in lanes:
        points = shortcut(driving.passable, lane[::-1] if backwards else lane, len(lane))
        for point in points * g.resolution_m + origin:
            piece = way_between(driving, pieces[-1][-1], point)
            if piece is not None:
                pieces.append(piece[1:])
        backwards = not backwards
    way = without_straight_points(np.concatenate(pieces))
    return _with_arcs(way, driving)


def _with_arcs(way: Floats, driving: DrivingGrid) -> Floats:
    """Round every U-turn of two right angles into a half circle, where the centre may be there."""
    pieces, i = [way[:1]], 1
    while i < len(way) - 1:
        arc = _half_circle(way[i - 1 : i + 3]) if i + 2 < len(way) else None
        if arc is not None and _is_passable(arc, driving):
            pieces.append(arc)
            i += 2
        else:
            pieces.append(way[i : i + 1])
            i += 1
    pieces.append(way[i:])
    return without_straight_points(np.concatenate(pieces))


def _half_circle(corners: Floats) -> Floats | None:
    """Half circle (K, 2) within a U-turn of four corners; None where it is not one."""
    into, across, out = np.diff(corners, axis=0)
    width = math.hypot(*across)
    before, after = math.hypot(*into), math.hypot(*out)
    if not _ARC_WIDTHS_M[0] <= width <= _ARC_WIDTHS_M[1] or min(before, after) < width:
        return None
    into, side, out = into / before, across / width, out / after
    if into @ out > -0.98 or abs(into @ side) > 0.2:
        return None
    center = 0.5 * (corners[1] + corners[2]) - 0.5 * width * into
    angle = np.arange(0.0, math.pi + 1e-6, _ARC_STEP_RAD)[:, None]
    return np.asarray(center + 0.5 * width * (np.sin(angle) * into - np.cos(angle) * side))


def _is_passable(points_m: Floats, driving: DrivingGrid) -> bool:
    g = driving.geometry
    points = (points_m - (g.origin_x_m, g.origin_y_m)) / g.resolution_m
    return all(sees(driving.passable, begin, end) for begin, end in itertools.pairwise(points))
