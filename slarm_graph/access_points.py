# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The words of radio: an access point, and a radio map over cells."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slarm_graph.geometry import Floats
from slarm_graph.grid import GridGeometry, Mask
from slarm_graph.raster.bands import windows
from slarm_graph.tiles import KnownTiles, Where


@dataclass(frozen=True, slots=True)
class AccessPoint:
    """A fixed radio transmitter.

    Parameters
    ----------
    name : str
    x_m, y_m, z_m : float
        Position in the map; z above the floor [m].
    power_dbm : float
        Transmit power [dBm].
    frequency_hz : float
        Carrier [Hz].
    """

    name: str
    x_m: float
    y_m: float
    z_m: float
    power_dbm: float = 20.0
    frequency_hz: float = 3.5e9

    def position_m(self) -> Floats:
        """Return (3,) x, y, z [m]."""
        return np.array([self.x_m, self.y_m, self.z_m])


@dataclass(frozen=True, slots=True)
class RadioMap:
    """Expected path loss from every access point to the robot's antenna in every cell.

    Parameters
    ----------
    geometry : GridGeometry
    access_points : tuple of AccessPoint, length A
    path_loss_db : (A, rows, cols) float32
        nan where no antenna can be (obstacles, cells unknown or out of reach).
    line_of_sight : (A, rows, cols) bool
        Whether the straight segment to the antenna is clear of obstacles, with their heights.
    antenna_height_m : float
    scenario : str
        Path-loss scenario of 3GPP TR 38.901, such as `InF-SH`.
    rician_factor_db : float
        Of the line-of-sight fading; drops out of the expected gain (paper eq. (1)-(2)).
    height_source : str
        Where obstacle heights came from.
    los_probability : (A, rows, cols) float32, optional
        Probability of line of sight where heights are uncertain; `line_of_sight` is then whether
        it is above one half, and the path loss that of the expected gain. None where heights are
        taken for certain.
    expansion_radius_m : float
        Kept from obstacles, rounded up to cells (the paper's R_e) [m].
    los_unknown : (A, rows, cols) bool, optional
        Links that pass cells nobody has seen; `line_of_sight` is false there. None for none.
    tiles : KnownTiles, optional
        Of a large map, those outside of which no antenna can be.
    """

    geometry: GridGeometry
    access_points: tuple[AccessPoint, ...]
    path_loss_db: NDArray[np.float32]
    line_of_sight: Mask
    antenna_height_m: float
    scenario: str
    rician_factor_db: float
    height_source: str
    los_probability: NDArray[np.float32] | None = None
    los_unknown: Mask | None = None
    expansion_radius_m: float = 0.0
    tiles: KnownTiles | None = None

    @property
    def where(self) -> Where:
        """Where it has to be looked at: everywhere, unless it has tiles."""
        return self.tiles or self.geometry.shape

    @property
    def sight_probability(self) -> NDArray[np.float32]:
        """Probability of line of sight (A, rows, cols), 0 or 1 where heights are certain."""
        if self.los_probability is not None:
            return self.los_probability
        return self.line_of_sight.astype(np.float32)

    @property
    def sight_unknown(self) -> Mask:
        """Links (A, rows, cols) that pass cells nobody has seen."""
        if self.los_unknown is not None:
            return self.los_unknown
        return np.zeros_like(self.line_of_sight)

    @property
    def channel_power_gain_db(self) -> NDArray[np.float32]:
        """Expected gain (A, rows, cols) [dB], minus the path loss."""
        return -self.path_loss_db

    @property
    def rss_dbm(self) -> NDArray[np.float32]:
        """Received signal strength (A, rows, cols) [dBm]."""
        power_dbm = np.array([ap.power_dbm for ap in self.access_points], dtype=np.float32)
        return np.asarray(power_dbm[:, None, None] - self.path_loss_db, dtype=np.float32)

    @property
    def best_access_point(self) -> NDArray[np.int64]:
        """Index of the strongest access point per cell (rows, cols); -1 where there is none."""
        rss = np.where(np.isnan(self.path_loss_db), -np.inf, self.rss_dbm)
        return np.where(np.isneginf(rss).all(axis=0), -1, rss.argmax(axis=0))

    def gain_span_db(self) -> tuple[float, float]:
        """Return the least and the greatest gain anywhere [dB]; nan where there is none."""
        least, most = np.inf, -np.inf
        for layer in self.path_loss_db:
            for part in windows(self.where):
                known = layer[part.cells]
                known = known[np.isfinite(known)]
                least = min(least, float(known.min(initial=np.inf)))
                most = max(most, float(known.max(initial=-np.inf)))
        return (-most, -least) if most >= least else (float("nan"), float("nan"))
