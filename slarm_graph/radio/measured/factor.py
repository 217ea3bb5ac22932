# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Sparse factors of precision matrices: solve, determinant and marginal variances."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import splu

from slarm_graph.geometry import Floats
from slarm_graph.kernels import kernel

Ints = NDArray[np.int32]


class Factor:
    """L D L' of a symmetric positive definite sparse matrix, rows permuted to keep L sparse.

    Parameters
    ----------
    matrix : (M, M) sparse
    """

    def __init__(self, matrix: sparse.csc_array) -> None:
        # SuperLU on the diagonal (no pivoting) is a Cholesky factorisation up to the scaling.
        self._lu = splu(
            sparse.csc_matrix(matrix),
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
        self._diagonal = self._lu.U.diagonal()

    def solve(self, right: Floats) -> Floats:
        """Return the matrix's inverse times a vector (M,) or columns (M, K)."""
        return np.asarray(self._lu.solve(np.ascontiguousarray(right, dtype=np.float64)))

    def log_determinant(self) -> float:
        """Return the natural logarithm of the determinant."""
        return float(np.log(np.abs(self._diagonal)).sum())

    def marginal_variances(self) -> Floats:
        """Return the diagonal (M,) of the inverse, by Takahashi's recursion (Takahashi 1973)."""
        lower = sparse.csc_matrix(self._lu.L)
        lower.sort_indices()
        inverse = np.zeros(len(lower.data))
        _selected_inverse(lower.indptr, lower.indices, lower.data, self._diagonal, inverse)
        on_diagonal = inverse[lower.indptr[:-1]]
        return np.asarray(on_diagonal[self._lu.perm_r])


@kernel
def _selected_inverse(
    starts: Ints, rows: Ints, lower: Floats, diagonal: Floats, inverse: Floats
) -> None:
    """Fill the inverse's entries on the pattern of unit lower L, last column first.

    With S the rows below the diagonal of column j: Z[S, j] = -Z[S, S] L[S, j] and
    Z[j, j] = 1 / D[j] - L[S, j]' Z[S, j].
    """
    size = len(starts) - 1
    place = np.full(size, -1, dtype=np.int64)
    for j in range(size - 1, -1, -1):
        first, last = starts[j] + 1, starts[j + 1]
        for p in range(first, last):
            place[rows[p]] = p
        for p in range(first, last):
            column = rows[p]
            inverse[p] -= inverse[starts[column]] * lower[p]
            for q in range(starts[column] + 1, starts[column + 1]):
                target = place[rows[q]]
                if target >= 0:
                    inverse[target] -= inverse[q] * lower[p]
                    inverse[p] -= inverse[q] * lower[target]
        total = 1.0 / diagonal[j]
        for p in range(first, last):
            total -= lower[p] * inverse[p]
            place[rows[p]] = -1
        inverse[starts[j]] = total
