# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Rank candidate sites on walls for one more access point by the coverage they would add."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slarm_graph.access_points import AccessPoint
from slarm_graph.config import RadioConfig
from slarm_graph.errors import BadInput
from slarm_graph.geographic import GeographicMap
from slarm_graph.geometry import Floats
from slarm_graph.grid import Mask
from slarm_graph.radio.connectivity.signal import SignalMap
from slarm_graph.radio.propagation.links import PropagationModel
from slarm_graph.radio.propagation.over_map import links_to

_SPACING_M = 0.5
"""Spacing of candidate sites; half of it moves the best site by no more than that."""

_MOST_CELLS = 20_000
"""Coverage is evaluated on a sample of so many cells: right to 0.4 % (binomial)."""


@dataclass(frozen=True, slots=True)
class CandidateSite:
    """A site on a wall, and the coverage an access point there would add.

    Parameters
    ----------
    x_m, y_m, z_m : float
        In the map [m].
    gained_m2 : float
        Floor that it would cover and no other does.
    share : float
        Share of the floor that would then be covered.
    """

    x_m: float
    y_m: float
    z_m: float
    gained_m2: float
    share: float


def candidate_sites_m(geographic: GeographicMap, spacing_m: float = _SPACING_M) -> Floats:
    """Return sites (K, 2) [m] on walls beside accessible floor, one per square of a given side."""
    floor, wall = np.pad(geographic.accessible, 1), geographic.obstacle
    beside = floor[:-2, 1:-1] | floor[2:, 1:-1] | floor[1:-1, :-2] | floor[1:-1, 2:]
    sites_m = geographic.geometry.center_of(np.argwhere(wall & beside))
    squares = np.floor(sites_m / spacing_m)
    off_m = np.linalg.norm(sites_m - (squares + 0.5) * spacing_m, axis=1)
    order = np.argsort(off_m, kind="stable")
    _, first = np.unique(squares[order], axis=0, return_index=True)
    return np.asarray(sites_m[order[first]])


def rank_sites(
    geographic: GeographicMap,
    signal: SignalMap,
    model: PropagationModel,
    radio: RadioConfig,
    *,
    height_m: float,
    threshold_dbm: float,
) -> tuple[CandidateSite, ...]:
    """Return sites on walls for one more access point, the best first.

    Parameters
    ----------
    geographic : GeographicMap
    signal : SignalMap
        Of the existing access points, on the map's cells.
    model : PropagationModel
        Predicts the new one.
    radio : RadioConfig
        Power and frequency of the new one.
    height_m : float
        Of the new one.
    threshold_dbm : float
        Least level that counts as covered.

    Raises
    ------
    BadInput
        When there is no wall beside the floor.
    """
    sites_m = candidate_sites_m(geographic)
    if not len(sites_m):
        raise BadInput("there is no wall beside the floor where one more access point could hang")
    floor, covered = signal.cells, signal.covered(threshold_dbm)
    points_m, cell_m2 = _uncovered(signal, floor & ~covered)
    ranked = []
    for x, y in sites_m.tolist():
        ap = AccessPoint("another", x, y, height_m, radio.power_dbm, radio.frequency_hz)
        level = radio.power_dbm - _loss_db(geographic, ap, points_m, model, radio)
        gained_m2 = float((level >= threshold_dbm).sum()) * cell_m2
        share = covered.sum() + gained_m2 / signal.geometry.resolution_m**2
        ranked.append(CandidateSite(x, y, height_m, gained_m2, float(share / floor.sum())))
    return tuple(sorted(ranked, key=lambda site: -site.gained_m2))


def _uncovered(signal: SignalMap, open_cells: Mask) -> tuple[Floats, float]:
    """Sample (N, 2) [m] of uncovered cells, and the area that each represents [m^2]."""
    cells = np.argwhere(open_cells)
    stride = max(1, -(-len(cells) // _MOST_CELLS))
    kept = cells[::stride]
    area_m2 = len(cells) * signal.geometry.resolution_m**2
    return signal.geometry.center_of(kept), area_m2 / max(len(kept), 1)


def _loss_db(
    geographic: GeographicMap,
    ap: AccessPoint,
    points_m: Floats,
    model: PropagationModel,
    radio: RadioConfig,
) -> Floats:
    links = links_to(
        geographic.geometry,
        geographic.heights_m,
        ap,
        points_m,
        antenna_height_m=radio.antenna_height_m,
        mount_radius_m=radio.mount_radius_m,
    )
    return model.path_loss_db(links).loss_db
