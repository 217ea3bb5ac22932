# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Which way walls run and face at single returns, in worked scenes turned every way."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slarm_graph.frontends.scans.icp import line_normals
from slarm_graph.frontends.scans.wall_sides import (
    _surfaces,
    own_surfaces,
    share_from_behind,
    wall_sides,
)
from slarm_graph.frontends.scans.wall_tangents import wall_tangents
from slarm_graph.geometry import Floats, Pose2, wrap_angles

TURNS = [0.0, 0.4, 1.9, -2.6]


def turned(points: Floats, turn_rad: float) -> Floats:
    return np.asarray(Pose2(0.0, 0.0, turn_rad).transform(points))


def staggered(gap_m: float, step_m: float = 0.05) -> Floats:
    """A wall along x, 2 m ahead to the left, of which the right half lies farther back."""
    left = np.arange(-1.0, 0.01, step_m)
    right = np.arange(0.05, 1.5, step_m)
    near = np.stack([left, np.full(len(left), 2.0)], axis=1)
    return np.concatenate([near, np.stack([right, np.full(len(right), 2.0 + gap_m)], axis=1)])


@pytest.mark.parametrize("order", [1, -1])
@pytest.mark.parametrize("turn_rad", TURNS)
def test_walls_face_who_sees_them_up_to_their_ends(turn_rad: float, order: int) -> None:
    """A step back of 0.4 m is where one wall ends and another begins."""
    points = staggered(0.4)
    pose = np.array([3.0, -1.0, 0.8])
    seen = _surfaces(turned(points, turn_rad)[::order], pose)
    expected = Pose2.from_array(pose).transform(turned(points, turn_rad)[::order])
    np.testing.assert_allclose(seen[:, :2], expected, atol=1e-9)
    off = wrap_angles(seen[:, 2] - (turn_rad + pose[2] - 0.5 * math.pi))
    np.testing.assert_allclose(off, 0.0, atol=1e-9)


def test_a_step_back_that_is_small_is_one_wall_with_a_corner() -> None:
    seen = _surfaces(staggered(0.2), np.zeros(3))
    slanted = np.abs(wrap_angles(seen[:, 2] + 0.5 * math.pi)) > 0.1
    assert 2 <= slanted.sum() <= 4


@pytest.mark.parametrize("offset_m", [0.3, 0.5, -0.3])
def test_walls_that_are_grazed_have_no_side(offset_m: float) -> None:
    """Beyond ten times its distance from the viewer, a sine of a tenth."""
    along = np.arange(0.5, 8.0, 0.05)
    seen = _surfaces(np.stack([along, np.full(len(along), offset_m)], axis=1), np.zeros(3))
    sure = along[abs(offset_m) / np.hypot(along, offset_m) > 0.1]
    np.testing.assert_allclose(seen[:, 0], sure)
    np.testing.assert_allclose(np.sin(seen[:, 2]), -np.sign(offset_m))


def test_single_returns_have_no_side() -> None:
    assert not len(_surfaces(np.array([[2.0, 0.0], [0.0, 2.0], [-2.0, 0.5]]), np.zeros(3)))


def test_sides_are_known_a_tenth_of_a_metre_about_a_return() -> None:
    """From behind at most two cells off is seen as such, what is farther is another wall."""
    wall = staggered(0.0)
    sides = wall_sides([wall], np.zeros((1, 3)))
    back = wall * [1.0, -1.0] + [0.0, 4.0]
    beyond = back - [0.0, 4.0]
    for off_m, share in [(-0.17, 0.0), (-0.08, 1.0), (0.0, 1.0), (0.08, 1.0), (0.17, 0.0)]:
        pose = np.array([0.0, 4.0 + off_m, 0.0])
        assert share_from_behind(sides, own_surfaces(beyond), pose) == share
        assert share_from_behind(sides, own_surfaces(wall), np.array([0.0, off_m, 0.0])) == 0.0


def bits(surface: Floats, low: Floats) -> tuple[int, int, int]:
    """Row and column of a surface (3,) from a corner, and its octant."""
    col, row = np.floor((surface[:2] - low) / 0.05).astype(int)
    return int(row), int(col), int(np.floor(surface[2] % math.tau / (math.tau / 8)))


@pytest.mark.parametrize("seed", range(6))
def test_sides_are_those_of_a_table_of_cells(seed: int) -> None:
    """Known two cells about, and the same up to two octants apart; by scans of ragged walls."""
    rng = np.random.default_rng(seed)
    bearings = np.linspace(-3.0, 3.0, 200)
    ragged = 1.5 + np.cumsum(rng.normal(0.0, 0.03, (3, 200)), axis=1)
    scans = [r[:, None] * np.stack([np.cos(bearings), np.sin(bearings)], axis=1) for r in ragged]
    poses = rng.uniform([3.0, -8.0, -1.0], [5.0, -6.0, 1.0], (2, 3))
    sides = wall_sides(scans[:2], poses)
    low, known = np.array([sides.origin_x_m, sides.origin_y_m]), np.zeros(sides.octants.shape, int)
    for scan, pose in zip(scans, poses, strict=False):
        for row, col, octant in (bits(s, low) for s in _surfaces(scan, pose)):
            known[row - 2 : row + 3, col - 2 : col + 3] |= 1 << octant
    np.testing.assert_array_equal(sides.octants, known)
    assert not known[0].any()
    assert known[1].any()
    for away in ([0.0, 0.0], [1.0, 0.0], [0.0, 3.0], [-2.5, -1.0]):
        pose = np.array([*(poses[0, :2] + away), 2.0])
        same = behind = 0
        for row, col, octant in (bits(s, low) for s in _surfaces(scans[2], pose)):
            inside = 0 <= row < known.shape[0] and 0 <= col < known.shape[1]
            if inside and known[row, col]:
                near = [(octant + d) % 8 for d in (-2, -1, 0, 1, 2)]
                is_same = any(known[row, col] >> k & 1 for k in near)
                same, behind = same + is_same, behind + (not is_same)
        assert share_from_behind(sides, own_surfaces(scans[2]), pose) == behind / max(
            same + behind, 1
        )


@pytest.mark.parametrize("order", [1, -1])
@pytest.mark.parametrize("turn_rad", TURNS)
def test_tangents_run_along_walls_up_to_their_ends(turn_rad: float, order: int) -> None:
    points = staggered(0.7)
    tangents = turned(wall_tangents(turned(points, turn_rad)[::order]), -turn_rad)[::order]
    none = ~tangents.any(axis=1)
    np.testing.assert_allclose(tangents[~none], np.tile([order, 0.0], (sum(~none), 1)), atol=1e-9)
    # None where the way on leads over to the other wall.
    assert np.abs(points[none, 0] - 0.025).max() < 0.3
    assert 0 < none.sum() <= 12


@pytest.mark.parametrize("turn_rad", TURNS)
@pytest.mark.parametrize(
    ("step_m", "bend_deg", "is_straight"),
    [(0.06, 30.0, True), (0.06, 43.0, False), (0.6, 12.0, True), (0.6, 17.0, False)],
)
def test_short_ways_may_bend_more_than_long_ones(
    turn_rad: float, step_m: float, bend_deg: float, is_straight: bool
) -> None:
    """At the corner the tangent halves the angle, else there is none."""
    along = np.arange(1, 8)[:, None] * step_m
    bend = math.radians(bend_deg)
    before = -along[::-1] * [1.0, 0.0]
    after = along * [math.cos(bend), math.sin(bend)]
    points = turned(np.concatenate([before, [[0.0, 0.0]], after]), turn_rad)
    tangent = wall_tangents(points)[7]
    middle = turn_rad + 0.5 * bend
    expected = np.array([math.cos(middle), math.sin(middle)]) if is_straight else np.zeros(2)
    np.testing.assert_allclose(tangent, expected, atol=1e-9)


def test_tangents_are_taken_over_more_than_noise() -> None:
    """Over 0.2 m to either side noise of 0.01 m turns a wall by a few degrees, whatever beams."""
    rng = np.random.default_rng(0)
    along = np.arange(0.0, 3.0, 0.01)
    points = np.stack([along, 2.0 + rng.normal(0.0, 0.01, len(along))], axis=1)
    tangents = wall_tangents(points)[5:-5]
    off = np.arctan2(tangents[:, 1], tangents[:, 0])
    assert np.std(off) < 0.05
    assert tangents.any(axis=1).all()


@pytest.mark.parametrize("seed", range(10))
def test_normals_are_those_of_least_squares(seed: int) -> None:
    """Of up to three points either side that hang together, by singular values."""
    rng = np.random.default_rng(seed)
    steps = rng.normal([0.1, 0.0], 0.1, (60, 2))
    points, max_gap = np.cumsum(steps, axis=0), 0.25
    far = np.hypot(*np.diff(points, axis=0).T) >= max_gap
    run = np.concatenate([[0], np.cumsum(far)])
    normals = line_normals(points, max_gap)
    for k in range(len(points)):
        near = [i for i in range(k - 3, k + 4) if 0 <= i < len(points) and run[i] == run[k]]
        if len(near) == 1:
            assert not normals[k].any()
            continue
        away = points[near] - points[near].mean(axis=0)
        across = np.linalg.svd(away)[2][1]
        assert abs(normals[k] @ across) == pytest.approx(1.0, abs=1e-9)
    assert far.any()
