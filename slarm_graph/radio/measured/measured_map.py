# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The measured radio map: what is expected in every cell, how sure, and how far readings spread."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from slarm_graph.access_points import AccessPoint
from slarm_graph.grid import GridGeometry

Layers = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class FittedTerms:
    """What was fitted for one access point.

    Parameters
    ----------
    readings, not_heard : int
        How many it rests on, and how many of these were not heard.
    level_at_1_m_dbm, exponent, wall_db : float
        Of the propagation model; nan where the position is unknown.
    sd : (3,) tuple of float
        Standard deviations of these.
    field_sd_db, range_m : float
        Of the residual field.
    drift_sd_db, drift_s : float
        What changes with time and not with place.
    noise_sd_db : float
        Of a reading, scale of Student's t.
    freedom : float
        Its degrees of freedom.
    position_sd_m : (3,) tuple of float
        Standard deviations of the access point's position; zeros where it was given.
    """

    readings: int
    not_heard: int
    level_at_1_m_dbm: float
    exponent: float
    wall_db: float
    sd: tuple[float, float, float]
    field_sd_db: float
    range_m: float
    drift_sd_db: float
    drift_s: float
    noise_sd_db: float
    freedom: float
    position_sd_m: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class MeasuredMap:
    """Received signal strength from measurements, per access point and cell.

    Parameters
    ----------
    geometry : GridGeometry
    access_points : tuple of AccessPoint, length A
    mean_dbm : (A, rows, cols) float32
        Expected level; nan where no antenna can be.
    mean_sd_db : (A, rows, cols) float32
        How sure that is.
    reading_sd_db : (A, rows, cols) float32
        Standard deviation of a new reading about it.
    fitted : tuple of FittedTerms, length A
    antenna_height_m : float
    notices : tuple of str
        What a user should know.
    """

    geometry: GridGeometry
    access_points: tuple[AccessPoint, ...]
    mean_dbm: Layers
    mean_sd_db: Layers
    reading_sd_db: Layers
    fitted: tuple[FittedTerms, ...]
    antenna_height_m: float
    notices: tuple[str, ...] = ()

    def probability_above(self, threshold_dbm: float, *, of_mean: bool = False) -> Layers:
        """Probability (A, rows, cols) that a reading, or the expected level, is above a threshold.

        nan where no antenna can be.
        """
        sd = self.mean_sd_db if of_mean else self.reading_sd_db
        return np.asarray(ndtr((self.mean_dbm - threshold_dbm) / sd), dtype=np.float32)
