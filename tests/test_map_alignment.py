# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Laying maps onto each other: the search alone, the field it slides down, and what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest
from test_map_accuracy import moved, room

from slarm_graph.errors import BadInput
from slarm_graph.eval.map_alignment import (
    _bilinear,
    _raster,
    _refine,
    _search,
    _thin,
    _walls_m,
    align_maps,
)
from slarm_graph.geometry import Floats, Pose2, transform_points
from slarm_graph.grid import GridGeometry, OccupancyGrid


def corner(seed: int = 0) -> Floats:
    """Points on walls that look like themselves from one side only."""
    along = np.arange(0.0, 6.0, 0.04)[:, None]
    walls = [along * [1.0, 0.0], along[:100] * [0.0, 1.0], [2.0, 1.5] + along[:30] * [1.0, 0.6]]
    return np.concatenate(walls) + np.random.default_rng(seed).uniform(-9.0, 9.0, 2)


def test_the_search_alone_finds_motions_to_a_cell_and_leans_to_no_side() -> None:
    """Rotations are tried every three degrees, and shifts in cells of 0.2 m."""
    off_m = []
    for seed in range(24):
        rng = np.random.default_rng(seed)
        source = corner(seed)
        theta = math.radians(3.0 * rng.integers(120))
        motion = Pose2(*rng.uniform(-20.0, 20.0, 2), theta)
        target = transform_points(motion.as_array(), source)
        found = _search(target, source)
        assert abs(math.remainder(found.theta - theta, math.tau)) < math.radians(3.1)
        off_m.append((transform_points(found.as_array(), source) - target).mean(axis=0))
    assert np.abs(off_m).max() < 0.2
    assert np.abs(np.mean(off_m, axis=0)).max() < 0.06


def test_refinement_slides_walls_onto_walls() -> None:
    grid = room()
    start = Pose2(0.12, -0.09, math.radians(1.4))
    found = _refine(grid, _thin(_walls_m(grid)), start)
    assert np.hypot(found.x, found.y) < 0.005
    assert abs(found.theta) < 0.001


def test_what_only_one_map_has_does_not_pull() -> None:
    """A wing twice as far away in one, a pillar in the other."""
    one = moved(room(), Pose2(0.0, 0.0, 0.0))
    x, y = np.moveaxis(one.geometry.centers(), -1, 0)
    other = OccupancyGrid(one.geometry, one.probability.copy())
    other.probability[(np.abs(x + 7.0) < 0.1) & (np.abs(y) < 6.0)] = 1.0
    one.probability[np.hypot(x - 3.0, y - 3.0) < 0.3] = 1.0
    found = align_maps(one, other)
    assert np.hypot(found.x, found.y) < 0.02
    assert abs(math.remainder(found.theta, math.tau)) < 0.005


def test_a_field_is_interpolated_between_cell_centres() -> None:
    """The oracle is a plane, which is its own interpolation; far outside counts as far."""
    geometry = GridGeometry(-1.0, 2.0, 0.5, 6, 8)
    centers = geometry.centers()
    field = 0.03 * centers[..., 0] - 0.02 * centers[..., 1]
    points = np.random.default_rng(0).uniform([-0.7, 2.3], [2.7, 4.7], (50, 2))
    found = _bilinear(field, geometry, points)
    np.testing.assert_allclose(found, 0.03 * points[:, 0] - 0.02 * points[:, 1], atol=1e-12)
    assert _bilinear(field, geometry, np.array([[-9.0, 3.0], [0.0, 9.0]])).tolist() == [0.5, 0.5]


def test_points_fill_their_cells_and_those_outside_none() -> None:
    geometry = GridGeometry(0.0, 0.0, 0.2, 3, 4)
    found = _raster(
        np.array([[0.1, 0.5], [0.7, 0.1], [0.75, 0.1], [-0.1, 0.1], [0.1, 0.7]]), geometry
    )
    assert np.argwhere(found).tolist() == [[0, 3], [2, 0]]
    assert found.max() == 1.0


def test_many_points_are_thinned_evenly() -> None:
    points = np.arange(30_000.0).reshape(-1, 2)
    assert len(_thin(points[:4_000])) == 4_000
    assert _thin(points)[:, 0].tolist() == list(np.arange(0.0, 30_000.0, 6.0))


def test_a_map_without_walls_is_refused() -> None:
    grid = room()
    blank = OccupancyGrid(grid.geometry, np.zeros_like(grid.probability))
    for pair in ((grid, blank), (blank, grid)):
        with pytest.raises(BadInput, match="without occupied cells"):
            align_maps(*pair)
