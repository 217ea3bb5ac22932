# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""3 x 3 matrices inside compiled loops, where a call of BLAS or LAPACK costs more than the work.

Products are summed in the order and with the rounding of OpenBLAS on a processor that multiplies
and adds in one step, so numpy's `@` is their oracle to the last bit.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, cast

import numpy as np
from numba import types
from numba.extending import intrinsic

from slarm_graph.geometry import Floats
from slarm_graph.kernels import kernel, kernel_with


def _fma(_: Any, a: Any, b: Any, c: Any) -> tuple[Any, Callable[..., Any]]:
    signature = types.float64(types.float64, types.float64, types.float64)
    return signature, lambda _context, builder, _signature, values: builder.fma(*values)


fma = cast(Callable[[float, float, float], float], intrinsic(_fma))
"""a * b + c, rounded once; only for compiled code."""


@kernel
def add3(a: Floats, b: Floats) -> Floats:
    """Return a + b of two matrices (3, 3): numba takes a quarter of a second for every `+`."""
    out = np.empty((3, 3))
    for row in range(3):
        for col in range(3):
            out[row, col] = a[row, col] + b[row, col]
    return out


@kernel
def scaled3(a: Floats, factor: float) -> Floats:
    """Return a matrix (3, 3) times a factor."""
    out = np.empty((3, 3))
    for row in range(3):
        for col in range(3):
            out[row, col] = a[row, col] * factor
    return out


@kernel
def symmetric3(a: Floats) -> Floats:
    """Return the mean of a matrix (3, 3) and its transpose."""
    out = np.empty((3, 3))
    for row in range(3):
        for col in range(3):
            out[row, col] = 0.5 * (a[row, col] + a[col, row])
    return out


@kernel
def add_vectors3(a: Floats, b: Floats) -> Floats:
    """Return a + b of two vectors (3,)."""
    out = np.empty(3)
    for k in range(3):
        out[k] = a[k] + b[k]
    return out


@kernel
def subtract3(a: Floats, b: Floats) -> Floats:
    """Return a - b of two vectors (3,)."""
    out = np.empty(3)
    for k in range(3):
        out[k] = a[k] - b[k]
    return out


@kernel
def matmul3(a: Floats, b: Floats) -> Floats:
    """Return a @ b of two matrices (3, 3)."""
    out = np.empty((3, 3))
    for row in range(3):
        for col in range(3):
            two = fma(a[row, 1], b[1, col], a[row, 0] * b[0, col])
            out[row, col] = fma(a[row, 2], b[2, col], two)
    return out


@kernel
def sandwich3(a: Floats, m: Floats) -> Floats:
    """Return a @ m @ a.T of two matrices (3, 3)."""
    return matmul3(matmul3(a, m), a.T)


@kernel
def matvec3(a: Floats, v: Floats) -> Floats:
    """Return a @ v of a matrix (3, 3) whose rows lie one after the other and a vector (3,)."""
    out = np.empty(3)
    for row in range(3):
        two = fma(a[row, 0], v[0], a[row, 1] * v[1])
        out[row] = fma(a[row, 2], v[2], two)
    return out


@kernel
def add_diagonal3(m: Floats, d: Floats) -> Floats:
    """Return m + diag(d) of a matrix (3, 3) and a vector (3,)."""
    out = m.copy()
    for k in range(3):
        out[k, k] += d[k]
    return out


@kernel
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


@kernel
def eigen2(m: Floats) -> tuple[Floats, Floats]:
    """Eigenvalues (2,), the lower first, and eigenvectors (2, 2), by column, of a symmetric matrix.

    Of a larger matrix it is the upper left corner. By Jacobi's rotation, as in Golub and Van Loan,
    "Matrix Computations", 8.5.2: the smaller angle, which cancels nothing.
    """
    a, b, c = m[0, 0], m[1, 0], m[1, 1]
    t = 0.0
    if b != 0.0:
        tau = (c - a) / (2.0 * b)
        t = math.copysign(1.0, tau) / (abs(tau) + math.hypot(1.0, tau))
    cosine = 1.0 / math.hypot(1.0, t)
    sine = t * cosine
    first, second = a - t * b, c + t * b
    values, axes = np.empty(2), np.empty((2, 2))
    k = 0 if first <= second else 1
    values[k], values[1 - k] = first, second
    axes[0, k], axes[1, k] = cosine, -sine
    axes[0, 1 - k], axes[1, 1 - k] = sine, cosine
    return values, axes


@kernel_with(inline=True)
def add_square3(h: Floats, x: float, y: float, z: float, weight: float) -> None:
    """Add weight times the outer product of (x, y, z) to the upper half of a matrix (3, 3)."""
    h[0, 0] += weight * x * x
    h[0, 1] += weight * x * y
    h[0, 2] += weight * x * z
    h[1, 1] += weight * y * y
    h[1, 2] += weight * y * z
    h[2, 2] += weight * z * z


@kernel
def mirror3(h: Floats) -> None:
    """Copy the upper half of a symmetric matrix (3, 3) to the lower one."""
    h[1, 0], h[2, 0], h[2, 1] = h[0, 1], h[0, 2], h[1, 2]
