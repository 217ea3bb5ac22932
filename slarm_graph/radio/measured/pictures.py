# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Figures of measured radio maps: posterior mean and standard deviation side by side."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from slarm_graph.radio.measured.measured_map import MeasuredMap

_DPI, _WIDTH_IN = 110, 9.0
"""Dots per inch of a screen at twice its density, and a column's width in a report [in]."""
_GROUND = "#d9d9d9"


def write_measured_png(path: Path, measured: MeasuredMap) -> None:
    """Write expected level and its standard deviation of every access point, one per row."""
    figure = measured_figure(measured)
    figure.savefig(path, dpi=_DPI, format="png", metadata={"Software": "slarm-graph"})


def measured_figure(measured: MeasuredMap) -> Figure:
    """Draw expected level and its standard deviation of every access point."""
    known = np.isfinite(measured.mean_dbm).any(axis=0)
    cells = np.argwhere(known)
    half_m = 0.5 * measured.geometry.resolution_m
    corner = measured.geometry.center_of(cells.min(axis=0)) - half_m
    far = measured.geometry.center_of(cells.max(axis=0)) + half_m
    width, height = far - corner
    tall_in = min(max(0.42 * _WIDTH_IN * height / width, 1.6), 6.0) + 0.6
    count = len(measured.access_points)
    figure = Figure(figsize=(_WIDTH_IN, count * tall_in), layout="constrained")
    FigureCanvasAgg(figure)
    for index, row in enumerate(figure.subplots(count, 2, squeeze=False)):
        name = measured.access_points[index].name
        for axes, layer, label, colours in (
            (row[0], measured.mean_dbm[index], "expected level [dBm]", "viridis"),
            (row[1], measured.mean_sd_db[index], "its standard deviation [dB]", "magma_r"),
        ):
            axes.set_facecolor(_GROUND)
            image = axes.imshow(
                np.ma.masked_invalid(layer),
                origin="lower",
                extent=measured.geometry.extent_m,
                cmap=colours,
                interpolation="nearest",
            )
            figure.colorbar(image, ax=axes, label=label)
            axes.set(xlim=(corner[0], far[0]), ylim=(corner[1], far[1]))
            axes.set_title(name, parse_math=False)  # a name is text, whatever is in it
            axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
        ap = measured.access_points[index]
        if np.isfinite(ap.x_m):
            row[0].plot(ap.x_m, ap.y_m, "*", color="white", mec="black", ms=12)
    return figure
