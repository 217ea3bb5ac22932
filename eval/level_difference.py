# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Difference of two maps of received levels, such as a measured and a predicted one."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from slarm_graph.counts import count_of
from slarm_graph.errors import BadInput
from slarm_graph.eval.metrics import Metric
from slarm_graph.geometry import Floats
from slarm_graph.grid import GridGeometry
from slarm_graph.radio.levels import LevelMap, common_names

_NORMAL_95 = 1.96
"""Half width of the central 95 % of a standard normal distribution."""
_COLUMNS, _SIDE_IN, _BAR_IN, _DPI = 3, 2.1, 0.86, 300
"""Maps beside each other; three and the bar of colours fill the 7.16 in of a page of two columns in
IEEE's journals, which ask for so many dots per inch."""
_SHOWN_SHARE = 0.98
"""Share of the differences within the limits of the colour scale; the rest has its end colours."""
_NOTHING = "0.75"
"""Grey of cells that are not compared."""


@dataclass(frozen=True, slots=True)
class LevelDifference:
    """Estimate minus reference, on the reference's cells.

    Parameters
    ----------
    geometry : GridGeometry
    names : tuple of str, length A
        Access points in both maps.
    difference_db : (A, rows, cols) float64
        nan where either has no level.
    sd_db : (A, rows, cols) float64
        Its standard deviation, from those of both maps, taken as independent.
    """

    geometry: GridGeometry
    names: tuple[str, ...]
    difference_db: Floats
    sd_db: Floats

    def metrics(self) -> tuple[Metric, ...]:
        """Return the metrics over all access points; the notes list each."""
        each = [one[np.isfinite(one)] for one in self.difference_db]
        whole = np.concatenate(each)
        rms = ", ".join(
            f"{name} {np.sqrt(np.mean(one**2)) if len(one) else np.nan:.2f}"
            for name, one in zip(self.names, each, strict=True)
        )
        bias = ", ".join(
            f"{name} {one.mean() if len(one) else np.nan:+.2f}"
            for name, one in zip(self.names, each, strict=True)
        )
        known = np.isfinite(self.difference_db) & np.isfinite(self.sd_db)
        sure = (np.abs(self.difference_db) > _NORMAL_95 * self.sd_db)[known]
        points = count_of(len(each), "access point")
        return (
            Metric("levels_rmse_db", float(np.sqrt(np.mean(whole**2))), note=rms),
            Metric("levels_bias_db", float(whole.mean()), note=bias),
            Metric("levels_mae_db", float(np.abs(whole).mean())),
            Metric("levels_differ", float(sure.mean()) if len(sure) else np.nan),
            Metric("levels_area_m2", self._area_m2(), note=points),
        )

    def _area_m2(self) -> float:
        compared = np.isfinite(self.difference_db).any(axis=0)
        return float(compared.sum()) * self.geometry.resolution_m**2


def level_difference(reference: LevelMap, estimate: LevelMap) -> LevelDifference:
    """Compare the access points that both maps have, by name, at the reference's cell centres.

    Raises
    ------
    BadInput
        When no access point, or no cell, is in both.
    """
    names, centers = common_names(reference, estimate), reference.geometry.centers()

    def at(layer: NDArray[np.float32]) -> Floats:
        """Sample a layer of the estimate at the reference's cell centres."""
        sampled = estimate.geometry.sample(layer, centers, outside=np.nan)
        return np.asarray(sampled, dtype=np.float64)

    ref = [reference.names.index(name) for name in names]
    est = [estimate.names.index(name) for name in names]
    level = np.stack([at(estimate.level_dbm[i]) for i in est])
    spread = np.stack([at(estimate.sd_db[i]) for i in est])
    difference_db = level - reference.level_dbm[ref]
    if not np.isfinite(difference_db).any():
        raise BadInput("no cell has a level in both maps: are they in one frame?")
    sd_db = np.hypot(spread, reference.sd_db[ref])
    return LevelDifference(reference.geometry, names, difference_db, sd_db)


def save_level_difference(path: Path, made: LevelDifference) -> None:
    """Write a map per access point; the file extension is the format: PNG, PDF, SVG ..."""
    columns = min(_COLUMNS, len(made.names))
    rows = -(-len(made.names) // columns)
    size = (_SIDE_IN * columns + _BAR_IN, _SIDE_IN * rows)
    figure = Figure(figsize=size, layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    finite = np.abs(made.difference_db[np.isfinite(made.difference_db)])
    limit = max(float(np.quantile(finite, _SHOWN_SHARE)), 0.1) if len(finite) else 1.0
    for axis, name, layer in zip(axes, made.names, made.difference_db, strict=False):
        axis.set_facecolor(_NOTHING)  # white is "no difference"
        shown = axis.imshow(
            layer,
            cmap="RdBu_r",
            vmin=-limit,
            vmax=limit,
            origin="lower",
            extent=made.geometry.extent_m,
            interpolation="none",
        )
        axis.set_title(name, fontsize=8)
        axis.set_xlabel("x [m]", fontsize=8)
        axis.tick_params(labelsize=7)
    for axis in axes[len(made.names) :]:
        axis.set_axis_off()
    axes[0].set_ylabel("y [m]", fontsize=8)
    bar = figure.colorbar(shown, ax=axes.tolist(), shrink=0.8, extend="both")
    bar.set_label("EST less REF [dB]", fontsize=8)
    bar.ax.tick_params(labelsize=7)
    figure.savefig(path, dpi=_DPI)
