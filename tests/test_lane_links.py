# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Times of the links between lanes, worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slarm_graph.config import DrivingConfig
from slarm_graph.exploration.contour_lanes import Lane
from slarm_graph.exploration.coverage_grid import driving_grid
from slarm_graph.exploration.lane_order import (
    _directions_out,
    _link_times_s,
    _nearest_first,
    _Spots,
    _spots,
    _turn_times_s,
    order_lanes,
)
from slarm_graph.geometry import Floats, Pose2
from slarm_graph.grid import GridGeometry

CONFIG = DrivingConfig(speed_m_s=0.5, acceleration_m_s2=2.0, turn_rate_rad_s=1.0)
STOP_S = 0.25
"""Of braking from the speed and of speeding up again."""


def test_sharp_turns_cost_a_stop_as_well_whichever_way_round() -> None:
    turns = np.radians([0.0, 29.0, -29.0, 31.0, -90.0, 200.0, 360.0, -331.0])
    sharp = np.array([0, 0, 0, 1, 1, 1, 0, 0])
    short = np.radians([0.0, 29.0, 29.0, 31.0, 90.0, 160.0, 0.0, 29.0])
    np.testing.assert_allclose(_turn_times_s(turns, CONFIG), short + STOP_S * sharp, atol=1e-9)


def link_s(
    start: tuple[float, float, float], end: tuple[float, float, float], around_m: float
) -> float:
    """Time from a spot (x, y, way out) to another, by a path so long."""
    spots = _Spots(np.array([start[:2], end[:2]]), np.array([start[2], end[2]]))
    paths = np.array([[0.0, around_m], [around_m, 0.0]])
    times = _link_times_s(spots, paths, 0.2, CONFIG)
    # The same the other way, in which a lane is left where it was entered.
    assert times[0, 1] == pytest.approx(times[1, 0])
    return float(times[0, 1])


@pytest.mark.parametrize(
    ("end", "around_m", "length_m", "turns"),
    [
        # On along x, into a lane that leads on: nothing to turn.
        ((2.0, 0.0, math.pi), 2.0, 2.0, []),
        # As long as a straight line, by less than a tile at either end; then really around.
        ((2.0, 0.0, math.pi), 2.39, 2.0, []),
        ((2.0, 0.0, math.pi), 2.41, 2.41, []),
        # A path too long to look for: 6 m at least, or by half more than the straight line.
        ((2.0, 0.0, math.pi), math.inf, 6.0, []),
        ((8.0, 0.0, math.pi), math.inf, 12.0, []),
        # To the left, and there into a lane along y, or along x.
        ((0.0, 2.0, -0.5 * math.pi), 2.0, 2.0, [0.5 * math.pi]),
        ((0.0, 2.0, math.pi), 2.0, 2.0, [0.5 * math.pi, 0.5 * math.pi]),
        # Back into the lane's other neighbour.
        ((0.0, 0.1, 0.0), 0.1, 0.1, [0.5 * math.pi, 0.5 * math.pi]),
        # Too near for a heading of its own: one turn.
        ((0.0, 0.05, 0.0), 0.05, 0.05, [math.pi]),
        ((0.0, 0.05, 0.75 * math.pi), 0.05, 0.05, [0.25 * math.pi]),
    ],
)
def test_links_take_their_way_and_their_turns(
    end: tuple[float, float, float], around_m: float, length_m: float, turns: list[float]
) -> None:
    expected = length_m / 0.5 + sum(turns) + STOP_S * len(turns)
    assert link_s((0.0, 0.0, 0.0), end, around_m) == pytest.approx(expected)


def test_lanes_are_left_in_the_direction_of_their_last_cells() -> None:
    """Over six cells, of short ones over all."""
    points = np.array([[k, 0.0] for k in range(12)] + [[11.0, k] for k in range(1, 12)])
    first, last = _directions_out(points)
    assert abs(first) == pytest.approx(math.pi)
    assert last == pytest.approx(0.5 * math.pi)
    stairs = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [2.0, 1.0], [2.0, 2.0]])
    first, last = _directions_out(stairs)
    assert (first, last) == (pytest.approx(-0.75 * math.pi), pytest.approx(0.25 * math.pi))


def test_lanes_come_by_their_nearer_end_and_those_without_a_path_not_at_all() -> None:
    away = np.array([5.0, 9.0, np.inf, np.inf, 8.0, 1.0, np.inf, 2.0])
    assert _nearest_first(away).tolist() == [2, 3, 0]


def test_spots_are_the_robot_and_both_ends_of_lanes() -> None:
    free = np.ones((40, 60), dtype=np.bool_)
    geometry = GridGeometry(-1.0, 2.0, 0.1, 40, 60)
    driving = driving_grid(geometry, free, ~free, free, ~free)
    lane = Lane(np.array([[5.5, 7.5], [6.5, 7.5], [7.5, 7.5]]), 3.0)
    spots = _spots([lane], driving, Pose2(0.5, 3.0, 0.3))
    np.testing.assert_allclose(spots.points_m, [[1.5, 1.0], [0.55, 0.75], [0.75, 0.75]])
    np.testing.assert_allclose(np.cos(spots.out_rad), [math.cos(0.3), -1.0, 1.0], atol=1e-12)


def row(y: float, first: float, last: float) -> Floats:
    x = np.arange(first, last + 1.0)
    return np.stack([x, np.full(len(x), y)], axis=1)


def test_lanes_side_by_side_are_driven_to_and_fro_where_they_are_worth_it() -> None:
    """Robot below the left end; 1.5 m2 each take 6.1 s, and 4.6 s from one to the other."""
    free = np.ones((120, 160), dtype=np.bool_)
    driving = driving_grid(GridGeometry(0.0, 0.0, 0.05, 120, 160), free, ~free, free, ~free)
    lanes = [Lane(row(30.5, 10.5, 70.5), 600.0), Lane(row(20.5, 10.5, 70.5), 600.0)]
    for price_s_m2, kept in [(1e6, 2), (7.3, 2), (7.0, 1), (4.2, 1), (4.1, 0)]:
        robot = Pose2(0.475, 1.025, 0.0)
        tour, rest = order_lanes(lanes, driving, robot, CONFIG, price_s_m2)
        assert rest == []
        assert len(tour) == kept
        expected = [lanes[1].points, lanes[0].points[::-1]]
        for found, points in zip(tour, expected, strict=False):
            np.testing.assert_array_equal(found, points)
