# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Looking at the unknown: which frontier, for how long, and when to let it be."""

from __future__ import annotations

import numpy as np
import pytest

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
    leg = selector.leg_to_frontier(driving, near, Pose2(x_m, 0.25, 0.0))
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


@pytest.mark.parametrize("step_m", [0.2, 0.035])
def test_a_place_that_comes_nearer_is_kept_however_long_it_takes(step_m: float) -> None:
    """Less than a tenth of a metre a look counts as well, once it has come to that."""
    selector = FrontierSelector()
    assert {look(selector, x) for x in np.arange(5.2, 0.8, -step_m)} == {WEST}
    # The other end is not held against what was given up here: it was not.
    assert look(selector, 9.8, WEST) == EAST


def test_a_place_is_given_up_after_thirty_looks_in_vain() -> None:
    """Twice; after a third go it is let be. West the far rim, more than 0.5 m on, has a go too."""
    selector = FrontierSelector()
    chosen = [look(selector, 5.0) for _ in range(130)]
    assert chosen == [WEST] * 64 + [EAST] * 63 + [None] * 3
    assert len(selector._vain_m) == 7


def test_another_place_is_looked_for_from_where_the_last_one_was_looked_at() -> None:
    """Nearer than a tenth of a metre to its goal the robot has arrived, whatever it sees there."""
    selector = FrontierSelector()
    assert look(selector, 1.0) == WEST
    goal_m = selector._goal_m
    assert goal_m is not None
    for off_m, kept in [(0.12, True), (0.08, False)]:
        look(selector, float(goal_m[0]) + off_m)
        assert (selector._goal_m is goal_m) == kept
    assert len(selector._vain_m) == 1


def test_gaps_between_beams_are_no_frontier() -> None:
    """Fewer than three unknown cells side by side are none, nor is what cannot be entered."""
    driving = corridor()
    driving.observed[:, :4] = driving.observed[:, -4:] = True
    driving.observed[2, 50:52] = False
    assert not frontier(driving).any()
    driving.observed[2, 50:53] = False
    rows, cols = np.nonzero(frontier(driving))
    assert (rows.min(), rows.max(), cols.min(), cols.max()) == (1, 3, 49, 53)
    driving.occupied[2, 51] = True
    assert not frontier(driving).any()


def test_the_goal_is_where_a_path_ends_and_not_its_first_corner() -> None:
    driving, selector = corridor(EAST), FrontierSelector()
    driving.passable[1:, 30] = False
    bent = driving_grid(
        driving.geometry, driving.passable, driving.occupied, driving.observed, driving.swept
    )
    leg = selector.leg_to_frontier(bent, bent.passable, Pose2(5.0, 0.35, 0.0))
    assert isinstance(leg, Leg)
    assert len(leg.points_m) > 2
    assert selector._goal_m is not None
    np.testing.assert_array_equal(selector._goal_m, leg.points_m[-1])
    assert selector._goal_m[0] < 0.6
    np.testing.assert_array_equal(selector._tried_m, [leg.points_m[-1]])
