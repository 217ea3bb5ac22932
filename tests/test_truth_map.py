# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The truth raster against matplotlib's point-in-polygon, areas and hand-made cases."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.path import Path as Outline

from slarm_graph.errors import BadInput
from slarm_graph.files.worlds import load_world, world_from_yaml
from slarm_graph.frontends.simulation.random_worlds import random_world
from slarm_graph.geometry import Pose2
from slarm_graph.polygons import contains
from slarm_graph.truth_map import truth_map

DELTAS_M = (0.02, 0.05, 0.1, 0.15, 0.2, 0.25)


@pytest.mark.parametrize("seed", range(3))
def test_centres_inside_solids_are_blocked(seed: int) -> None:
    world = random_world(np.random.default_rng(seed))
    truth = truth_map(world, 0.13)
    centers = truth.geometry.centers().reshape(-1, 2)
    want = ~Outline(world.boundary_m).contains_points(centers)
    heights = np.where(want, world.ceiling_m, 0.0)
    for solid in world.solids:
        inside = Outline(solid.corners_m).contains_points(centers)
        heights = np.maximum(heights, np.where(inside, solid.height_m, 0.0))
    np.testing.assert_allclose(truth.heights_m.ravel(), heights.astype(np.float32))
    np.testing.assert_array_equal(truth.blocked.ravel(), heights > 0)


@pytest.mark.parametrize("seed", range(3))
def test_touched_cells_hold_all_that_samples_of_them_find(seed: int) -> None:
    rng = np.random.default_rng(seed)
    world = random_world(rng)
    touched, centre = truth_map(world, 0.2, "touched"), truth_map(world, 0.2)
    assert np.all(touched.blocked | ~centre.blocked)
    found = np.zeros(touched.blocked.shape, dtype=bool)
    corners = touched.geometry.centers() - 0.1
    for _ in range(400):
        points = corners + rng.uniform(0.0, 0.2, corners.shape)
        found |= ~contains(world.boundary_m, points)
        for solid in world.solids:
            found |= contains(solid.corners_m, points)
    assert not np.any(found & ~touched.blocked)
    # What samples miss are slivers: a solid cuts a corner or an edge lies along the cell's side.
    assert np.mean(touched.blocked & ~found) < 0.02


@pytest.mark.parametrize("delta", DELTAS_M)
def test_areas_of_the_papers_room(delta: float) -> None:
    truth = truth_map(load_world("paper_room"), delta)
    weight = truth.area_weight * delta**2
    assert weight.sum() == pytest.approx(70.0)
    assert truth.area_weight.max() == 1.0
    ring = 70.0 - 7.0 * 3.5 - 3 * 1.3
    assert weight[truth.reachable].sum() == pytest.approx(ring, rel=0.035)
    hollow = ~truth.blocked & ~truth.reachable
    assert weight[hollow].sum() == pytest.approx(6.0 * 2.5, rel=0.08)


def test_seams_between_pieces_of_a_wall_are_solid() -> None:
    """Centres on the mitre of two wall pieces lie inside the wall, at any resolution."""
    room = load_world("paper_room")
    for delta in (0.05, 0.1, 0.125, 0.25, 0.5):
        truth = truth_map(room, delta)
        x, y = np.moveaxis(np.abs(truth.geometry.centers()), -1, 0)
        wall = (x < 3.5 - 1e-6) & (y < 1.75 - 1e-6) & ((x > 3.0 + 1e-6) | (y > 1.25 + 1e-6))
        assert truth.blocked[wall].all()
        assert set(np.unique(truth.heights_m[wall])) == {np.float32(1.8)}


def test_half_of_the_faces_count() -> None:
    """At 0.1 m the long sides of the inner wall pass through cell centres."""
    truth = truth_map(load_world("paper_room"), 0.1)
    x, y = np.moveaxis(truth.geometry.centers(), -1, 0)
    long_side = (np.abs(np.abs(y) - 1.75) < 1e-6) & (np.abs(x) < 3.5 - 1e-6)
    assert long_side.sum() == 140
    assert not truth.blocked[long_side & (y > 0)].any()
    assert truth.blocked[long_side & (y < 0)].all()


@pytest.mark.parametrize("thickness_m", [0.04, 0.003])
@pytest.mark.parametrize("delta", [0.02, 0.05, 0.25])
def test_nothing_is_reached_through_a_wall(delta: float, thickness_m: float) -> None:
    """However thin it is and however it lies; what it encloses is free but out of reach."""
    text = (
        "{name: thin, ceiling_m: 3, boundary_m: [[0,0],[4,0],[4,4],[0,4]],"
        " start: {x_m: 0.4, y_m: 0.4}, walls: [{center_m: [2.073, 2.041], size_m: [2, 2],"
        f" thickness_m: {thickness_m}, height_m: 2, heading_deg: %s}}]}}"
    )
    for heading_deg in (0.0, 31.0):
        truth = truth_map(world_from_yaml(text % heading_deg), delta)
        x, y = np.moveaxis(truth.geometry.centers(), -1, 0)
        away = np.hypot(x - 2.073, y - 2.041)
        assert not truth.reachable[away < 0.95].any()
        assert truth.reachable[(away > 1.45) & ~truth.blocked].all()


def test_what_lies_beyond_an_area_is_not_reached() -> None:
    truth = truth_map(load_world("paper_room"), 0.25, area=(-5.0, 5.0, -3.5, -2.0))
    y = truth.geometry.centers()[..., 1]
    assert not truth.reachable[y > -2.0].any()
    assert truth.reachable[(y < -2.0) & ~truth.blocked].all()
    # A strip that ends at the eastern box parts what is above it from what is below.
    cut = truth_map(load_world("paper_room"), 0.25, area=(-5.0, 5.0, -3.5, 1.0))
    x, y = np.moveaxis(cut.geometry.centers(), -1, 0)
    assert cut.reachable[(x < -3.6) & (y < 1.0) & ~cut.blocked].all()


def test_clipped_cells_weigh_their_share() -> None:
    truth = truth_map(load_world("paper_room"), 0.15)
    assert truth.geometry.shape == (47, 67)
    assert truth.area_weight[0, -1] == pytest.approx((10.0 - 66 * 0.15) / 0.15)
    assert truth.area_weight[-1, 0] == pytest.approx((7.0 - 46 * 0.15) / 0.15)
    assert truth.area_weight[0, 0] == 1.0


def test_reachability_does_not_pass_corners() -> None:
    text = (
        "{name: corner, ceiling_m: 3, boundary_m: [[0,0],[4,0],[4,4],[0,4]],"
        " start: {x_m: 0.5, y_m: 0.5}, boxes: ["
        "{name: a, center_m: [1,3], size_m: [2,2], height_m: 1},"
        "{name: b, center_m: [3,1], size_m: [2,2], height_m: 1}]}"
    )
    truth = truth_map(world_from_yaml(text), 0.5)
    assert truth.reachable[0, 0]
    assert not truth.blocked[-1, -1]
    assert not truth.reachable[-1, -1]


def test_a_blocked_start_is_refused() -> None:
    text = (
        "{name: shut, ceiling_m: 3, boundary_m: [[0,0],[4,0],[4,4],[0,4]],"
        " start: {x_m: 3, y_m: 1}, boxes: [{center_m: [1,1], size_m: [1,1], height_m: 1}]}"
    )
    with pytest.raises(BadInput, match=r"shut: start: .* blocked cell at a resolution of 0.1 m"):
        truth_map(replace(world_from_yaml(text), start=Pose2(1.0, 1.0)), 0.1)
