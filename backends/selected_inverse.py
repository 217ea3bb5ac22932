# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Entries of the inverse of a sparse matrix, where the matrix or its factor has entries.

The inverse of a pose graph's information is full, but covariances are asked for only of nodes that
a constraint joins. These follow from the factor L D L^T alone, from the last column to the first
(Takahashi, Fagan, Chin, "Formation of a Sparse Bus Impedance Matrix and Its Application to Short
Circuit Study", 1973; Erisman, Tinney, "On Computing Certain Elements of the Inverse of a Sparse
Matrix", 1975): the time is that of the factorisation, not that of a solution per column.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, eye_array
from scipy.sparse.linalg import splu

from slarm_graph.geometry import Floats
from slarm_graph.kernels import kernel

Indices = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class SelectedInverse:
    """Entries of a symmetric inverse on the pattern of the factor.

    Parameters
    ----------
    position : (N,) int64
        Of every row and column in the order of elimination.
    diagonal : (N,) float64
        Of the inverse, in that order.
    starts, rows, values : (N + 1,) int64, (E,) int64, (E,) float64
        Its entries below the diagonal by columns, rows ascending.
    """

    position: Indices
    diagonal: Floats
    starts: Indices
    rows: Indices
    values: Floats

    def at(self, rows: Indices, columns: Indices) -> Floats:
        """Return the entries at rows and columns of any shape; NaN for those that are not known."""
        one, other = self.position[rows], self.position[columns]
        lower, column = np.maximum(one, other).ravel(), np.minimum(one, other).ravel()
        known = (self.diagonal, self.starts, self.rows, self.values)
        return np.asarray(_entries(lower, column, *known)).reshape(one.shape)


def selected_inverse(matrix: csc_array, order: Indices) -> SelectedInverse | None:
    """Invert a sparse matrix where its factor has entries.

    Parameters
    ----------
    matrix : csc_array
        (N, N), symmetric, positive definite.
    order : (N,) int64
        In which rows and columns are eliminated.

    Returns
    -------
    SelectedInverse or None
        None where the matrix is not positive definite in double precision.
    """
    ordered = csc_array(matrix[order][:, order])
    ordered.sort_indices()
    starts, rows = ordered.indptr.astype(np.int64), ordered.indices.astype(np.int64)
    parents, counts = _elimination_tree(starts, rows)
    factor_starts = np.concatenate([[0], np.cumsum(counts)])
    factor_rows, factor, pivots = _factorised(starts, rows, ordered.data, parents, factor_starts)
    if not (np.isfinite(pivots) & (pivots > 0.0)).all():
        return None
    diagonal, below = _inverted(factor_starts, factor_rows, factor, pivots)
    if not (np.isfinite(diagonal) & (diagonal >= 0.0)).all():
        return None
    position = np.empty_like(order)
    position[order] = np.arange(len(order))
    return SelectedInverse(position, diagonal, factor_starts, factor_rows, below)


def elimination_order(count: int, i: Indices, j: Indices) -> Indices:
    """Order (N,) of nodes by minimum degree, so that the factor has few entries.

    Parameters
    ----------
    count : int
        Number N of nodes.
    i, j : (M,) int64
        Nodes that are joined.
    """
    both = np.concatenate([i, j]), np.concatenate([j, i])
    joined = csc_array((np.ones(2 * len(i)), both), shape=(count, count))
    joined.data[:] = 1.0
    # Dominant, so that no pivot is exchanged: only the order is wanted.
    dominant = csc_array(joined + (count + 1.0) * eye_array(count))
    factored = splu(
        dominant,
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    return np.argsort(factored.perm_c).astype(np.int64)


@kernel
def _elimination_tree(starts: Indices, rows: Indices) -> tuple[Indices, Indices]:
    """Parent of every column, -1 for roots, and the entries of each below the diagonal."""
    size = len(starts) - 1
    parents, counts = np.full(size, -1, dtype=np.int64), np.zeros(size, dtype=np.int64)
    met = np.full(size, -1, dtype=np.int64)
    for k in range(size):
        met[k] = k
        for entry in range(starts[k], starts[k + 1]):
            i = rows[entry]
            while i < k and met[i] != k:
                if parents[i] < 0:
                    parents[i] = k
                counts[i] += 1
                met[i] = k
                i = parents[i]
    return parents, counts


@kernel
def _factorised(
    starts: Indices, rows: Indices, values: Floats, parents: Indices, factor_starts: Indices
) -> tuple[Indices, Floats, Floats]:
    """Rows and values of the unit lower factor by columns, without its diagonal, and the pivots.

    Row by row: row k of the factor solves a triangular system with the columns before it, which are
    met in ascending order along the elimination tree. Ends at a pivot that is not positive.
    """
    size = len(starts) - 1
    factor_rows = np.empty(factor_starts[size], dtype=np.int64)
    factor = np.empty(factor_starts[size])
    pivots, filled = np.zeros(size), factor_starts[:-1].copy()
    solution, met = np.zeros(size), np.full(size, -1, dtype=np.int64)
    path, reached = np.empty(size, dtype=np.int64), np.empty(size, dtype=np.int64)
    for k in range(size):
        met[k], first = k, size
        for entry in range(starts[k], starts[k + 1]):
            i = rows[entry]
            if i > k:
                continue
            solution[i] += values[entry]
            length = 0
            while met[i] != k:
                path[length] = i
                met[i] = k
                length += 1
                i = parents[i]
            # A path is ascending, and comes before those it runs into.
            for step in range(length):
                first -= 1
                reached[first] = path[length - 1 - step]
        pivots[k], solution[k] = solution[k], 0.0
        for index in range(first, size):
            j = reached[index]
            residual, solution[j] = solution[j], 0.0
            for entry in range(factor_starts[j], filled[j]):
                solution[factor_rows[entry]] -= factor[entry] * residual
            share = residual / pivots[j]
            pivots[k] -= share * residual
            factor_rows[filled[j]], factor[filled[j]] = k, share
            filled[j] += 1
        if not pivots[k] > 0.0:
            break
    return factor_rows, factor, pivots


@kernel
def _inverted(
    starts: Indices, rows: Indices, factor: Floats, pivots: Floats
) -> tuple[Floats, Floats]:
    """Diagonal of the inverse, and its values below it on the factor's pattern.

    With Z the inverse and L the factor, Z = D^-1 L^-1 + (1 - L^T) Z.
    """
    size = len(pivots)
    diagonal, values = np.empty(size), np.empty(len(factor))
    place = np.full(size, -1, dtype=np.int64)
    for j in range(size - 1, -1, -1):
        begin, end = starts[j], starts[j + 1]
        for entry in range(begin, end):
            place[rows[entry]] = entry
            values[entry] = 0.0
        for entry in range(begin, end):
            k, share = rows[entry], factor[entry]
            total = diagonal[k] * share
            for other in range(starts[k], starts[k + 1]):
                at = place[rows[other]]
                if at >= 0:
                    values[at] -= values[other] * share
                    total += values[other] * factor[at]
            values[entry] -= total
        diagonal[j] = 1.0 / pivots[j]
        for entry in range(begin, end):
            diagonal[j] -= factor[entry] * values[entry]
            place[rows[entry]] = -1
    return diagonal, values


@kernel
def _entries(
    lower: Indices,
    column: Indices,
    diagonal: Floats,
    starts: Indices,
    rows: Indices,
    values: Floats,
) -> Floats:
    """Entries (K,) at rows `lower`, not before `column`; NaN where the pattern has none."""
    found = np.full(len(lower), np.nan)
    for k in range(len(lower)):
        if lower[k] == column[k]:
            found[k] = diagonal[column[k]]
            continue
        begin, end = starts[column[k]], starts[column[k] + 1]
        while begin < end:
            middle = (begin + end) // 2
            if rows[middle] < lower[k]:
                begin = middle + 1
            else:
                end = middle
        if begin < starts[column[k] + 1] and rows[begin] == lower[k]:
            found[k] = values[begin]
    return found
