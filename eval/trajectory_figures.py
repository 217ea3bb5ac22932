# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Interactive figures of trajectories over the occupancy grid, with marks at poses."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import plotly.graph_objects as go

from slarm_graph.eval.page import COLORS, Figure, plain, single
from slarm_graph.eval.position_uncertainty import CHI_95
from slarm_graph.eval.report_figures import add_background_map, aspect, map_picture, metric_axes
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
"""The ground truth is a wide grey line beneath the estimates, which have all other colours. Widths
in pixels."""

_ELLIPSES = 30
"""Number of confidence ellipses; more would cover the path."""
_CIRCLE = np.stack([f(np.linspace(0.0, 2.0 * np.pi, 25)) for f in (np.cos, np.sin)])
"""Unit circle of 24 chords, which is round at the size of an ellipse on the page."""


@dataclass(frozen=True, slots=True)
class Marks:
    """Marks on the map besides trajectories.

    Parameters
    ----------
    closures : (C, 2, 2) float64
        Both ends of every accepted loop closure [m].
    rejected : sequence of (x, y, words)
        Rejected loop closures, where the robot was [m].
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
    """Return a figure of trajectories by name over the map, the first on top.

    Raw odometry is hidden until it is switched on in the legend.
    """
    picture, geometry = map_picture(grid)
    fig = go.Figure()
    add_background_map(fig, picture, geometry)
    add_trajectories(fig, trajectories)
    marks = marks or Marks()
    first = next(iter(trajectories.values()))
    _add_ellipses(fig, first, marks.covariances)
    _add_closures(fig, marks)
    _add_points(fig, marks.conflicts, "contradictions", "#d55e00", "diamond-open")
    _add_ends(fig, first)
    metric_axes(fig, geometry)
    words = f"Map with the trajectories {', '.join(trajectories)}"
    return Figure(fig, words, aspect=aspect(geometry))


def add_trajectories(fig: go.Figure, trajectories: Mapping[str, Trajectory]) -> None:
    """Draw trajectories by name, the first one on top."""
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


def _add_closures(fig: go.Figure, marks: Marks) -> None:
    if len(marks.closures):
        gaps = np.full((len(marks.closures), 1, 2), np.nan)
        line = np.concatenate([marks.closures, gaps], axis=1).reshape(-1, 2)
        _add_line(fig, line, f"loop closures ({len(marks.closures)})", "#009e73", 200)
    _add_points(fig, marks.rejected, "rejected closures", "#777777", "x", visible="legendonly")


def _add_points(
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


def _add_ellipses(fig: go.Figure, trajectory: Trajectory, covariances: Floats | None) -> None:
    """Draw 95 % confidence ellipses of some poses."""
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
    _add_line(fig, line, "95 % ellipses", "#cc79a7", 220)


def _add_line(fig: go.Figure, line: Floats, name: str, color: str, rank: int) -> None:
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


def _add_ends(fig: go.Figure, trajectory: Trajectory) -> None:
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
