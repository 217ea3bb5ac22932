# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Plots of evaluated trajectories for print: paths, errors along them, errors by length."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.transforms import Affine2D

from slarm_graph.eval.alignment import Alignment, positions
from slarm_graph.eval.evaluation import Evaluation
from slarm_graph.eval.trajectory_accuracy import (
    absolute_errors,
    absolute_rotations_rad,
    drift,
    statistics,
)
from slarm_graph.geometry import Floats
from slarm_graph.grid import OccupancyGrid
from slarm_graph.mapping import thinned

KINDS = ("png", "pdf", "svg")
_COLORS = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00")
"""Colours of Okabe and Ito, which suit colour-blind people."""
_DASHES = ("-", "--", "-.", ":")
"""Line styles, which distinguish lines in grey print, too."""
_WIDTH_IN, _WIDE_IN = 3.5, 7.16
"""Widths of a column and a page of IEEE's journals [in]."""
_STYLE = Path(__file__).with_name("trajectory_plots.mplstyle")
_DRAWN = 5_000
"""Most points of a line; more than a page has dots across only make files large."""

Evaluations = Mapping[str, Evaluation]
BackgroundMap = tuple[OccupancyGrid, Alignment]
"""A map, and the motion that brings it into the reference's frame."""


def save_plots(
    folder: Path, evaluations: Evaluations, below: BackgroundMap | None = None
) -> list[Path]:
    """Write every figure as PNG, PDF and SVG.

    Parameters
    ----------
    folder : Path
        Created if missing.
    evaluations : mapping of str to Evaluation
        By label; all against one reference.
    below : (OccupancyGrid, Alignment), optional
        Drawn below the paths.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with mpl.rc_context(fname=_STYLE):
        figures = {
            "paths": _paths(evaluations, below),
            "error_on_path": _errors_on_paths(evaluations, below),
            "error": _errors(evaluations),
            "rpe_by_length": _boxes(evaluations),
        }
        written = []
        for name, figure in figures.items():
            for kind in KINDS:
                path = folder / f"{name}.{kind}"
                figure.savefig(path, metadata={"Date": None} if kind == "svg" else None)
                written.append(path)
    return written


def _thin(points: Floats) -> Floats:
    return thinned(points, _DRAWN)


def _plain(name: str) -> str:
    """Return a name that matplotlib's legends do not hide."""
    return name.lstrip("_") or "-"


def _paths(evaluations: Evaluations, below: BackgroundMap | None) -> Figure:
    figure = Figure(figsize=(_WIDTH_IN, _WIDTH_IN))
    axes = figure.subplots()
    _add_map(axes, below)
    first = next(iter(evaluations.values()))
    truth = _thin(positions(first.pairs.reference))
    axes.plot(truth[:, 0], truth[:, 1], color="#555555", lw=2.6, alpha=0.45, label="reference")
    for index, (name, found) in enumerate(evaluations.items()):
        moved = _thin(positions(found.alignment.moved(found.pairs.estimate)))
        color, dashes = _COLORS[index % len(_COLORS)], _DASHES[index % len(_DASHES)]
        axes.plot(moved[:, 0], moved[:, 1], label=_plain(name), color=color, ls=dashes)
    _as_a_map(axes, truth)
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.01), ncols=2)
    return figure


def _errors_on_paths(evaluations: Evaluations, below: BackgroundMap | None) -> Figure:
    count = len(evaluations)
    cols = min(count, 2)
    rows = -(-count // cols)
    figure = Figure(figsize=(_WIDTH_IN * cols, 3.1 * rows), layout="constrained")
    panels = np.atleast_1d(figure.subplots(rows, cols, squeeze=False)).ravel()
    errors = [absolute_errors(e.pairs, e.alignment) for e in evaluations.values()]
    top = max(float(np.quantile(e, 0.99)) for e in errors) or 1.0
    for axes, (name, found), error in zip(panels, evaluations.items(), errors, strict=False):
        _add_map(axes, below)
        moved = positions(found.alignment.moved(found.pairs.estimate))[:, :2]
        lines = LineCollection(list(np.stack([moved[:-1], moved[1:]], axis=1)), cmap="viridis")
        lines.set_array(error[1:])
        lines.set_clim(0.0, top)
        lines.set_linewidth(1.8)
        axes.add_collection(lines)
        axes.set_title(f"{_plain(name)}: {statistics(error).rmse:.3f} m RMSE", fontsize=8)
        _as_a_map(axes, moved)
        figure.colorbar(lines, ax=axes, label="position error [m]", shrink=0.8, extend="max")
    for axes in panels[count:]:
        axes.set_axis_off()
    return figure


def _errors(evaluations: Evaluations) -> Figure:
    figure = Figure(figsize=(_WIDE_IN, 4.2), layout="constrained")
    panels = figure.subplots(2, 2, sharey="row")
    for index, (name, found) in enumerate(evaluations.items()):
        pairs, color = found.pairs, _COLORS[index % len(_COLORS)]
        turned = np.degrees(absolute_rotations_rad(pairs, found.alignment))
        for col, along in enumerate((pairs.seconds, pairs.metres)):
            for row, error in enumerate((absolute_errors(pairs, found.alignment), turned)):
                xy = _thin(np.column_stack([along, error]))
                label = _plain(name) if (row, col) == (0, 0) else None
                panels[row, col].plot(xy[:, 0], xy[:, 1], color=color, lw=0.9, label=label)
    panels[0, 0].set_ylabel("position error [m]")
    panels[1, 0].set_ylabel("rotation error [deg]")
    panels[1, 0].set_xlabel("time [s]")
    panels[1, 1].set_xlabel("distance [m]")
    for axes in panels.ravel():
        axes.set_ylim(bottom=0.0)
    figure.legend(loc="outside upper center", ncols=4)
    return figure


def _boxes(evaluations: Evaluations) -> Figure:
    figure = Figure(figsize=(_WIDE_IN, 2.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    width = 0.8 / len(evaluations)
    ticks: list[str] = []
    for index, (name, found) in enumerate(evaluations.items()):
        drifts = drift(found.pairs, scale=found.alignment.scale)
        color = _COLORS[index % len(_COLORS)]
        left.plot([], [], color=color, lw=5, alpha=0.6, label=_plain(name))
        if not drifts:
            continue
        ticks = ticks or [f"{d.length_m:.3g}" for d in drifts]
        places = np.arange(len(drifts)) + (index - (len(evaluations) - 1) / 2) * width
        for axes, values in (
            (left, [100.0 * d.translation_share for d in drifts]),
            (right, [np.degrees(d.rotation_rad_m) for d in drifts]),
        ):
            axes.boxplot(
                values,
                positions=places,
                widths=0.85 * width,
                patch_artist=True,
                showfliers=False,
                manage_ticks=False,
                boxprops={"facecolor": color, "alpha": 0.6, "linewidth": 0.6},
                medianprops={"color": "black"},
            )
    for axes in (left, right):
        axes.set_xticks(range(len(ticks)), ticks)
        axes.set_xlabel("length of the stretch [m]")
        axes.set_ylim(bottom=0.0)
    left.set_ylabel("translation error [%]")
    right.set_ylabel("rotation error [deg/m]")
    figure.legend(loc="outside upper center", ncols=4)
    return figure


def _add_map(axes: Axes, below: BackgroundMap | None) -> None:
    if below is None:
        return
    grid, motion = below
    image = np.full(grid.geometry.shape, 0.93)
    image[grid.free], image[grid.occupied] = 1.0, 0.25
    affine = np.eye(3)
    affine[:2, :2] = motion.scale * motion.rotation[:2, :2]
    affine[:2, 2] = motion.shift_m[:2]
    axes.imshow(
        image,
        cmap="gray",
        vmin=0.0,
        vmax=1.0,
        origin="lower",
        extent=grid.geometry.extent_m,
        transform=Affine2D(affine) + axes.transData,
        interpolation="none",
        zorder=0,
    )


def _as_a_map(axes: Axes, points: Floats) -> None:
    """Set the axes to the points' extent with a margin, and equal scales."""
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    margin = 0.06 * float((high - low).max()) + 0.2
    axes.set_xlim(low[0] - margin, high[0] + margin)
    axes.set_ylim(low[1] - margin, high[1] + margin)
    axes.set_aspect("equal")
    axes.grid(False)
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
