# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Interactive curves: errors along the path, and a backend's own figures over time."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from slarm_graph.backend import Table
from slarm_graph.errors import BadInput
from slarm_graph.eval.alignment import align
from slarm_graph.eval.association import associate
from slarm_graph.eval.page import COLORS, Figure, plain, single
from slarm_graph.eval.trajectory_accuracy import absolute_errors, absolute_rotations_rad
from slarm_graph.trajectory import Trajectory

_MAX_POINTS = 3_000
"""Points of a curve: three per pixel of the page's width, so that no peak of a few is lost."""
_FLATTENED = 20.0
"""Where one curve is so many times as high as another, linear axes would flatten that one."""
_TITLES = {
    "n_eff": "effective sample size N_eff",
    "distinct_ancestors": "distinct ancestors",
    "common_update": "updates since all particles had one ancestor",
}
_LEAST_ROWS = 8
"""Fewest rows that are drawn as a curve instead of a table."""
_CURVE_PX, _TITLE_PX = 130, 30
"""Heights of a curve among several, and of the title above it."""
_AROUND_PX = 120
"""Margins of the page's figures, with the axis of time below."""


def error_figure(runs: Mapping[str, tuple[Trajectory, Trajectory]]) -> Figure | None:
    """Return position and rotation errors over time and distance, each estimate SE(2)-aligned.

    Parameters
    ----------
    runs : mapping of str to (Trajectory, Trajectory)
        The true path and the estimate of every run.
    """
    fig = make_subplots(2, 2, shared_yaxes=True, vertical_spacing=0.1, horizontal_spacing=0.05)
    means = []
    for index, (name, (truth, estimate)) in enumerate(runs.items()):
        try:
            pairs = associate(truth, estimate)
        except BadInput:
            continue
        alignment = align(pairs)
        off_m = absolute_errors(pairs, alignment)
        turned = np.degrees(absolute_rotations_rad(pairs, alignment))
        means.append(float(off_m.mean()))
        keep = slice(None, None, max(1, len(off_m) // _MAX_POINTS))
        for row, (error, unit) in enumerate(((off_m, "m"), (turned, "deg")), start=1):
            for col, (along, of) in enumerate(((pairs.seconds, "s"), (pairs.metres, "m")), start=1):
                fig.add_scatter(
                    x=single(along[keep]),
                    y=single(error[keep]),
                    mode="lines",
                    name=plain(name),
                    legendgroup=str(index),
                    showlegend=(row, col) == (1, 1),
                    line={"width": 1.4, "color": COLORS[index % len(COLORS)]},
                    hovertemplate=f"%{{x:.1f}} {of}: %{{y:.3g}} {unit}<extra>{plain(name)}</extra>",
                    row=row,
                    col=col,
                )
    if not means:
        return None
    log = max(means) > _FLATTENED * max(min(means), 1e-9)
    for row, title in ((1, "position error [m]"), (2, "rotation error [deg]")):
        fig.update_yaxes(title=title, row=row, col=1)
        fig.update_yaxes(type="log" if log else "linear", row=row)
    fig.update_xaxes(title="time [s]", row=2, col=1)
    fig.update_xaxes(title="distance [m]", row=2, col=2)
    words = "Errors over time and distance, each estimate laid onto the truth by SE(2)"
    return Figure(fig, words, height_px=560)


def table_figure(table: Table) -> Figure | None:
    """Return a backend's figures over time; None where they are no series of numbers."""
    stamp = next((c for c in ("stamp_ns", "stamp_s") if c in table.columns), None)
    if stamp is None or len(table.rows) < _LEAST_ROWS or table.path() is not None:
        return None
    at = table.columns.index(stamp)
    stamps = np.array([float(row[at]) for row in table.rows])
    seconds = (stamps - stamps[0]) * (1e-9 if stamp == "stamp_ns" else 1.0)
    shown = [c for c in table.columns if _is_series(table, c)]
    if not shown or np.any(np.diff(seconds) < 0):
        return None
    fig = _stacked([_TITLES.get(column, column.replace("_", " ")) for column in shown])
    keep = slice(None, None, max(1, len(seconds) // _MAX_POINTS))
    for row, column in enumerate(shown, start=1):
        index = table.columns.index(column)
        values = np.array([float(r[index]) for r in table.rows])
        title = fig.layout.annotations[row - 1].text
        fig.add_scatter(
            x=single(seconds[keep]),
            y=single(values[keep]),
            mode="lines",
            line={"width": 1.3, "color": COLORS[(row - 1) % len(COLORS)]},
            hovertemplate=f"%{{x:.1f}} s: %{{y:.4g}}<extra>{title}</extra>",
            showlegend=False,
            row=row,
            col=1,
        )
    fig.update_yaxes(rangemode="tozero")
    fig.update_xaxes(title="time [s]", row=len(shown), col=1)
    height_px = (_CURVE_PX + _TITLE_PX) * len(shown) + _AROUND_PX
    return Figure(fig, f"{table.name} over time", height_px=height_px)


def _stacked(titles: Sequence[str]) -> go.Figure:
    """Return axes for curves one above the other, each with its title above it.

    Beside an axis a title of several lines would cover the numbers.
    """
    height_px = (_CURVE_PX + _TITLE_PX) * len(titles)
    names = [plain(title) for title in titles]
    spacing = _TITLE_PX / height_px
    fig = make_subplots(
        len(titles), 1, shared_xaxes=True, vertical_spacing=spacing, subplot_titles=names
    )
    fig.update_annotations(x=0.0, xanchor="left", font_size=13)
    fig.update_layout(showlegend=False, meta={"above": _TITLE_PX})
    return fig


def _is_series(table: Table, column: str) -> bool:
    """Whether a column is a time series: numbers that change, no pose and no flag."""
    if column.startswith(("stamp", "mean_")) or column in ("x_m", "y_m", "theta_rad"):
        return False
    index = table.columns.index(column)
    values = [row[index] for row in table.rows]
    numbers = all(isinstance(v, (int, float)) and math.isfinite(v) for v in values)
    return numbers and len(set(values)) > 2
