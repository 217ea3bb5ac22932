# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The report's radio map: the gain of every access point, with values under the pointer."""

from __future__ import annotations

import math

import numpy as np
import plotly.graph_objects as go

from slarm_graph.access_points import RadioMap
from slarm_graph.eval import report_page as html
from slarm_graph.eval.report_figures import height_px, metric_axes, single
from slarm_graph.grid import GridGeometry, Mask

_MAX_GAIN_CELLS = 90_000
"""Values under the pointer: 300 x 300, one to some ten pixels of a page of 1000 pixels."""


def gain_figure(radio: RadioMap) -> str:
    """Return the gain of every access point with hover values, cells left out where too many."""
    fig = go.Figure()
    budget = _MAX_GAIN_CELLS / len(radio.access_points)
    rows, cols = _mapped(radio)
    size = (rows.stop - rows.start) * (cols.stop - cols.start)
    step = max(1, math.ceil(math.sqrt(size / budget)))
    g = radio.geometry
    x = g.origin_x_m + (np.arange(cols.start, cols.stop, step) + 0.5) * g.resolution_m
    y = g.origin_y_m + (np.arange(rows.start, rows.stop, step) + 0.5) * g.resolution_m
    gain_db = radio.channel_power_gain_db[:, rows, cols][:, ::step, ::step]
    clear = radio.line_of_sight[:, rows, cols][:, ::step, ::step]
    low, high = radio.gain_span_db()
    for index, ap in enumerate(radio.access_points):
        fig.add_heatmap(
            x=single(x),
            y=single(y),
            z=np.round(gain_db[index], 2),
            customdata=clear[index].astype(np.uint8),
            hovertemplate="%{x:.2f}, %{y:.2f} m<br>%{z:.2f} dB"
            f"<br>line of sight (1 yes, 0 no): %{{customdata}}<extra>{ap.name}</extra>",
            colorscale="Viridis",
            zmin=low,
            zmax=high,
            colorbar={"title": "gain [dB]"},
            visible=index == 0,
            hoverongaps=False,
        )
    _put_access_points(fig, radio)
    side_m = g.resolution_m * step
    shown = GridGeometry(x[0] - side_m / 2, y[0] - side_m / 2, side_m, len(y), len(x))
    metric_axes(fig, shown)
    return html.figure(fig, height_px(shown))


def _mapped(radio: RadioMap) -> tuple[slice, slice]:
    """Return the rows and columns with a value in them."""
    known: Mask = np.asarray(np.isfinite(radio.path_loss_db).any(axis=0))
    rows, cols = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    if not len(rows):
        return slice(0, radio.geometry.rows), slice(0, radio.geometry.cols)
    return slice(int(rows[0]), int(rows[-1]) + 1), slice(int(cols[0]), int(cols[-1]) + 1)


def _put_access_points(fig: go.Figure, radio: RadioMap) -> None:
    fig.add_scatter(
        x=[ap.x_m for ap in radio.access_points],
        y=[ap.y_m for ap in radio.access_points],
        text=[f"<b>{ap.name}</b>" for ap in radio.access_points],
        customdata=[f"{ap.name}, {ap.z_m:g} m high" for ap in radio.access_points],
        mode="markers+text",
        textposition="bottom center",
        textfont={"color": "white", "shadow": "0 0 3px black, 0 0 3px black"},
        marker={"symbol": "star", "size": 16, "color": "white", "line": {"width": 1.5}},
        hovertemplate="%{customdata}<extra></extra>",
        cliponaxis=False,
        showlegend=False,
    )
    if len(radio.access_points) < 2:
        return
    count = len(radio.access_points)
    buttons = [
        {
            "label": ap.name,
            "method": "restyle",
            "args": [{"visible": [i == index for i in range(count)] + [True]}],
        }
        for index, ap in enumerate(radio.access_points)
    ]
    fig.update_layout(updatemenus=[{"buttons": buttons, "x": 0, "y": 1.12, "xanchor": "left"}])
