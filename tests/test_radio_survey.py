# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Driving for certainty: variances against dense algebra, and where the explorer goes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from slarm_graph.config import DrivingConfig
from slarm_graph.exploration.coverage_grid import known_coverage
from slarm_graph.exploration.explorer import Finished, Leg
from slarm_graph.exploration.radio_survey import (
    RadioSurvey,
    RadioSurveyConfig,
    _cell_of_nodes,
    _goals,
)
from slarm_graph.geometry import Pose2
from slarm_graph.grid import GridGeometry
from slarm_graph.radio.measured.field_variance import FieldVariance, Shadowing
from slarm_graph.radio.measured.nodes import make_nodes
from slarm_graph.radio.measured.priors import FloorField, field_correlation

GRID = GridGeometry(0.0, 0.0, 0.1, 40, 60)
SHADOWING = Shadowing(3.0, 4.0, 3.0)


def floor_nodes():
    free = np.ones(GRID.shape, dtype=bool)
    free[:30, 30] = False
    return make_nodes(GRID, free, 0.5, 1000)


def test_variances_and_gains_are_those_of_dense_algebra():
    nodes, rng = floor_nodes(), np.random.default_rng(0)
    heard = rng.uniform([0.1, 0.1], [2.5, 3.9], (40, 2))
    sure = FieldVariance(nodes, heard, SHADOWING)
    unit = FloorField(nodes).unit_precision(3.0).matrix.toarray()
    prior = 16.0 * np.linalg.inv(unit)
    pick = np.eye(len(nodes))[nodes.at(heard)]
    # Readings of one piece are off its value as one, by how far a piece's points are from its
    # middle.
    middles = (np.arange(400) + 0.5) / 400 - 0.5
    away = np.hypot(middles[:, None], middles).mean() * np.sqrt(nodes.area_m2)
    beside = 16.0 * (1.0 - field_correlation(away, 3.0) ** 2)
    inner = pick @ (prior + np.diag(beside)) @ pick.T + 9.0 * np.eye(len(heard))
    posterior = prior - prior @ pick.T @ np.linalg.solve(inner, pick @ prior)
    np.testing.assert_allclose(sure.variance_db2, np.diag(posterior), rtol=1e-5)
    everywhere = np.ones(len(nodes), dtype=bool)
    assert sure.rms_db(everywhere) == pytest.approx(
        np.sqrt(nodes.area_m2 @ np.diag(posterior) / nodes.area_m2.sum()), rel=1e-5
    )
    paths = [np.array([3, 20, 41]), np.array([60])]
    for path, gain in zip(paths, sure.variance_reductions(paths, 4.0), strict=True):
        more = np.eye(len(nodes))[path]
        inner = more @ posterior @ more.T + np.diag(9.0 / 4.0 + beside[path])
        after = posterior - posterior @ more.T @ np.linalg.solve(inner, more @ posterior)
        less = nodes.area_m2 @ (np.diag(posterior) - np.diag(after))
        assert gain == pytest.approx(less, rel=1e-4)


def listened(points, free=None):
    free = np.ones((40, 60), dtype=bool) if free is None else free
    return replace(known_coverage(free, 0.1), heard_m=np.asarray(points, dtype=np.float64))


def asked(heard):
    """What a fresh explorer says to signals heard at points."""
    return RadioSurvey(RadioSurveyConfig(), DrivingConfig()).next_goal(
        listened(heard), Pose2(2.0, 2.0, 0.0)
    )


def test_it_goes_where_nothing_was_heard():
    rng = np.random.default_rng(1)
    left = rng.uniform([0.1, 0.1], [2.9, 3.9], (300, 2))
    leg = asked(left)
    assert isinstance(leg, Leg)
    assert leg.points_m[-1, 0] > 3.5


def test_it_stops_when_sure_and_when_nothing_is_listened_to():
    rng = np.random.default_rng(2)
    everywhere = rng.uniform([0.1, 0.1], [5.9, 3.9], (2000, 2))
    done = asked(everywhere)
    assert isinstance(done, Finished)
    assert "sure to" in done.reason
    deaf = asked(np.empty((0, 2)))
    assert isinstance(deaf, Finished)
    assert "nothing is listened to" in deaf.reason


def test_what_the_model_is_off_counts():
    """At the same readings it is sure to the root of both squares."""
    rng = np.random.default_rng(2)
    everywhere = listened(rng.uniform([0.1, 0.1], [5.9, 3.9], (2000, 2)))
    told = {}
    for off_db in (0.0, 1.5):
        config = RadioSurveyConfig(certainty_db=3.0, model_sd_db=off_db)
        done = RadioSurvey(config, DrivingConfig()).next_goal(everywhere, Pose2(2.0, 2.0, 0.0))
        assert isinstance(done, Finished)
        told[off_db] = float(done.reason.split()[-2])
    assert told[1.5] == pytest.approx(np.hypot(told[0.0], 1.5), abs=0.02)


def test_a_place_that_was_the_goal_too_often_is_let_be():
    explorer = RadioSurvey(RadioSurveyConfig(certainty_db=0.01, model_sd_db=0.0), DrivingConfig())
    pose, near = Pose2(0.5, 2.0, 0.0), [[0.5, 2.0]]
    ends = []
    for _ in range(30):
        leg = explorer.next_goal(listened(near), pose)
        assert isinstance(leg, Leg)
        ends.append(tuple(np.floor(leg.points_m[-1] / 0.5)))
    assert max(ends.count(end) for end in ends) <= 8


def test_a_certainty_that_no_drive_can_reach_is_refused() -> None:
    with pytest.raises(ValueError, match="never reached"):
        RadioSurveyConfig(certainty_db=1.0)


def test_a_piece_of_floor_is_driven_to_where_its_middle_is() -> None:
    """Brute force: of its own cells the one nearest to the mean of them."""
    rng = np.random.default_rng(3)
    nodes = make_nodes(GRID, rng.random(GRID.shape) < 0.8, 0.5, 1000)
    for node, cell in enumerate(_cell_of_nodes(nodes)):
        own = np.argwhere(nodes.of_cell == node)
        away = np.linalg.norm(GRID.center_of(own) - nodes.centers_m[node], axis=1)
        at = divmod(int(cell), GRID.cols)
        assert nodes.of_cell[at] == node
        off = np.linalg.norm(GRID.center_of(np.array(at)) - nodes.centers_m[node])
        assert off == pytest.approx(away.min(), abs=1e-9)


def test_goals_are_uncertain_for_their_time_and_a_metre_apart() -> None:
    rng = np.random.default_rng(4)
    sure = FieldVariance(floor_nodes(), rng.uniform([0.1, 0.1], [2.5, 3.9], (40, 2)), SHADOWING)
    time_s = rng.uniform(2.0, 20.0, len(sure.nodes))
    time_s[::7] = np.inf
    goals = _goals(sure, time_s)
    rate, centers = sure.variance_db2 / time_s, sure.nodes.centers_m
    assert (np.diff(rate[goals]) <= 0.0).all()
    assert np.isfinite(time_s[goals]).all()
    apart = np.abs(centers[goals][:, None] - centers[goals]).max(axis=2)
    assert (apart + 9.0 * np.eye(len(goals))).min() >= 1.0
    # What is no goal is near to a better one, or cannot be reached.
    for node in set(range(len(rate))) - set(goals.tolist()):
        near = goals[np.abs(centers[goals] - centers[node]).max(axis=1) < 1.0]
        assert rate[node] == 0.0 or rate[near].max() >= rate[node]
    wide = GridGeometry(0.0, 0.0, 0.1, 120, 100)
    nodes = make_nodes(wide, np.ones(wide.shape, dtype=bool), 0.5, 1000)
    sure = FieldVariance(nodes, np.array([[0.1, 0.1]]), SHADOWING)
    assert len(_goals(sure, np.ones(len(nodes)))) == 40
    assert not len(_goals(sure, np.full(len(nodes), np.inf)))


@pytest.mark.parametrize("heading", [0.0, 1.57, 3.14, -1.57])
def test_of_ways_that_tell_the_same_the_one_ahead_is_gone(heading: float) -> None:
    """From the middle of a square all four ways are alike but for the turn."""
    square = np.ones((60, 60), dtype=bool)
    middle = listened([[3.0, 3.0]], square)
    explorer = RadioSurvey(RadioSurveyConfig(), DrivingConfig(turn_rate_rad_s=0.2))
    leg = explorer.next_goal(middle, Pose2(3.0, 3.0, heading))
    assert isinstance(leg, Leg)
    path = leg.points_m[-1] - leg.points_m[0]
    assert abs(np.arctan2(path[1], path[0]) - heading) % (2.0 * np.pi) < 0.5


def test_places_asked_for_too_often_are_told_by_squares() -> None:
    explorer = RadioSurvey(RadioSurveyConfig(), DrivingConfig())
    nodes = floor_nodes()
    explorer._asks.update({(2, 3): 8, (5, 5): 7, (0, 0): 9})
    worth = explorer._worth_trying(nodes)
    squares = np.floor(nodes.centers_m / 0.5).astype(int).tolist()
    expected = [square not in ([2, 3], [0, 0]) for square in squares]
    assert worth.tolist() == expected
    assert worth.sum() < len(nodes)


def test_what_cannot_be_reached_is_no_goal() -> None:
    """Of two rooms without a door the robot knows the one it stands in."""
    free = np.ones((40, 60), dtype=bool)
    free[18:22] = False
    for y_m in (1.0, 3.0):
        explorer = RadioSurvey(RadioSurveyConfig(), DrivingConfig())
        leg = explorer.next_goal(listened([[1.0, y_m]], free), Pose2(1.0, y_m, 0.0))
        assert isinstance(leg, Leg)
        assert leg.points_m[-1, 0] > 1.5
        assert (leg.points_m[:, 1] > 2.0).all() == (y_m > 2.0)
