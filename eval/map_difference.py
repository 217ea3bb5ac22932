# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""A figure of the differences of two occupancy grids, with an enlarged detail."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from slarm_graph.eval.map_accuracy import classes_on
from slarm_graph.geometry import Pose2
from slarm_graph.grid import GridGeometry, OccupancyGrid

_UNKNOWN, _FREE, _BOTH, _ESTIMATE, _REFERENCE = range(5)
"""Codes of the classes of cells."""
CLASS_STYLES = {
    _BOTH: ("wall in both", "#000000"),
    _ESTIMATE: ("wall only in EST", "#d55e00"),
    _REFERENCE: ("wall only in REF", "#0072b2"),
    _FREE: ("free in both", "#ffffff"),
    _UNKNOWN: ("unknown in either", "#dedede"),
}
"""Label and colour of every class; vermilion and blue of Okabe and Ito suit colour-blind people."""
_CLOSER_SHARE = 0.25
"""Side of the enlarged detail, as a share of the map's longer side."""
_WIDTH_IN, _DPI = 7.16, 300
"""Width of a page of two columns in IEEE's journals [in], and the resolution they ask for."""


def difference_classes(
    reference: OccupancyGrid, estimate: OccupancyGrid, reference_from_estimate: Pose2 | None = None
) -> NDArray[np.uint8]:
    """Return the class of every cell (rows, cols) of the reference: what it is in both maps."""
    occupied, free = classes_on(reference, estimate, reference_from_estimate or Pose2())
    classes = np.full(reference.geometry.shape, _UNKNOWN, dtype=np.uint8)
    classes[reference.free & free] = _FREE
    classes[reference.occupied & occupied] = _BOTH
    classes[reference.free & occupied] = _ESTIMATE
    classes[reference.occupied & free] = _REFERENCE
    return classes


def save_difference(
    path: Path,
    reference: OccupancyGrid,
    estimate: OccupancyGrid,
    reference_from_estimate: Pose2 | None = None,
) -> None:
    """Write the figure; the file extension is the format: PNG, PDF, SVG ..."""
    classes = difference_classes(reference, estimate, reference_from_estimate)
    geometry = reference.geometry
    figure = Figure(figsize=(_WIDTH_IN, 3.9), layout="constrained")
    whole, closer = figure.subplots(1, 2)
    for axes in (whole, closer):
        axes.imshow(
            classes,
            cmap=ListedColormap([CLASS_STYLES[kind][1] for kind in sorted(CLASS_STYLES)]),
            vmin=-0.5,
            vmax=len(CLASS_STYLES) - 0.5,
            origin="lower",
            extent=geometry.extent_m,
            interpolation="none",
        )
        axes.set_aspect("equal")
        axes.autoscale(False)
        axes.tick_params(labelsize=7)
        axes.set_xlabel("x [m]", fontsize=8)
    whole.set_ylabel("y [m]", fontsize=8)
    x_m, y_m, side_m = densest_difference(classes, geometry)
    closer.set_xlim(x_m, x_m + side_m)
    closer.set_ylim(y_m, y_m + side_m)
    closer.set_title(_differing(classes), fontsize=8)
    frame = Rectangle((x_m, y_m), side_m, side_m, fill=False, lw=0.8, ls="--", ec="#009e73")
    whole.add_patch(frame)
    for axes in (whole, closer):
        _add_scale(axes)
    handles = [
        Patch(facecolor=color, edgecolor="#888888", lw=0.5, label=label)
        for label, color in CLASS_STYLES.values()
    ]
    figure.legend(
        handles=handles, loc="outside upper center", ncols=len(handles), fontsize=7, frameon=False
    )
    figure.savefig(path, dpi=_DPI, bbox_inches="tight")


def densest_difference(
    classes: NDArray[np.uint8], geometry: GridGeometry
) -> tuple[float, float, float]:
    """Return the lower left corner and side of the square with the most differing cells [m].

    Where none differs, that with the most walls.
    """
    cells = max(2, round(_CLOSER_SHARE * max(classes.shape)))
    differs = _differs(classes) if _differs(classes).any() else classes == _BOTH
    density = uniform_filter(differs.astype(np.float64), cells, mode="constant")
    row, col = np.unravel_index(int(density.argmax()), density.shape)
    x_m, y_m = geometry.center_of(np.array([[row, col]]))[0]
    side_m = cells * geometry.resolution_m
    return float(x_m) - side_m / 2.0, float(y_m) - side_m / 2.0, side_m


def _differs(classes: NDArray[np.uint8]) -> NDArray[np.bool_]:
    return np.isin(classes, (_ESTIMATE, _REFERENCE))


def _differing(classes: NDArray[np.uint8]) -> str:
    count = int(_differs(classes).sum())
    return f"where they differ most (cells in all: {count})" if count else "no cell differs"


def _add_scale(axes: Axes) -> None:
    (x_min, x_max), (y_min, y_max) = axes.get_xlim(), axes.get_ylim()
    power = 10.0 ** math.floor(math.log10((x_max - x_min) / 3.0))
    length_m = max(n for n in (1.0, 2.0, 5.0) if n * power <= (x_max - x_min) / 3.0) * power
    x, y = x_min + 0.04 * (x_max - x_min), y_min + 0.05 * (y_max - y_min)
    box = {"facecolor": "white", "alpha": 0.8, "linewidth": 0, "pad": 1.0}
    axes.plot([x, x + length_m], [y, y], color="black", lw=2.5, solid_capstyle="butt")
    axes.text(x, y + 0.015 * (y_max - y_min), f"{length_m:g} m", fontsize=7, va="bottom", bbox=box)
