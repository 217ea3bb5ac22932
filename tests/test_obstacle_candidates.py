# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""What outlines may show of obstacles, where it is known what stands there."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import ConvexHull
from test_walls import turned

from slarm_graph.geometry import Floats
from slarm_graph.polygons import signed_area_m2
from slarm_graph.recovery.known_sizes import Match
from slarm_graph.recovery.obstacle_candidates import ObstacleCandidate, candidates_on, convex_hull
from slarm_graph.recovery.obstacles import _rank, matched_blocks
from slarm_graph.recovery.returns import NO_RETURNS, Returns
from slarm_graph.recovery.walls import Outline

BEFORE_A_WALL = np.array(
    [[0, 0], [1, 0], [1, 0.7], [2.2, 0.7], [2.2, 0], [5, 0], [5, 4], [0, 4]], dtype=np.float64
)
IN_A_CORNER = np.array([[1, 0], [5, 0], [5, 4], [0, 4], [0, 0.7], [1, 0.7]], dtype=np.float64)


def outline(corners: Floats, fitted: list[int] | None = None) -> Outline:
    """An outline with some sides fitted, or all."""
    mask = np.full(len(corners), fitted is None)
    mask[fitted or []] = True
    return Outline(corners, mask)


def has_corners(ring: Floats, expected: Floats) -> bool:
    """Whether a ring has some corners, wherever it begins, and is counter-clockwise."""
    return len(ring) == len(expected) and signed_area_m2(ring) > 0.0 and any(
        np.allclose(np.roll(ring, k, axis=0), expected, atol=1e-5) for k in range(len(ring))
    )  # fmt: skip


def only(found: list[ObstacleCandidate]) -> ObstacleCandidate:
    (one,) = found
    return one


@pytest.mark.parametrize("rad", [0.0, 0.7, 2.5, -1.9])
@pytest.mark.parametrize("roll", range(8))
def test_a_box_before_a_wall_is_a_run_of_three_sides(rad: float, roll: int) -> None:
    corners = np.roll(turned(BEFORE_A_WALL, rad), roll, axis=0)
    found = only(list(candidates_on(outline(corners), NO_RETURNS, 1.5)))
    assert found.sides == tuple((side + roll) % 8 for side in (1, 2, 3))
    assert found.shown_m == pytest.approx(0.7 + 1.2 + 0.7)
    box = turned(np.array([[1.0, 0.0], [2.2, 0.0], [2.2, 0.7], [1.0, 0.7]]), rad)
    assert has_corners(found.box_m, box)
    assert has_corners(found.ring_m, box)
    assert sorted(found.plan.sides_m) == pytest.approx([0.7, 1.2])
    assert found.plan.area_m2 == pytest.approx(0.84)
    assert (found.plan.corners_seen, *found.plan.unseen_m) == (2, 0.0, 0.0)


@pytest.mark.parametrize("rad", [0.0, 0.7, 2.5])
@pytest.mark.parametrize("roll", range(6))
def test_a_box_in_a_corner_shows_one_of_its_own(rad: float, roll: int) -> None:
    """Its fourth, in the room's corner, is hidden and filled in."""
    corners = np.roll(turned(IN_A_CORNER, rad), roll, axis=0)
    found = only(list(candidates_on(outline(corners), NO_RETURNS, 1.5)))
    assert found.sides == tuple((side + roll) % 6 for side in (4, 5))
    assert found.shown_m == pytest.approx(1.7)
    box = turned(np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.7], [0.0, 0.7]]), rad)
    assert has_corners(found.box_m, box)
    assert has_corners(found.ring_m, box)
    assert found.plan.corners_seen == 1


@pytest.mark.parametrize("side", range(5))
def test_any_fitted_side_of_a_run_or_beside_it_gives_the_rectangle(side: int) -> None:
    """The wall before it, its own three sides, the wall behind it."""
    found = only(list(candidates_on(outline(BEFORE_A_WALL, [side]), NO_RETURNS, 1.5)))
    assert has_corners(found.box_m, BEFORE_A_WALL[[1, 4, 3, 2]])


@pytest.mark.parametrize("fitted", [[], [5], [6, 7]])
def test_without_a_fitted_side_there_is_no_rectangle(fitted: list[int]) -> None:
    assert not list(candidates_on(outline(BEFORE_A_WALL, fitted), NO_RETURNS, 1.5))


@pytest.mark.parametrize("size", [0.2, 1.0, 4.0])
def test_corners_in_front_were_seen_whatever_the_size(size: float) -> None:
    found = only(list(candidates_on(outline(BEFORE_A_WALL * size), NO_RETURNS, 1.5 * size)))
    assert found.plan.corners_seen == 2


def test_the_smallest_rectangle_counts() -> None:
    """A side that is slanted by mistake makes a larger one."""
    slanted = BEFORE_A_WALL.copy()
    slanted[2] = [1.3, 0.7]
    found = only(list(candidates_on(outline(slanted), NO_RETURNS, 1.5)))
    assert has_corners(found.box_m, BEFORE_A_WALL[[1, 4, 3, 2]])
    assert found.plan.area_m2 == pytest.approx(0.84 - 0.5 * 0.3 * 0.7)


def test_a_niche_and_what_is_too_long_are_no_obstacle() -> None:
    niche = BEFORE_A_WALL.copy()
    niche[2:4, 1] = -0.7
    assert all(2 not in c.sides for c in candidates_on(outline(niche), NO_RETURNS, 1.5))
    assert not list(candidates_on(outline(BEFORE_A_WALL), NO_RETURNS, 1.19))
    assert list(candidates_on(outline(BEFORE_A_WALL), NO_RETURNS, 1.21))


@pytest.mark.parametrize(("deg", "is_corner"), [(15.0, False), (25.0, True)])
def test_an_outline_that_bends_by_twenty_degrees_has_a_corner(deg: float, is_corner: bool) -> None:
    """A ramp on the wall: it begins and ends with such a bend."""
    top_m = math.tan(math.radians(deg))
    ramp = np.array([[0, 0], [1, 0], [2, top_m], [3, 0], [5, 0], [5, 4], [0, 4]], dtype=np.float64)
    found = [c.sides for c in candidates_on(outline(ramp), NO_RETURNS, 2.5)]
    assert found == ([(1, 2)] if is_corner else [])


def island_of(ring: Floats, *, fitted: bool = True, returns: Returns = NO_RETURNS) -> Outline:
    return Outline(ring[::-1].copy(), np.full(len(ring), fitted))


def disc(radius_m: float, count: int, center: tuple[float, float] = (3.0, 2.0)) -> Floats:
    angle = np.arange(count) * math.tau / count
    return np.asarray(np.array(center) + radius_m * np.column_stack([np.cos(angle), np.sin(angle)]))


@pytest.mark.parametrize("rad", [0.0, 0.4, -1.2])
def test_an_island_is_an_obstacle_seen_from_all_sides(rad: float) -> None:
    box = turned(np.array([[0.0, 0.0], [1.2, 0.0], [1.2, 0.7], [0.0, 0.7]]), rad)
    found = only(list(candidates_on(island_of(box), NO_RETURNS, 1.5)))
    assert found.sides == (0, 1, 2, 3)
    assert found.shown_m == pytest.approx(3.8)
    assert has_corners(found.ring_m, box)
    assert has_corners(found.box_m, box)
    assert sorted(found.plan.sides_m) == pytest.approx([0.7, 1.2], abs=1e-5)
    assert found.plan.area_m2 == pytest.approx(0.84)
    assert found.plan.corners_seen == 4
    low, high = box.min(axis=0), box.max(axis=0)
    longest_m = float((high - low).max())
    assert not list(candidates_on(island_of(box), NO_RETURNS, longest_m - 0.01))


def test_an_island_of_other_than_four_corners_has_a_rectangle_around_it() -> None:
    found = only(list(candidates_on(island_of(disc(0.4, 8)), NO_RETURNS, 1.0)))
    assert has_corners(found.ring_m, disc(0.4, 8))
    assert found.box_m.shape == (4, 2)
    side_m = 0.8 * math.cos(math.pi / 8)
    assert signed_area_m2(found.box_m) == pytest.approx(side_m**2, rel=1e-5)
    kite = np.array([[0.0, 0.0], [1.2, 0.0], [1.0, 0.7], [0.1, 0.7]])
    found = only(list(candidates_on(island_of(kite), NO_RETURNS, 1.5)))
    assert has_corners(found.box_m, kite)


def returns_of(*rings: Floats) -> Returns:
    points = np.concatenate(rings)
    return Returns.of(points, np.ones(len(points)))


def test_returns_round_an_island_that_cells_made_angular() -> None:
    """Only its own count, and only where no line was fitted."""
    cells, true = disc(0.33, 8), disc(0.3, 60)
    other = disc(0.2, 30, (3.0, 2.65))
    seen = returns_of(true, other)
    found = only(list(candidates_on(island_of(cells, fitted=False), seen, 1.0)))
    assert found.plan.area_m2 == pytest.approx(signed_area_m2(true))
    fitted = only(list(candidates_on(island_of(cells), seen, 1.0)))
    assert fitted.plan.area_m2 == pytest.approx(signed_area_m2(cells))


@pytest.mark.parametrize(
    "seen",
    [
        disc(0.3, 60)[:20],  # one side only
        disc(0.38, 60),  # another, larger shape
        disc(0.3, 60)[:2],  # no area
        disc(0.1, 60),  # what is inside is not it
        disc(0.3, 60, (5.0, 2.0)),
    ],
)
def test_returns_that_tell_another_shape_leave_an_island_as_it_is(seen: Floats) -> None:
    cells = disc(0.33, 8)
    found = only(list(candidates_on(island_of(cells, fitted=False), returns_of(seen), 1.0)))
    assert has_corners(found.ring_m, cells)


@pytest.mark.parametrize("seed", range(5))
def test_a_hull_is_that_of_another_program(seed: int) -> None:
    points = np.random.default_rng(seed).normal(size=(40, 2))
    assert has_corners(convex_hull(points), points[ConvexHull(points).vertices])
    line = np.column_stack([np.arange(5.0), np.arange(5.0)])
    assert convex_hull(line) is line


def test_sure_matches_with_few_sides_come_first_and_those_without_last() -> None:
    """A misfit of two centimetres is sure; else it counts by metre of outline."""
    box = only(list(candidates_on(outline(BEFORE_A_WALL), NO_RETURNS, 1.5)))
    long, short = replace(box, shown_m=4.0), replace(box, sides=(1, 2), shown_m=1.0)
    order: list[tuple[ObstacleCandidate, float | None]] = [
        (short, 0.02), (long, 0.001), (long, 0.019), (long, 0.03), (short, 0.021), (long, 0.1),
        (short, None),
    ]  # fmt: skip
    ranks = [_rank(c, None if off is None else Match(off, 1.0, 1.0)) for c, off in order]
    assert ranks == sorted(ranks)
    assert len(set(ranks)) == len(order)


@pytest.mark.parametrize("rad", [0.0, 0.7])
@pytest.mark.parametrize(("length_m", "count"), [(1.3, 2), (2.1, 2), (2.2, 1)])
def test_what_goes_on_below_another_thing_may_be_longer_than_it_shows(
    rad: float, length_m: float, count: int
) -> None:
    """It shows 0.8 m, and may go on by the other's 1.2 m; both are solid where they show."""
    corners = np.array([[0, 0], [1, 0], [1, 0.7], [2.2, 0.7], [2.2, 0.4], [3, 0.4], [3, 0],
                        [5, 0], [5, 4], [0, 4]], dtype=np.float64)  # fmt: skip
    outlines = [outline(turned(corners, rad))]
    sizes = ((1.2, 0.7, 1.5, 1.0), (length_m, 0.4, 0.9, 1.0))
    found = matched_blocks(outlines, NO_RETURNS, sizes, 0.15)
    expected = [("block 1", 1.5, {1, 2, 3}), ("block 2", 0.9, {4, 5})][:count]
    assert [(b.solid.name, b.solid.height_m, set(b.sides)) for b in found] == expected
    assert [b.outline for b in found] == [0] * count
    tall = np.array([[1.0, 0.0], [2.2, 0.0], [2.2, 0.7], [1.0, 0.7]])
    low = np.array([[2.2, 0.0], [3.0, 0.0], [3.0, 0.4], [2.2, 0.4]])
    for block, ring in zip(found, (tall, low), strict=False):
        assert has_corners(block.solid.corners_m, turned(ring, rad))
