# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The report's maps: trajectories over the occupancy grid, and the recovered geographic map."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray

from slarm_graph.eval.page import COLORS, Figure, plain, png_uri, single
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
_STATES: Mapping[int, tuple[str, str]] = {
    CellState.ACCESSIBLE: ("accessible", "#ffffff"),
    CellState.EXPANSION: ("too near to an obstacle", "#f2cf8f"),
    CellState.ENCLOSED: ("free, out of reach", "#9cc7ea"),
    CellState.OBSTACLE: ("obstacle", "#282828"),
    CellState.UNKNOWN: ("unknown", _GROUND),
}
_SOLID = "#b8541a"

RAW_ODOMETRY, GROUND_TRUTH = "raw odometry", "ground truth"
_STYLES = {
    RAW_ODOMETRY: {"color": "#c26a1b", "width": 1, "dash": "dot"},
    GROUND_TRUTH: {"color": "#7fd0a0", "width": 5},
}


MAP_WORDS = "White is free, black occupied, grey unknown."
HEIGHT_WORDS = "Heights that are not written show under the pointer."
_PAGE_PX, _TALL_PX = 1000.0, 760.0
"""About the width of a page, and the height that the template gives a map at most."""
_ELLIPSES = 30
"""More would cover the path."""
CHI_95 = math.sqrt(5.991)
"""95 % of a normal distribution in the plane lie within so many standard deviations."""
_CIRCLE = np.stack([f(np.linspace(0.0, 2.0 * np.pi, 25)) for f in (np.cos, np.sin)])
_LETTER_PX, _LINE_PX = 8.0, 18.0
"""Width of a letter and height of a line at the page's font of 13 px [px]."""
_MOST_TOLD = 500
"""Obstacles, the largest, that tell their name and height on hovering; half a second for all, and
more than anyone hovers over."""
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
    return png_uri(np.ascontiguousarray(large))


@dataclass(frozen=True, slots=True)
class Marks:
    """What is shown on the map besides paths.

    Parameters
    ----------
    closures : (C, 2, 2) float64
        Both ends of every accepted loop closure [m].
    rejected : sequence of (x, y, words)
        Loop closures that were not, where the robot was [m].
    conflicts : sequence of (x, y, words)
        Where the map contradicts itself [m].
    covariances : (N, 3, 3) float64, optional
        Of the first trajectory's poses, in the robot's frame.
    """

    closures: Floats = field(default_factory=lambda: np.zeros((0, 2, 2)))
    rejected: Sequence[tuple[float, float, str]] = ()
    conflicts: Sequence[tuple[float, float, str]] = ()
    covariances: Floats | None = None


def trajectory_figure(
    grid: OccupancyGrid, trajectories: Mapping[str, Trajectory], marks: Marks | None = None
) -> Figure:
    """Return trajectories by name over the map, the first on top, each to be switched.

    Raw odometry is there to be switched on in the legend.
    """
    picture, geometry = map_picture(grid)
    fig = go.Figure()
    put_map_below(fig, picture, geometry)
    put_trajectories(fig, trajectories)
    marks = marks or Marks()
    first = next(iter(trajectories.values()))
    _put_ellipses(fig, first, marks.covariances)
    _put_closures(fig, marks)
    _put_points(fig, marks.conflicts, "contradictions", "#d55e00", "diamond-open")
    _put_ends(fig, first)
    metric_axes(fig, geometry)
    words = f"Map with the trajectories {', '.join(trajectories)}"
    return Figure(fig, words, aspect=aspect(geometry))


def put_trajectories(fig: go.Figure, trajectories: Mapping[str, Trajectory]) -> None:
    """Draw paths by name, the first last and so on top."""
    ours = [name for name in trajectories if name not in _STYLES]
    for name, trajectory in reversed(list(trajectories.items())):
        style = _STYLES.get(name) or {"color": COLORS[ours.index(name) % len(COLORS)], "width": 2}
        step = max(1, math.ceil(len(trajectory) / _MAX_PATH_POINTS))
        x, y = trajectory.poses[::step, 0], trajectory.poses[::step, 1]
        seconds = (trajectory.stamps_ns[::step] - trajectory.stamps_ns[0]) * 1e-9
        fig.add_scatter(
            x=single(x),
            y=single(y),
            mode="lines",
            name=plain(name),
            line=style,
            customdata=single(seconds),
            hovertemplate="x %{x:.2f} m, y %{y:.2f} m<br>%{customdata:.1f} s"
            f"<extra>{plain(name)}</extra>",
            visible="legendonly" if name == RAW_ODOMETRY else True,
            legendrank=100 + list(trajectories).index(name),
        )


def _put_closures(fig: go.Figure, marks: Marks) -> None:
    if len(marks.closures):
        gaps = np.full((len(marks.closures), 1, 2), np.nan)
        line = np.concatenate([marks.closures, gaps], axis=1).reshape(-1, 2)
        fig.add_scatter(
            x=single(line[:, 0]),
            y=single(line[:, 1]),
            mode="lines",
            name=f"loop closures ({len(marks.closures)})",
            line={"color": "#009e73", "width": 1},
            hoverinfo="skip",
            visible="legendonly",
            legendrank=200,
        )
    _put_points(fig, marks.rejected, "rejected closures", "#777777", "x", visible="legendonly")


def _put_points(
    fig: go.Figure,
    points: Sequence[tuple[float, float, str]],
    name: str,
    color: str,
    symbol: str,
    visible: str | bool = True,
) -> None:
    if not points:
        return
    points = points[:: max(1, len(points) // _MAX_PATH_POINTS)]
    fig.add_scatter(
        x=[p[0] for p in points],
        y=[p[1] for p in points],
        text=[plain(p[2]) for p in points],
        mode="markers",
        name=f"{name} ({len(points)})",
        marker={"color": color, "symbol": symbol, "size": 7},
        hovertemplate="x %{x:.2f} m, y %{y:.2f} m<br>%{text}<extra></extra>",
        visible=visible,
        legendrank=210,
    )


def _put_ellipses(fig: go.Figure, trajectory: Trajectory, covariances: Floats | None) -> None:
    """Draw where a pose lies with 95 % confidence, of some poses."""
    if covariances is None or not np.isfinite(covariances).any():
        return
    chosen = np.linspace(0, len(trajectory) - 1, min(_ELLIPSES, len(trajectory))).astype(int)
    rings = []
    for index in chosen:
        theta = float(trajectory.poses[index, 2])
        turn = np.array([[np.cos(theta), -np.sin(theta)], [np.sin(theta), np.cos(theta)]])
        spread = turn @ covariances[index][:2, :2] @ turn.T
        if np.isfinite(spread).all():
            values, axes = np.linalg.eigh(spread)
            ring = axes @ (np.sqrt(values.clip(0.0))[:, None] * _CIRCLE) * CHI_95
            rings.append(np.vstack([ring.T + trajectory.poses[index, :2], [np.nan, np.nan]]))
    line = np.concatenate(rings)
    fig.add_scatter(
        x=single(line[:, 0]),
        y=single(line[:, 1]),
        mode="lines",
        name="95 % ellipses",
        line={"color": "#cc79a7", "width": 1},
        hoverinfo="skip",
        visible="legendonly",
        legendrank=220,
    )


def geographic_figure(geographic: GeographicMap) -> Figure:
    """Return the recovered map by what its cells are, with the obstacles of known height."""
    fig = go.Figure()
    picture, geometry = _state_picture(geographic)
    put_map_below(fig, picture, geometry)
    for state, (name, color) in _STATES.items():
        if (geographic.states == state).any():
            line = {"width": 1, "color": "#888888"}
            marker = {"symbol": "square", "size": 11, "color": color, "line": line}
            fig.add_scatter(x=[None], y=[None], mode="markers", name=name, marker=marker)
    known = [solid for solid in geographic.solids if math.isfinite(solid.height_m)]
    sizes_m = np.array([np.ptp(solid.corners_m, axis=0).sum() for solid in known])
    told = set(np.argsort(-sizes_m, kind="stable")[:_MOST_TOLD].tolist())
    _put_outlines(fig, [solid for n, solid in enumerate(known) if n not in told])
    for solid in (solid for n, solid in enumerate(known) if n in told):
        _put_solid(fig, solid, px_per_m(geometry))
    metric_axes(fig, geometry)
    return Figure(fig, "Recovered map by the state of its cells", aspect=aspect(geometry))


def difference_figure(
    classes: NDArray[np.uint8], geometry: GridGeometry, looks: Mapping[int, tuple[str, str]]
) -> Figure:
    """Return where two maps differ, by the class of every cell (rows, cols)."""
    fig = go.Figure()
    picture, shown = _class_picture(classes, geometry, looks)
    put_map_below(fig, picture, shown)
    for name, color in looks.values():
        line = {"width": 1, "color": "#888888"}
        marker = {"symbol": "square", "size": 11, "color": color, "line": line}
        fig.add_scatter(x=[None], y=[None], mode="markers", name=plain(name), marker=marker)
    metric_axes(fig, shown)
    return Figure(fig, "Where two maps differ", aspect=aspect(shown))


def _state_picture(geographic: GeographicMap) -> tuple[str, GridGeometry]:
    return _class_picture(geographic.states, geographic.geometry, _STATES)


def _class_picture(
    classes: NDArray[np.uint8], geometry: GridGeometry, looks: Mapping[int, tuple[str, str]]
) -> tuple[str, GridGeometry]:
    """Return classes as a picture's data address, every so many cells where there are many."""
    step = max(1, math.ceil(math.sqrt(classes.size / _MAX_MAP_PIXELS)))
    cells = classes[::step, ::step]
    shown = GridGeometry(
        geometry.origin_x_m, geometry.origin_y_m, geometry.resolution_m * step, *cells.shape
    )
    palette = np.zeros((256, 3), dtype=np.uint8)
    for kind, (_, color) in looks.items():
        palette[kind] = np.frombuffer(bytes.fromhex(color[1:]), dtype=np.uint8)
    return _sharp_uri(palette[cells]), shown


def _put_solid(fig: go.Figure, solid: Solid, scale_px_m: float) -> None:
    """Outline an obstacle, tell its height on hovering, and write it there where there is room."""
    ring = np.vstack([solid.corners_m, solid.corners_m[:1]])
    label = f"{solid.height_m:.3g} m"
    fig.add_scatter(
        x=ring[:, 0],
        y=ring[:, 1],
        mode="lines",
        line={"color": _SOLID, "width": 2},
        fill="toself",
        fillcolor="rgba(0,0,0,0)",
        hoveron="fills",
        hoverinfo="text",
        text=plain(f"{solid.name} {label}"),
        showlegend=False,
    )
    size_px = np.ptp(solid.corners_m, axis=0) * scale_px_m
    if (size_px < np.array([_LETTER_PX * len(label), _LINE_PX]) * _ROOM_FOR_LABEL).all():
        return
    x, y = solid.corners_m.mean(axis=0)
    font = {"color": _SOLID}
    bold = f"<b>{label}</b>"
    fig.add_annotation(x=x, y=y, text=bold, showarrow=False, font=font, bgcolor="#ffffff")


def _put_outlines(fig: go.Figure, solids: Sequence[Solid]) -> None:
    """Outline obstacles in one line, which takes a thousandth of the time of one for each."""
    if not solids:
        return
    gap = np.full((1, 2), np.nan)
    rings = [np.vstack([s.corners_m, s.corners_m[:1], gap]) for s in solids]
    line = single(np.concatenate(rings))
    fig.add_scatter(
        x=line[:, 0],
        y=line[:, 1],
        mode="lines",
        line={"color": _SOLID, "width": 1},
        hoverinfo="skip",
        showlegend=False,
    )


def _put_ends(fig: go.Figure, trajectory: Trajectory) -> None:
    for name, pose, symbol in (
        ("start", trajectory.poses[0], "circle"),
        ("end", trajectory.poses[-1], "square"),
    ):
        marker = {
            "symbol": symbol,
            "size": 10,
            "color": COLORS[0],
            "line": {"width": 1.5, "color": "#ffffff"},
        }
        fig.add_scatter(x=pose[:1], y=pose[1:2], mode="markers", name=name, marker=marker)


def put_map_below(fig: go.Figure, picture: str, geometry: GridGeometry) -> None:
    """Lay a picture of a map below everything else, over the cells it shows."""
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


def aspect(geometry: GridGeometry) -> float:
    """Return the height of a map over its width."""
    x_min, x_max, y_min, y_max = geometry.extent_m
    return (y_max - y_min) / (x_max - x_min)


def px_per_m(geometry: GridGeometry) -> float:
    """Return how many pixels of the page a metre of a map takes, roughly."""
    x_min, x_max, y_min, y_max = geometry.extent_m
    tall_px = min(_PAGE_PX * aspect(geometry), _TALL_PX)
    return min(_PAGE_PX / (x_max - x_min), tall_px / (y_max - y_min))


def metric_axes(fig: go.Figure, geometry: GridGeometry) -> None:
    """Show all of a grid and nothing else, a metre as long up as across."""
    x_min, x_max, y_min, y_max = geometry.extent_m
    looks = {"showgrid": False, "zeroline": False, "constrain": "domain"}
    fig.update_xaxes(title="x [m]", range=[x_min, x_max], **looks)
    fig.update_yaxes(title="y [m]", range=[y_min, y_max], scaleanchor="x", **looks)
    fig.update_layout(plot_bgcolor=_GROUND, meta={"ground": True}, dragmode="pan")
