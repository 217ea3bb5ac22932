# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Trajectories over the occupancy grid, with what belongs to their poses."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import plotly.graph_objects as go

from slarm_graph.eval.page import COLORS, Figure, plain, single
from slarm_graph.eval.report_figures import aspect, map_picture, metric_axes, put_map_below
from slarm_graph.geometry import Floats
from slarm_graph.grid import OccupancyGrid
from slarm_graph.trajectory import Trajectory

_MAX_PATH_POINTS = 4_000
"""Points of a path: several per pixel of the page's width of 1000 pixels."""

RAW_ODOMETRY, GROUND_TRUTH = "raw odometry", "ground truth"
_STYLES = {
    RAW_ODOMETRY: {"color": "#c26a1b", "width": 1, "dash": "dot"},
    GROUND_TRUTH: {"color": "#a0a0a0", "width": 5},
}
"""Truth lies wide beneath, so that the estimate is seen on it; grey, as in print, because every
other colour is an estimate's. Widths in pixels."""

_ELLIPSES = 30
"""More would cover the path."""
CHI_95 = math.sqrt(5.991)
"""95 % of a normal distribution in the plane lie within so many standard deviations."""
_CIRCLE = np.stack([f(np.linspace(0.0, 2.0 * np.pi, 25)) for f in (np.cos, np.sin)])
"""Of 24 chords, which is round at the size of an ellipse on the page."""


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
        _put_line(fig, line, f"loop closures ({len(marks.closures)})", "#009e73", 200)
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
    _put_line(fig, line, "95 % ellipses", "#cc79a7", 220)


def _put_line(fig: go.Figure, line: Floats, name: str, color: str, rank: int) -> None:
    """Draw a line (N, 2) with gaps of nan, to be switched on in the legend."""
    fig.add_scatter(
        x=single(line[:, 0]),
        y=single(line[:, 1]),
        mode="lines",
        name=name,
        line={"color": color, "width": 1},
        hoverinfo="skip",
        visible="legendonly",
        legendrank=rank,
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
