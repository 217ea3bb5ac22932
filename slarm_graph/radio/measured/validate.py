# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Spatial block cross-validation of measured maps.

Neighbouring readings share their fading, so leaving out random ones flatters every method; blocks
of a metre and more test what the map is there for (Roberts et al. 2017, Ecography 40).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse, stats

from slarm_graph.geometry import Floats
from slarm_graph.radio.measured.fit import Fit, log_student_t
from slarm_graph.radio.measured.mean_function import MeanFunction
from slarm_graph.radio.measured.nodes import Nodes
from slarm_graph.radio.measured.readings import RssReadings

BLOCK_M, FOLDS = 1.0, 5
"""Side of a block, several wavelengths; and number of folds, 80 % to train on."""


def block_folds(points_m: Floats, rng: np.random.Generator) -> NDArray[np.int64]:
    """Assign blocks of floor to folds at random; return the fold (N,) of points (N, 2) [m]."""
    blocks = np.floor(points_m / BLOCK_M).astype(np.int64)
    names, member = np.unique(blocks, axis=0, return_inverse=True)
    fold = np.arange(len(names)) % FOLDS
    return np.asarray(rng.permutation(fold)[member.ravel()])


@dataclass(frozen=True, slots=True)
class Predicted:
    """Predictive distributions of N readings, Student's t.

    Parameters
    ----------
    mean_dbm, scale_db : (N,) float64
    freedom : float
    """

    mean_dbm: Floats
    scale_db: Floats
    freedom: float

    def within(self, rss_dbm: Floats, share: float = 0.95) -> NDArray[np.bool_]:
        """Whether readings (N,) lie in the central prediction interval of a probability."""
        half = stats.t.ppf(0.5 + 0.5 * share, self.freedom)
        return np.asarray(np.abs(rss_dbm - self.mean_dbm) <= half * self.scale_db)

    def log_score(self, rss_dbm: Floats) -> Floats:
        """Log predictive density (N,) of readings [log 1/dB]; more is better."""
        scaled = (rss_dbm - self.mean_dbm) / self.scale_db
        return np.asarray(log_student_t(scaled, self.freedom) - np.log(self.scale_db))


def predict_readings(
    fit: Fit, nodes: Nodes, mean: MeanFunction, readings: RssReadings, *, with_drift: bool = True
) -> Predicted:
    """Predict readings at poses and times.

    Parameters
    ----------
    fit : Fit
    nodes : Nodes
        Of the fit.
    mean : MeanFunction
    readings : RssReadings
        Its values are not used.
    with_drift : bool
        Whether drift and antenna pattern at that instant are used; else the map alone predicts.
    """
    hyper, count = fit.hyper, len(readings)
    design, map_variance_db2 = mean.reading_design_and_variance(readings)
    if not with_drift:
        design[:, mean.terms + readings.classes - 1 :] = 0.0
    field = nodes.weights(readings.points_m)
    bridge = sparse.csr_array((count, len(fit.drift_times_s)))
    left_db2 = np.full(count, hyper.drift_sd_db**2)
    if with_drift and len(fit.drift_times_s) > 1:
        bridge, share = _bridge(readings.times_s, fit.drift_times_s, hyper.drift_s)
        left_db2 *= share
    observation = sparse.csr_array(sparse.hstack([field, bridge], format="csr"))
    variance = fit.posterior.variance(design, observation) + left_db2 + map_variance_db2
    variance += hyper.noise_sd_db[readings.noise_class] ** 2
    return Predicted(fit.posterior.mean(design, observation), np.sqrt(variance), hyper.freedom)


def _bridge(
    times_s: Floats, kept_s: Floats, correlation_s: float
) -> tuple[sparse.csr_array, Floats]:
    """Interpolate the drift: weights (N, T) of its state, and the share of variance left."""
    after = np.clip(kept_s.searchsorted(times_s, side="right"), 1, len(kept_s) - 1)
    to_left = np.exp(-np.abs(times_s - kept_s[after - 1]) / correlation_s)
    to_right = np.exp(-np.abs(times_s - kept_s[after]) / correlation_s)
    between = np.exp(-(kept_s[after] - kept_s[after - 1]) / correlation_s)
    gain = 1.0 / np.maximum(1.0 - between**2, 1e-12)
    left = (to_left - to_right * between) * gain
    right = (to_right - to_left * between) * gain
    rows = np.tile(np.arange(len(times_s)), 2)
    columns = np.concatenate([after - 1, after])
    weights = sparse.csr_array(
        (np.concatenate([left, right]), (rows, columns)), shape=(len(times_s), len(kept_s))
    )
    return weights, np.clip(1.0 - left * to_left - right * to_right, 0.0, 1.0)
