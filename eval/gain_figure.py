# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The page's radio maps: gain, line of sight, best access point, and how the gain is spread."""

from __future__ import annotations

import math

import numpy as np
import plotly.graph_objects as go

from slarm_graph.access_points import RadioMap
from slarm_graph.eval.page import COLORS, Figure, plain, single
from slarm_graph.eval.report_figures import aspect, metric_axes
from slarm_graph.grid import GridGeometry, Mask

_MAX_GAIN_CELLS = 60_000
"""Of all access points together; a page stays below half a megabyte for them."""
_CURVE_POINTS = 300
"""Points of a curve: one for every two to four pixels of the page's width."""
_NONE = 2
"""Where no gain is known; drawn in no colour."""
_CLEAR = "rgba(0,0,0,0)"


def gain_figure(radio: RadioMap) -> Figure:
    """Return all layers of a radio map to choose from: gains on one scale, sight, best server."""
    fig = go.Figure()
    rows, cols = _mapped(radio)
    budget = _MAX_GAIN_CELLS / len(radio.access_points)
    size = (rows.stop - rows.start) * (cols.stop - cols.start)
    step = max(1, math.ceil(math.sqrt(size / budget)))
    g = radio.geometry
    x = g.origin_x_m + (np.arange(cols.start, cols.stop, step) + 0.5) * g.resolution_m
    y = g.origin_y_m + (np.arange(rows.start, rows.stop, step) + 0.5) * g.resolution_m
    gain_db = single(np.round(-radio.path_loss_db[:, rows, cols][:, ::step, ::step], 2))
    clear = radio.line_of_sight[:, rows, cols][:, ::step, ::step]
    labels = _put_gains(fig, radio, single(x), single(y), gain_db, clear)
    labels += _put_sights(fig, radio, single(x), single(y), gain_db, clear)
    if len(radio.access_points) > 1:
        labels += _put_best(fig, radio, single(x), single(y), gain_db)
    _put_access_points(fig, radio)
    _put_choice(fig, labels)
    side_m = g.resolution_m * step
    shown = GridGeometry(x[0] - side_m / 2, y[0] - side_m / 2, side_m, len(y), len(x))
    metric_axes(fig, shown)
    fig.update_layout(showlegend=False, meta={"ground": True, "below": True})
    return Figure(fig, "Radio map: gain, line of sight, best access point", aspect=aspect(shown))


def _put_gains(fig, radio, x, y, gain_db, clear) -> list[str]:  # type: ignore[no-untyped-def]
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


def _put_sights(fig, radio, x, y, gain_db, clear) -> list[str]:  # type: ignore[no-untyped-def]
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


def _put_best(fig, radio, x, y, gain_db) -> list[str]:  # type: ignore[no-untyped-def]
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
    """Return a colour scale of as many plain steps."""
    count = len(colors)
    return [[(i + end) / count, color] for i, color in enumerate(colors) for end in (0, 1)]


def _put_access_points(fig: go.Figure, radio: RadioMap) -> None:
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


def _put_choice(fig: go.Figure, labels: list[str]) -> None:
    buttons = [
        {
            "label": plain(label),
            "method": "restyle",
            "args": [{"visible": [i == index for i in range(len(labels))] + [True]}],
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
        loss_db = radio.path_loss_db[index]
        known = -loss_db[np.isfinite(loss_db)]
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


def _mapped(radio: RadioMap) -> tuple[slice, slice]:
    """Return the rows and columns with a value in them."""
    known: Mask = np.asarray(np.isfinite(radio.path_loss_db).any(axis=0))
    rows, cols = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    if not len(rows):
        return slice(0, radio.geometry.rows), slice(0, radio.geometry.cols)
    return slice(int(rows[0]), int(rows[-1]) + 1), slice(int(cols[0]), int(cols[-1]) + 1)
