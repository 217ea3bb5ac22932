# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Accuracy of a recovered geographic and radio map against the theoretical radio map.

`accuracy` is the paper's figure as settled here: the share of the reference's accessible cells that
the final map calls accessible and whose gain is right within the tolerance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from slarm_graph.access_points import RadioMap
from slarm_graph.errors import BadInput
from slarm_graph.eval.metrics import Metric
from slarm_graph.geographic import GeographicMap
from slarm_graph.geometry import Floats
from slarm_graph.grid import GridGeometry, Mask
from slarm_graph.radio.path_loss import smallest_blocking_gap_db


@dataclass(frozen=True, slots=True)
class RadioAccuracy:
    """Agreement of a recovered map with the truth; shares are by area, from 0 to 1.

    Parameters
    ----------
    accuracy : float
        Reference-accessible, called accessible, and gain within the tolerance.
    coverage_accessible : float
        Share of the reference-accessible cells that are called accessible.
    gain_hit : float
        Share of those whose gain is within the tolerance; accuracy = coverage x gain_hit.
    coverage_observed, coverage_visited, coverage_footprint : float
        The three coverage layers, as shares of the reference-accessible cells.
    los_agreement : float
        Share of the cells accessible in both whose line of sight agrees.
    gain_rmse_db, gain_mae_db : float
        Of the cells accessible in both [dB].
    false_accessible : float
        Cells called accessible that are not, as a share of all that are called so.
    iou : float
        Intersection over union of accessible cells.
    tolerance_db : float
    smallest_gap_db : float
        Smallest loss that blocking adds in a reference-accessible cell [dB].
    """

    accuracy: float
    coverage_accessible: float
    gain_hit: float
    coverage_observed: float
    coverage_visited: float
    coverage_footprint: float
    los_agreement: float
    gain_rmse_db: float
    gain_mae_db: float
    false_accessible: float
    iou: float
    tolerance_db: float
    smallest_gap_db: float

    @property
    def warnings(self) -> tuple[str, ...]:
        """What makes the figures mean less than they seem to."""
        if self.tolerance_db < self.smallest_gap_db:
            return ()
        return (
            f"a tolerance of {self.tolerance_db:g} dB cannot tell blocked from clear links, which"
            f" differ by as little as {self.smallest_gap_db:.2f} dB here",
        )

    def metrics(self) -> tuple[Metric, ...]:
        """Return the figures under the names of the run folder's contract."""
        note = f"|gain error| <= {self.tolerance_db:g} dB"
        shares = ("coverage_observed", "coverage_visited", "coverage_footprint", "gain_hit")
        others = ("coverage_accessible", "los_agreement", "false_accessible", "iou")
        return (
            Metric("accuracy", self.accuracy, note="; ".join((note, *self.warnings))),
            *(Metric(name, getattr(self, name)) for name in shares + others),
            Metric("gain_rmse_db", self.gain_rmse_db),
            Metric("gain_mae_db", self.gain_mae_db),
        )


def radio_accuracy(
    reference_accessible: Mask,
    reference: RadioMap,
    geographic: GeographicMap,
    estimate: RadioMap,
    *,
    tolerance_db: float = 1.0,
    access_point: int = 0,
    extent_m: tuple[float, float, float, float] | None = None,
) -> RadioAccuracy:
    """Compare a recovered map with the truth, on the reference's lattice.

    The estimate may lie on any lattice of the same frame: it is looked up at the reference's cell
    centres. With a reference on a fixed fine lattice the result is comparable across resolutions
    (`accuracy_area`).

    Parameters
    ----------
    reference_accessible : (rows, cols) bool
        Cells whose centre is free and reachable from the start, in truth.
    reference : RadioMap
        Theoretical, on the same lattice.
    geographic : GeographicMap
    estimate : RadioMap
        On the geographic map's lattice.
    tolerance_db : float
    access_point : int
        Which one to compare.
    extent_m : (x_min, x_max, y_min, y_max), optional
        The true space; cells that stick out count by the area inside.

    Raises
    ------
    BadInput
        When no reference cell is accessible.
    """
    if not reference_accessible.any():
        raise BadInput("the reference has no accessible cell")
    area = cell_weights(reference.geometry, extent_m)
    cells = _looked_up(reference, geographic, estimate, access_point)
    both = cells.accessible & reference_accessible
    hit = both & (cells.gain_error_db <= tolerance_db)
    # Missing gains count as misses; the dB figures are over the gains that exist.
    compared = both & np.isfinite(cells.gain_error_db)
    errors_db, weights = cells.gain_error_db[compared], area[compared]
    return RadioAccuracy(
        accuracy=_share(area, hit, reference_accessible),
        coverage_accessible=_share(area, both, reference_accessible),
        gain_hit=_share(area, hit, both),
        coverage_observed=_share(area, cells.observed, reference_accessible),
        coverage_visited=_share(area, cells.visited, reference_accessible),
        coverage_footprint=_share(area, cells.footprint, reference_accessible),
        los_agreement=_share(area, cells.sight_agrees, both),
        gain_rmse_db=_mean(errors_db**2, weights) ** 0.5,
        gain_mae_db=_mean(errors_db, weights),
        false_accessible=_false_share(geographic, reference, reference_accessible),
        iou=_share(area, both, cells.accessible | reference_accessible),
        tolerance_db=tolerance_db,
        smallest_gap_db=_smallest_gap_db(reference, reference_accessible, access_point),
    )


@dataclass(frozen=True, slots=True)
class _LookedUp:
    """The estimate at every cell centre (rows, cols) of the reference; nan where it has no gain."""

    accessible: Mask
    observed: Mask
    visited: Mask
    footprint: Mask
    sight_agrees: Mask
    gain_error_db: Floats


def _looked_up(
    reference: RadioMap, geographic: GeographicMap, estimate: RadioMap, access_point: int
) -> _LookedUp:
    lattice, centers = geographic.geometry, reference.geometry.centers()
    sight = lattice.sample(estimate.line_of_sight[access_point], centers, outside=False)
    gain_db = lattice.sample(estimate.channel_power_gain_db[access_point], centers, np.nan)
    return _LookedUp(
        lattice.sample(geographic.accessible, centers, outside=False),
        lattice.sample(geographic.coverage.observed, centers, outside=False),
        lattice.sample(geographic.coverage.visited, centers, outside=False),
        lattice.sample(geographic.coverage.footprint, centers, outside=False),
        sight == reference.line_of_sight[access_point],
        np.abs(gain_db - reference.channel_power_gain_db[access_point]).astype(np.float64),
    )


def _share(area: Floats, of: Mask, among: Mask) -> float:
    """Area of the cells in both masks over that of the second; 0 when that is empty."""
    total = float(area[among].sum())
    return float(area[of & among].sum()) / total if total else 0.0


def _mean(values: Floats, weights: Floats) -> float:
    """Weighted mean of (N,) values; nan when there are none."""
    total = float(weights.sum())
    return float((weights * values).sum()) / total if total else math.nan


def cell_weights(
    geometry: GridGeometry, extent_m: tuple[float, float, float, float] | None = None
) -> Floats:
    """Area of every cell (rows, cols) inside the extent, as a share of a whole cell."""
    if extent_m is None:
        return np.ones(geometry.shape)
    x_min, x_max, y_min, y_max = extent_m
    g, step = geometry, geometry.resolution_m
    across = _inside(g.origin_x_m + np.arange(g.cols + 1.0) * step, x_min, x_max)
    up = _inside(g.origin_y_m + np.arange(g.rows + 1.0) * step, y_min, y_max)
    return np.outer(up, across)


def _inside(edges_m: Floats, low_m: float, high_m: float) -> Floats:
    """Share (N,) of every interval between equally spaced edges (N + 1,) within two limits."""
    step = edges_m[1] - edges_m[0]
    # Rounded so that a lattice which fits exactly has weights of exactly one.
    return np.asarray(np.round(np.diff(np.clip(edges_m, low_m, high_m)) / step, 9))


def _false_share(
    geographic: GeographicMap, reference: RadioMap, reference_accessible: Mask
) -> float:
    """Share of the map's own accessible cells whose centre is not accessible in truth."""
    called = geographic.accessible
    if not called.any():
        return 0.0
    centers = geographic.geometry.centers()[called]
    return float(np.mean(~reference.geometry.sample(reference_accessible, centers, outside=False)))


def _smallest_gap_db(reference: RadioMap, accessible: Mask, access_point: int) -> float:
    ap = reference.access_points[access_point]
    off_m = reference.geometry.centers()[accessible] - ap.position_m()[:2]
    rise_m = ap.z_m - reference.antenna_height_m
    distances_m = np.sqrt(np.sum(off_m**2, axis=1) + rise_m**2)
    return smallest_blocking_gap_db(ap.frequency_hz, reference.scenario, distances_m)
