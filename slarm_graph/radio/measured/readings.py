# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Readings of signal strength and their likelihood: Student's t, censored at either end.

Heard readings have heavy-tailed noise (Student's t by iterated weights). One not heard is censored:
the level was below the receiver's threshold, or the packet was lost anyway. One at saturation is
censored from above. Each is replaced by the Gaussian whose log likelihood has the same slope and
curvature at the present expectation (Laplace approximation; Rasmussen and Williams 3.4).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr

from slarm_graph.geometry import Floats
from slarm_graph.grid import Mask

_LEAST_WEIGHT = 1e-6
"""Of an uninformative reading, relative to a usual one: keeps the sparsity pattern."""


@dataclass(frozen=True, slots=True)
class RssReadings:
    """Readings of one access point with the poses at which they were taken.

    Parameters
    ----------
    points_m : (N, 2) float64
        In the map [m].
    times_s : (N,) float64
        Since some instant [s].
    rss_dbm : (N,) float64
        Received signal strength; nan where the access point was not heard.
    noise_class : (N,) int64
        Classes have a noise level each, such as single packets and means of several.
    headings_rad : (N,) float64, optional
        Of the robot.
    position_sd_m : (N,) float64, optional
        Standard deviation of the position, along each axis [m].
    classes : int
        Number of noise classes; class 0 is that of the map.
    """

    points_m: Floats
    times_s: Floats
    rss_dbm: Floats
    noise_class: NDArray[np.int64]
    headings_rad: Floats | None = None
    position_sd_m: Floats | None = None
    classes: int = 1

    def __len__(self) -> int:
        return len(self.rss_dbm)

    @property
    def heard(self) -> Mask:
        """Which readings have a value (N,)."""
        return np.isfinite(self.rss_dbm)

    def only(self, which: NDArray[np.generic]) -> RssReadings:
        """Return a subset of the readings, by mask or index."""
        return RssReadings(
            self.points_m[which],
            self.times_s[which],
            self.rss_dbm[which],
            self.noise_class[which],
            None if self.headings_rad is None else self.headings_rad[which],
            None if self.position_sd_m is None else self.position_sd_m[which],
            self.classes,
        )


@dataclass(frozen=True, slots=True)
class Receiver:
    """Limits of a receiver, at which readings are censored.

    Parameters
    ----------
    threshold_dbm : float
        Sensitivity: weaker signals are not heard; -inf when the receiver hears everything.
    saturation_dbm : float
        Stronger signals are reported as this.
    lost_share : float
        Packet loss: share of the readings that is missing although the signal was strong.
    """

    threshold_dbm: float = -np.inf
    saturation_dbm: float = np.inf
    lost_share: float = 0.02


def gaussian_equivalent(
    rss_dbm: Floats, expected_dbm: Floats, variance: Floats, receiver: Receiver, freedom: float
) -> tuple[Floats, Floats]:
    """Return Gaussian observations with the slope and curvature of the readings' log likelihoods.

    Parameters
    ----------
    rss_dbm : (N,)
        nan: not heard.
    expected_dbm : (N,)
        Present expectation.
    variance : (N,) [dB^2]
        Of the noise.
    receiver : Receiver
    freedom : float
        Degrees of freedom of Student's t.

    Returns
    -------
    values : (N,) [dBm]
    weights : (N,)
        Factors of the noise precision.
    """
    sigma = np.sqrt(variance)
    values = np.where(np.isnan(rss_dbm), expected_dbm, rss_dbm)
    weights = (freedom + 1.0) / (freedom + (values - expected_dbm) ** 2 / variance)
    not_heard = np.isnan(rss_dbm)
    saturated = ~not_heard & (rss_dbm >= receiver.saturation_dbm)
    for which, limit, sign, lost in (
        (not_heard, receiver.threshold_dbm, 1.0, receiver.lost_share),
        (saturated, receiver.saturation_dbm, -1.0, 0.0),
    ):
        if which.any():
            scaled = sign * (limit - expected_dbm[which]) / sigma[which]
            slope, curve = _censored_derivatives(scaled, lost)
            weights[which] = np.maximum(curve, _LEAST_WEIGHT)
            push = -sign * slope * sigma[which] / weights[which]
            values[which] = expected_dbm[which] + push
    return values, weights


def _censored_derivatives(scaled: Floats, lost: float) -> tuple[Floats, Floats]:
    """Slope and negative curvature of log(lost + (1 - lost) Phi(u)) at u."""
    u = np.clip(scaled, -30.0, 30.0)
    log_share = log_ndtr(u) + np.log1p(-lost)
    total = np.logaddexp(log_share, np.log(lost)) if lost > 0.0 else log_share
    density = np.exp(-0.5 * u**2 - 0.5 * np.log(2.0 * np.pi) + np.log1p(-lost) - total)
    return density, density * (u + density)
