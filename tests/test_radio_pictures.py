# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of radio maps: what is where on them, and what they say."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.text import Annotation

from slarm_graph.access_points import AccessPoint, RadioMap
from slarm_graph.grid import GridGeometry
from slarm_graph.radio.measured.measured_map import MeasuredMap
from slarm_graph.radio.measured.pictures import measured_figure, write_measured_png
from slarm_graph.radio.pictures import _at_most, radio_figure


def radio_of(
    geometry: GridGeometry, *access_points: AccessPoint, border: int = 0, seed: int = 0
) -> RadioMap:
    """Values everywhere but in a border of so many cells."""
    rng = np.random.default_rng(seed)
    loss_db = np.full((len(access_points), *geometry.shape), np.nan, dtype=np.float32)
    inside = slice(border, geometry.rows - border), slice(border, geometry.cols - border)
    loss_db[:, *inside] = rng.uniform(50, 90, loss_db[:, *inside].shape)
    return RadioMap(
        geometry, access_points, loss_db, np.ones(loss_db.shape, dtype=np.bool_), 0.4, "InF-SH",
        9.0, "default", expansion_radius_m=0.25,
    )  # fmt: skip


def panels_of(figure: Figure) -> list[Axes]:
    """Axes with a map, without the colour bars."""
    return [axes for axes in figure.axes if axes.get_xlabel() == "x [m]"]


SMALL = GridGeometry(-1.0, 2.0, 0.5, 12, 20)
AP = AccessPoint("north", 3.0, 7.0, 2.5)


def test_a_map_is_shown_as_far_as_it_has_values() -> None:
    """With a margin of a twenty-fifth of the longer side, a metre as long up as across."""
    (axes,) = panels_of(radio_figure(radio_of(SMALL, AP, border=2)))
    margin = 0.04 * 8.0
    assert axes.get_xlim() == pytest.approx((0.0 - margin, 8.0 + margin))
    assert axes.get_ylim() == pytest.approx((3.0 - margin, 7.0 + margin))
    assert axes.get_aspect() == 1.0
    blank = radio_of(SMALL, AP, border=6)
    (axes,) = panels_of(radio_figure(blank))
    assert (*axes.get_xlim(), *axes.get_ylim()) == pytest.approx(SMALL.extent_m)


@pytest.mark.parametrize(
    ("rows", "cols", "tall_in"),
    [(20, 20, 4.9), (10, 20, 4.9 * (10 + 1.6) / (20 + 1.6)), (2, 60, 2.0), (60, 10, 9.0)],
)
def test_a_panel_is_as_tall_as_its_map_within_bounds(rows: int, cols: int, tall_in: float) -> None:
    radio = radio_of(GridGeometry(0.0, 0.0, 0.5, rows, cols), AP, replace(AP, name="south"))
    assert radio_figure(radio).get_size_inches() == pytest.approx([7.0, 3 * (tall_in + 0.7)])


def test_every_access_point_has_a_panel_and_several_have_a_best() -> None:
    one, other = AP, AccessPoint("a_$x$", 1.0, 3.0, 2.5, power_dbm=25.0, frequency_hz=2.4e9)
    radio = radio_of(SMALL, one, other)
    radio.path_loss_db[:, 3, 4] = np.nan
    panels = panels_of(radio_figure(radio))
    titles = [axes.get_title() for axes in panels]
    assert titles[0].startswith("north: InF-SH, 3.5 GHz, antenna at 0.4 m\n")
    assert titles[1].startswith("a_$x$: InF-SH, 2.4 GHz, antenna at 0.4 m\n")
    assert titles[1].endswith("obstacle heights: default; Rician factor 9 dB, R_e 0.25 m")
    assert titles[2] == "best server"
    for index, axes in enumerate(panels[:2]):
        (image,) = axes.images
        np.testing.assert_array_equal(
            image.get_array().filled(np.nan), radio.channel_power_gain_db[index]
        )
        assert image.get_clim() == pytest.approx(radio.gain_span_db())
        assert tuple(image.get_extent()) == SMALL.extent_m
        assert image.origin == "lower"
    (best,) = panels[2].images
    np.testing.assert_array_equal(best.get_array().filled(-1), radio.best_access_point)
    assert best.get_array().mask.sum() == 1
    assert best.get_clim() == (-0.5, 1.5)
    assert [axes.get_ylabel() for axes in panels] == ["y [m]"] * 3
    assert len(panels_of(radio_figure(radio_of(SMALL, one)))) == 1


def names_on(axes: Axes) -> list[Annotation]:
    return [text for text in axes.texts if isinstance(text, Annotation)]


def test_an_access_point_is_a_star_with_its_name_as_it_is_written() -> None:
    """Beside the star on the side away from the scale; one far outside is left out."""
    points = (
        AccessPoint("high_$1$", 3.0, 7.0, 2.5),
        AccessPoint("low", 1.0, 2.5, 2.5),
        AccessPoint("outside", 30.0, 4.0, 2.5),
    )
    figure = radio_figure(radio_of(SMALL, *points))
    *own, best = panels_of(figure)
    assert [[name.get_text() for name in names_on(axes)] for axes in own] == [
        ["high_$1$"], ["low"], []
    ]  # fmt: skip
    assert [name.get_text() for name in names_on(best)] == ["high_$1$", "low"]
    for name, y_points, side in zip(names_on(best), (-9.0, 9.0), ("top", "bottom"), strict=True):
        assert name.xyann == (0.0, y_points)
        assert name.get_va() == side
        assert name.get_ha() == "center"
    stars = [line.get_xydata().tolist() for line in best.lines]
    assert stars == [[[3.0, 7.0]], [[1.0, 2.5]]]
    every = [text for axes in figure.axes for text in (*names_on(axes), axes.title)]
    every += [label for axes in figure.axes for label in axes.get_yticklabels()]
    assert not any(text.get_parse_math() for text in every if "$" in text.get_text())


@pytest.mark.parametrize("wide_m", [0.9, 4.7, 10.1, 24.0, 51.0, 300.0])
def test_the_scale_is_the_longest_round_length_of_a_fifth_of_the_width(wide_m: float) -> None:
    radio = radio_of(GridGeometry(7.0, -3.0, wide_m / 20, 12, 20), AP)
    (axes,) = panels_of(radio_figure(radio))
    (x_min, x_max), (y_min, y_max) = axes.get_xlim(), axes.get_ylim()
    (bar,) = [patch for patch in axes.patches if isinstance(patch, Rectangle)]
    rounds_m = [n * 10.0**k for k in range(-3, 4) for n in (1, 2, 5)]
    expected_m = max(m for m in rounds_m if m <= 0.2 * (x_max - x_min))
    assert bar.get_width() == pytest.approx(expected_m)
    (label,) = [text for text in axes.texts if not isinstance(text, Annotation)]
    assert label.get_text() == f"{expected_m:g} m"
    assert label.get_position()[0] == pytest.approx(bar.get_x() + expected_m / 2)
    assert x_min < bar.get_x() < bar.get_x() + bar.get_width() < x_max
    top = bar.get_y() + bar.get_height()
    assert y_min < bar.get_y() < top < label.get_position()[1] < y_min + 0.1 * (y_max - y_min)


def test_a_large_map_is_drawn_from_every_so_many_th_cell() -> None:
    radio = radio_of(GridGeometry(-1.0, 2.0, 0.1, 40, 61), AP)
    found = _at_most(300, radio)
    assert found.geometry == GridGeometry(-1.0, 2.0, 0.1 * 3, 14, 21)
    np.testing.assert_array_equal(found.path_loss_db, radio.path_loss_db[:, ::3, ::3])
    np.testing.assert_array_equal(found.line_of_sight, radio.line_of_sight[:, ::3, ::3])
    assert _at_most(40 * 61, radio) is radio
    assert _at_most(40 * 61 - 1, radio).geometry.shape == (20, 31)


def measured_of(geometry: GridGeometry, border: int, *access_points: AccessPoint) -> MeasuredMap:
    level = radio_of(geometry, *access_points, border=border).path_loss_db
    return MeasuredMap(
        geometry, access_points, mean_dbm=-level, mean_sd_db=level / 10, reading_sd_db=level / 5,
        fitted=(), antenna_height_m=0.4,
    )  # fmt: skip


def test_a_measured_map_shows_whole_cells_of_level_and_doubt_beside_each_other() -> None:
    lost = AccessPoint("lost", np.nan, np.nan, np.nan)
    figure = measured_figure(measured_of(SMALL, 2, AP, lost))
    panels = panels_of(figure)
    assert [axes.get_title() for axes in panels] == ["north", "north", "lost", "lost"]
    measured = measured_of(SMALL, 2, AP, lost)
    for k, axes in enumerate(panels):
        assert axes.get_xlim() == pytest.approx((0.0, 8.0))
        assert axes.get_ylim() == pytest.approx((3.0, 7.0))
        (image,) = axes.images
        layer = (measured.mean_dbm, measured.mean_sd_db)[k % 2][k // 2]
        np.testing.assert_array_equal(image.get_array().filled(np.nan), layer)
        assert tuple(image.get_extent()) == SMALL.extent_m
        assert image.origin == "lower"
    bars = [axes.get_ylabel() for axes in figure.axes if axes not in panels]
    assert bars == ["expected level [dBm]", "its standard deviation [dB]"] * 2
    stars = [[line.get_xydata().tolist() for line in axes.lines] for axes in panels]
    assert stars == [[[[3.0, 7.0]]], [], [], []]
    width_in, height_in = figure.get_size_inches()
    assert (width_in, height_in) == pytest.approx((9.0, 2 * (0.42 * 9.0 * 4.0 / 8.0 + 0.6)))


def test_a_measured_map_of_one_cell_and_any_name_is_drawn(tmp_path: Path) -> None:
    odd = replace(AP, name=r"$\frac$")
    write_measured_png(tmp_path / "m.png", measured_of(GridGeometry(0.0, 0.0, 0.5, 3, 3), 1, odd))
    assert (tmp_path / "m.png").stat().st_size > 2_000
