# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Symmetric 3 x 3 matrices inside compiled loops, where a LAPACK call costs more than the work."""

from __future__ import annotations

import numpy as np
from numba import njit

from slarm_graph.geometry import Floats


@njit(cache=True, nogil=True)
def invert3(m: Floats) -> Floats:
    """Invert a symmetric positive definite matrix (3, 3) by its adjugate, scaled to unit diagonal.

    Scaling keeps metres and radians of very different certainty from cancelling.
    """
    a = 1.0 / np.sqrt(m[0, 0])
    b = 1.0 / np.sqrt(m[1, 1])
    c = 1.0 / np.sqrt(m[2, 2])
    p, q, r = m[0, 1] * a * b, m[0, 2] * a * c, m[1, 2] * b * c
    xx, xy, xz = 1.0 - r * r, q * r - p, p * r - q
    yy, yz, zz = 1.0 - q * q, p * q - r, 1.0 - p * p
    scale = 1.0 / (xx + p * xy + q * xz)
    out = np.empty((3, 3))
    out[0, 0] = xx * scale * a * a
    out[0, 1] = out[1, 0] = xy * scale * a * b
    out[0, 2] = out[2, 0] = xz * scale * a * c
    out[1, 1] = yy * scale * b * b
    out[1, 2] = out[2, 1] = yz * scale * b * c
    out[2, 2] = zz * scale * c * c
    return out


@njit(cache=True, nogil=True, inline="always")
def add_square3(h: Floats, x: float, y: float, z: float, weight: float) -> None:
    """Add weight times the square of the row (x, y, z) to the upper half of a matrix (3, 3)."""
    h[0, 0] += weight * x * x
    h[0, 1] += weight * x * y
    h[0, 2] += weight * x * z
    h[1, 1] += weight * y * y
    h[1, 2] += weight * y * z
    h[2, 2] += weight * z * z


@njit(cache=True, nogil=True)
def mirror3(h: Floats) -> None:
    """Copy the upper half of a symmetric matrix (3, 3) to the lower one."""
    h[1, 0], h[2, 0], h[2, 1] = h[0, 1], h[0, 2], h[1, 2]
