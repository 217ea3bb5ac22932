# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Figures of radio maps: gain with its unit, colour bar, scale bar and access points."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.patheffects import withStroke

from slarm_graph.access_points import AccessPoint, RadioMap
from slarm_graph.grid import GridGeometry
from slarm_graph.raster.bands import every_so_many

_DPI = 130
"""Of pictures on a screen: with the width 910 pixels across."""
_WIDTH_IN = 7.0
"""Width of a page's text [in]."""
_PIXELS = 1_200_000
"""Cells drawn at the most: one to each of the picture's pixels (900 across, 1200 up). matplotlib
needs some 60 bytes for a cell, so that four times as many are 200 MB more."""
_CELLS: Final[dict[str, Any]] = {"interpolation": "nearest", "interpolation_stage": "data"}
"""Values are brought to pixels before they become colours: the same picture of cells, in a third of
the memory (colours are four numbers of 8 bytes to a pixel)."""
_GROUND = "#d9d9d9"
_SERVERS = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00", "#f0e442", "#000000")
"""Okabe and Ito's colours, which colour-blind people can tell apart."""


def write_radio_png(path: Path, radio: RadioMap) -> None:
    """Write the expected gain of every access point, one below the other, and the best server."""
    figure = radio_figure(_at_most(_PIXELS, radio))
    figure.savefig(path, dpi=_DPI, format="png", metadata={"Software": "slarm-graph"})


def _at_most(cells: int, radio: RadioMap) -> RadioMap:
    """Subsample rows and columns to at most so many cells."""
    g = radio.geometry
    step = math.ceil(math.sqrt(g.rows * g.cols / cells))
    if step <= 1:
        return radio
    loss_db = np.stack(
        [every_so_many(layer, radio.where, step, math.nan) for layer in radio.path_loss_db]
    )
    side_m, shape = g.resolution_m * step, loss_db.shape[1:]
    return replace(
        radio,
        geometry=GridGeometry(g.origin_x_m, g.origin_y_m, side_m, *shape),
        path_loss_db=loss_db,
        line_of_sight=radio.line_of_sight[:, ::step, ::step],
        los_probability=None,
        los_unknown=None,
        tiles=None,
    )


def radio_figure(radio: RadioMap) -> Figure:
    """Draw the expected gain per access point, and which is strongest where there are several."""
    count = len(radio.access_points)
    x_min, x_max, y_min, y_max = _extent_of_values(radio)
    tall_in = min(max(0.7 * _WIDTH_IN * (y_max - y_min) / (x_max - x_min), 2.0), 9.0)
    panels = count + (count > 1)
    figure = Figure(figsize=(_WIDTH_IN, panels * (tall_in + 0.7)), layout="constrained")
    FigureCanvasAgg(figure)
    all_axes = figure.subplots(panels, 1, squeeze=False)[:, 0]
    for index in range(count):
        draw_gain(all_axes[index], radio, index, limits_db=radio.gain_span_db())
    if count > 1:
        draw_best_access_point(all_axes[-1], radio)
    for axes in all_axes:
        axes.set_xlim(x_min, x_max)
        axes.set_ylim(y_min, y_max)
        _draw_scale_bar(axes, x_min, x_max, y_min)
    return figure


def draw_gain(
    axes: Axes, radio: RadioMap, index: int, *, limits_db: tuple[float, float] | None = None
) -> None:
    """Draw the expected channel power gain of one access point into axes, with a colour bar.

    Parameters
    ----------
    axes : matplotlib Axes
    radio : RadioMap
    index : int
        Which access point.
    limits_db : (float, float), optional
        Ends of the colour scale, so that pictures can be compared [dB].
    """
    gain_db = radio.channel_power_gain_db[index]
    low, high = limits_db or (None, None)
    axes.set_facecolor(_GROUND)
    image = axes.imshow(
        np.ma.masked_invalid(gain_db),
        origin="lower",
        extent=radio.geometry.extent_m,
        cmap="viridis",
        vmin=low,
        vmax=high,
        **_CELLS,
    )
    axes.figure.colorbar(image, ax=axes, label="expected channel power gain [dB]")
    ap = radio.access_points[index]
    axes.set_title(
        f"{ap.name}: {radio.scenario}, {ap.frequency_hz * 1e-9:g} GHz, antenna at"
        f" {radio.antenna_height_m:g} m\nobstacle heights: {radio.height_source};"
        f" Rician factor {radio.rician_factor_db:g} dB, R_e {radio.expansion_radius_m:g} m",
        fontsize=9,
        parse_math=False,
    )
    _finish(axes, radio, [index])


def draw_best_access_point(axes: Axes, radio: RadioMap) -> None:
    """Draw which access point is received strongest in every cell."""
    best = radio.best_access_point
    count = len(radio.access_points)
    axes.set_facecolor(_GROUND)
    image = axes.imshow(
        np.ma.masked_less(best, 0),
        origin="lower",
        extent=radio.geometry.extent_m,
        cmap=ListedColormap([_SERVERS[i % len(_SERVERS)] for i in range(count)]),
        vmin=-0.5,
        vmax=count - 0.5,
        **_CELLS,
    )
    bar = axes.figure.colorbar(image, ax=axes, ticks=range(count), label="strongest access point")
    bar.ax.set_yticklabels([ap.name for ap in radio.access_points], parse_math=False)
    axes.set_title("best server", fontsize=9)
    _finish(axes, radio, list(range(count)))


def _finish(axes: Axes, radio: RadioMap, indices: list[int]) -> None:
    x_min, x_max, y_min, y_max = _extent_of_values(radio)
    for index in indices:
        ap = radio.access_points[index]
        # One far outside would squeeze the map to nothing.
        if x_min <= ap.x_m <= x_max and y_min <= ap.y_m <= y_max:
            # Low down the name stands above its star, for below it stands the scale bar.
            _draw_access_point(axes, ap, above=ap.y_m < y_min + 0.2 * (y_max - y_min))
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.set_aspect("equal")


def _draw_access_point(axes: Axes, ap: AccessPoint, *, above: bool) -> None:
    place = (ap.x_m, ap.y_m)
    axes.plot(*place, "*", color="white", mec="black", ms=13, clip_on=False, zorder=5)
    label = axes.annotate(
        ap.name,
        place,
        (0.0, 9.0 if above else -9.0),
        textcoords="offset points",
        ha="center",
        va="bottom" if above else "top",
        fontsize=8,
        color="white",
        zorder=6,
        parse_math=False,  # a name is text, whatever is in it
    )
    label.set_path_effects([withStroke(linewidth=2, foreground="black")])


def _extent_of_values(radio: RadioMap) -> tuple[float, float, float, float]:
    """x_min, x_max, y_min, y_max [m] of the cells with a value, with a margin."""
    valued = np.asarray(np.isfinite(radio.path_loss_db).any(axis=0))
    rows, cols = np.flatnonzero(valued.any(axis=1)), np.flatnonzero(valued.any(axis=0))
    if not len(rows):
        return radio.geometry.extent_m
    step = radio.geometry.resolution_m
    low = radio.geometry.center_of([rows[0], cols[0]]) - step / 2
    high = radio.geometry.center_of([rows[-1], cols[-1]]) + step / 2
    margin = 0.04 * float(np.max(high - low))
    return (
        float(low[0]) - margin,
        float(high[0]) + margin,
        float(low[1]) - margin,
        float(high[1]) + margin,
    )


def _draw_scale_bar(axes: Axes, x_min: float, x_max: float, y_min: float) -> None:
    """Draw a bar of a round length near a fifth of the width."""
    fifth = 0.2 * (x_max - x_min)
    power = 10.0 ** math.floor(math.log10(fifth))
    length = max(step * power for step in (1.0, 2.0, 5.0) if step * power <= fifth)
    thick = 0.012 * (x_max - x_min)
    left = x_min + 0.03 * (x_max - x_min)
    bottom = y_min + thick
    axes.add_patch(
        Rectangle((left, bottom), length, 0.5 * thick, color="black", ec="white", zorder=6)
    )
    axes.text(
        left + length / 2,
        bottom + 0.8 * thick,
        f"{length:g} m",
        ha="center",
        va="bottom",
        fontsize=8,
        zorder=6,
        bbox={"facecolor": "white", "alpha": 0.7, "pad": 0.5, "edgecolor": "none"},
    )
