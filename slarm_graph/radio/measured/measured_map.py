# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The measured radio map: posterior mean and standard deviation of the RSS, and of a reading."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slarm_graph.access_points import AccessPoint
from slarm_graph.grid import GridGeometry

Layers = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class FittedTerms:
    """Fitted parameters of one access point.

    Parameters
    ----------
    readings, not_heard : int
        Number of readings, and of these the censored ones.
    level_at_1_m_dbm, exponent, wall_db : float
        Of the propagation model; nan where the position is unknown.
    sd : (3,) tuple of float
        Standard deviations of these.
    field_sd_db, range_m : float
        Of the residual field.
    drift_sd_db, drift_s : float
        Standard deviation and correlation time of the drift.
    noise_sd_db : float
        Scale of the Student's t noise of a reading.
    freedom : float
        Degrees of freedom of that.
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
        Posterior mean of the level; nan where no antenna can be.
    mean_sd_db : (A, rows, cols) float32
        Posterior standard deviation of it.
    reading_sd_db : (A, rows, cols) float32
        Standard deviation of a new reading about it.
    fitted : tuple of FittedTerms, length A
    antenna_height_m : float
    notices : tuple of str
        Warnings for the user.
    """

    geometry: GridGeometry
    access_points: tuple[AccessPoint, ...]
    mean_dbm: Layers
    mean_sd_db: Layers
    reading_sd_db: Layers
    fitted: tuple[FittedTerms, ...]
    antenna_height_m: float
    notices: tuple[str, ...] = ()
