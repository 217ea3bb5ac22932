# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Outlines laid onto the lines of returns: exact in rooms without noise, and step by step."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest

from slarm_graph.geometry import Floats
from slarm_graph.grid import GridGeometry
from slarm_graph.polygons import contains
from slarm_graph.raster.outlines import outlines_m
from slarm_graph.recovery.returns import Returns
from slarm_graph.recovery.wall_lines import Wall, wall_between
from slarm_graph.recovery.walls import _closed, _corner, _joined, straighten_outlines

CELL_M = 0.05
L_ROOM = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 2.0], [2.5, 2.0], [2.5, 3.0], [0.0, 3.0]])
PILLAR = np.array([[1.0, 1.0], [1.0, 1.6], [1.8, 1.6], [1.8, 1.0]])


def turned(points: Floats, rad: float) -> Floats:
    """Points turned about the origin, then moved away from it."""
    turn = np.array([[math.cos(rad), -math.sin(rad)], [math.sin(rad), math.cos(rad)]])
    return np.asarray(points @ turn.T + [1.37, -0.82])


def returns_on(*rings: Floats) -> Returns:
    """Returns without noise every centimetre of closed rings."""
    points = [
        a + (b - a) * np.arange(0.0, 1.0, 0.01 / np.linalg.norm(b - a))[:, None]
        for ring in rings
        for a, b in zip(ring, np.roll(ring, -1, axis=0), strict=True)
    ]
    return Returns.of(np.concatenate(points), np.ones(sum(map(len, points))))


def same_ring(found: Floats, expected: Floats, atol: float = 1e-6) -> bool:
    """Whether two rings have the same corners in the same order, wherever they begin."""
    return len(found) == len(expected) and any(
        np.allclose(np.roll(found, k, axis=0), expected, atol=atol) for k in range(len(found))
    )


def wall(start: Sequence[float], end: Sequence[float], *, fitted: bool = True) -> Wall:
    a, b = np.array(start, dtype=np.float64), np.array(end, dtype=np.float64)
    return Wall(a, b, a, (b - a) / np.linalg.norm(b - a), fitted)


@pytest.mark.parametrize("rad", [0.0, 0.2, math.pi / 4, 1.3, 2.0, -2.5])
def test_a_room_without_noise_has_its_exact_corners(rad: float) -> None:
    room, pillar = turned(L_ROOM, rad), turned(PILLAR, rad)
    low, high = room.min(axis=0) - 0.3, room.max(axis=0) + 0.3
    geometry = GridGeometry.covering(low[0], high[0], low[1], high[1], CELL_M)
    free = contains(room, geometry.centers()) & ~contains(pillar, geometry.centers())
    outlines = outlines_m(geometry, free)
    returns = returns_on(room, pillar)
    for roll in range(5):
        begun = [np.roll(outline, 7 * roll, axis=0) for outline in outlines]
        found = straighten_outlines(begun, returns, CELL_M)
        assert same_ring(found[0].corners_m, room)
        assert same_ring(found[1].corners_m, pillar)
        assert all(one.fitted.all() for one in found)


def test_an_outline_without_returns_stays_as_cells_have_it() -> None:
    far = returns_on(L_ROOM + 50.0)
    (found,) = straighten_outlines([L_ROOM], far, CELL_M)
    assert same_ring(found.corners_m, L_ROOM)
    assert not found.fitted.any()


def test_nothing_is_fitted_to_what_is_smaller_than_the_shortest_wall() -> None:
    """Though its side across be longer: what is so small is no wall."""
    for side_m, is_fitted in ((0.29, False), (0.31, True)):
        corners = side_m * np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
        (found,) = straighten_outlines([corners], returns_on(corners), CELL_M)
        assert found.fitted.any() == is_fitted
        assert is_fitted or same_ring(found.corners_m, corners)


def ring_of(corners: Floats, returns: Returns) -> list[Wall]:
    ends = np.roll(corners, -1, axis=0)
    return [wall_between(a, b, returns, CELL_M) for a, b in zip(corners, ends, strict=True)]


def broken(corners: Floats, profile: Sequence[tuple[float, float]]) -> Floats:
    """A ring each of whose sides goes by (share of the way, metres outward) between its corners."""
    points = []
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        out = np.array([b[1] - a[1], a[0] - b[0]]) / np.linalg.norm(b - a)
        points += [a, *(a + share * (b - a) + off_m * out for share, off_m in profile)]
    return np.array(points)


ROOM = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 3.0], [0.0, 3.0]])


@pytest.mark.parametrize(
    "profile",
    [
        [(0.2, 0.02), (0.4, -0.02), (0.6, 0.02), (0.8, -0.02)],
        # The ends are too short to be fitted themselves.
        [(0.05, 0.03), (0.95, -0.03)],
        [(0.04, -0.03), (0.5, 0.03)],
        [(0.5, 0.03), (0.96, -0.03)],
        [(0.03, -0.03), (0.06, 0.03)],
        [(0.94, -0.03), (0.97, 0.03)],
        # Frames of a door and a window, which nobody took a return of.
        [(0.4, 0.0), (0.4, 0.1), (0.45, 0.1), (0.45, 0.0)],
        [(0.3, 0.0), (0.3, -0.1), (0.34, -0.1), (0.34, 0.0), (0.6, 0.0), (0.6, 0.1), (0.7, 0.1),
         (0.7, 0.0)],
    ],
)  # fmt: skip
def test_stretches_of_a_wall_become_one_wherever_the_outline_begins(
    profile: list[tuple[float, float]],
) -> None:
    outline, returns = turned(broken(ROOM, profile), 0.4), returns_on(turned(ROOM, 0.4))
    for roll in range(len(outline)):
        found = _joined(ring_of(np.roll(outline, roll, axis=0), returns), returns, CELL_M)
        assert all(one.fitted for one in found)
        assert same_ring(np.array([one.start for one in found]), turned(ROOM, 0.4))
        assert same_ring(np.array([one.end for one in found]), turned(ROOM, 0.4))


def test_a_triangle_keeps_three_sides() -> None:
    """One side is broken in two; of a sliver only the longest side is seen."""
    corners = np.array([[0.0, 0.0], [2.0, 0.0], [1.0, 2.0]])
    returns = returns_on(corners)
    found = _joined(ring_of(np.insert(corners, 1, [1.2, 0.02], axis=0), returns), returns, CELL_M)
    assert same_ring(np.array([one.start for one in found]), corners)
    sliver = np.array([[0.0, 0.0], [2.0, 0.0], [2.2, 0.1]])
    x = np.arange(0.0, 2.0, 0.01)
    base = Returns.of(np.column_stack([x, np.zeros(len(x))]), np.ones(len(x)))
    ring = [wall_between(*sliver[[0, 1]], base, CELL_M)]
    ring += [wall(*sliver[[1, 2]], fitted=False), wall(*sliver[[2, 0]], fitted=False)]
    assert len(_joined(ring, base, CELL_M)) == 3


def test_a_niche_is_a_part_of_the_room() -> None:
    """What juts out by more than two and a half cells is not taken in."""
    niche = broken(ROOM, [(0.4, 0.0), (0.4, 0.4), (0.6, 0.4), (0.6, 0.0)])
    returns = returns_on(niche)
    found = _joined(ring_of(niche, returns), returns, CELL_M)
    assert same_ring(np.array([one.start for one in found]), niche)


@pytest.mark.parametrize("seed", range(10))
def test_two_walls_meet_where_both_lines_do(seed: int) -> None:
    rng = np.random.default_rng(seed)
    corner = rng.uniform(-9.0, 9.0, 2)
    one = rng.uniform(0.0, math.tau)
    other = one + rng.choice([-1.0, 1.0]) * rng.uniform(0.3, 2.8)
    ahead, after = (np.array([math.cos(rad), math.sin(rad)]) for rad in (one, other))
    # Corners of cells are some centimetres off, and anchors wherever returns have their mean.
    seen = corner + rng.uniform(-0.1, 0.1, 2)
    a = Wall(seen - 2.0 * ahead, seen, corner - 1.3 * ahead, ahead, fitted=True)
    b = Wall(seen, seen + 3.0 * after, corner + 0.7 * after, after, fitted=True)
    found = _corner(a, b, CELL_M)
    assert found is not None
    np.testing.assert_allclose(found, corner, atol=1e-9)


def test_walls_that_hardly_bend_or_meet_far_away_have_no_corner() -> None:
    def at(deg: float) -> Wall:
        rad = math.radians(deg)
        return wall([5.0, 3.0], [5.0 + math.cos(rad), 3.0 + math.sin(rad)])

    before = wall([4.0, 3.01], [5.0, 3.01])
    for deg in (0.0, 14.0, -14.0, 166.0, 180.0):
        assert _corner(before, at(deg), CELL_M) is None
    for deg in (16.0, -16.0, 164.0):
        assert _corner(before, at(deg), CELL_M) is not None
    for away_m, there in ((1.0, True), (1.01, False)):
        up = Wall(np.array([5.0, 3.0 + away_m]), np.array([5.0, 6.0]), np.array([5.0, 5.0]),
                  np.array([0.0, 1.0]), fitted=True)  # fmt: skip
        assert (_corner(wall([4.0, 3.0], [5.0, 3.0]), up, 0.25) is not None) == there


def test_stretches_of_one_line_meet_where_they_did() -> None:
    found = _corner(wall([4.0, 3.0], [5.0, 3.0]), wall([5.0, 3.0], [7.0, 3.0]), CELL_M)
    assert found is not None
    assert found.tolist() == [5.0, 3.0]


def test_a_jog_between_parallel_walls_belongs_to_neither() -> None:
    ring = [wall([1.0, 1.0], [2.0, 1.0]), wall([2.0, 1.1], [3.0, 1.1]),
            wall([3.0, 1.0], [3.0, 3.0]), wall([3.0, 3.0], [1.0, 3.0]),
            wall([1.0, 3.0], [1.0, 1.0])]  # fmt: skip
    found = _closed(ring, None, CELL_M)
    expected = [[1.0, 1.0], [2.0, 1.0], [2.0, 1.1], [3.0, 1.1], [3.0, 3.0], [1.0, 3.0]]
    np.testing.assert_allclose(found.corners_m, expected, atol=1e-12)
    assert found.fitted.tolist() == [True, False, True, True, True, True]
