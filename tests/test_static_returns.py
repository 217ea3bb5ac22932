# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Static returns of keyframes: by counting cell by cell, and in a room with passers-by."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slarm_graph.config import MatchingConfig
from slarm_graph.frontends.scans.static_returns import static_returns
from slarm_graph.frontends.scans.submaps import Keyframe
from slarm_graph.geometry import Floats, Pose2, transform_points

_NEVER_JOINED = MatchingConfig(max_gap_m=0.0, min_points=3)


def _keyframe(points: Floats, pose: Pose2) -> Keyframe:
    return Keyframe(0, points, pose, np.eye(3), np.zeros(2))


def _by_counting(keyframes: list[Keyframe]) -> list[Floats]:
    """Of ten keyframes in a row, any ten, three must have a return in the cell."""
    cells = [
        [
            tuple(np.floor(p / 0.25))
            for p in transform_points(k.local_from_robot.as_array(), k.points_m)
        ]
        for k in keyframes
    ]
    kept = []
    for k, keyframe in enumerate(keyframes):
        rows = []
        for point, cell in zip(keyframe.points_m, cells[k], strict=True):
            runs = (range(b, b + 10) for b in range(k - 9, k + 1))
            most = max(sum(0 <= m < len(cells) and cell in cells[m] for m in run) for run in runs)
            if most >= 3:
                rows.append(point)
        kept.append(np.array(rows).reshape(-1, 2))
    return kept


@pytest.mark.parametrize("seed", range(3))
def test_returns_are_those_that_counting_confirms(seed: int) -> None:
    rng = np.random.default_rng(seed)
    keyframes = [
        _keyframe(
            rng.uniform(-1.5, 1.5, (40, 2)),
            Pose2(*rng.uniform(-0.3, 0.3, 2), rng.uniform(-math.pi, math.pi)),
        )
        for _ in range(25)
    ]
    expected = _by_counting(keyframes)
    assert 100 < sum(len(e) for e in expected) < 900
    for found, points in zip(static_returns(keyframes, _NEVER_JOINED), expected, strict=True):
        np.testing.assert_array_equal(found.points_m, points)


def test_a_wall_stands_though_its_returns_lie_half_a_metre_apart() -> None:
    wall = [np.arange(s, 12.0, 0.45) for s in np.linspace(0.0, 0.4, 8)]
    keyframes = [_keyframe(np.column_stack([x, np.full(len(x), 3.1)]), Pose2()) for x in wall]
    for found, given in zip(static_returns(keyframes, MatchingConfig()), keyframes, strict=True):
        assert len(found.points_m) >= len(given.points_m) - 2


def test_who_walks_is_left_out_and_the_wall_behind_stays() -> None:
    x = np.arange(0.0, 6.0, 0.1)
    wall = np.column_stack([x, np.full(len(x), 3.1)])
    walked = [np.array([[0.4 * k, 1.0], [0.4 * k + 0.1, 1.0]]) for k in range(12)]
    keyframes = [_keyframe(np.concatenate([wall, w]), Pose2()) for w in walked]
    for found in static_returns(keyframes, MatchingConfig()):
        np.testing.assert_array_equal(found.points_m, wall)


def test_where_too_little_is_confirmed_everything_is_kept() -> None:
    points = np.random.default_rng(0).uniform(-50.0, 50.0, (30, 2))
    alone = _keyframe(points, Pose2())
    np.testing.assert_array_equal(static_returns([alone], MatchingConfig())[0].points_m, points)
