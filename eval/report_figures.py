# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The report's interactive figures: trajectories over the map, gain with hover values."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray

from slarm_graph.eval import report_page as html
from slarm_graph.geometry import Floats
from slarm_graph.grid import GridGeometry, Mask, OccupancyGrid
from slarm_graph.radio_words import RadioMap
from slarm_graph.trajectory import Trajectory

_MAX_MAP_PIXELS = 1_500_000
_MAX_GAIN_CELLS = 90_000
_MAX_PATH_POINTS = 4_000
_FREE, _UNKNOWN, _OCCUPIED = 255, 226, 40

RAW_ODOMETRY, GROUND_TRUTH = "raw odometry", "ground truth"
_ESTIMATE = {"color": "#1f5fbf", "width": 2}
_STYLES = {
    RAW_ODOMETRY: {"color": "#c26a1b", "width": 1, "dash": "dot"},
    GROUND_TRUTH: {"color": "#9ad9b0", "width": 5},
}


def map_picture(grid: OccupancyGrid) -> tuple[str, GridGeometry]:
    """Return the map as a picture's data address, made coarser where it is large.

    An occupied cell stays visible however much coarser the picture is.
    """
    image = np.full(grid.geometry.shape, _UNKNOWN, dtype=np.uint8)
    image[grid.free] = _FREE
    image[grid.occupied] = _OCCUPIED
    step = max(1, math.ceil(math.sqrt(image.size / _MAX_MAP_PIXELS)))
    rows, cols = (-(-n // step) * step for n in image.shape)
    padded = np.full((rows, cols), _UNKNOWN, dtype=np.uint8)
    padded[: image.shape[0], : image.shape[1]] = image
    coarse = padded.reshape(rows // step, step, cols // step, step).min(axis=(1, 3))
    g = grid.geometry
    shown = GridGeometry(
        g.origin_x_m, g.origin_y_m, g.resolution_m * step, rows // step, cols // step
    )
    return html.png_uri(np.ascontiguousarray(coarse[::-1])), shown


def trajectory_figure(grid: OccupancyGrid, trajectories: Mapping[str, Trajectory]) -> str:
    """Return trajectories by name over the map, the first on top.

    Raw odometry is there to be switched on in the legend.
    """
    picture, geometry = map_picture(grid)
    fig = go.Figure()
    _put_map_below(fig, picture, geometry)
    for name, trajectory in reversed(list(trajectories.items())):
        style = _STYLES.get(name, _ESTIMATE)
        step = max(1, math.ceil(len(trajectory) / _MAX_PATH_POINTS))
        x, y = trajectory.poses[::step, 0], trajectory.poses[::step, 1]
        seconds = (trajectory.stamps_ns[::step] - trajectory.stamps_ns[0]) * 1e-9
        fig.add_scattergl(
            x=_single(x),
            y=_single(y),
            mode="lines",
            name=name,
            line=style,
            customdata=_single(seconds),
            hovertemplate="%{x:.2f}, %{y:.2f} m<br>%{customdata:.1f} s<extra>" + name + "</extra>",
            visible="legendonly" if name == RAW_ODOMETRY else True,
        )
    _put_ends(fig, next(iter(trajectories.values())))
    _metric_axes(fig, geometry)
    return html.figure(fig, _height_px(geometry))


def _put_ends(fig: go.Figure, trajectory: Trajectory) -> None:
    for name, pose, symbol in (
        ("start", trajectory.poses[0], "circle"),
        ("end", trajectory.poses[-1], "square"),
    ):
        marker = {"symbol": symbol, "size": 10, "color": "#1f5fbf", "line": {"width": 1.5}}
        fig.add_scatter(x=pose[:1], y=pose[1:2], mode="markers", name=name, marker=marker)


def _put_map_below(fig: go.Figure, picture: str, geometry: GridGeometry) -> None:
    x_min, x_max, y_min, y_max = geometry.extent_m
    fig.add_layout_image(
        source=picture,
        xref="x",
        yref="y",
        x=x_min,
        y=y_max,
        sizex=x_max - x_min,
        sizey=y_max - y_min,
        sizing="stretch",
        layer="below",
    )


def _height_px(geometry: GridGeometry) -> int:
    """Return a height at which the map fills the page's width, within what fits a screen."""
    x_min, x_max, y_min, y_max = geometry.extent_m
    return round(min(max(1000.0 * (y_max - y_min) / (x_max - x_min), 420.0), 860.0))


def _metric_axes(fig: go.Figure, geometry: GridGeometry) -> None:
    x_min, x_max, y_min, y_max = geometry.extent_m
    fig.update_xaxes(title="x [m]", range=[x_min, x_max], showgrid=False, zeroline=False)
    fig.update_yaxes(
        title="y [m]",
        range=[y_min, y_max],
        scaleanchor="x",
        showgrid=False,
        zeroline=False,
    )


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
            x=_single(x),
            y=_single(y),
            z=np.round(gain_db[index], 2),
            customdata=clear[index].astype(np.uint8),
            hovertemplate="%{x:.2f}, %{y:.2f} m<br>%{z:.2f} dB<br>line of sight: %{customdata}"
            f"<extra>{ap.name}</extra>",
            colorscale="Viridis",
            zmin=low,
            zmax=high,
            colorbar={"title": "gain [dB]"},
            visible=index == 0,
            hoverongaps=False,
        )
    _put_access_points(fig, radio)
    shown = GridGeometry(
        float(x[0]), float(y[0]), g.resolution_m, rows.stop - rows.start, cols.stop - cols.start
    )
    _metric_axes(fig, shown)
    return html.figure(fig, _height_px(shown))


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
        text=[f"{ap.name}, {ap.z_m:g} m high" for ap in radio.access_points],
        mode="markers",
        name="access points",
        marker={"symbol": "star", "size": 15, "color": "#e63946", "line": {"width": 1}},
        hovertemplate="%{text}<extra></extra>",
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


def _single(values: Floats) -> NDArray[np.float32]:
    """Halve the page's size: single precision is far below a pixel."""
    return np.asarray(values, dtype=np.float32)
