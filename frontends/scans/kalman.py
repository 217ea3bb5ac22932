# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""A Kalman filter of a state that keeps its value but for noise.

The library's own (filterpy's) loads statistics and plotting with it: 45 MB and a second of every
run, for two short formulas. It is the oracle of the tests.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slarm_graph.frontends.scans.small_matrix import (
    add3,
    add_vectors3,
    invert3,
    matmul3,
    matvec3,
    sandwich3,
    scaled3,
)
from slarm_graph.geometry import Floats
from slarm_graph.kernels import kernel


@dataclass
class KalmanState:
    """State and covariance, in the letters of the literature.

    Parameters
    ----------
    x : (3,) float64
    P : (3, 3) float64
    """

    x: Floats
    P: Floats


@kernel
def kalman_update(x: Floats, P: Floats, y: Floats, R: Floats, H: Floats) -> tuple[Floats, Floats]:
    """State (3,) and covariance (3, 3) after a measurement, in Joseph's form.

    Parameters
    ----------
    x, P : (3,), (3, 3) float64
        Before it.
    y, R, H : (3,), (3, 3), (3, 3) float64
        Residual z - H x of a measurement z of noise covariance R.
    """
    gain = matmul3(matmul3(P, H.T), invert3(add3(sandwich3(H, P), R)))
    I_KH = add3(np.eye(3), scaled3(matmul3(gain, H), -1.0))
    return add_vectors3(x, matvec3(gain, y)), add3(sandwich3(I_KH, P), sandwich3(gain, R))
