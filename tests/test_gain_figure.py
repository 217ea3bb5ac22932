# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Interactive figures of radio maps: every layer has its values, at its cells, in its colours."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import plotly.graph_objects as go
import pytest
from test_radio_pictures import measured_of, radio_of

from slarm_graph.access_points import AccessPoint, RadioMap
from slarm_graph.eval.gain_figure import _shown_cells, gain_curves, gain_figure, measured_figure
from slarm_graph.eval.page import COLORS
from slarm_graph.grid import GridGeometry

SHOWN_CELLS = GridGeometry(-1.0, 2.0, 0.5, 7, 9)
HUT = AccessPoint("hut", 3.0, 4.0, 2.5)
TOWER = AccessPoint("tower", 0.0, 3.0, 12.0, power_dbm=26.0)


def two_signals() -> RadioMap:
    """Cells that both, one and none reach, within a border that none does."""
    radio = radio_of(SHOWN_CELLS, HUT, TOWER, replace(HUT, name="shed", x_m=1.0), border=1, seed=4)
    radio.path_loss_db[:, 2, 3] = np.nan
    radio.path_loss_db[0, 3, 3] = np.nan
    radio.line_of_sight[...] = np.random.default_rng(1).random(radio.line_of_sight.shape) < 0.5
    return radio


def color_of(layer: go.Heatmap, code: int) -> str:
    """The colour of a whole number on a scale of steps: that of the step that it lies in."""
    at = (code - layer.zmin) / (layer.zmax - layer.zmin)
    low = [color for place, color in layer.colorscale if place <= at]
    high = [color for place, color in layer.colorscale if place >= at]
    assert low[-1] == high[0], "amid a step"
    return str(high[0])


WITH_VALUES = slice(1, 6), slice(1, 8)


def test_layers_are_the_gains_the_sights_and_the_best_of_the_cells_with_values() -> None:
    radio = two_signals()
    *layers, stars = gain_figure(radio).content.data
    least, most = -np.nanmax(radio.path_loss_db), -np.nanmin(radio.path_loss_db)
    for layer in layers:
        np.testing.assert_allclose(layer.x, np.arange(-0.25, 3.0, 0.5))
        np.testing.assert_allclose(layer.y, np.arange(2.75, 5.0, 0.5))
    gains, sights, best = layers[:3], layers[3:6], layers[6]
    for index, (gain, sight) in enumerate(zip(gains, sights, strict=True)):
        loss_db = radio.path_loss_db[index, *WITH_VALUES]
        clear = radio.line_of_sight[index, *WITH_VALUES]
        np.testing.assert_allclose(gain.z, -loss_db, atol=0.006)
        np.testing.assert_array_equal(gain.customdata, clear)
        assert (gain.zmin, gain.zmax) == pytest.approx((least, most))
        np.testing.assert_array_equal(sight.z, np.where(np.isnan(loss_db), 2, clear))
        assert dict(zip(sight.colorbar.ticktext, sight.colorbar.tickvals, strict=True)) == {
            "blocked": 0, "clear": 1
        }  # fmt: skip
        assert [color_of(sight, k) for k in range(3)] == [COLORS[5], COLORS[4], "rgba(0,0,0,0)"]
    np.testing.assert_array_equal(
        best.z, np.where(radio.best_access_point < 0, 3, radio.best_access_point)[WITH_VALUES]
    )
    rss_dbm = np.where(np.isnan(radio.rss_dbm), -np.inf, radio.rss_dbm).max(axis=0)[WITH_VALUES]
    np.testing.assert_allclose(best.customdata, np.where(np.isinf(rss_dbm), np.nan, rss_dbm),
                               atol=0.06)  # fmt: skip
    assert [color_of(best, k) for k in range(4)] == [*COLORS[:3], "rgba(0,0,0,0)"]
    assert list(best.colorbar.ticktext) == ["hut", "tower", "shed"]
    assert list(best.colorbar.tickvals) == [0, 1, 2]
    assert list(zip(stars.x, stars.y, stars.customdata, strict=True)) == [
        (3.0, 4.0, "hut, 2.5 m high"),
        (0.0, 3.0, "tower, 12 m high"),
        (1.0, 4.0, "shed, 2.5 m high"),
    ]


def test_one_layer_is_shown_at_a_time_and_the_access_points_always() -> None:
    for radio in (two_signals(), radio_of(SHOWN_CELLS, HUT)):
        fig = gain_figure(radio).content
        names = [ap.name for ap in radio.access_points]
        expected = [f"{name}: {what}" for what in ("gain", "line of sight") for name in names]
        expected += ["best access point"] * (len(names) > 1)
        (menu,) = fig.layout.updatemenus
        assert [button.label for button in menu.buttons] == expected
        for index, button in enumerate(menu.buttons):
            shown = button.args[0]["visible"]
            assert len(shown) == len(fig.data)
            assert [k for k, one in enumerate(shown) if one] == [index, len(shown) - 1]
        assert [trace.visible for trace in fig.data] == [
            True, *[False] * (len(expected) - 1), None
        ]  # fmt: skip
        assert fig.layout.showlegend is False


@pytest.mark.parametrize(("most", "step"), [(105, 1), (104, 2), (27, 2), (26, 3), (3, 6)])
def test_where_there_are_too_many_cells_every_so_many_th_is_shown(most: int, step: int) -> None:
    """Of three layers of 5 by 7 cells; a value is shown at its own cell's centre."""
    radio = two_signals()
    rows, cols, x, y = _shown_cells(SHOWN_CELLS, radio.path_loss_db, most, radio.where)
    assert (rows, cols) == (slice(1, 6, step), slice(1, 8, step))
    centers = SHOWN_CELLS.center_of(np.argwhere(np.ones(SHOWN_CELLS.shape, dtype=np.bool_)))
    places = centers.reshape(*SHOWN_CELLS.shape, 2)[rows, cols]
    np.testing.assert_allclose(places, np.stack(np.meshgrid(x, y), axis=-1))


def test_a_curve_tells_the_share_of_cells_with_so_much_gain_or_less() -> None:
    radio = two_signals()
    radio.path_loss_db[2] = np.nan
    found = gain_curves(radio)
    assert [curve.name for curve in found.content.data] == ["hut", "tower"]
    for index, curve in enumerate(found.content.data):
        gain_db = -radio.path_loss_db[index]
        gain_db = np.sort(gain_db[np.isfinite(gain_db)])
        assert (curve.x[0], curve.x[-1]) == (gain_db[0], gain_db[-1])
        assert (curve.y[0], curve.y[-1]) == (0.0, 1.0)
        below = np.searchsorted(gain_db, curve.x, side="right") / len(gain_db)
        assert np.abs(below - curve.y).max() <= 1.0 / len(gain_db) + 1e-6
        assert curve.showlegend
    assert len({curve.line.dash for curve in found.content.data}) == 2
    assert "gain [dB]" in found.content.layout.xaxis.title.text


def test_a_measured_map_is_shown_with_its_standard_deviation() -> None:
    measured = measured_of(SHOWN_CELLS, 1, HUT, TOWER)
    fig = measured_figure(measured).content
    for index, layer in enumerate(fig.data):
        np.testing.assert_allclose(layer.x, np.arange(-0.25, 3.0, 0.5))
        np.testing.assert_allclose(layer.y, np.arange(2.75, 5.0, 0.5))
        np.testing.assert_allclose(layer.z, measured.mean_dbm[index, *WITH_VALUES], atol=0.06)
        np.testing.assert_allclose(
            layer.customdata, measured.mean_sd_db[index, *WITH_VALUES], atol=0.06
        )
    assert [layer.visible for layer in fig.data] == [True, False]
    buttons = fig.layout.updatemenus[0].buttons
    assert [button.args[0]["visible"] for button in buttons] == [[True, False], [False, True]]
    assert [button.label for button in buttons] == ["hut", "tower"]
