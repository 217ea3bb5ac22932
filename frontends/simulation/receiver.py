# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""A simulated receiver: the received signal strength (RSS) of a known world's access points.

    RSS = power - free-space loss at 1 m - 10 n log10(d) - wall loss * solids passed + shadowing

Shadowing is a Gaussian field over the floor, one per access point, with exponential correlation
(Gudmundson 1991). A reading averages the power of some fades, is quantised, and is missing below
the receiver's threshold.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import map_coordinates

from slarm_graph.config import SignalConfig
from slarm_graph.geometry import Floats, Pose2
from slarm_graph.radio.fading import channel_coefficients
from slarm_graph.radio.propagation.models import decades_of_distance, friis_loss_at_1_m_db
from slarm_graph.radio.propagation.solid_crossings import solid_crossings
from slarm_graph.readings import Signal
from slarm_graph.world import WorldMap

ANTENNA_M, MOUNT_M = 0.5, 0.25
"""Height of the robot's antenna, and how deep an access point may sit in what carries it: the
defaults of the radio map."""

_CELLS_PER_RANGE = 20
"""Cells of the shadowing field per decorrelation distance: between two, a twentieth of its variance
is lost at most."""

_MARGIN_RANGES = 5.0
"""Margin of the field in decorrelation distances before it repeats: exp(-5) is 0.7 %."""


class SignalChannel:
    """Propagation from the access points of a world to any point of it.

    Parameters
    ----------
    world : WorldMap
    config : SignalConfig
    rng : numpy.random.Generator
        Source of shadowing and of every reading's fading.
    """

    def __init__(self, world: WorldMap, config: SignalConfig, rng: np.random.Generator) -> None:
        self._world, self._config, self._rng = world, config, rng
        x_min, x_max, y_min, y_max = world.extent_m()
        self._corner_m = np.array([x_min, y_min])
        self._step_m = config.shadowing_m / _CELLS_PER_RANGE
        rows, cols = (
            int(np.ceil(length_m / self._step_m)) + 2 for length_m in (y_max - y_min, x_max - x_min)
        )
        self._shadowing_db = [
            config.shadowing_db * shadowing(rows, cols, 1.0 / _CELLS_PER_RANGE, rng)
            for _ in world.access_points
        ]

    def levels_dbm(self, points_m: Floats) -> Floats:
        """Return the RSS (A, N) at points (N, 2) [m], without fading [dBm]."""
        return np.stack([self._level_dbm(i, points_m) for i in range(len(self._shadowing_db))])

    def passed(self, index: int, points_m: Floats) -> Floats:
        """Return the number (N,) of solids on the links of one access point to points (N, 2)."""
        ap = self._world.access_points[index]
        counts = solid_crossings(
            self._world.solids, ap.position_m(), points_m, ANTENNA_M, mount_radius_m=MOUNT_M
        )
        return counts.astype(np.float64)

    def hear(self, world_from_robot: Pose2) -> tuple[Signal, ...]:
        """Draw a reading of every access point at the robot's pose."""
        here = np.array([[world_from_robot.x, world_from_robot.y]])
        signals = []
        for index, ap in enumerate(self._world.access_points):
            clear = self.passed(index, here) == 0.0
            rss = float(self._level_dbm(index, here)[0]) + self.fade_db(bool(clear[0]))
            heard = rss >= self._config.threshold_dbm
            signals.append(Signal(ap.name, self._rounded(rss) if heard else float("nan")))
        return tuple(signals)

    def _level_dbm(self, index: int, points_m: Floats) -> Floats:
        ap, config = self._world.access_points[index], self._config
        flat_m = np.linalg.norm(points_m - ap.position_m()[:2], axis=1)
        decades = decades_of_distance(np.hypot(flat_m, ap.z_m - ANTENNA_M))
        loss = friis_loss_at_1_m_db(ap.frequency_hz) + config.exponent * decades
        loss += config.wall_db * self.passed(index, points_m)
        rows_cols = ((points_m - self._corner_m) / self._step_m)[:, ::-1].T
        shadow = map_coordinates(self._shadowing_db[index], rows_cols, order=1, mode="nearest")
        return np.asarray(ap.power_dbm - loss + shadow)

    def fade_db(self, clear: bool) -> float:
        """Draw the mean power of some fades of unit mean [dB]."""
        drawn = channel_coefficients(
            0.0, clear, self._config.rician_factor_db, self._rng, realisations=self._config.fades
        )
        return float(10.0 * np.log10(np.mean(np.abs(drawn) ** 2)))

    def _rounded(self, rss_dbm: float) -> float:
        quantum = self._config.quantum_db
        return rss_dbm if quantum == 0.0 else round(rss_dbm / quantum) * quantum


def shadowing(rows: int, cols: int, step: float, rng: np.random.Generator) -> Floats:
    """Draw a Gaussian field (rows, cols) of unit variance and correlation exp(-distance).

    By circulant embedding (Dietrich and Newsam 1997): the covariance on a torus, long enough that
    the field does not meet itself, is diagonal for the Fourier transform.

    Parameters
    ----------
    rows, cols : int
    step : float
        Between neighbours, in decorrelation distances.
    rng : numpy.random.Generator
    """
    margin = int(np.ceil(_MARGIN_RANGES / step))
    up, along = (
        step * np.minimum(np.arange(n), n - np.arange(n)) for n in (rows + margin, cols + margin)
    )
    correlation = np.exp(-np.hypot(up[:, None], along[None]))
    spectrum = np.maximum(np.fft.fft2(correlation).real, 0.0)
    white = rng.standard_normal(correlation.shape)
    field = np.fft.ifft2(np.sqrt(spectrum) * np.fft.fft2(white)).real
    return np.asarray(field[:rows, :cols])


class SimulatedReceiver:
    """Receiver of a world's access points with a limited rate; no readings at a rate of zero.

    Parameters
    ----------
    world : WorldMap
    config : SignalConfig
    rng : numpy.random.Generator
        A generator is spawned from it, so that other draws do not depend on the readings.
    """

    def __init__(self, world: WorldMap, config: SignalConfig, rng: np.random.Generator) -> None:
        self.channel = None
        if config.rate_hz > 0.0 and world.access_points:
            self.channel = SignalChannel(world, config, rng.spawn(1)[0])
        self._every_ns = round(1e9 / config.rate_hz) if config.rate_hz > 0.0 else 0
        self._next_ns = 0

    def at(self, stamp_ns: int, world_from_robot: Pose2) -> tuple[Signal, ...]:
        """Return the readings at a stamp [ns]; none within a period of the last ones."""
        if self.channel is None or stamp_ns < self._next_ns:
            return ()
        self._next_ns = stamp_ns + self._every_ns
        return self.channel.hear(world_from_robot)
