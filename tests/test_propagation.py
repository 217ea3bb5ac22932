# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Propagation models behind their seam, and walls counted along links."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slarm_graph import parts
from slarm_graph.access_points import AccessPoint
from slarm_graph.config import RunConfig
from slarm_graph.files.configs import load_config
from slarm_graph.geographic import CellState, Coverage, GeographicMap
from slarm_graph.grid import GridGeometry
from slarm_graph.radio.path_loss import path_loss_db
from slarm_graph.radio.propagation.crossings import (
    crossings_by_height,
    link_crossings,
    wall_crossings,
)
from slarm_graph.radio.propagation.links import Links
from slarm_graph.radio.propagation.over_map import links_to, make_model, predicted_radio_map
from slarm_graph.radio.radio_map import radio_map

GRID = GridGeometry(-1.0, -2.0, 0.1, 60, 80)


def brute_crossings(heights, eye, point, antenna_m):
    """Runs of blocked samples, a tenth of a cell apart, that are more than two cells apart."""
    shares = np.linspace(0.0, 1.0, 4000)
    plan = eye[:2] + shares[:, None] * (point - eye[:2])
    tops = GRID.sample(heights, plan, outside=0.0)
    blocked = tops > eye[2] + shares * (antenna_m - eye[2])
    at = np.flatnonzero(blocked)
    free_m = np.diff(at) * np.hypot(*(point - eye[:2])) / 3999
    return int(len(at) > 0) + int((free_m > 2.0 * GRID.resolution_m + 0.01).sum())


def test_crossings_are_those_of_a_finely_sampled_segment():
    rng = np.random.default_rng(0)
    heights = np.zeros(GRID.shape, dtype=np.float32)
    heights[:, 30:32], heights[20:23, 10:70], heights[45, :40] = math.inf, 1.0, 1.9
    points = rng.uniform([-0.9, -1.9], [6.9, 3.9], (200, 2))
    for eye in ([0.512, 0.337, 2.5], [5.03, 2.97, 0.2], [9.0, 1.03, 1.5]):
        counted = wall_crossings(GRID, heights, eye, points, 0.4)
        expected = [brute_crossings(heights, np.array(eye), point, 0.4) for point in points]
        # A sampled segment misses the corner of a cell that it only touches.
        assert np.mean(counted == expected) > 0.97
        assert np.abs(counted - expected).max() <= 1
        assert counted.max() >= 2


def test_thick_walls_count_once_and_low_ones_are_looked_over():
    heights = np.zeros(GRID.shape)
    heights[:, 30:40] = 1.0
    low, high = [[5.95, 0.05]], [[3.2, 0.05]]
    assert wall_crossings(GRID, heights, [0.05, 0.05, 0.5], low, 0.5)[0] == 1
    assert wall_crossings(GRID, heights, [0.05, 0.05, 4.0], low, 0.5)[0] == 0
    assert wall_crossings(GRID, heights, [0.05, 0.05, 4.0], high, 0.5)[0] == 1
    assert wall_crossings(GRID, heights, [2.25, 0.05, 0.5], low, 0.5, mount_radius_m=0.4)[0] == 1
    assert wall_crossings(GRID, heights, [2.25, 0.05, 0.5], low, 0.5, mount_radius_m=0.9)[0] == 0


def links(distance_m, crossings, clear):
    distance_m = np.array(distance_m)
    points = np.column_stack([distance_m, np.zeros_like(distance_m)])
    counts = np.array(crossings, dtype=np.int16)
    return Links(np.zeros(3), points, distance_m, np.array(clear), counts, 3.5e9, 0.0)


@pytest.mark.parametrize("name", list(parts.registered("propagation model")))
def test_every_model_answers_for_every_link(name):
    config = RunConfig()
    model = parts.make("propagation model", name, config, config.radio)
    answer = model.path_loss_db(links([2.0, 20.0, 20.0], [0, 0, 2], [True, True, False]))
    assert answer.loss_db.shape == answer.shadowing_sigma_db.shape == (3,)
    assert answer.loss_db[0] < answer.loss_db[1] <= answer.loss_db[2]
    assert (answer.shadowing_sigma_db >= 0.0).all()


def test_the_3gpp_model_is_the_standards_row():
    config = load_config(None, ["radio.scenario=InH"])
    answer = make_model(config).path_loss_db(links([5.0, 9.0], [0, 3], [True, False]))
    np.testing.assert_array_equal(
        answer.loss_db, path_loss_db([5.0, 9.0], 3.5e9, [True, False], "InH")
    )


def test_multi_wall_by_hand():
    config = load_config(
        None,
        [
            "radio.propagation=multi-wall",
            "multi-wall.exponent=3",
            "multi-wall.wall_db=7",
            "multi-wall.intercept_db=40",
        ],
    )
    answer = make_model(config).path_loss_db(links([10.0, 100.0], [0, 2], [True, False]))
    np.testing.assert_allclose(answer.loss_db, [70.0, 114.0])


def test_log_distance_by_hand():
    """Blocked links lose more and spread wider; below 0.1 m no law of distance holds."""
    config = load_config(
        None,
        [
            "radio.propagation=log-distance",
            "log-distance.exponent=3",
            "log-distance.blocked_db=8",
            "log-distance.intercept_db=40",
            "log-distance.sigma_db=2",
            "log-distance.sigma_blocked_db=5",
        ],
    )
    clear = [True, False, True, True]
    answer = make_model(config).path_loss_db(links([10.0, 100.0, 0.1, 0.01], [0] * 4, clear))
    np.testing.assert_allclose(answer.loss_db, [70.0, 108.0, 10.0, 10.0])
    np.testing.assert_array_equal(answer.shadowing_sigma_db, [2.0, 5.0, 2.0, 2.0])


@pytest.mark.parametrize("name", ["log-distance", "multi-wall"])
def test_the_first_metre_is_free_space_unless_said_otherwise(name):
    """Friis at 3.5 GHz over 1 m: a wavelength of 8.565 cm, 20 log10(4 pi / 0.08565)."""
    config = load_config(None, [f"radio.propagation={name}"])
    answer = make_model(config).path_loss_db(links([1.0, 10.0], [0, 0], [True, True]))
    np.testing.assert_allclose(answer.loss_db, [43.33, 63.33], atol=0.005)
    np.testing.assert_array_equal(answer.shadowing_sigma_db, [4.0, 4.0])


def test_a_map_moved_by_a_cell_has_the_crossings_of_a_moved_access_point():
    """The oracle moves the link the other way, on a map with room around what stands on it."""
    rng = np.random.default_rng(2)
    heights = np.zeros(GRID.shape, dtype=np.float32)
    heights[10:50, 30:32], heights[20:23, 12:66], heights[42, 10:40] = math.inf, 1.0, 1.9
    points = rng.uniform([0.1, -0.9], [5.9, 2.9], (150, 2))
    eye = np.array([0.512, 0.337, 2.5])
    found = link_crossings(GRID, heights, eye, points, 0.4, shift_cells=2)
    shifts = 0.1 * 2 * np.array([(0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)])
    for counts, shift in zip(found.counts, shifts, strict=True):
        moved = wall_crossings(GRID, heights, eye - [*shift, 0.0], points - shift, 0.4)
        np.testing.assert_array_equal(counts, moved)
    assert len({tuple(counts) for counts in found.counts}) == 5
    (alone,) = link_crossings(GRID, heights, eye, points, 0.4).counts
    np.testing.assert_array_equal(alone, found.counts[0])


def test_several_heights_in_one_walk_pass_what_each_does_alone():
    rng = np.random.default_rng(5)
    heights = np.zeros(GRID.shape, dtype=np.float32)
    heights[10:50, 30:32], heights[20:23, 12:66], heights[42, 10:40] = math.inf, 1.0, 1.9
    points = rng.uniform([0.1, -0.9], [5.9, 2.9], (150, 2))
    above_m = np.array([2.5, 0.1, 3.5, 1.2, 0.1])
    plans_m = np.array([[0.512, 0.337], [-0.2, 3.1], [5.3, 1.04]])
    found = crossings_by_height(GRID, heights, plans_m, above_m, points, 0.4, mount_radius_m=0.3)
    for plan_m, by_height in zip(plans_m, found, strict=True):
        for counts, z in zip(by_height, above_m, strict=True):
            eye = [*plan_m, z]
            alone = wall_crossings(GRID, heights, eye, points, 0.4, mount_radius_m=0.3)
            np.testing.assert_array_equal(counts, alone)
        assert len({tuple(counts) for counts in by_height}) == 3


def test_a_gap_of_two_cells_along_an_axis_is_none_wherever_it_is():
    rng = np.random.default_rng(7)
    for size, counted in ((2, 1), (3, 2)):
        heights = np.zeros(GRID.shape, dtype=np.float32)
        heights[:, [40, 41 + size]] = math.inf
        west = rng.uniform([-0.9, -1.9], [2.9, 3.9], (50, 2))
        east = np.column_stack([rng.uniform(3.5, 6.9, 50), west[:, 1]])
        for start, end in zip([*west, *east], [*east, *west], strict=True):
            assert wall_crossings(GRID, heights, [*start, 0.5], [end], 0.5)[0] == counted
            turned = GridGeometry(-2.0, -1.0, 0.1, 80, 60)
            passed = wall_crossings(turned, heights.T, [*start[::-1], 0.5], [end[::-1]], 0.5)
            assert passed[0] == counted


def test_corners_of_cells_are_passed_alike_from_all_sides():
    grid, heights = GridGeometry(0.0, 0.0, 1.0, 9, 9), np.zeros((9, 9))
    heights[4, 5] = math.inf
    for eye, end, counted in (
        ([1.0, 0.0], [9.0, 8.0], 1),
        ([9.0, 8.0], [1.0, 0.0], 1),
        ([0.0, 0.0], [9.0, 9.0], 1),
        ([9.0, 9.0], [0.0, 0.0], 0),
        ([5.0, 0.5], [5.0, 8.5], 1),
        ([5.5, 4.5], [5.5, 4.5], 1),
        ([5.5, 5.0], [5.5, 8.5], 0),
        ([5.0, 4.5], [1.5, 4.5], 0),
    ):
        assert wall_crossings(grid, heights, [*eye, 1.0], [end], 1.0)[0] == counted, (eye, end)


def test_a_link_passes_the_inside_of_an_obstacle_below_its_top():
    heights, insides = np.zeros(GRID.shape), np.zeros(GRID.shape, dtype=np.int16)
    heights[:, 20:30], heights[:, 40:50] = 1.0, math.inf
    insides[:, 22:28], insides[:, 42:48] = 1, 2
    for eye_m, through in ((0.5, [True, True]), (8.0, [False, True])):
        eye = [0.05, 0.05, eye_m]
        found = link_crossings(
            GRID, heights, eye, [[5.95, 0.05], [1.05, 0.05]], 0.5, insides=insides
        )
        assert found.through[0].tolist() == through
    assert link_crossings(GRID, heights, eye, [[5.95, 0.05]], 0.5).through.shape == (1, 0)


def test_radio_map_by_another_model():
    states = np.full((30, 40), CellState.ACCESSIBLE, dtype=np.uint8)
    states[:, 20] = CellState.OBSTACLE
    heights = np.where(states == CellState.OBSTACLE, np.inf, 0.0).astype(np.float32)
    nothing = np.zeros(states.shape, dtype=bool)
    grid = GridGeometry(0.0, 0.0, 0.1, 30, 40)
    flat = GeographicMap(grid, states, heights, "infinite", Coverage(nothing, nothing, nothing))
    ap = AccessPoint("ap", 1.05, 1.55, 2.5)
    plain = predicted_radio_map(flat, [ap], RunConfig())
    np.testing.assert_array_equal(
        plain.path_loss_db, radio_map(flat, [ap], RunConfig().radio).path_loss_db
    )
    config = load_config(None, ["radio.propagation=multi-wall", "multi-wall.wall_db=9"])
    walls = predicted_radio_map(flat, [ap], config)
    np.testing.assert_array_equal(np.isnan(walls.path_loss_db), np.isnan(plain.path_loss_db))
    point = np.array([[3.05, 1.55]])
    link = links_to(grid, heights, ap, point, antenna_height_m=0.5, mount_radius_m=0.25)
    assert link.crossings[0] == 1
    loss = make_model(config).path_loss_db(link).loss_db[0]
    assert walls.path_loss_db[0, 15, 30] == pytest.approx(loss, abs=1e-4)
    assert loss == pytest.approx(43.33 + 20.0 * math.log10(math.hypot(2.0, 2.0)) + 9.0, abs=0.02)
