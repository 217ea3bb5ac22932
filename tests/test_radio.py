# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The radio stage: gain per cell, several access points, fading."""

from __future__ import annotations

import logging
import math

import numpy as np
import pytest

from slarm_graph.access_points import AccessPoint, RadioMap
from slarm_graph.config import RadioConfig
from slarm_graph.errors import BadInput
from slarm_graph.files.worlds import load_world
from slarm_graph.geographic import CellState, Coverage, GeographicMap
from slarm_graph.grid import GridGeometry
from slarm_graph.radio.fading import channel_coefficients, faded_gain_db, fading_maps
from slarm_graph.radio.path_loss import path_loss_db
from slarm_graph.radio.radio_map import radio_map, radio_notices, theoretical_radio_map
from slarm_graph.world import Solid

CONFIG = RadioConfig()


def geographic(states, heights=None, resolution=0.1):
    grid = GridGeometry(0.0, 0.0, resolution, *states.shape)
    nothing = np.zeros(states.shape, dtype=bool)
    tops = np.where(states == CellState.OBSTACLE, math.inf, 0.0) if heights is None else heights
    layers = Coverage(nothing, nothing, nothing)
    return GeographicMap(grid, states.astype(np.uint8), tops.astype(np.float32), "default", layers)


def test_one_cell_by_hand():
    """A 3D distance, not the one in plan, goes into the formula."""
    states = np.full((40, 50), CellState.ACCESSIBLE)
    ap = AccessPoint("ap", 0.05, 0.05, 2.5)
    radio = radio_map(geographic(states), [ap], CONFIG)
    distance_m = math.sqrt(4.0**2 + 3.0**2 + 2.0**2)
    expected = 31.84 + 21.5 * math.log10(distance_m) + 19.0 * math.log10(3.5)
    assert radio.line_of_sight.all()
    assert radio.path_loss_db[0, 30, 40] == pytest.approx(expected, abs=1e-4)
    assert radio.channel_power_gain_db[0, 30, 40] == -radio.path_loss_db[0, 30, 40]


def test_gain_exists_exactly_where_the_robot_can_get():
    rng = np.random.default_rng(0)
    states = rng.integers(0, 5, (20, 30))
    radio = radio_map(geographic(states), [AccessPoint("ap", 1.0, 1.0, 2.5)], CONFIG)
    blocked = ~np.isin(states, (CellState.ACCESSIBLE, CellState.EXPANSION))
    np.testing.assert_array_equal(np.isnan(radio.path_loss_db[0]), blocked)
    assert not radio.line_of_sight[0][blocked].any()


def test_wall_makes_links_blocked_and_lossier():
    states = np.full((30, 40), CellState.ACCESSIBLE)
    states[:, 20] = CellState.OBSTACLE
    radio = radio_map(geographic(states), [AccessPoint("ap", 1.05, 1.55, 2.5)], CONFIG)
    assert radio.line_of_sight[0, :, :20].all()
    assert not radio.line_of_sight[0, :, 21:].any()
    rise_m = 2.5 - CONFIG.antenna_height_m
    blocked_db = path_loss_db(math.hypot(2.0, rise_m), 3.5e9, False, "InF-SH")
    assert radio.path_loss_db[0, 15, 30] == pytest.approx(float(blocked_db), abs=1e-4)


def test_strongest_access_point_serves():
    states = np.full((10, 60), CellState.ACCESSIBLE)
    states[:, :2] = CellState.OBSTACLE
    points = [AccessPoint("west", 0.5, 0.5, 2.5), AccessPoint("east", 5.5, 0.5, 2.5)]
    radio = radio_map(geographic(states), points, CONFIG)
    best = radio.best_access_point
    assert (best[:, :2] == -1).all()
    assert (best[:, 3:29] == 0).all()
    assert (best[:, 31:] == 1).all()
    louder = [points[0], AccessPoint("east", 5.5, 0.5, 2.5, power_dbm=60.0)]
    assert (radio_map(geographic(states), louder, CONFIG).best_access_point[:, 3:] == 1).all()


def test_access_point_outside_is_warned_about_and_computed(caplog):
    states = np.full((10, 10), CellState.ACCESSIBLE)
    with caplog.at_level(logging.WARNING):
        radio = radio_map(geographic(states), [AccessPoint("far", 9.0, 0.5, 2.5)], CONFIG)
    assert "far at (9, 0.5) m lies outside the map" in caplog.text
    assert np.isfinite(radio.path_loss_db).all()


def test_cells_beyond_the_scenario_are_told():
    geometry = GridGeometry(0.0, 0.0, 1.0, 1, 700)
    notices = radio_notices(geometry, [AccessPoint("ap", 0.0, 0.0, 2.5)], CONFIG)
    assert len(notices) == 1
    assert "1 to 600 m" in notices[0]


def test_needs_an_access_point():
    with pytest.raises(BadInput, match="--ap"):
        radio_map(geographic(np.ones((3, 3))), [], CONFIG)


def test_the_papers_room():
    """Its open ring and the share of it in sight; both worked out apart from this code."""
    world = load_world("paper_room")
    geometry = GridGeometry.covering(*world.extent_m(), 0.05)
    radio = theoretical_radio_map(world, geometry, CONFIG)
    free = np.isfinite(radio.path_loss_db[0])
    wall_and_boxes = 2 * 0.5 * (7.0 + 2.5) + 3 * 1.3
    assert free.sum() * 0.05**2 == pytest.approx(70.0 - wall_and_boxes, abs=0.05)
    x, y = np.moveaxis(geometry.centers(), -1, 0)
    ring = free & ((np.abs(x) > 3.5) | (np.abs(y) > 1.75))
    assert 0.28 < radio.line_of_sight[0][ring].mean() < 0.38
    assert radio.height_source == "truth"
    # The AP looks straight down the north corridor, and never into the south one.
    assert radio.line_of_sight[0][ring & (y > 1.8) & (np.abs(x) < 1.5)].all()
    assert not radio.line_of_sight[0][ring & (y < -1.8) & (np.abs(x) < 3.0) & (y > -3.0)].any()


def test_fading_converges_to_the_expected_gain():
    rng = np.random.default_rng(3)
    loss_db, clear = np.array([60.0, 75.0]), np.array([True, False])
    for factor_db in (-3.0, 7.0):
        h = channel_coefficients(loss_db, clear, factor_db, rng, realisations=200_000)
        mean_power = np.mean(np.abs(h) ** 2, axis=0)
        np.testing.assert_allclose(mean_power, 10.0 ** (-0.1 * loss_db), rtol=0.015)


def test_realisations_of_a_map_average_to_the_expected_gain():
    """Clear, blocked and half-likely links; outage where the power falls below the threshold."""
    loss_db = np.array([[[60.0, 75.0, 70.0, np.nan]]], dtype=np.float32)
    radio = RadioMap(
        GridGeometry(0.0, 0.0, 0.5, 1, 4),
        (AccessPoint("ap", 0.0, 0.0, 2.0, power_dbm=10.0),),
        loss_db,
        np.array([[[True, False, False, False]]]),
        0.5,
        "InF-SH",
        7.0,
        "prior",
        los_probability=np.array([[[1.0, 0.0, 0.5, 0.0]]], dtype=np.float32),
    )
    maps = fading_maps(radio, 40_000, np.random.default_rng(5), threshold_dbm=-65.0)
    assert maps.gain_db.shape == (40_000, 1, 1, 4)
    mean = np.mean(10.0 ** (0.1 * maps.gain_db.astype(np.float64)), axis=0)
    np.testing.assert_allclose(mean[0, 0, :3], 10.0 ** (-0.1 * loss_db[0, 0, :3]), rtol=0.03)
    assert np.isnan(maps.outage_probability[0, 0, 3])
    # Rayleigh: P(power < its mean) = 1 - 1 / e; the clear link is 15 dB above.
    np.testing.assert_allclose(maps.outage_probability[0, 0, 1], 1.0 - np.exp(-1.0), atol=0.01)
    assert maps.outage_probability[0, 0, 0] < 0.01
    with pytest.raises(BadInput, match="realisations"):
        fading_maps(radio, 10**9, np.random.default_rng(5))


def test_rician_factor_narrows_clear_links_only():
    rng = np.random.default_rng(4)
    h = channel_coefficients([60.0, 60.0], [True, False], 7.0, rng, realisations=50_000)
    power = np.abs(h) ** 2 * 1e6
    factor = 10.0**0.7
    np.testing.assert_allclose(
        power.var(axis=0), [(1 + 2 * factor) / (1 + factor) ** 2, 1.0], rtol=0.05
    )
    assert faded_gain_db(h).shape == (50_000, 2)


def test_expected_gain_does_not_know_the_rician_factor():
    states = np.full((5, 5), CellState.ACCESSIBLE)
    ap = [AccessPoint("ap", 0.0, 0.0, 2.5)]
    low = radio_map(geographic(states), ap, RadioConfig(rician_factor_db=0.0))
    high = radio_map(geographic(states), ap, RadioConfig(rician_factor_db=20.0))
    np.testing.assert_array_equal(low.path_loss_db, high.path_loss_db)


@pytest.mark.parametrize("depth_m", [0.01, 0.04, 0.08])
@pytest.mark.parametrize("last_center_m", [2.45, 2.52])
def test_an_access_point_swallowed_by_a_recovered_wall_serves_its_room(
    depth_m: float, last_center_m: float
) -> None:
    """However deep in, or behind, the thin wall it hangs on, it sees the room before it.

    The centre of the last free cell may lie before the wall or in it.
    """
    geometry = GridGeometry(-2.0, last_center_m - 2.45, 0.1, 30, 40)
    corners = np.array([[-2.0, 2.5], [2.0, 2.5], [2.0, 2.55], [-2.0, 2.55]])
    free = geometry.centers()[..., 1] < last_center_m + 0.01
    states = np.where(free, CellState.ACCESSIBLE, CellState.OBSTACLE).astype(np.uint8)
    geographic = GeographicMap(
        geometry=geometry,
        states=states,
        heights_m=np.where(free, 0.0, np.inf).astype(np.float32),
        height_source="infinite",
        coverage=Coverage(free, free, free),
        solids=(Solid("wall", corners, math.inf),),
    )
    radio = radio_map(geographic, [AccessPoint("a", 0.0, 2.5 + depth_m, 2.4)], RadioConfig())
    assert radio.line_of_sight[0][free].all()
