# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Places for one more access point, against whole radio maps of every place."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from slarm_graph.access_points import AccessPoint
from slarm_graph.config import RunConfig
from slarm_graph.errors import BadInput
from slarm_graph.geographic import CellState, Coverage, GeographicMap
from slarm_graph.grid import GridGeometry
from slarm_graph.radio.connectivity import candidate_sites
from slarm_graph.radio.connectivity.candidate_sites import candidate_sites_m, rank_sites
from slarm_graph.radio.connectivity.coverage import connections
from slarm_graph.radio.connectivity.signal import SignalMap
from slarm_graph.radio.propagation.over_map import make_model, predicted_radio_map

GRID = GridGeometry(0.0, 0.0, 0.1, 42, 82)
CONFIG = RunConfig.model_validate({"radio": {"propagation": "multi-wall", "power_dbm": -10.0}})
AP = AccessPoint("here", 0.65, 0.65, 2.4, -10.0, CONFIG.radio.frequency_hz)
THRESHOLD_DBM = -63.0


def two_rooms():
    """A wall all around and one between two rooms."""
    states = np.full(GRID.shape, CellState.ACCESSIBLE, dtype=np.uint8)
    states[[0, -1]] = states[:, [0, 40, -1]] = CellState.OBSTACLE
    heights = np.where(states == CellState.OBSTACLE, np.inf, 0.0).astype(np.float32)
    nothing = np.zeros(GRID.shape, dtype=bool)
    return GeographicMap(GRID, states, heights, "infinite", Coverage(nothing, nothing, nothing))


def ranked(geographic, threshold_dbm=THRESHOLD_DBM):
    signal = SignalMap.of_prediction(predicted_radio_map(geographic, [AP], CONFIG))
    asked = {"height_m": 2.4, "threshold_dbm": threshold_dbm}
    return rank_sites(geographic, signal, make_model(CONFIG), CONFIG.radio, **asked)


def test_the_ranking_is_that_of_whole_radio_maps_with_the_new_one():
    geographic = two_rooms()
    places = ranked(geographic)
    alone = _connected_m2(geographic, [AP])
    gained = {
        (x, y): _connected_m2(
            geographic, [AP, AccessPoint("new", x, y, 2.4, -10.0, AP.frequency_hz)]
        )
        - alone
        for x, y in candidate_sites_m(geographic)[::3].tolist()
    }
    by_place = {(p.x_m, p.y_m): p for p in places}
    floor_m2 = geographic.accessible.sum() * 0.01
    for site, expected in gained.items():
        assert by_place[site].gained_m2 == pytest.approx(expected)
        assert by_place[site].share == pytest.approx((alone + expected) / floor_m2)
    assert [p.gained_m2 for p in places] == sorted((p.gained_m2 for p in places), reverse=True)
    assert places[0].gained_m2 >= max(gained.values()) > 2.0 * np.median(list(gained.values()))
    assert places[0].x_m > 4.0  # in or at the room that has none


def _connected_m2(geographic, points):
    radio = predicted_radio_map(geographic, points, CONFIG)
    return connections(SignalMap.of_prediction(radio), THRESHOLD_DBM)[-1].area_m2


def test_every_square_of_wall_beside_the_floor_has_a_place_on_it():
    geographic = two_rooms()
    places = candidate_sites_m(geographic, 0.5)
    rows, cols = GRID.cell_of(places).T
    assert (geographic.states[rows, cols] == CellState.OBSTACLE).all()
    squares = {tuple(square) for square in np.floor(places / 0.5).astype(int).tolist()}
    assert len(squares) == len(places)
    for row, col in np.argwhere(geographic.obstacle):
        beside = [(row + 1, col), (row - 1, col), (row, col + 1), (row, col - 1)]
        inside = [(r, c) for r, c in beside if 0 <= r < 42 and 0 <= c < 82]
        touches = any(geographic.accessible[cell] for cell in inside)
        square = np.floor(GRID.center_of([row, col]) / 0.5).astype(int).tolist()
        assert not touches or tuple(square) in squares


def test_large_floors_are_judged_on_a_sample(monkeypatch):
    geographic = two_rooms()
    whole = {(p.x_m, p.y_m): p.gained_m2 for p in ranked(geographic)}
    monkeypatch.setattr(candidate_sites, "_MOST_CELLS", 300)
    for site in ranked(geographic):
        assert site.gained_m2 == pytest.approx(whole[site.x_m, site.y_m], abs=1.0)


def test_nothing_to_gain_and_no_wall():
    geographic = two_rooms()
    assert {p.gained_m2 for p in ranked(geographic, -200.0)} == {0.0}
    bare = np.full(GRID.shape, CellState.ACCESSIBLE, dtype=np.uint8)
    with pytest.raises(BadInput, match="no wall"):
        ranked(replace(geographic, states=bare, heights_m=np.zeros(GRID.shape, np.float32)))
