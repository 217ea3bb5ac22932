# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Relations that are about another point of the robot are told from a trajectory that is wrong."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from slarm_graph.eval.relation_point import point_advice
from slarm_graph.geometry import Floats, Pose2


def at(point: Pose2, relations: Floats) -> Floats:
    """Relations of the robot's origin as a point of it sees them."""
    moved = [point.inverse() @ Pose2.from_array(r) @ point for r in relations]
    return np.array([m.as_array() for m in moved])


def drive(seed: int, count: int = 200) -> Floats:
    rng = np.random.default_rng(seed)
    turns = rng.choice([0.0, 0.1, math.pi], count) + rng.normal(0.0, 0.02, count)
    return np.column_stack([rng.normal(0.0, 2.0, (count, 2)), turns])


def noisy(relations: Floats, seed: int) -> Floats:
    error = np.random.default_rng(seed).normal(0.0, 0.03, relations.shape)
    error[::20] *= 30.0  # some relations are plainly wrong
    return relations + error * [1.0, 1.0, 0.1]


@pytest.mark.parametrize("x, y", [(0.44, 0.0), (-0.2, 0.3), (0.0, -0.15)])
def test_the_point_that_relations_are_about_is_found(x: float, y: float) -> None:
    robot = drive(1)
    advice = point_advice(noisy(robot, 2), at(Pose2(x, y, 0.0), robot))
    told = re.search(r"point \((.*), (.*)\) m", advice)
    assert told is not None
    np.testing.assert_allclose([float(v) for v in told.groups()], [x, y], atol=0.012)


def test_relations_of_the_point_itself_get_no_advice() -> None:
    """One in a thousand may: of forty drives none."""
    robots = [drive(seed) for seed in range(40)]
    assert not any(point_advice(noisy(r, 100 + k), r) for k, r in enumerate(robots))


def test_a_robot_that_never_turned_says_nothing_of_the_point() -> None:
    robot = drive(1) * [1.0, 1.0, 0.0]
    assert point_advice(noisy(robot, 2) * [1.0, 1.0, 0.0], robot) == ""


def test_a_wrong_scale_is_not_taken_for_another_point() -> None:
    robot = drive(3)
    assert point_advice(robot * [1.05, 1.05, 1.0], robot) == ""
