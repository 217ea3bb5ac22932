# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Interactive figures of radio maps: gain, line of sight, best access point, measured levels."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray

from slarm_graph.access_points import RadioMap
from slarm_graph.eval.page import COLORS, Figure, plain, single
from slarm_graph.eval.report_figures import aspect, metric_axes
from slarm_graph.geometry import Floats
from slarm_graph.grid import GridGeometry
from slarm_graph.radio.measured.measured_map import MeasuredMap
from slarm_graph.raster.bands import windows
from slarm_graph.tiles import Where, Window

_MAX_CELLS = 60_000
"""Most cells drawn of all access points together, half a megabyte of the page."""
_CURVE_POINTS = 300
"""Points of a curve: one for every two to four pixels of the page's width."""
_NONE = 2
"""Class of cells without a known gain; transparent."""
_CLEAR = "rgba(0,0,0,0)"


def gain_figure(radio: RadioMap) -> Figure:
    """Return a figure of the selectable layers of a radio map: gain, line of sight, best server."""
    fig = go.Figure()
    rows, cols, x, y = _shown_cells(radio.geometry, radio.path_loss_db, _MAX_CELLS, radio.where)
    gain_db = single(np.round(-radio.path_loss_db[:, rows, cols], 2))
    clear = radio.line_of_sight[:, rows, cols]
    at = single(x), single(y)
    labels = _add_gains(fig, radio, *at, gain_db, clear)
    labels += _add_sights(fig, radio, *at, gain_db, clear)
    if len(radio.access_points) > 1:
        labels += _add_best(fig, radio, *at, gain_db)
    _add_access_points(fig, radio)
    _add_choice(fig, labels, always=1)
    words = "Radio map: gain, line of sight, best access point"
    return _over_cells(fig, x, y, radio.geometry.resolution_m * rows.step, words)


def _shown_cells(
    geometry: GridGeometry, layers: NDArray[np.float32] | Floats, most: int, where: Where
) -> tuple[slice, slice, Floats, Floats]:
    """Return the rows and columns to draw of layers (A, rows, cols), and their x and y [m].

    These are the rows and columns with a value; where there are too many, every n-th.

    Parameters
    ----------
    geometry : GridGeometry
    layers : (A, rows, cols)
        nan where there is no value.
    most : int
        Values of all layers together.
    where : (rows, cols) or KnownTiles
    """
    rows, cols = _window_of_values(layers, where)
    size = (rows.stop - rows.start) * (cols.stop - cols.start)
    step = max(1, math.ceil(math.sqrt(size / (most / len(layers)))))
    rows, cols = slice(rows.start, rows.stop, step), slice(cols.start, cols.stop, step)
    side_m = geometry.resolution_m
    x, y = (
        np.asarray(origin_m + (np.arange(at.start, at.stop, step) + 0.5) * side_m, np.float64)
        for origin_m, at in ((geometry.origin_x_m, cols), (geometry.origin_y_m, rows))
    )
    return rows, cols, x, y


def _window_of_values(layers: NDArray[np.float32] | Floats, where: Where) -> Window:
    """Return the rows and columns in which any layer has a value; all where none has."""
    valued = [np.zeros(n, dtype=np.bool_) for n in layers.shape[1:]]
    for layer in layers:
        for part in windows(where):
            known = np.isfinite(layer[part.cells])
            for axis in range(2):
                valued[axis][part.cells[axis]] |= known.any(axis=1 - axis)
    rows, cols = (np.flatnonzero(one if one.any() else ~one) for one in valued)
    return slice(int(rows[0]), int(rows[-1]) + 1), slice(int(cols[0]), int(cols[-1]) + 1)


def _over_cells(fig: go.Figure, x: Floats, y: Floats, side_m: float, words: str) -> Figure:
    """Return a figure of layers over the cells with these centres and this side [m]."""
    shown = GridGeometry(x[0] - side_m / 2, y[0] - side_m / 2, side_m, len(y), len(x))
    metric_axes(fig, shown)
    fig.update_layout(showlegend=False, meta={"ground": True, "below": True})
    return Figure(fig, words, aspect=aspect(shown))


def _add_gains(fig, radio, x, y, gain_db, clear) -> list[str]:  # type: ignore[no-untyped-def]
    low, high = radio.gain_span_db()
    for index, ap in enumerate(radio.access_points):
        fig.add_heatmap(
            x=x,
            y=y,
            z=gain_db[index],
            customdata=clear[index].astype(np.uint8),
            hovertemplate="x %{x:.2f} m, y %{y:.2f} m<br>%{z:.1f} dB"
            "<br>line of sight (1 yes, 0 no): %{customdata}"
            f"<extra>{plain(ap.name)}</extra>",
            colorscale="Viridis",
            zmin=low,
            zmax=high,
            colorbar={"title": {"text": "gain [dB]"}},
            visible=index == 0,
            hoverongaps=False,
        )
    return [f"{ap.name}: gain" for ap in radio.access_points]


def _add_sights(fig, radio, x, y, gain_db, clear) -> list[str]:  # type: ignore[no-untyped-def]
    for index, ap in enumerate(radio.access_points):
        sight = np.where(np.isfinite(gain_db[index]), clear[index], _NONE).astype(np.uint8)
        fig.add_heatmap(
            x=x,
            y=y,
            z=sight,
            colorscale=_steps([COLORS[5], COLORS[4], _CLEAR]),
            zmin=-0.5,
            zmax=2.5,
            colorbar={"tickvals": [0, 1], "ticktext": ["blocked", "clear"]},
            hovertemplate="x %{x:.2f} m, y %{y:.2f} m<br>line of sight (1 yes, 0 no): %{z}"
            f"<extra>{plain(ap.name)}</extra>",
            visible=False,
            hoverongaps=False,
        )
    return [f"{ap.name}: line of sight" for ap in radio.access_points]


def _add_best(fig, radio, x, y, gain_db) -> list[str]:  # type: ignore[no-untyped-def]
    power_dbm = np.array([ap.power_dbm for ap in radio.access_points])[:, None, None]
    rss_dbm = np.where(np.isfinite(gain_db), gain_db + power_dbm, -np.inf)
    count = len(radio.access_points)
    known = np.isfinite(rss_dbm).any(axis=0)
    best = np.where(known, rss_dbm.argmax(axis=0), count).astype(np.uint8)
    names = [plain(ap.name) for ap in radio.access_points]
    strongest_dbm = single(np.round(np.where(known, rss_dbm.max(axis=0), np.nan), 1))
    fig.add_heatmap(
        x=x,
        y=y,
        z=best,
        customdata=strongest_dbm,
        hovertemplate="x %{x:.2f} m, y %{y:.2f} m<br>access point number %{z}:"
        " %{customdata:.1f} dBm<extra></extra>",
        colorscale=_steps([*(COLORS[i % len(COLORS)] for i in range(count)), _CLEAR]),
        zmin=-0.5,
        zmax=count + 0.5,
        colorbar={"tickvals": list(range(count)), "ticktext": names},
        visible=False,
        hoverongaps=False,
    )
    return ["best access point"]


def _steps(colors: list[str]) -> list[list[float | str]]:
    """Return a colour scale with one step per colour."""
    count = len(colors)
    return [[(i + end) / count, color] for i, color in enumerate(colors) for end in (0, 1)]


def _add_access_points(fig: go.Figure, radio: RadioMap) -> None:
    fig.add_scatter(
        x=[ap.x_m for ap in radio.access_points],
        y=[ap.y_m for ap in radio.access_points],
        text=[f"<b>{plain(ap.name)}</b>" for ap in radio.access_points],
        customdata=[f"{plain(ap.name)}, {ap.z_m:g} m high" for ap in radio.access_points],
        mode="markers+text",
        textposition="bottom center",
        textfont={"color": "white", "shadow": "0 0 3px black, 0 0 3px black"},
        marker={
            "symbol": "star",
            "size": 16,
            "color": "white",
            "line": {"width": 1.5, "color": "black"},
        },
        hovertemplate="%{customdata}<extra></extra>",
        cliponaxis=False,
        showlegend=False,
    )


def _add_choice(fig: go.Figure, labels: Sequence[str], always: int = 0) -> None:
    """Add a menu that shows one layer at a time; the last `always` traces are always shown."""
    buttons = [
        {
            "label": plain(label),
            "method": "restyle",
            "args": [{"visible": [i == index for i in range(len(labels))] + [True] * always}],
        }
        for index, label in enumerate(labels)
    ]
    menu = {"buttons": buttons, "x": 0, "y": 1.0, "xanchor": "left", "yanchor": "bottom",
            "pad": {"b": 6}, "bgcolor": "#ffffff", "font": {"color": "#1c2430"}}  # fmt: skip
    fig.update_layout(updatemenus=[menu])


def gain_curves(radio: RadioMap) -> Figure:
    """Return the cumulative distribution of the gain over the mapped cells, by access point."""
    fig = go.Figure()
    shares = np.linspace(0.0, 1.0, _CURVE_POINTS)
    for index, ap in enumerate(radio.access_points):
        parts = [radio.path_loss_db[index][part.cells] for part in windows(radio.where)]
        known = -np.concatenate([loss_db[np.isfinite(loss_db)] for loss_db in parts])
        if not known.size:
            continue
        fig.add_scatter(
            x=single(np.quantile(known, shares)),
            y=single(shares),
            mode="lines",
            name=plain(ap.name),
            line={"width": 2, "dash": ("solid", "dash", "dot", "dashdot")[index % 4]},
            hovertemplate="%{y:.0%} of the cells have %{x:.1f} dB or less"
            f"<extra>{plain(ap.name)}</extra>",
            showlegend=True,
        )
    fig.update_xaxes(title="expected channel power gain [dB]")
    fig.update_yaxes(title="share of the mapped cells", range=[0.0, 1.0], tickformat=".0%")
    return Figure(fig, "Cumulative distribution of the gain", height_px=360)


def measured_figure(measured: MeasuredMap) -> Figure:
    """Return a figure of the expected level of every access point, thinned where large."""
    layers, where = measured.mean_dbm, measured.geometry.shape
    rows, cols, x, y = _shown_cells(measured.geometry, layers, _MAX_CELLS, where)
    fig = go.Figure()
    for index, ap in enumerate(measured.access_points):
        fig.add_heatmap(
            x=single(x),
            y=single(y),
            z=np.round(measured.mean_dbm[index, rows, cols], 1),
            customdata=np.round(measured.mean_sd_db[index, rows, cols], 1),
            hovertemplate="x %{x:.2f} m, y %{y:.2f} m<br>%{z} dBm, sd %{customdata} dB"
            f"<extra>{plain(ap.name)}</extra>",
            colorscale="Viridis",
            colorbar={"title": {"text": "level [dBm]"}},
            visible=index == 0,
            hoverongaps=False,
        )
    _add_choice(fig, [ap.name for ap in measured.access_points])
    words = "Measured radio map: expected level per access point"
    return _over_cells(fig, x, y, measured.geometry.resolution_m * rows.step, words)
