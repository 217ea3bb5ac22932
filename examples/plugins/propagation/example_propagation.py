# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""A propagation model of one's own.

slarm radio map.yaml --ap 0 0 2 --set radio.propagation=two_slope --set two_slope.breakpoint_m=8
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from pydantic import Field

from slarm_graph import Links, PathLoss, RadioConfig, Stage


class TwoSlopeConfig(Stage):
    """The propagation model `two_slope`."""

    breakpoint_m: float = Field(default=10.0, gt=0)
    """Distance from which on the loss grows faster."""
    near_exponent: float = Field(default=2.0, gt=0)
    """Tenths of the loss per decade of distance up to there [dB/10]."""
    far_exponent: float = Field(default=4.0, gt=0)
    """And beyond [dB/10]."""
    sigma_db: float = Field(default=4.0, ge=0)
    """Standard deviation of the shadow fading."""


class TwoSlope:
    """Path loss with two slopes over distance, as in long halls."""

    settings: ClassVar[type[Stage]] = TwoSlopeConfig

    def __init__(self, settings: TwoSlopeConfig, radio: RadioConfig) -> None:
        self._settings = settings

    def path_loss_db(self, links: Links) -> PathLoss:
        """Return expected loss and shadow fading of links."""
        s = self._settings
        at_1_m_db = 32.4 + 20.0 * np.log10(links.frequency_hz * 1e-9)
        near_m = np.clip(links.distance_m, 0.1, s.breakpoint_m)
        beyond = np.maximum(links.distance_m / near_m, 1.0)
        loss_db = at_1_m_db + 10.0 * (
            s.near_exponent * np.log10(near_m) + s.far_exponent * np.log10(beyond)
        )
        return PathLoss(loss_db, np.full(len(links), s.sigma_db))
