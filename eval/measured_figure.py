# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The page's measured radio map: expected level with its certainty under the pointer."""

from __future__ import annotations

import math

import numpy as np
import plotly.graph_objects as go

from slarm_graph.eval.page import Figure, plain, single
from slarm_graph.eval.report_figures import aspect, metric_axes
from slarm_graph.grid import GridGeometry, Mask
from slarm_graph.radio.measured.measured_map import MeasuredMap

_MAX_CELLS = 60_000
"""Values shown for all access points together; the page grows by about a megabyte for them."""


def measured_figure(measured: MeasuredMap) -> Figure:
    """Return the expected level of every access point, cells left out where too many."""
    grid, count = measured.geometry, len(measured.access_points)
    known: Mask = np.asarray(np.isfinite(measured.mean_dbm).any(axis=0))
    rows, cols = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    rows, cols = np.arange(rows[0], rows[-1] + 1), np.arange(cols[0], cols[-1] + 1)
    step = max(1, math.ceil(math.sqrt(len(rows) * len(cols) * count / _MAX_CELLS)))
    rows, cols = rows[::step], cols[::step]
    x = grid.origin_x_m + (cols + 0.5) * grid.resolution_m
    y = grid.origin_y_m + (rows + 0.5) * grid.resolution_m
    fig = go.Figure()
    for index, ap in enumerate(measured.access_points):
        fig.add_heatmap(
            x=single(np.asarray(x, dtype=np.float64)),
            y=single(np.asarray(y, dtype=np.float64)),
            z=np.round(measured.mean_dbm[index][np.ix_(rows, cols)], 1),
            customdata=np.round(measured.mean_sd_db[index][np.ix_(rows, cols)], 1),
            hovertemplate="x %{x:.2f} m, y %{y:.2f} m<br>%{z} dBm, sd %{customdata} dB"
            f"<extra>{plain(ap.name)}</extra>",
            colorscale="Viridis",
            colorbar={"title": {"text": "level [dBm]"}},
            visible=index == 0,
            hoverongaps=False,
        )
    buttons = [
        {
            "label": plain(ap.name),
            "method": "restyle",
            "args": [{"visible": [i == index for i in range(count)]}],
        }
        for index, ap in enumerate(measured.access_points)
    ]
    fig.update_layout(updatemenus=[{"buttons": buttons, "x": 0, "y": 1.12, "xanchor": "left"}])
    side_m = grid.resolution_m * step
    shown = GridGeometry(x[0] - side_m / 2, y[0] - side_m / 2, side_m, len(y), len(x))
    metric_axes(fig, shown)
    fig.update_layout(showlegend=False, meta={"ground": True, "below": True})
    return Figure(fig, "Measured radio map: expected level per access point", aspect=aspect(shown))
