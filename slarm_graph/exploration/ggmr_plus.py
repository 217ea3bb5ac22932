# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""GGMR+: cover with the body, see with the laser, and turn as little as possible.

Against the literal algorithm: what the laser has seen free need not be driven to only to be known;
lanes lie a body's width apart instead of a cell's and follow the walls; and their order is a tour
that is planned anew as the map grows, by the time that driving takes, turns included.
"""

from __future__ import annotations

import math
from collections import Counter
from typing import Final, Literal

import numpy as np

from slarm_graph.config import ExploreConfig
from slarm_graph.exploration.contour_lanes import Lane, contour_lanes
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
from slarm_graph.exploration.lanes import coverable
from slarm_graph.exploration.planning import distances_from, reachable
from slarm_graph.exploration.baselines import _padded
from slarm_graph.exploration.explorer import coverage_grid
from slarm_graph.exploration.tour import ordered, without_detours
from slarm_graph.geometry import Floats, Pose2, wrap_angle
from slarm_graph.grid import GridGeometry, Mask

_TRACKING_M: Final = 0.01
_MIN_LANE_M2: Final = 0.01
_WORTH_S_M2: Final = 200.0
_LANE_M: Final = 3.0
_LEG_M: Final = 4.0
_MOST_LANES: Final = 250
_TOUR_CELL_M: Final = 0.2
_NEWS_M2: Final = 0.25
_MAX_TRIES: Final = 4
_SAME_PLACE_M: Final = 0.1
_HEADING_CELLS: Final = 6
_STOP_RAD: Final = math.radians(30.0)


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
        self._tour: list[Floats] = []
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
        """Drive on along the tour; plan anew where floor was seen since, and when it ends."""
        if not self._tour or self._has_learnt(driving):
            self._plan(driving, start, pose)
        fresh = self._planned_on is driving.observed
        leg = self._next_leg(driving, pose)
        if leg is None and not fresh:
            self._plan(driving, start, pose)
            leg = self._next_leg(driving, pose)
        return leg

    def _plan(self, driving: DrivingGrid, start: tuple[int, int], pose: Pose2) -> None:
        near = reachable(driving.moves, start)
        lanes = lanes_to_cover(driving, near, self._config.driving.robot_radius_m)
        lanes = [lane for lane in lanes if self._tries[self._place(lane.points, driving)] < _MAX_TRIES]
        self._tour = tour_of(lanes, driving, pose, self._config)
        self._planned_on = driving.observed

    def _place(self, points: Floats, driving: DrivingGrid) -> tuple[int, int]:
        x, y = points[len(points) // 2] * (driving.geometry.resolution_m / _SAME_PLACE_M)
        return int(x), int(y)

    def _has_learnt(self, driving: DrivingGrid) -> bool:
        """Whether floor was seen since the last plan that it does not know of."""
        if self._planned_on is None or self._planned_on.shape != driving.observed.shape:
            return True
        news = np.count_nonzero(driving.observed & ~self._planned_on)
        return bool(news * driving.geometry.resolution_m**2 > _NEWS_M2)

    def _next_leg(self, driving: DrivingGrid, pose: Pose2) -> Leg | None:
        g = driving.geometry
        pieces, is_link = [np.array([[pose.x, pose.y]])], [np.ones(1, dtype=np.bool_)]
        length_m, here = 0.0, pieces[0][0]
        while self._tour and length_m < _LEG_M:
            lane = self._tour.pop(0)
            self._tries[self._place(lane, driving)] += 1
            points = lane * g.resolution_m + (g.origin_x_m, g.origin_y_m)
            to = way_between(driving, here, points[0])
            if to is None:
                continue
            here = points[-1]
            pieces += [to[1:], points[1:]]
            is_link += [np.ones(len(to) - 1, dtype=np.bool_), np.zeros(len(points) - 1, np.bool_)]
            length_m += path_m(to) + path_m(points)
        way = smooth_way(np.concatenate(pieces), np.concatenate(is_link), driving)
        return Leg(way) if len(way) > 1 else None


def path_m(points):
    return float(np.hypot(*np.diff(points, axis=0).T).sum()) if len(points) > 1 else 0.0


STEP_M, LANE_M, LINK_M = 0.02, 0.09, 0.18


def smooth_way(points, is_link, driving):
    points_in = points
    keep = np.ones(len(points), dtype=bool)
    keep[1:] = np.hypot(*np.diff(points, axis=0).T) > 1e-6
    points, is_link = points[keep], is_link[keep]
    if len(points) < 3:
        return points
    step = np.hypot(*np.diff(points, axis=0).T)
    along = np.concatenate([[0.0], np.cumsum(step)])
    n = max(2, int(np.ceil(along[-1] / STEP_M)) + 1)
    at = np.linspace(0, along[-1], n)
    dense = np.stack([np.interp(at, along, points[:, k]) for k in (0, 1)], -1)
    seg = np.clip(np.searchsorted(along, at, side="left"), 1, len(points) - 1)
    link = is_link[seg]
    k = int(round(LANE_M / STEP_M)); kl = int(round(LINK_M / STEP_M))
    near = grown(link, kl)
    room = to_corner(dense, ~link)
    lane = average(dense, np.minimum(k, room))
    both = average(dense, np.where(near, kl, np.minimum(k, room)))
    g = driving.geometry
    ok = _ok(both, driving)
    bad = ~ok & near
    if bad.any():
        bad = grown(bad, kl)
        both = np.where(bad[:, None], lane, both)
    # a link that is still not passable stays as planned
    ok = _ok(both, driving)
    bad = ~ok & link
    if bad.any():
        both = average(dense, np.where(bad, 0, np.where(near, kl, np.minimum(k, room))))
    return without_straight_points(both)


CORNER_M, CORNER_RAD = 0.16, math.radians(60)


def to_corner(dense, where):
    """Samples to the nearest sharp corner."""
    m = int(round(CORNER_M / STEP_M))
    n = len(dense)
    i = np.arange(n)
    a, b = np.maximum(i - m, 0), np.minimum(i + m, n - 1)
    u, v = dense - dense[a], dense[b] - dense
    bend = np.abs(np.arctan2(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0], (u * v).sum(1)))
    import cv2
    best = cv2.dilate(bend[None], np.ones((1, 2 * m + 1)))[0]
    corner = where & (bend >= best) & (bend > CORNER_RAD)
    at = np.flatnonzero(corner)
    if not len(at):
        return np.full(n, n)
    k = np.clip(np.searchsorted(at, i), 1, len(at)) 
    lo, hi = at[k - 1], at[np.minimum(k, len(at) - 1)]
    return np.minimum(np.abs(i - lo), np.abs(i - hi))


def grown(m, k):
    import cv2
    return cv2.dilate(m.astype(np.uint8)[None], np.ones((1, 2 * k + 1), np.uint8))[0] > 0


def _ok(pts, driving):
    g = driving.geometry
    cells = g.cell_of(pts)
    inside = g.contains(cells)
    ok = np.zeros(len(pts), bool)
    ok[inside] = driving.passable[cells[inside, 0], cells[inside, 1]]
    return ok


def average(points, reach):
    n = len(points)
    i = np.arange(n)
    reach = np.minimum(reach, np.minimum(i, n - 1 - i))
    total = np.concatenate([np.zeros((1, 2)), np.cumsum(points, axis=0)])
    return (total[i + reach + 1] - total[i - reach]) / (2 * reach + 1)[:, None]


def lanes_to_cover(driving: DrivingGrid, near: Mask, radius_m: float) -> list[Lane]:
    """Lanes over the free floor that the body could pass over and has not."""
    cell_m = driving.geometry.resolution_m
    passable = driving.passable & near
    wanted = driving.observed & coverable(passable, radius_m / cell_m) & ~driving.swept
    radius = max(0.5, (radius_m - _TRACKING_M) / cell_m)
    lanes = contour_lanes(wanted, passable, radius, _LANE_M / cell_m)
    return [lane for lane in lanes if lane.area_cells * cell_m**2 >= _MIN_LANE_M2]


def tour_of(
    lanes: list[Lane], driving: DrivingGrid, pose: Pose2, config: ExploreConfig
) -> list[Floats]:
    """Lanes (K, 2) [cells] in the order and the sense in which to drive them."""
    if not lanes:
        return []
    cell_m = driving.geometry.resolution_m
    side = max(1, round(_TOUR_CELL_M / cell_m))
    padded = _padded(driving, side)
    rows, cols = padded.geometry.rows // side, padded.geometry.cols // side
    geometry = GridGeometry(0.0, 0.0, 1.0, rows, cols)
    coarse = coverage_grid(geometry, padded, np.zeros((rows, cols), dtype=np.bool_))
    spots = np.array([p for lane in lanes for p in (lane.points[0], lane.points[-1])])
    g = driving.geometry
    robot = (np.array([pose.x, pose.y]) - (g.origin_x_m, g.origin_y_m)) / cell_m
    cells = np.clip((spots / side).astype(np.int64), 0, [cols - 1, rows - 1])
    start = np.clip((robot / side).astype(np.int64), 0, [cols - 1, rows - 1])
    away = distances_from(coarse.moves, (int(start[1]), int(start[0])))[cells[:, 1], cells[:, 0]]
    nearest = np.argsort(away.reshape(-1, 2).min(axis=1), kind="stable")
    nearest = nearest[np.isfinite(away.reshape(-1, 2).min(axis=1)[nearest])][:_MOST_LANES]
    if not len(nearest):
        return []
    lanes = [lanes[i] for i in nearest]
    ends = np.stack([2 * nearest, 2 * nearest + 1], axis=-1).ravel()
    spots, cells, away = spots[ends], cells[ends], away[ends]
    out = np.array([a for lane in lanes for a in _headings(lane.points)])
    between = np.stack(
        [distances_from(coarse.moves, (int(r), int(c)))[cells[:, 1], cells[:, 0]] for c, r in cells]
    )
    links_s = _times_s(between * side, spots, out, spots, out, cell_m, config)
    first_s = _times_s(
        away[None] * side, robot[None], np.array([pose.theta]), spots, out, cell_m, config
    )[0]
    tour = ordered(links_s, first_s)
    per_cell_s = cell_m / config.driving.speed_m_s
    worth_s = np.array(
        [_WORTH_S_M2 * l.area_cells * cell_m**2 - len(l.points) * per_cell_s for l in lanes]
    )
    tour = without_detours(tour, links_s, first_s, worth_s)
    global LAST_LINKS
    LAST_LINKS = len(tour) and first_s[tour[0]] + sum(links_s[a ^ 1, b] for a, b in zip(tour[:-1], tour[1:]))
    return [lanes[e // 2].points[:: -1 if e % 2 else 1] for e in tour]


def _headings(points: Floats) -> tuple[float, float]:
    """Directions out of a lane at its first and its last point [rad]."""
    k = min(_HEADING_CELLS, len(points) - 1)
    first, last = points[0] - points[k], points[-1] - points[-1 - k]
    return math.atan2(first[1], first[0]), math.atan2(last[1], last[0])


def _times_s(
    geodesic: Floats,
    a: Floats,
    out_a: Floats,
    b: Floats,
    out_b: Floats,
    cell_m: float,
    config: ExploreConfig,
) -> Floats:
    """Time (N, M) from leaving at ends a to entering at ends b, turns included [s]."""
    step = b[None] - a[:, None]
    straight = np.hypot(step[..., 0], step[..., 1])
    side = max(1, round(_TOUR_CELL_M / cell_m))
    distance = np.where(geodesic <= straight + 2.0 * side, straight, geodesic)
    bearing = np.arctan2(step[..., 1], step[..., 0])
    into = out_b[None] + math.pi
    bearing = np.where(straight < 3.0, into, bearing)
    c = config.driving
    time_s = distance * cell_m / c.speed_m_s
    for turn in (_between(out_a[:, None], bearing), _between(bearing, into)):
        time_s = time_s + turn / c.turn_rate_rad_s
        time_s += np.where(turn > _STOP_RAD, c.speed_m_s / c.acceleration_m_s2, 0.0)
    return np.minimum(time_s, 1e9)


def _between(a: Floats, b: Floats) -> Floats:
    return np.abs((b - a + math.pi) % (2.0 * math.pi) - math.pi)
