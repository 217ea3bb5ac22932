# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Predict the RSS and its standard deviation in every cell from the fit of an access point."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slarm_graph.access_points import AccessPoint
from slarm_graph.config import RadioConfig
from slarm_graph.geometry import Floats
from slarm_graph.radio.measured.fit import Fit
from slarm_graph.radio.measured.mean_function import MAP_TERMS, MeanFunction
from slarm_graph.radio.measured.measured_map import FittedTerms
from slarm_graph.radio.measured.nodes import Nodes
from slarm_graph.radio.measured.readings import RssReadings

_CELLS_AT_A_TIME = 200_000
"""Bounds the memory of a prediction; more is not faster."""


@dataclass(frozen=True, slots=True)
class FittedAccessPoint:
    """One access point after its fit.

    Parameters
    ----------
    mean : MeanFunction
    readings : RssReadings
    fit : Fit
    position_sd_m : tuple of float
        Of the access point, where it was located by its readings [m].
    """

    mean: MeanFunction
    readings: RssReadings
    fit: Fit
    position_sd_m: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class PredictedAccessPoint:
    """One access point with its fitted terms and the prediction of N cells.

    Parameters
    ----------
    access_point : AccessPoint
    terms : FittedTerms
    levels : (3, N) float32
        Expected level [dBm], its standard deviation and that of a reading [dB].
    """

    access_point: AccessPoint
    terms: FittedTerms
    levels: NDArray[np.float32]


def predict_access_point(
    nodes: Nodes,
    fitted: FittedAccessPoint,
    cells: NDArray[np.int64],
    name: str,
    radio: RadioConfig,
) -> PredictedAccessPoint:
    """Predict cells for one access point.

    Parameters
    ----------
    nodes : Nodes
    fitted : FittedAccessPoint
    cells : (N, 2) int64
        Rows and columns.
    name : str
    radio : RadioConfig
    """
    mean_dbm, variance = predict_cells(nodes, fitted, cells)
    reading = np.sqrt(variance + fitted.fit.reading_sd_db() ** 2)
    levels = np.stack([mean_dbm, np.sqrt(variance), reading]).astype(np.float32)
    return PredictedAccessPoint(_as_access_point(name, fitted, radio), _terms(fitted), levels)


def predict_cells(
    nodes: Nodes, fitted: FittedAccessPoint, cells: NDArray[np.int64]
) -> tuple[Floats, Floats]:
    """Return expected level (N,) [dBm] and its variance (N,) [dB^2] in cells (N, 2)."""
    posterior, terms, count = fitted.fit.posterior, fitted.mean.terms, len(nodes)
    on_nodes = np.column_stack(
        [
            posterior.state[:count],
            posterior.factor.marginal_variances()[:count],
            posterior.state_per_beta[:count],
        ]
    )
    mean_dbm, variance = np.empty(len(cells)), np.empty(len(cells))
    for first in range(0, len(cells), _CELLS_AT_A_TIME):
        part = slice(first, first + _CELLS_AT_A_TIME)
        points_m = nodes.geometry.center_of(cells[part])
        there = nodes.weights(points_m) @ on_nodes
        design = np.zeros((len(points_m), len(posterior.beta)))
        design[:, :terms], map_variance_db2 = fitted.mean.map_design_and_variance(points_m)
        mean_dbm[part] = design @ posterior.beta + there[:, 0]
        variance[part] = (
            map_variance_db2 + there[:, 1] + posterior.coefficient_variance(design, there[:, 2:])
        )
    return mean_dbm, variance


def _as_access_point(name: str, fitted: FittedAccessPoint, radio: RadioConfig) -> AccessPoint:
    """The access point by name; without a position all but its frequency is nan."""
    ap = fitted.mean.access_point
    if ap is None:
        nowhere = float("nan")
        return AccessPoint(name, nowhere, nowhere, nowhere, nowhere, radio.frequency_hz)
    return replace(ap, name=name)


def _terms(fitted: FittedAccessPoint) -> FittedTerms:
    hyper, posterior = fitted.fit.hyper, fitted.fit.posterior
    terms = min(fitted.mean.terms, len(MAP_TERMS))
    values, spread = np.full(3, np.nan), np.full(3, np.nan)
    values[:terms] = posterior.beta[:terms]
    spread[:terms] = np.sqrt(np.diag(posterior.beta_covariance))[:terms]
    level, exponent, wall = (float(v) for v in values)
    return FittedTerms(
        len(fitted.readings),
        int((~fitted.readings.heard).sum()),
        level,
        exponent,
        wall,
        (float(spread[0]), float(spread[1]), float(spread[2])),
        hyper.field_sd_db,
        hyper.range_m,
        hyper.drift_sd_db,
        hyper.drift_s,
        float(hyper.noise_sd_db[0]),
        hyper.freedom,
        fitted.position_sd_m,
    )
