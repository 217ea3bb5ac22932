# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Order of lanes: travel times between their ends, and a short tour over them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from slarm_graph.config import DrivingConfig
from slarm_graph.exploration.contour_lanes import Lane
from slarm_graph.exploration.coverage_grid import DrivingGrid, start_cell, tiled
from slarm_graph.exploration.searches import distances_between, distances_from
from slarm_graph.exploration.tour import short_tour, worthwhile
from slarm_graph.geometry import Floats, Pose2
from slarm_graph.grid import Cells

_TILE_M: Final = 0.2
"""Shortest paths around obstacles are computed on tiles of this side, half of the narrowest
passage."""
_MOST_LANES: Final = 250
"""The nearest ones are ordered at once; the map will have changed before the rest are driven."""
_HEADING_CELLS: Final = 6
"""Length over which the heading at a lane's end is measured, 0.3 m: above stairs of cells."""
_STOP_RAD: Final = math.radians(30.0)
"""The follower takes sharper turns than this on the spot, see `_SHARP_RAD` there."""
_BESIDE_M: Final = 0.08
"""Ends nearer than this are one place: the heading between them is noise."""
_NEAR_M: Final = 6.0
"""Paths to farther ends are only estimated: the tour goes to near ones first anyway."""
_DETOUR: Final = 1.5
"""Estimated length of longer paths, over the straight line."""


@dataclass(frozen=True, slots=True)
class _Spots:
    """The robot, and both ends of every lane.

    Parameters
    ----------
    points_m : (N, 2) float64
        x, y from the corner of the grid [m].
    out_rad : (N,) float64
        Heading at which a spot is left.
    """

    points_m: Floats
    out_rad: Floats


def order_lanes(
    lanes: list[Lane],
    driving: DrivingGrid,
    pose: Pose2,
    config: DrivingConfig,
    price_s_m2: float,
) -> tuple[list[Floats], list[Lane]]:
    """Order the nearest lanes by a tour from the robot; leave out those not worth their time.

    Parameters
    ----------
    lanes : list of Lane
    driving : DrivingGrid
    pose : Pose2
        `map_from_robot`.
    config : DrivingConfig
    price_s_m2 : float
        The most time that a square metre of floor is worth [s/m2].

    Returns
    -------
    list of (K, 2) float64
        Lanes as they are to be driven; x, y [cells].
    list of Lane
        Lanes that were too far away to be considered.
    """
    cell_m = driving.geometry.resolution_m
    tiles = tiled(driving, max(1, round(_TILE_M / cell_m)))
    tile_m = tiles.geometry.resolution_m
    start = start_cell(tiles, pose)
    if start is None:
        return [], []
    at = _tile_of(_spots(lanes, driving, pose), tile_m, tiles.codes.shape)
    nearest = _nearest_first(distances_from(tiles.moves, start)[at[1:, 0], at[1:, 1]])
    few = [lanes[i] for i in nearest[:_MOST_LANES]]
    rest = [lanes[i] for i in nearest[_MOST_LANES:]]
    if not few:
        return [], []
    spots = _spots(few, driving, pose)
    at = _tile_of(spots, tile_m, tiles.codes.shape)
    at[0] = start
    around_m = distances_between(tiles.moves, at, _NEAR_M / tile_m) * tile_m
    link_s = _link_times_s(spots, around_m, tile_m, config)
    worth_s = np.array([lane.area_cells for lane in few]) * (cell_m**2 * price_s_m2)
    worth_s -= np.array([len(lane.points) for lane in few]) * (cell_m / config.speed_m_s)
    between_s, first_s = link_s[1:, 1:], link_s[0, 1:]
    tour = worthwhile(short_tour(between_s, first_s), between_s, first_s, worth_s)
    return [few[end // 2].points[:: -1 if end % 2 else 1] for end in tour], rest


def _spots(lanes: list[Lane], driving: DrivingGrid, pose: Pose2) -> _Spots:
    g = driving.geometry
    robot = np.array([[pose.x - g.origin_x_m, pose.y - g.origin_y_m]])
    ends = [end for lane in lanes for end in (lane.points[0], lane.points[-1])]
    out_rad = [angle for lane in lanes for angle in _directions_out(lane.points)]
    points_m = np.concatenate([robot, np.array(ends).reshape(-1, 2) * g.resolution_m])
    return _Spots(points_m, np.array([pose.theta, *out_rad]))


def _directions_out(points: Floats) -> tuple[float, float]:
    """Headings at which a lane is left at its first and its last point [rad]."""
    back = min(_HEADING_CELLS, len(points) - 1)
    first, last = points[0] - points[back], points[-1] - points[-1 - back]
    return math.atan2(first[1], first[0]), math.atan2(last[1], last[0])


def _tile_of(spots: _Spots, tile_m: float, shape: tuple[int, ...]) -> Cells:
    """Row and column (N, 2) of the tile of every spot."""
    cells = np.floor(spots.points_m[:, ::-1] / tile_m).astype(np.int64)
    return np.clip(cells, 0, np.array(shape) - 1)


def _nearest_first(away: Floats) -> NDArray[np.int64]:
    """Reachable lanes, by the distance of their nearer end."""
    of_lane = away.reshape(-1, 2).min(axis=1)
    order = np.argsort(of_lane, kind="stable")
    return np.asarray(order[np.isfinite(of_lane[order])])


def _link_times_s(spots: _Spots, around_m: Floats, slack_m: float, config: DrivingConfig) -> Floats:
    """Travel time (N, N) from leaving at one spot to entering at another, turns included [s].

    Parameters
    ----------
    spots : _Spots
    around_m : (N, N) float64
        Length of the path around obstacles [m]; inf where it is long.
    slack_m : float
        A path about as long as the straight line is the straight line [m].
    config : DrivingConfig
    """
    step_m = spots.points_m[None] - spots.points_m[:, None]
    straight_m = np.hypot(step_m[..., 0], step_m[..., 1])
    guess_m = np.maximum(_NEAR_M, _DETOUR * straight_m)
    length_m = np.where(around_m <= straight_m + 2.0 * slack_m, straight_m, around_m)
    length_m = np.where(np.isfinite(around_m), length_m, guess_m)
    into_rad = np.broadcast_to(spots.out_rad[None] + math.pi, straight_m.shape)
    bearing_rad = np.arctan2(step_m[..., 1], step_m[..., 0])
    bearing_rad = np.where(straight_m < _BESIDE_M, into_rad, bearing_rad)
    time_s = length_m / config.speed_m_s
    time_s += _turn_times_s(bearing_rad - spots.out_rad[:, None], config)
    time_s += _turn_times_s(into_rad - bearing_rad, config)
    return np.asarray(time_s)


def _turn_times_s(turn_rad: Floats, config: DrivingConfig) -> Floats:
    """Time of turns [s]; sharp ones cost a stop as well."""
    turn_rad = np.abs((turn_rad + math.pi) % (2.0 * math.pi) - math.pi)
    stop_s = config.speed_m_s / config.acceleration_m_s2
    return np.asarray(
        turn_rad / config.turn_rate_rad_s + np.where(turn_rad > _STOP_RAD, stop_s, 0.0)
    )
