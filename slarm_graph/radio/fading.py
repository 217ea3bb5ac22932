# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Small-scale (Rician and Rayleigh) fading: channel realisations about the expected gain."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slarm_graph.access_points import RadioMap
from slarm_graph.errors import BadInput
from slarm_graph.geometry import Floats

_MOST_VALUES = 500_000_000
"""Two gigabytes of single precision: more is a typing error on most machines."""


@dataclass(frozen=True, slots=True)
class FadingMaps:
    """Realisations of a radio map.

    Parameters
    ----------
    gain_db : (R, A, rows, cols) float32
        Channel power gain of every realisation [dB]; nan where no antenna can be.
    outage_probability : (A, rows, cols) float32
        Share of the realisations whose received power is below the threshold.
    threshold_dbm : float
    """

    gain_db: NDArray[np.float32]
    outage_probability: NDArray[np.float32]
    threshold_dbm: float


def fading_maps(
    radio: RadioMap, realisations: int, rng: np.random.Generator, *, threshold_dbm: float = -90.0
) -> FadingMaps:
    """Draw maps of the channel power gain about the expected gain, eq. (1)-(2).

    Cells are independent of each other. Where line of sight is uncertain it is drawn as well.

    Parameters
    ----------
    radio : RadioMap
    realisations : int
    rng : numpy Generator
    threshold_dbm : float
        Received power below which a link counts as out [dBm].

    Raises
    ------
    BadInput
        When there are none, or more than two gigabytes of them.
    """
    shape = (realisations, *radio.path_loss_db.shape)
    if realisations < 1 or np.prod(shape, dtype=np.float64) > _MOST_VALUES:
        raise BadInput(
            f"{realisations} realisations of {radio.path_loss_db[0].size} cells: give from 1 to"
            f" {_MOST_VALUES // max(radio.path_loss_db.size, 1)}"
        )
    gain_db: NDArray[np.float32] = np.empty(shape, dtype=np.float32)
    for one in gain_db:
        clear = rng.random(radio.path_loss_db.shape) < radio.sight_probability
        drawn = channel_coefficients(
            radio.path_loss_db, clear, radio.rician_factor_db, rng, realisations=1
        )
        one[...] = faded_gain_db(drawn[0])
    power_dbm = np.array([ap.power_dbm for ap in radio.access_points])[:, None, None]
    out = np.mean(gain_db + power_dbm < threshold_dbm, axis=0)
    nowhere = np.isnan(radio.path_loss_db)
    return FadingMaps(gain_db, np.where(nowhere, np.nan, out).astype(np.float32), threshold_dbm)


def write_fading(path: Path, maps: FadingMaps) -> None:
    """Write realisations as a compressed NPZ of plain arrays."""
    with path.open("wb") as file:
        np.savez_compressed(
            file,
            allow_pickle=False,
            channel_power_gain_db=maps.gain_db,
            outage_probability=maps.outage_probability,
            threshold_dbm=np.asarray(maps.threshold_dbm),
        )


def channel_coefficients(
    path_loss_db: ArrayLike,
    line_of_sight: ArrayLike,
    rician_factor_db: float,
    rng: np.random.Generator,
    *,
    realisations: int,
) -> NDArray[np.complex128]:
    """Draw channel coefficients H (paper eq. (1)-(2)).

    h = sqrt(a / (a + 1)) h_LoS + sqrt(1 / (a + 1)) h_NLoS, scaled to the expected gain. h_LoS has
    unit modulus and a uniform phase, h_NLoS is circular Gaussian of unit power, and the Rician
    factor a is 0 where the link is blocked, so that E|h|^2 = 1 whatever a is.

    Parameters
    ----------
    path_loss_db : (...) [dB]
    line_of_sight : (...) bool
    rician_factor_db : float
        Power of the direct over the scattered part on clear links [dB].
    rng : numpy Generator
    realisations : int
        Number R of independent draws.

    Returns
    -------
    (R, ...) complex128
        |H|^2 is the linear channel power gain.
    """
    loss_db, clear = np.broadcast_arrays(np.asarray(path_loss_db, dtype=np.float64), line_of_sight)
    shape = (realisations, *loss_db.shape)
    factor = np.where(clear, 10.0 ** (0.1 * rician_factor_db), 0.0)
    direct = np.exp(2j * np.pi * rng.random(shape))
    scattered = (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)) * np.sqrt(0.5)
    fading = np.sqrt(factor / (factor + 1.0)) * direct + np.sqrt(1.0 / (factor + 1.0)) * scattered
    return np.asarray(10.0 ** (-0.05 * loss_db) * fading, dtype=np.complex128)


def faded_gain_db(coefficients: ArrayLike) -> Floats:
    """Channel power gain of realisations (...) [dB]."""
    power = np.abs(np.asarray(coefficients)) ** 2
    return np.asarray(10.0 * np.log10(power), dtype=np.float64)
