# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Figures 3 to 5 of the paper, and its complexity, drawn from our numbers; the page with them."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from slarm_graph.access_points import RadioMap
from slarm_graph.eval.page import Cell, Gallery, PageTable, Section, page
from slarm_graph.paper.theory import Complexity
from slarm_graph.radio.pictures import draw_gain

_DPI: Final = 130
"""Of pictures on a screen: 130 pixels to the inch make them as wide as the page."""
_KNOWN_SIZES: Final = ", with sizes"
"""End of the labels of curves that are drawn broken."""


@dataclass(frozen=True, slots=True)
class Curve:
    """A line of figure 5: accuracy with standard deviation over resolutions."""

    label: str
    panel: str
    resolution_m: Sequence[float]
    accuracy: Sequence[float]
    spread: Sequence[float]


def save_gain_figure(path: Path, title: str, maps: Sequence[tuple[float, RadioMap]]) -> None:
    """Draw gain maps side by side on one colour scale.

    Parameters
    ----------
    path : Path
    title : str
    maps : sequence of (resolution [m], RadioMap)
    """
    if not maps:
        return
    gains = np.concatenate([m.channel_power_gain_db.ravel() for _, m in maps])
    limits = (float(np.nanmin(gains)), float(np.nanmax(gains)))
    figure = Figure(figsize=(5.2 * len(maps), 4.2), layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(title)
    for axes, (resolution_m, radio) in zip(
        figure.subplots(1, len(maps), squeeze=False)[0], maps, strict=True
    ):
        draw_gain(axes, radio, 0, limits_db=limits)
        axes.set_title(f"resolution {resolution_m:g} m")
    figure.savefig(path, dpi=_DPI)


def save_accuracy_figure(
    path: Path, title: str, curves: Sequence[Curve], paper: Sequence[tuple[float, float, str]]
) -> None:
    """Draw accuracy over resolution, a panel per kind of curve in the order in which they come."""
    panels = list(dict.fromkeys(curve.panel for curve in curves))
    figure = Figure(figsize=(5.0 * len(panels), 5.4), layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(title)
    all_axes = figure.subplots(1, len(panels), sharey=True, squeeze=False)[0]
    shared: dict[str, Artist] = {}
    for axes, panel in zip(all_axes, panels, strict=True):
        _draw_panel(axes, [c for c in curves if c.panel == panel], paper)
        axes.set_title(panel)
        handles, labels = axes.get_legend_handles_labels()
        if sum({c.label for c in curves if c.panel == p} == set(labels) for p in panels) > 1:
            shared |= dict(zip(labels, handles, strict=True))
        else:
            axes.legend(fontsize=7, handlelength=3.5)
    if shared:
        figure.legend(
            list(shared.values()),
            list(shared),
            loc="outside lower center",
            ncols=6,
            fontsize=8,
            handlelength=3.5,
        )
    all_axes[0].set_ylabel("accuracy [%]")
    figure.savefig(path, dpi=_DPI)


def save_times_figure(
    path: Path, explorer: str, lines: Mapping[str, Sequence[tuple[float, float, float, float]]]
) -> None:
    """Draw drive, planning and wall time over the cell size.

    Parameters
    ----------
    path : Path
    explorer : str
    lines : mapping of label to (resolution [m], drive [s], planning [s], wall [s])
    """
    figure = Figure(figsize=(13.0, 4.2), layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(
        f"{explorer} in closed loop: completion time. The paper says it grows with the resolution;"
        " it does as cells get finer"
    )
    names = ("driving, simulated", "planning, processor", "whole run, wall clock")
    for n, (axes, name) in enumerate(zip(figure.subplots(1, 3), names, strict=True)):
        for label, points in lines.items():
            x, y = [point[0] for point in points], [point[n + 1] for point in points]
            axes.plot(x, y, "o-", label=label, markersize=3)
        axes.set_title(name)
        axes.set_xlabel("resolution [m]")
        axes.set_ylabel("time [s]")
        axes.set_yscale("log")
        axes.grid(alpha=0.3)
    figure.axes[0].legend(fontsize=7)
    figure.savefig(path, dpi=_DPI)


def save_complexity_figure(path: Path, table: Sequence[Complexity]) -> None:
    """Draw what Algorithm 1 was counted to take beside the paper's bounds."""
    figure = Figure(figsize=(11.0, 4.2), layout="constrained")
    FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2)
    side = np.sqrt([row.cells for row in table])
    left.loglog(side, [row.comparisons for row in table], "o-", label="comparisons, counted")
    left.loglog(side, side**2, ":", color="0.5", label="N$^2$")
    left.loglog(side, side**3, "--", color="0.5", label="N$^3$ (paper, best case)")
    left.set_xlabel("N, side of the grid [cells]")
    left.set_title("Algorithm 1, comparisons: each cell is looked at about once and a half")
    left.legend()
    resolution = [row.resolution_m for row in table]
    right.plot(resolution, [row.drive_s for row in table], "o-")
    right.set_xlabel("resolution [m]")
    right.set_ylabel("time of driving [s]")
    right.set_title("Algorithm 1, time to visit every cell at 0.6 m/s")
    right.set_ylim(bottom=0)
    figure.savefig(path, dpi=_DPI)


def _draw_panel(
    axes: Axes, curves: Sequence[Curve], paper: Sequence[tuple[float, float, str]]
) -> None:
    names = [c.label.rpartition(", with")[0] or c.label for c in curves]
    for name, curve in zip(names, curves, strict=True):
        color = f"C{sorted(set(names)).index(name)}"
        style = "--" if curve.label.endswith(_KNOWN_SIZES) else "-"
        percent, spread = 100 * np.array(curve.accuracy), 100 * np.array(curve.spread)
        axes.errorbar(
            curve.resolution_m,
            percent,
            spread,
            fmt=f"o{style}",
            color=color,
            label=curve.label,
            markersize=3,
            capsize=2,
        )
    for resolution_m, accuracy, label in paper:
        axes.plot(resolution_m, 100 * accuracy, "k*", markersize=10)
        axes.annotate(
            f"{label} {100 * accuracy:.2f}",
            (resolution_m, 100 * accuracy),
            textcoords="offset points",
            xytext=(6, -12),
            fontsize=8,
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.7, "pad": 1.0},
        )
    axes.set_xlabel("resolution [m]")
    axes.grid(alpha=0.3)


def gallery_html(
    folder: Path, title: str, lead: str, pictures: Sequence[str], tables: Sequence[str]
) -> str:
    """Return a page with pictures, then tables, of those that are in the folder.

    Parameters
    ----------
    folder : Path
    title, lead : str
    pictures, tables : sequence of str
        File names; PNG and CSV.
    """
    shown = [
        Section(_title(name), (Gallery([(name, (folder / name).read_bytes())]),))
        for name in pictures
        if (folder / name).is_file()
    ]
    rows = [
        Section(_title(name), (_csv_table(folder / name),))
        for name in tables
        if (folder / name).is_file()
    ]
    return page(title, lead, (), [*shown, *rows])


def _csv_table(path: Path) -> PageTable:
    with path.open(newline="", encoding="utf-8") as file:
        columns, *rows = csv.reader(file)
    return PageTable(columns, [[_number(cell) for cell in row] for row in rows])


def _number(text: str) -> Cell:
    try:
        return float(text)
    except ValueError:
        return text


def _title(name: str) -> str:
    return name.rpartition(".")[0].replace("_", " ").capitalize()
