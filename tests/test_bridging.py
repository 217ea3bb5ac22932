# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Between two matches a path by odometry is led from the one to the other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from slarm_graph.backends.graph_building import GraphBuilder
from slarm_graph.backends.path_interpolation import bridged_by_odometry, step_variance
from slarm_graph.config import FrontendConfig, PoseGraphConfig
from slarm_graph.constraint import MatchResult
from slarm_graph.frontends.scans.tracker import TrackedScan
from slarm_graph.frontends.scans.wheel_motion import WheelMotion
from slarm_graph.geometry import Pose2, compose


def chain(start: np.ndarray, motions: np.ndarray) -> np.ndarray:
    path = [start]
    for motion in motions:
        path.append(compose(path[-1], motion))
    return np.array(path)


def test_steps_take_what_is_missed_as_they_are_unsure() -> None:
    """Odometry that is short by a tenth, and as unsure as the way is long: the truth comes out."""
    true = np.array([[0.1, 0.0, 0.0], [2.0, 0.0, 0.0], [0.3, 0.0, 0.0]])
    path = chain(np.array([1.0, 2.0, 0.5]), true)
    found = bridged_by_odometry(path[0], path[-1], true * [0.9, 1.0, 1.0], true[:, 0])
    np.testing.assert_allclose(found, path[1:-1], atol=1e-12)


def test_odometry_that_is_right_is_left_alone() -> None:
    rng = np.random.default_rng(0)
    motions = rng.normal(0.0, [1.0, 1.0, 2.0], (6, 3))
    path = chain(np.array([1.0, 2.0, 3.0]), motions)
    found = bridged_by_odometry(path[0], path[-1], motions, rng.uniform(1.0, 2.0, 6))
    np.testing.assert_allclose(found[:, :2], path[1:-1, :2], atol=1e-12)
    np.testing.assert_allclose(np.cos(found[:, 2] - path[1:-1, 2]), 1.0)


def test_headings_go_the_short_way_round() -> None:
    start, end = np.array([0.0, 0.0, 3.1]), np.array([0.0, 0.0, -3.1])
    found = bridged_by_odometry(start, end, np.zeros((2, 3)), np.ones(2))
    np.testing.assert_allclose(np.abs(found), [[0.0, 0.0, np.pi]])


def scan(k: int, x_m: float, *, matched: bool, has_odometry: bool = True) -> TrackedScan:
    """Return a scan where the tracker has it; odometry drives half a metre a scan."""
    pose, unsure = Pose2(x_m), 1e-4 * np.eye(3)
    match = MatchResult(pose, unsure, 0.9, 100, 1, "" if matched else "no returns")
    wheels = WheelMotion(np.array([0.5, 0.0, 0.0]), unsure, unsure) if has_odometry else None
    odom = Pose2(0.5 * k) if has_odometry else None
    points = np.zeros((0, 2))
    return TrackedScan(k, points, pose, Pose2(), unsure, match, odom, False, wheels)


@pytest.mark.parametrize(
    ("has_odometry", "expected"),
    [(True, [0.0, 0.6, 1.2, 1.8, 2.4, 2.9]), (False, [0.0, 0.5, 1.0, 1.5, 2.4, 2.9])],
)
def test_scans_that_odometry_placed_end_where_the_next_was_matched(
    has_odometry: bool, expected: list[float]
) -> None:
    builder = GraphBuilder(PoseGraphConfig(), FrontendConfig())
    for k, (x_m, matched) in enumerate(
        [(0.0, True), (0.5, False), (1.0, False), (1.5, False), (2.4, True), (2.9, True)]
    ):
        builder.add_scan(scan(k, x_m, matched=matched, has_odometry=has_odometry or k == 0))
    np.testing.assert_allclose(builder.odometry_trajectory().poses[:, 0], expected, atol=1e-12)


def test_what_comes_before_the_first_match_stays() -> None:
    builder = GraphBuilder(PoseGraphConfig(), FrontendConfig())
    for k, (x_m, matched) in enumerate([(0.0, False), (0.5, False), (1.4, True)]):
        builder.add_scan(scan(k, x_m, matched=matched))
    np.testing.assert_allclose(builder.odometry_trajectory().poses[:, 0], [0.0, 0.5, 1.4])


def test_a_step_is_as_unsure_as_what_tells_of_it() -> None:
    """A match, else odometry; with neither, what has come to the tracker's own doubt."""
    told = scan(0, 0.0, matched=True)
    wheels = WheelMotion(np.array([0.5, 0.0, 0.0]), np.diag([4.0, 1.0, 9.0]), np.eye(3))
    placed = replace(scan(1, 0.5, matched=False), wheels=wheels)
    assert step_variance(replace(told, wheels=wheels)) == pytest.approx(2e-4)
    assert step_variance(placed) == pytest.approx(5.0)
    assert step_variance(replace(placed, wheels=None)) == pytest.approx(2e-4)
