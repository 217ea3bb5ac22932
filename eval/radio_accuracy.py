# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Accuracy of a recovered geographic and radio map against the theoretical radio map.

`accuracy` is the paper's metric as defined here: the share of the reference's accessible cells that
the final map calls accessible and whose gain is right within the tolerance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slarm_graph.access_points import RadioMap
from slarm_graph.counts import count_of
from slarm_graph.errors import BadInput
from slarm_graph.eval.radio_scores import LinkAccuracy, RadioAccuracy
from slarm_graph.geographic import GeographicMap
from slarm_graph.geometry import Floats
from slarm_graph.grid import GridGeometry, Mask, Scalar
from slarm_graph.radio.path_loss import smallest_blocking_gap_db

Extent = tuple[float, float, float, float]
"""x_min, x_max, y_min, y_max [m]."""


def radio_accuracy(
    reference_accessible: Mask,
    reference: RadioMap,
    geographic: GeographicMap,
    estimate: RadioMap,
    *,
    tolerance_db: float = 1.0,
    extent_m: Extent | None = None,
) -> RadioAccuracy:
    """Compare a recovered map with the truth, on the reference's lattice, for every access point.

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
        On the geographic map's lattice, of the same access points in the same order.
    tolerance_db : float
    extent_m : (x_min, x_max, y_min, y_max), optional
        Area that is compared; cells at its edge count by their area inside.

    Raises
    ------
    BadInput
        When no reference cell is accessible, or the access points do not correspond.
    """
    area = _weights(reference.geometry, extent_m)
    if not (area * reference_accessible).any():
        raise BadInput("the reference has no accessible cell")
    if len(reference.access_points) != len(estimate.access_points):
        raise BadInput(
            f"the reference has {count_of(len(reference.access_points), 'access point')}, the"
            f" estimate {len(estimate.access_points)}: compare maps of the same ones"
        )
    cells = _looked_up(reference, geographic, estimate)
    both = cells.accessible & reference_accessible
    links = tuple(
        _link(reference, n, cells, reference_accessible, area, tolerance_db)
        for n in range(len(reference.access_points))
    )
    gaps = [_smallest_gap_db(reference, reference_accessible, n) for n in range(len(links))]
    return RadioAccuracy(
        links=links,
        coverage_accessible=_share(area, both, reference_accessible),
        coverage_observed=_share(area, cells.observed, reference_accessible),
        coverage_visited=_share(area, cells.visited, reference_accessible),
        coverage_footprint=_share(area, cells.footprint, reference_accessible),
        false_accessible=_false_share(geographic, reference, reference_accessible, extent_m),
        iou=_share(area, both, cells.accessible | reference_accessible),
        tolerance_db=tolerance_db,
        expansion_radius_m=geographic.expansion_radius_m,
        smallest_gap_db=min(gaps),
    )


def _link(
    reference: RadioMap,
    n: int,
    cells: _LookedUp,
    reference_accessible: Mask,
    area: Floats,
    tolerance_db: float,
) -> LinkAccuracy:
    """Compute the accuracy of the n-th access point."""
    both = cells.accessible & reference_accessible
    error_db, sight = cells.gain_error_db[n], reference.line_of_sight[n]
    hit = both & (error_db <= tolerance_db)
    # Missing gains count as misses; the dB figures are over the gains that exist.
    compared = both & np.isfinite(error_db)
    unknown = reference.sight_unknown[n]
    # Three classes: clear, blocked, unknown; a map agrees with itself everywhere.
    agrees = both & (cells.unknown[n] == unknown) & (cells.sight[n] == sight)
    missed = (cells.probability[n] - reference.sight_probability[n])[both] ** 2
    return LinkAccuracy(
        access_point=reference.access_points[n].name,
        accuracy=_share(area, hit, reference_accessible),
        gain_hit=_share(area, hit, both),
        los_agreement=_share(area, agrees, both),
        los_unknown=_share(area, cells.unknown[n], both),
        los_unknown_reference=_share(area, unknown, both),
        los_brier=_mean(missed, area[both]),
        gain_rmse_db=_mean(error_db[compared] ** 2, area[compared]) ** 0.5,
        gain_mae_db=_mean(error_db[compared], area[compared]),
    )


@dataclass(frozen=True, slots=True)
class _LookedUp:
    """The estimate at every cell centre of the reference; nan where it has no gain.

    Cells are (rows, cols), links (A, rows, cols).
    """

    accessible: Mask
    observed: Mask
    visited: Mask
    footprint: Mask
    sight: Mask
    unknown: Mask
    probability: Floats
    gain_error_db: Floats


def _looked_up(reference: RadioMap, geographic: GeographicMap, estimate: RadioMap) -> _LookedUp:
    lattice, centers = geographic.geometry, reference.geometry.centers()

    def links(layer: NDArray[Scalar], outside: float | bool) -> NDArray[Scalar]:
        """Sample a layer (A, ...) of every access point."""
        return np.stack([lattice.sample(one, centers, outside=outside) for one in layer])

    gain_db = links(estimate.channel_power_gain_db, np.nan)
    return _LookedUp(
        lattice.sample(geographic.accessible, centers, outside=False),
        lattice.sample(geographic.coverage.observed, centers, outside=False),
        lattice.sample(geographic.coverage.visited, centers, outside=False),
        lattice.sample(geographic.coverage.footprint, centers, outside=False),
        links(estimate.line_of_sight, outside=False),
        links(estimate.sight_unknown, outside=False),
        links(estimate.sight_probability, 0.0).astype(np.float64),
        np.abs(gain_db - reference.channel_power_gain_db).astype(np.float64),
    )


def _share(area: Floats, of: Mask, among: Mask) -> float:
    """Area of the cells in both masks over that of the second; 0 when that is empty."""
    total = float(area[among].sum())
    return float(area[of & among].sum()) / total if total else 0.0


def _mean(values: Floats, weights: Floats) -> float:
    """Weighted mean of (N,) values; nan when there are none."""
    total = float(weights.sum())
    return float((weights * values).sum()) / total if total else math.nan


def _weights(geometry: GridGeometry, extent_m: Extent | None) -> Floats:
    """Area of every cell (rows, cols) inside the extent, as a share of a whole cell."""
    return np.ones(geometry.shape) if extent_m is None else geometry.share_within(*extent_m)


def _false_share(
    geographic: GeographicMap,
    reference: RadioMap,
    reference_accessible: Mask,
    extent_m: Extent | None,
) -> float:
    """Share of the map's own accessible area whose cell centre is not accessible in truth."""
    called = geographic.accessible
    area = _weights(geographic.geometry, extent_m)
    centers = geographic.geometry.centers()
    true = reference.geometry.sample(reference_accessible, centers, outside=False)
    return _share(area, ~true, called)


def _smallest_gap_db(reference: RadioMap, accessible: Mask, access_point: int) -> float:
    ap = reference.access_points[access_point]
    off_m = reference.geometry.centers()[accessible] - ap.position_m()[:2]
    rise_m = ap.z_m - reference.antenna_height_m
    distances_m = np.sqrt(np.sum(off_m**2, axis=1) + rise_m**2)
    return smallest_blocking_gap_db(ap.frequency_hz, reference.scenario, distances_m)
