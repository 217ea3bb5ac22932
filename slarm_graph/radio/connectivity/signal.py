# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Signal level of every access point per cell, with outage probability, SNR and SINR."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from slarm_graph.access_points import RadioMap
from slarm_graph.grid import GridGeometry, Mask
from slarm_graph.radio.measured.measured_map import MeasuredMap
from slarm_graph.radio.path_loss import shadow_sigma_db

Layers = NDArray[np.float32]

THERMAL_DBM_HZ = -174.0
"""Thermal noise at 290 K, k T [dBm/Hz]."""


@dataclass(frozen=True, slots=True)
class SignalMap:
    """Received levels of access points over cells.

    Parameters
    ----------
    geometry : GridGeometry
    names : tuple of str, length A
    level_dbm : (A, rows, cols) float32
        Expected received signal strength; nan where no antenna can be.
    spread_db : (A, rows, cols) float32
        Standard deviation of a reading about it.
    """

    geometry: GridGeometry
    names: tuple[str, ...]
    level_dbm: Layers
    spread_db: Layers

    @staticmethod
    def of_prediction(radio: RadioMap) -> SignalMap:
        """Make one of a predicted map; readings spread by the scenario's shadow fading."""
        spread = shadow_sigma_db(radio.line_of_sight, radio.scenario).astype(np.float32)
        names = tuple(ap.name for ap in radio.access_points)
        return SignalMap(radio.geometry, names, radio.rss_dbm, spread)

    @staticmethod
    def of_measured(measured: MeasuredMap) -> SignalMap:
        """Make one of a measured map."""
        names = tuple(ap.name for ap in measured.access_points)
        return SignalMap(measured.geometry, names, measured.mean_dbm, measured.reading_sd_db)

    @property
    def cells(self) -> Mask:
        """Cells (rows, cols) with a level."""
        return np.asarray(np.isfinite(self.level_dbm).any(axis=0))

    def best_level_dbm(self) -> Layers:
        """Level (rows, cols) of the strongest access point; nan where there is none."""
        strongest = np.where(np.isnan(self.level_dbm), -np.inf, self.level_dbm).max(axis=0)
        return np.asarray(np.where(self.cells, strongest, np.nan), dtype=np.float32)

    def covered(self, threshold_dbm: float) -> Mask:
        """Cells (rows, cols) where the strongest access point is at or above a threshold."""
        with np.errstate(invalid="ignore"):
            return np.asarray(self.best_level_dbm() >= threshold_dbm)

    def best_server(self) -> NDArray[np.int64]:
        """Index (rows, cols) of the strongest access point; -1 where there is none."""
        levels = np.where(np.isnan(self.level_dbm), -np.inf, self.level_dbm)
        return np.where(self.cells, levels.argmax(axis=0), -1)

    def outage(self, threshold_dbm: float) -> Layers:
        """Probability (rows, cols) that no access point is above a threshold, taken as independent.

        nan where no antenna can be.
        """
        with np.errstate(invalid="ignore"):
            below = ndtr((threshold_dbm - self.level_dbm) / np.maximum(self.spread_db, 1e-3))
        below = np.where(np.isnan(below), 1.0, below).prod(axis=0)
        return np.asarray(np.where(self.cells, below, np.nan), dtype=np.float32)

    def snr_db(self, noise_dbm: float) -> Layers:
        """Signal to noise ratio (rows, cols) of the best server [dB]."""
        return np.asarray(self.best_level_dbm() - noise_dbm, dtype=np.float32)

    def sinr_db(self, noise_dbm: float) -> Layers:
        """Signal to interference and noise ratio (rows, cols) [dB]; all others interfere."""
        power_mw = 10.0 ** (0.1 * np.nan_to_num(self.level_dbm.astype(np.float64), nan=-400.0))
        best = power_mw.max(axis=0)
        disturbing = power_mw.sum(axis=0) - best + 10.0 ** (0.1 * noise_dbm)
        ratio = 10.0 * np.log10(np.maximum(best, 1e-300) / disturbing)
        return np.asarray(np.where(self.cells, ratio, np.nan), dtype=np.float32)


def noise_floor_dbm(bandwidth_hz: float, noise_figure_db: float) -> float:
    """Return the receiver's noise power in a bandwidth [dBm]."""
    return float(THERMAL_DBM_HZ + 10.0 * np.log10(bandwidth_hz) + noise_figure_db)


@dataclass(frozen=True, slots=True)
class Connection:
    """Coverage statistics of one access point, or of all by the best server.

    Parameters
    ----------
    name : str
    area_m2, share : float
        Floor with the expected level at or above the threshold, and its share of all floor.
    largest_share : float
        Share of the floor in the largest connected component of that.
    mean_outage : float
        Mean probability of a reading below the threshold.
    percentiles_dbm : tuple of float
        5, 25, 50, 75, 95 % of the levels over the floor (points of its CDF).
    """

    name: str
    area_m2: float
    share: float
    largest_share: float
    mean_outage: float
    percentiles_dbm: tuple[float, ...]


PERCENTILES = (5.0, 25.0, 50.0, 75.0, 95.0)
"""Points of the CDF that are reported."""
