# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Built-in propagation models: 3GPP TR 38.901, log-distance with line of sight, multi-wall."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from slarm_graph.config import RadioConfig, Stage
from slarm_graph.geometry import Floats
from slarm_graph.radio.path_loss import path_loss_db, shadow_sigma_db
from slarm_graph.radio.propagation.links import Links, PathLoss

NEAREST_M = 0.1
"""Shorter distances are held at this: within a wavelength or so no distance law holds."""

_SPEED_OF_LIGHT_M_S = 299_792_458.0
"""By definition of the metre (SI), in vacuum; in air it is 0.03 % less."""


def friis_loss_at_1_m_db(frequency_hz: float) -> float:
    """Free-space loss over the first metre [dB], 20 log10(4 pi f / c) (Friis 1946)."""
    return float(20.0 * np.log10(4.0 * np.pi * frequency_hz / _SPEED_OF_LIGHT_M_S))


def decades_of_distance(distance_m: Floats) -> Floats:
    """Return 10 log10 of 3D distances (...) [m], held below `NEAREST_M`."""
    return np.asarray(10.0 * np.log10(np.maximum(distance_m, NEAREST_M)))


class ScenarioModel:
    """A row of 3GPP TR 38.901, Table 7.4.1-1; the paper's is InF-SH (eq. (15)-(16))."""

    settings = Stage

    def __init__(self, settings: Stage, radio: RadioConfig) -> None:
        del settings
        self._scenario = radio.scenario

    def path_loss_db(self, links: Links) -> PathLoss:
        """Return the row's loss and shadow fading."""
        clear = links.line_of_sight
        return PathLoss(
            path_loss_db(links.distance_m, links.frequency_hz, clear, self._scenario),
            shadow_sigma_db(clear, self._scenario),
        )


class LogDistanceSettings(Stage):
    """Log-distance path loss: intercept + 10 n log10(d) + a blocked link's extra."""

    intercept_db: float | None = None
    """Loss at 1 m [dB]; null: that of free space at the access point's frequency."""
    exponent: float = Field(default=2.0, gt=0)
    """n; 2 in free space, 1.6-1.8 along corridors, 2-3 indoors (Rappaport, Table 4.2)."""
    blocked_db: float = Field(default=6.0, ge=0)
    """What a link without line of sight loses more [dB]."""
    sigma_db: float = Field(default=4.0, ge=0)
    """Standard deviation of the shadow fading of a clear link [dB]."""
    sigma_blocked_db: float = Field(default=7.0, ge=0)
    """And of a blocked one [dB]."""


class LogDistance:
    """Log-distance path loss with line of sight."""

    settings = LogDistanceSettings

    def __init__(self, settings: LogDistanceSettings, radio: RadioConfig) -> None:
        del radio
        self._s = settings

    def path_loss_db(self, links: Links) -> PathLoss:
        """Return intercept + 10 n log10(d), more where blocked."""
        s, blocked = self._s, ~links.line_of_sight
        loss_db = _at_1_m_db(s.intercept_db, links) + s.exponent * decades_of_distance(
            links.distance_m
        )
        return PathLoss(
            loss_db + s.blocked_db * blocked, np.where(blocked, s.sigma_blocked_db, s.sigma_db)
        )


class MultiWallSettings(Stage):
    """Multi-wall path loss (COST 231, eq. 4.7.2): log-distance + a loss for every wall passed."""

    intercept_db: float | None = None
    """Loss at 1 m [dB]; null: that of free space at the access point's frequency."""
    exponent: float = Field(default=2.0, gt=0)
    """n of 10 n log10(d)."""
    wall_db: float = Field(default=5.0, ge=0)
    """Loss of each wall or obstacle passed [dB]; 3.4 light, 6.9 heavy (COST 231, Table 4.7.2)."""
    sigma_db: float = Field(default=4.0, ge=0)
    """Standard deviation of the shadow fading [dB]."""


class MultiWall:
    """Log-distance path loss with a loss for every wall and obstacle of the map that is passed."""

    settings = MultiWallSettings

    def __init__(self, settings: MultiWallSettings, radio: RadioConfig) -> None:
        del radio
        self._s = settings

    def path_loss_db(self, links: Links) -> PathLoss:
        """Return intercept + 10 n log10(d) + number of crossings times the wall loss."""
        s = self._s
        loss_db = _at_1_m_db(s.intercept_db, links) + s.exponent * decades_of_distance(
            links.distance_m
        )
        loss_db = loss_db + s.wall_db * links.crossings
        return PathLoss(loss_db, np.full(len(links), s.sigma_db))


def _at_1_m_db(intercept_db: float | None, links: Links) -> float:
    return friis_loss_at_1_m_db(links.frequency_hz) if intercept_db is None else intercept_db
