# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Looking at the unknown: which frontier, for how long, and when to let it be."""

from __future__ import annotations

import numpy as np

from slarm_graph.exploration.coverage_grid import DrivingGrid, driving_grid
from slarm_graph.exploration.explorer import Leg
from slarm_graph.exploration.frontier import FrontierSelector, frontier
from slarm_graph.geometry import Pose2
from slarm_graph.grid import GridGeometry

CELL_M = 0.1
WEST, EAST = "west", "east"


def corridor(*shut: str) -> DrivingGrid:
    """Ten metres of known corridor with unknown floor at both ends, each of which can be shut."""
    observed = np.ones((5, 108), dtype=np.bool_)
    observed[:, :4] = observed[:, -4:] = False
    passable = np.ones_like(observed)
    if WEST in shut:
        passable[:, 5] = False
    if EAST in shut:
        passable[:, -6] = False
    geometry = GridGeometry(0.0, 0.0, CELL_M, *observed.shape)
    nothing = np.zeros_like(observed)
    return driving_grid(geometry, passable, nothing, observed, nothing)


def look(selector: FrontierSelector, x_m: float, *shut: str) -> str | None:
    """Where the robot at x goes; None where it gives up."""
    driving = corridor(*shut)
    near = driving.passable.copy()
    if WEST in shut:
        near[:, :5] = False
    if EAST in shut:
        near[:, -5:] = False
    leg = selector.look_at_unknown(driving, near, Pose2(x_m, 0.25, 0.0))
    if leg is None:
        return None
    assert isinstance(leg, Leg)
    return WEST if leg.points_m[-1, 0] < x_m else EAST


def test_frontiers_are_the_rims_of_unknown_floor() -> None:
    cols = np.flatnonzero(frontier(corridor())[2])
    assert set(cols) == {0, 3, 4, 103, 104, 107}


def test_narrow_strips_are_left_out_where_that_is_asked_for() -> None:
    driving = corridor()
    driving.observed[:, 50] = False
    assert frontier(driving)[2, 50]
    wide = frontier(driving, 2.0 * CELL_M)[2]
    assert not wide[45:55].any()
    assert wide[4]


def test_the_nearest_frontier_comes_first() -> None:
    assert look(FrontierSelector(), 5.0) == WEST
    assert look(FrontierSelector(), 9.0) == EAST


def test_a_frontier_once_chosen_is_kept_though_another_comes_nearer() -> None:
    selector = FrontierSelector()
    assert [look(selector, x) for x in (5.3, 5.5, 8.0, 5.0)] == [WEST] * 4


def test_gaps_that_seem_now_open_and_now_shut_hold_nobody_for_ever() -> None:
    """Each of two frontiers vanishes as the robot comes near to it, as behind a phantom gap."""
    selector = FrontierSelector()
    chosen: list[str | None] = []
    while None not in chosen and len(chosen) < 100:
        chosen += [look(selector, 4.0, EAST), look(selector, 10.0, WEST)]
    assert chosen[:2] == [WEST, EAST]
    assert chosen[-1] is None
    assert chosen.count(EAST) == 3


def test_a_place_that_comes_no_nearer_is_let_be() -> None:
    selector = FrontierSelector()
    chosen = [look(selector, 5.0) for _ in range(250)]
    assert chosen[:30] == [WEST] * 30
    assert EAST in chosen
    assert chosen[-1] is None
