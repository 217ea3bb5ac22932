# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Following corners: what is left to drive, what is let out, and where it is steered to."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slarm_graph.config import DrivingConfig
from slarm_graph.exploration.path_follower import PathFollower, _is_sharp, _without_tiny_steps
from slarm_graph.geometry import Floats, Pose2
from slarm_graph.world import DriveCommand

PATH = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [2.0, 1.2], [2.0, 0.2]])
CONFIG = DrivingConfig()


def driven(pose: Pose2, command: DriveCommand, dt_s: float) -> Pose2:
    """Pose after a command, on the arc that it asks for."""
    turn = command.turn_rate_rad_s * dt_s
    chord = command.speed_m_s * dt_s * (math.sin(0.5 * turn) / (0.5 * turn) if turn else 1.0)
    return pose @ Pose2(chord * math.cos(0.5 * turn), chord * math.sin(0.5 * turn), turn)


def along(path: Floats, at: Floats) -> float:
    """Way from the point of a path nearest to a place to its end [m]."""
    lengths = np.hypot(*np.diff(path, axis=0).T)
    best, left = math.inf, 0.0
    for k, length in enumerate(lengths):
        way = (path[k + 1] - path[k]) / length
        done = float(np.clip((at - path[k]) @ way, 0.0, length))
        away = float(np.linalg.norm(path[k] + done * way - at))
        if away < best:
            best, left = away, length - done + lengths[k + 1 :].sum()
    return left


def test_what_is_left_is_the_way_to_the_end() -> None:
    """All along a path with corners of all kinds, as measured on the path itself."""
    follower, pose, left = PathFollower(CONFIG), Pose2(0.0, 0.0, 0.2), []
    assert follower.done
    assert follower.remaining_m(pose) == 0.0
    follower.follow(PATH)
    length = float(np.hypot(*np.diff(PATH, axis=0).T).sum())
    assert follower.remaining_m(pose) == pytest.approx(length)
    for _ in range(600):
        pose = driven(pose, follower.command(pose, 0.05), 0.05)
        if follower.done:
            break
        left.append(follower.remaining_m(pose))
        expected = along(PATH, np.array([pose.x, pose.y]))
        assert left[-1] == pytest.approx(expected, abs=0.06)
        assert follower.points_m[-1].tolist() == PATH[-1].tolist()
    assert follower.done
    assert follower.remaining_m(pose) == 0.0
    assert math.hypot(pose.x - 2.0, pose.y - 0.2) < 0.02
    assert max(np.diff(left)) < 0.02


def test_a_path_is_gone_on_along_from_where_it_was_to_end() -> None:
    follower, pose = PathFollower(CONFIG), Pose2(1.2, 0.0, 0.0)
    follower.follow(np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.1]]))
    follower.command(pose, 0.05)
    np.testing.assert_array_equal(follower.points_m, [[1.0, 0.0], [2.0, 0.1]])
    follower.extend(np.array([[2.0, 0.1], [3.0, 0.1], [3.0, 1.0]]))
    expected = [[1.0, 0.0], [2.0, 0.1], [3.0, 0.1], [3.0, 1.0]]
    np.testing.assert_array_equal(follower.points_m, expected)
    assert follower.remaining_m(pose) == pytest.approx(math.hypot(0.8, 0.1) + 1.0 + 0.9)
    follower.stop()
    assert follower.done
    assert follower.command(pose, 0.05) == DriveCommand(0.0, 0.0)


def test_corners_too_near_to_the_last_are_left_out() -> None:
    points = np.array(
        [[0.0, 0.0], [0.01, 0.0], [0.014, 0.0], [0.016, 0.0], [0.02, 0.005], [1.0, 0]]
    )
    np.testing.assert_array_equal(_without_tiny_steps(points), points[[0, 3, 5]])
    assert not len(_without_tiny_steps(np.empty((0, 2))))


@pytest.mark.parametrize("bend_deg", [-170.0, -31.0, -29.0, 0.0, 29.0, 31.0, 90.0, 180.0])
def test_bends_of_more_than_thirty_degrees_are_sharp(bend_deg: float) -> None:
    way = np.radians(np.array([20.0, 20.0, 20.0 + bend_deg, 20.0 + bend_deg]))
    steps = np.array([0.3, 0.7, 2.0, 0.1])[:, None] * np.stack([np.cos(way), np.sin(way)], axis=1)
    points = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    assert _is_sharp(points).tolist() == [False, abs(bend_deg) > 30.0, False]
    assert not len(_is_sharp(points[:2]))


@pytest.mark.parametrize("off_deg", [49.0, 51.0, -51.0, 170.0])
def test_who_looks_elsewhere_turns_on_the_spot_until_it_looks_ahead(off_deg: float) -> None:
    """From fifty degrees on, to three; at no more than the turn rate, and not beyond."""
    follower, pose = PathFollower(CONFIG), Pose2(0.0, 0.0, math.radians(off_deg))
    follower.follow(np.array([[0.0, 0.0], [3.0, 0.0]]))
    turned_for = 0
    while (command := follower.command(pose, 0.1)).speed_m_s == 0.0:
        assert abs(command.turn_rate_rad_s) <= CONFIG.turn_rate_rad_s
        assert command.turn_rate_rad_s * off_deg < 0.0
        pose, turned_for = driven(pose, command, 0.1), turned_for + 1
        assert turned_for < 100
    if abs(off_deg) > 50.0:
        assert abs(math.degrees(pose.theta)) < 3.0
        least_s = math.radians(abs(off_deg) - 3.0) / CONFIG.turn_rate_rad_s
        assert turned_for == pytest.approx(least_s / 0.1, abs=1.0)
    else:
        assert turned_for == 0


@pytest.mark.parametrize("aside_m", [0.05, -0.08])
def test_beside_its_lane_it_is_steered_along_an_arc_to_a_point_ahead(aside_m: float) -> None:
    """Pure pursuit at a crawl: the arc through the robot, along its heading, and that point."""
    follower = PathFollower(CONFIG)
    follower.follow(np.array([[0.0, 0.0], [3.0, 0.0]]))
    command = follower.command(Pose2(1.0, aside_m, 0.1), 0.1)
    assert command.speed_m_s == pytest.approx(CONFIG.acceleration_m_s2 * 0.1)
    # Of a point 0.12 m on, as seen from the robot: 2 y / d^2.
    seen = Pose2(1.0, aside_m, 0.1).inverse().transform(np.array([1.12, 0.0]))
    curvature = 2.0 * seen[1] / (seen @ seen)
    assert command.turn_rate_rad_s == pytest.approx(command.speed_m_s * curvature)
