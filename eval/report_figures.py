# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The report's maps: trajectories over the occupancy grid, and the recovered geographic map."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray

from slarm_graph.eval import report_page as html
from slarm_graph.geographic import CellState, GeographicMap
from slarm_graph.geometry import Floats
from slarm_graph.grid import GridGeometry, OccupancyGrid
from slarm_graph.trajectory import Trajectory
from slarm_graph.world import Solid

_MAX_MAP_PIXELS = 1_500_000
"""Pixels of a map's picture: a page of 1000 pixels can be zoomed into, and walls of one cell
stay."""
_SHARP_PIXELS = 1_000
"""Browsers blur what they enlarge: pictures of few cells are made this wide or high."""
_MAX_PATH_POINTS = 4_000
"""Points of a path: several per pixel of the page's width of 1000 pixels."""
_FREE, _UNKNOWN, _OCCUPIED = 255, 226, 40
"""Shades of grey: white, a light and a dark one, far enough apart to be told from each other in
print."""
_GROUND = "#e2e2e2"
_STATES = {
    CellState.ACCESSIBLE: ("accessible", "#ffffff"),
    CellState.EXPANSION: ("too near to an obstacle", "#f2cf8f"),
    CellState.ENCLOSED: ("free, out of reach", "#9cc7ea"),
    CellState.OBSTACLE: ("obstacle", "#282828"),
    CellState.UNKNOWN: ("unknown", _GROUND),
}
_SOLID = "#b8541a"

RAW_ODOMETRY, GROUND_TRUTH = "raw odometry", "ground truth"
_ESTIMATE = {"color": "#1f5fbf", "width": 2}
_STYLES = {
    RAW_ODOMETRY: {"color": "#c26a1b", "width": 1, "dash": "dot"},
    GROUND_TRUTH: {"color": "#9ad9b0", "width": 5},
}


_MAP_WORDS = "<p>White is free, black occupied, grey unknown.</p>"
_HEIGHT_WORDS = "<p>Heights that are not written show under the pointer.</p>"
_PAGE_PX = 1000.0
"""Width of the column that the page's style gives to figures [px]."""
_LETTER_PX, _LINE_PX = 8.0, 18.0
"""Width of a letter and height of a line at the page's font of 13 px [px]."""
_ROOM_FOR_LABEL = 1.5
"""A label is written where an obstacle is so many times as long, or as wide; else on hovering."""


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
    return _sharp_uri(coarse), shown


def _sharp_uri(cells: NDArray[np.uint8]) -> str:
    """Return cells (rows, cols, ...), the lowest row first, as a picture's data address."""
    times = math.ceil(_SHARP_PIXELS / max(cells.shape[:2]))
    large = cells[::-1].repeat(times, axis=0).repeat(times, axis=1)
    return html.png_uri(np.ascontiguousarray(large))


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
            x=single(x),
            y=single(y),
            mode="lines",
            name=name,
            line=style,
            customdata=single(seconds),
            hovertemplate="%{x:.2f}, %{y:.2f} m<br>%{customdata:.1f} s<extra>" + name + "</extra>",
            visible="legendonly" if name == RAW_ODOMETRY else True,
        )
    _put_ends(fig, next(iter(trajectories.values())))
    metric_axes(fig, geometry)
    return html.figure(fig, height_px(geometry), _GROUND) + _MAP_WORDS


def geographic_figure(geographic: GeographicMap) -> str:
    """Return the recovered map by what its cells are, with the obstacles of known height."""
    fig = go.Figure()
    picture, geometry = _state_picture(geographic)
    _put_map_below(fig, picture, geometry)
    for state, (name, color) in _STATES.items():
        if (geographic.states == state).any():
            marker = {"symbol": "square", "size": 11, "color": color, "line": {"width": 1}}
            fig.add_scatter(x=[None], y=[None], mode="markers", name=name, marker=marker)
    known = [solid for solid in geographic.solids if math.isfinite(solid.height_m)]
    for solid in known:
        _put_solid(fig, solid, px_per_m(geometry))
    metric_axes(fig, geometry)
    words = _HEIGHT_WORDS if len(fig.layout.annotations) < len(known) else ""
    return html.figure(fig, height_px(geometry), _GROUND) + words


def _state_picture(geographic: GeographicMap) -> tuple[str, GridGeometry]:
    """Return the states as a picture's data address, every so many cells where there are many."""
    g = geographic.geometry
    step = max(1, math.ceil(math.sqrt(geographic.states.size / _MAX_MAP_PIXELS)))
    states = geographic.states[::step, ::step]
    shown = GridGeometry(g.origin_x_m, g.origin_y_m, g.resolution_m * step, *states.shape)
    palette = np.zeros((256, 3), dtype=np.uint8)
    for state, (_, color) in _STATES.items():
        palette[state] = np.frombuffer(bytes.fromhex(color[1:]), dtype=np.uint8)
    return _sharp_uri(palette[states]), shown


def _put_solid(fig: go.Figure, solid: Solid, scale_px_m: float) -> None:
    """Outline an obstacle, tell its height on hovering, and write it there where there is room."""
    ring = np.vstack([solid.corners_m, solid.corners_m[:1]])
    label = f"{solid.height_m:g} m"
    fig.add_scatter(
        x=ring[:, 0],
        y=ring[:, 1],
        mode="lines",
        line={"color": _SOLID, "width": 2},
        fill="toself",
        fillcolor="rgba(0,0,0,0)",
        hoveron="fills",
        hoverinfo="text",
        text=f"{solid.name} {label}",
        showlegend=False,
    )
    size_px = np.ptp(solid.corners_m, axis=0) * scale_px_m
    if (size_px < np.array([_LETTER_PX * len(label), _LINE_PX]) * _ROOM_FOR_LABEL).all():
        return
    x, y = solid.corners_m.mean(axis=0)
    font = {"color": _SOLID}
    bold = f"<b>{label}</b>"
    fig.add_annotation(x=x, y=y, text=bold, showarrow=False, font=font, bgcolor="#ffffff")


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


def height_px(geometry: GridGeometry) -> int:
    """Return a figure height at which the map fills the page's width, within what fits a screen."""
    x_min, x_max, y_min, y_max = geometry.extent_m
    return round(min(max(_PAGE_PX * (y_max - y_min) / (x_max - x_min), 420.0), 860.0))


def px_per_m(geometry: GridGeometry) -> float:
    """Return how many pixels of the page a metre of a map takes, roughly."""
    x_min, x_max, y_min, y_max = geometry.extent_m
    return min(_PAGE_PX / (x_max - x_min), height_px(geometry) / (y_max - y_min))


def metric_axes(fig: go.Figure, geometry: GridGeometry) -> None:
    """Show all of a grid and nothing else, a metre as long up as across."""
    x_min, x_max, y_min, y_max = geometry.extent_m
    fig.update_xaxes(title="x [m]", range=[x_min, x_max], showgrid=False, zeroline=False)
    fig.update_yaxes(
        title="y [m]",
        range=[y_min, y_max],
        scaleanchor="x",
        showgrid=False,
        zeroline=False,
    )


def single(values: Floats) -> NDArray[np.float32]:
    """Halve the page's size: single precision is far below a pixel."""
    return np.asarray(values, dtype=np.float32)
