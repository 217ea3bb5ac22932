# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Line of sight against brute force: every segment against every box, by slabs."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

from slarm_graph.convex import convex_pieces, is_convex
from slarm_graph.frontends.simulation.random_worlds import random_world
from slarm_graph.grid import GridGeometry
from slarm_graph.polygons import contains, signed_area_m2
from slarm_graph.radio import shadows
from slarm_graph.radio.line_of_sight import (
    line_of_sight_over_cells,
    line_of_sight_past_cells,
    line_of_sight_past_solids,
    line_of_sight_to_points,
)
from slarm_graph.radio.shadows import next_containing, unoccluded
from slarm_graph.world import Solid

HEIGHTS_M = [0.3, 1.0, 1.8, 2.5, math.inf]


def brute_force(geometry, low, high, access_point, antenna_height, *, grow):
    """Whether segments miss all boxes, grown by `grow` [m] on every side."""
    low, high = low - grow, high + grow
    clear = np.ones(geometry.shape, dtype=bool)
    for row, col in np.ndindex(geometry.shape):
        x, y = geometry.center_of([row, col])
        step = np.array([x, y, antenna_height]) - access_point
        with np.errstate(divide="ignore", invalid="ignore"):
            a, b = (low - access_point) / step, (high - access_point) / step
        enter, leave = np.minimum(a, b), np.maximum(a, b)
        inside = (low <= access_point) & (access_point <= high)
        enter = np.where(step == 0, np.where(inside, -np.inf, np.inf), enter).max(axis=1)
        leave = np.where(step == 0, np.where(inside, np.inf, -np.inf), leave).min(axis=1)
        clear[row, col] = not np.any(np.minimum(leave, 1.0) > np.maximum(enter, 0.0))
    return clear


def boxes_of_cells(geometry, heights):
    cells = np.argwhere(heights > 0.0)
    half = geometry.resolution_m / 2
    low, high = geometry.center_of(cells) - half, geometry.center_of(cells) + half
    tops = heights[cells[:, 0], cells[:, 1]]
    return np.column_stack([low, np.full(len(low), -1e9)]), np.column_stack([high, tops])


def assert_between(ours, low, high, geometry, access_point, antenna_height):
    """Exact up to rounding: between the answers for boxes a hair smaller and a hair larger."""
    if not len(low):
        assert ours.all()
        return
    generous = brute_force(geometry, low, high, access_point, antenna_height, grow=-1e-7)
    strict = brute_force(geometry, low, high, access_point, antenna_height, grow=1e-7)
    assert not np.any(ours & ~generous)
    assert not np.any(~ours & strict)


@pytest.mark.parametrize("seed", range(40))
def test_cells_equal_brute_force(seed):
    rng = np.random.default_rng(seed)
    rows, cols = rng.integers(1, 18, 2)
    geometry = GridGeometry(
        *rng.choice([0.0, -1.0, 0.37], 2), rng.choice([0.05, 0.1, 0.25]), int(rows), int(cols)
    )
    share = rng.choice([0.02, 0.1, 0.4])
    heights = np.where(
        rng.random(geometry.shape) < share, rng.choice(HEIGHTS_M, geometry.shape), 0.0
    )
    x_min, x_max, y_min, y_max = geometry.extent_m
    plan = rng.uniform([x_min - 0.2, y_min - 0.2], [x_max + 0.2, y_max + 0.2])
    if seed % 2:
        # On centres and corners of cells every second ray meets the lattice exactly.
        cell = rng.integers([0, 0], geometry.shape)
        plan = geometry.center_of(cell) + rng.choice([0.0, 0.5], 2) * geometry.resolution_m
    access_point = np.array([*plan, rng.choice([0.3, 0.5, 1.8, 2.5])])
    antenna = float(rng.choice([0.3, 0.5, 1.0, 2.0]))
    ours = line_of_sight_over_cells(geometry, heights, access_point, antenna)
    assert_between(ours, *boxes_of_cells(geometry, heights), geometry, access_point, antenna)


def box(x0, y0, x1, y1, height):
    return Solid("box", np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]]), height)


@pytest.mark.parametrize("seed", range(20))
def test_solids_equal_brute_force(seed):
    rng = np.random.default_rng(seed)
    geometry = GridGeometry.covering(-1.0, 1.0, -0.8, 0.8, 0.1)
    starts = rng.uniform(-1.0, 0.7, (5, 2)).round(1)
    ends = starts + rng.uniform(0.05, 0.6, (5, 2)).round(1) + 0.05
    tops = rng.choice(HEIGHTS_M, 5)
    solids = [box(*s, *e, t) for s, e, t in zip(starts, ends, tops, strict=True)]
    access_point = np.array([*rng.uniform(-1.2, 1.2, 2).round(1), rng.choice([0.4, 1.8, 2.5])])
    antenna = float(rng.choice([0.3, 0.5, 1.0]))
    ours = line_of_sight_past_solids(geometry, solids, access_point, antenna)
    low = np.column_stack([starts, np.full(5, -1e9)])
    assert_between(ours, low, np.column_stack([ends, tops]), geometry, access_point, antenna)


def test_cells_and_solids_agree_on_boxes_made_of_cells():
    geometry = GridGeometry.covering(0.0, 4.0, 0.0, 3.0, 0.1)
    heights = np.zeros(geometry.shape)
    heights[10:16, 8:15] = 1.8
    heights[20:22, 25:33] = 1.2
    solids = [box(0.8, 1.0, 1.5, 1.6, 1.8), box(2.5, 2.0, 3.3, 2.2, 1.2)]
    for access_point in ([2.0, 3.0, 2.5], [0.33, 0.21, 2.0], [3.9, 0.1, 1.0]):
        cells = line_of_sight_over_cells(geometry, heights, access_point, 0.5)
        vectors = line_of_sight_past_solids(geometry, solids, access_point, 0.5)
        np.testing.assert_array_equal(cells, vectors)


def test_shadow_ends_where_the_ray_clears_the_top():
    """By hand: eye at 2.5 m, wall to 1.5 m from x = 1 to 2, antenna at 0.5 m: dark up to x = 4."""
    geometry = GridGeometry.covering(0.0, 6.0, 0.0, 1.0, 0.1)
    wall = box(1.0, -10.0, 2.0, 10.0, 1.5)
    clear = line_of_sight_past_solids(geometry, [wall], [0.0, 0.5, 2.5], 0.5)
    x = geometry.centers()[5, :, 0]
    np.testing.assert_array_equal(clear[5], (x < 1.0) | (x > 4.0))


def test_antenna_above_the_access_point_sees_over_what_is_near_it():
    geometry = GridGeometry.covering(0.0, 6.0, 0.0, 1.0, 0.1)
    wall = box(2.0, -10.0, 2.5, 10.0, 1.0)
    clear = line_of_sight_past_solids(geometry, [wall], [0.0, 0.5, 0.5], 2.5)
    # The ray to x passes x = 2 at 0.5 + 2 * 2 / x, below 1 m when x > 8: never here but inside.
    x = geometry.centers()[5, :, 0]
    np.testing.assert_array_equal(clear[5], np.ones_like(clear[5]))
    level = line_of_sight_past_solids(geometry, [wall], [0.0, 0.5, 0.5], 0.5)
    np.testing.assert_array_equal(level[5], x < 2.0)


def test_mirrored_worlds_have_mirrored_shadows():
    rng = np.random.default_rng(5)
    geometry = GridGeometry.covering(-1.5, 1.5, -1.5, 1.5, 0.1)
    heights = np.where(rng.random(geometry.shape) < 0.05, 1.8, 0.0)
    clear = line_of_sight_over_cells(geometry, heights, [0.31, -0.47, 2.5], 0.5)
    mirrored = line_of_sight_over_cells(geometry, heights[:, ::-1], [-0.31, -0.47, 2.5], 0.5)
    np.testing.assert_array_equal(mirrored, clear[:, ::-1])
    turned = line_of_sight_over_cells(geometry, heights.T, [-0.47, 0.31, 2.5], 0.5)
    np.testing.assert_array_equal(turned, clear.T)


def test_more_obstacles_never_clear_a_link():
    rng = np.random.default_rng(6)
    geometry = GridGeometry.covering(0.0, 4.0, 0.0, 4.0, 0.1)
    heights = np.where(rng.random(geometry.shape) < 0.03, 1.5, 0.0)
    more = np.maximum(heights, np.where(rng.random(geometry.shape) < 0.03, 2.0, 0.0))
    before = line_of_sight_over_cells(geometry, heights, [2.0, 2.0, 2.5], 0.5)
    after = line_of_sight_over_cells(geometry, more, [2.0, 2.0, 2.5], 0.5)
    assert not np.any(after & ~before)


def test_concave_solid_and_a_ray_along_its_cut():
    corners = np.array([[1, 1], [3, 1], [3, 3], [2, 2], [1, 3]], dtype=float)
    pieces = convex_pieces(corners)
    assert all(is_convex(piece) for piece in pieces)
    assert sum(map(signed_area_m2, pieces)) == pytest.approx(signed_area_m2(corners))
    geometry = GridGeometry.covering(0.0, 6.0, 0.0, 6.0, 0.2)
    solid = Solid("notched", corners, math.inf)
    clear = line_of_sight_past_solids(geometry, [solid], [0.1, 0.1, 2.0], 0.5)
    assert not np.diag(clear)[8:].any()


NOTCHED = {
    "L": [[2, 2], [8, 2], [8, 4], [4, 4], [4, 8], [2, 8]],
    "U": [[2, 2], [9, 2], [9, 8], [7, 8], [7, 4], [4, 4], [4, 8], [2, 8]],
    "T": [[4, 1], [6, 1], [6, 5], [9, 5], [9, 7], [1, 7], [1, 5], [4, 5]],
    "arrow": [[2, 2], [8, 5], [2, 8], [5, 5]],
}


@pytest.mark.parametrize("shape", NOTCHED)
def test_no_ray_slips_through_where_a_concave_solid_is_cut(shape):
    """Second implementation: shapely on the whole plan, for rays through corners and along cuts."""
    plan = np.array(NOTCHED[shape], dtype=float)
    inner = shapely.Polygon(plan).buffer(-1e-6)
    geometry = GridGeometry(-0.5, -0.5, 1.0, 11, 11)
    solid = Solid(shape, plan, math.inf)
    for place in np.ndindex(11, 11):
        eye = np.array(place, dtype=float)
        if inner.intersects(shapely.Point(eye)):
            continue
        clear = line_of_sight_past_solids(geometry, [solid], [*eye, 2.0], 0.5)
        rays = shapely.linestrings([[eye, (col, row)] for row, col in np.ndindex(11, 11)])
        slips = clear & shapely.intersects(inner, rays).reshape(clear.shape)
        assert not slips.any(), (eye, np.argwhere(slips)[:3])


@pytest.mark.parametrize("seed", range(10))
def test_the_next_polygon_around_a_point_is_the_one_that_shapely_finds(seed):
    rng = np.random.default_rng(seed)
    angle = np.linspace(0.0, 2.0 * np.pi, 8)[:7] + 0.1
    stars = [
        rng.uniform(-2.0, 2.0, 2)
        + rng.uniform(0.3, 1.5, (7, 1)) * np.column_stack([np.cos(angle), np.sin(angle)])
        for _ in range(8)
    ]
    starts = np.arange(0, 57, 7)
    for point in rng.uniform(-3.0, 3.0, (60, 2)):
        around = [shapely.Polygon(star).contains(shapely.Point(point)) for star in stars]
        for first in range(9):
            expected = next((i for i in range(first, 8) if around[i]), 8)
            assert next_containing(first, point[None], np.concatenate(stars), starts) == expected


def test_outer_wall_hides_the_far_leg_of_an_l_shaped_room():
    boundary = np.array([[0, 0], [4, 0], [4, 1], [1, 1], [1, 4], [0, 4]], dtype=float)
    geometry = GridGeometry.covering(0.0, 4.0, 0.0, 4.0, 0.1)
    clear = line_of_sight_past_solids(geometry, [], [3.9, 0.1, 2.0], 0.5, boundary_m=boundary)
    assert clear[:10, :10].any()
    assert not clear[30:, :10].any()


def test_access_point_in_a_wall_is_put_on_its_face():
    geometry = GridGeometry.covering(0.0, 3.0, 0.0, 3.0, 0.1)
    wall = box(-0.5, 3.0, 3.5, 3.4, 3.0)
    inside = [1.5, 3.02, 2.5]
    assert not line_of_sight_past_solids(geometry, [wall], inside, 0.5).any()
    assert line_of_sight_past_solids(geometry, [wall], inside, 0.5, mount_radius_m=0.25).all()
    heights = np.zeros(geometry.shape)
    heights[-1] = math.inf
    cells = line_of_sight_over_cells(geometry, heights, [1.5, 2.95, 2.5], 0.5, mount_radius_m=0.25)
    assert cells[:28].mean() > 0.95


def test_nothing_hides_anything_in_the_open():
    geometry = GridGeometry(0.0, 0.0, 0.1, 7, 9)
    assert line_of_sight_over_cells(geometry, np.zeros((7, 9)), [5.0, -2.0, 2.5], 0.5).all()
    assert line_of_sight_past_solids(geometry, [], [5.0, -2.0, 2.5], 0.5).all()


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("antenna_m", [0.5, 2.0])
def test_points_and_cells_see_the_same(seed: int, antenna_m: float) -> None:
    world = random_world(np.random.default_rng(seed), obstacles=8)
    geometry = GridGeometry(-6.0, -4.5, 0.1, 90, 120)
    centers, ap = geometry.centers(), world.access_points[0].position_m()
    boxes = [solid for solid in world.solids if len(solid.corners_m) == 4]
    outside = ~np.any([contains(solid.corners_m, centers) for solid in boxes], axis=0)
    cells = line_of_sight_past_solids(geometry, boxes, ap, antenna_m)
    points = line_of_sight_to_points(centers[outside], boxes, ap, antenna_m)
    assert (points != cells[outside]).sum() <= 2
    assert 0 < points.sum() <= len(points)
    assert line_of_sight_to_points(centers[0], [], ap, antenna_m).all()


@pytest.mark.parametrize("quarter", range(4))
def test_a_ray_along_the_sides_of_a_box_is_hidden_by_it_and_passes_beside_it(quarter: int) -> None:
    """By hand: from four metres before a box to four behind it, inside its width and outside."""
    turn = np.linalg.matrix_power(np.array([[0.0, -1.0], [1.0, 0.0]]), quarter)
    wall = Solid("box", box(-1.0, -0.5, 1.0, 0.5, math.inf).corners_m @ turn.T, math.inf)
    for across_m, is_clear in (
        (0.0, False),
        (0.4, False),
        (-0.4, False),
        (0.6, True),
        (-0.6, True),
    ):
        eye, point = turn @ [-4.0, across_m], turn @ [4.0, across_m]
        found = line_of_sight_to_points(point[None], [wall], np.array([*eye, 2.0]), 0.5)
        assert found.tolist() == [is_clear]


@pytest.mark.parametrize("eye", [(60.0, 45.0), (31.5, 8.25), (-40.0, 17.0), (75.3, 89.9)])
def test_cells_behind_others_hide_nothing_else(eye: tuple[float, float]) -> None:
    rng, geometry = np.random.default_rng(11), GridGeometry(0.0, 0.0, 0.05, 90, 120)
    coarse = rng.random((18, 24)) < 0.3
    cells = coarse.repeat(5, axis=0).repeat(5, axis=1) ^ (rng.random(geometry.shape) < 0.02)
    position_m = [*(0.05 * np.array(eye)), 2.5]
    clear = line_of_sight_over_cells(geometry, np.where(cells, np.inf, 0.0), position_m, 0.5)
    past = line_of_sight_past_cells(geometry, cells, position_m, 0.5)
    np.testing.assert_array_equal(past, clear)
    boxes, _ = shadows.boxes_of_cells(cells, 0.0, np.ones((3, 3), dtype=np.bool_))
    assert unoccluded(np.array(eye), boxes).mean() < 0.5
