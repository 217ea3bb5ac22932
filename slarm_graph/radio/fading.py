# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Small-scale fading: realisations of the channel whose mean power is the expected gain."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slarm_graph.geometry import Floats


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
