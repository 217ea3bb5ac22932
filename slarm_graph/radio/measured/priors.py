# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Gaussian priors as sparse precisions: a field between walls, and a drift along time.

The field solves (kappa^2 - Laplacian) f = white noise on the floor, which makes it Matern of
smoothness 1 (Lindgren, Rue and Lindstroem 2011, eq. (2) and (10)); walls bound the floor, so that
it correlates along the way around them and not through them (Bakka et al. 2019). The positive
definite matrix is that of the finite volumes, whatever their shape. Near walls its variance would
grow; it is scaled back to be the same everywhere.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from scipy import sparse, special

from slarm_graph.geometry import Floats
from slarm_graph.radio.measured.factor import Factor
from slarm_graph.radio.measured.nodes import Nodes

_RANGES_KEPT = 8
"""Fields of so many ranges are kept for a search that comes back to them; memory, not results."""


def matern_correlation(distance_m: Floats, range_m: float) -> Floats:
    """Matern correlation of smoothness 1, about 0.14 at the range."""
    scaled = math.sqrt(8.0) * np.asarray(distance_m, dtype=np.float64) / range_m
    near = scaled < 1e-6
    return np.where(near, 1.0, scaled * special.k1(np.where(near, 1.0, scaled)))


@dataclass(frozen=True, slots=True)
class Precision:
    """A sparse precision matrix with the logarithm of its determinant."""

    matrix: sparse.csc_array
    log_determinant: float


@dataclass(slots=True)
class FloorField:
    """Fields of unit variance on the nodes of a floor, one for every range asked for."""

    nodes: Nodes
    _kept: dict[float, Precision] = field(default_factory=dict)

    def unit_precision(self, range_m: float) -> Precision:
        """Return the precision (M, M) of a field of unit variance and a range [m]."""
        if range_m not in self._kept:
            if len(self._kept) >= _RANGES_KEPT:
                self._kept.pop(next(iter(self._kept)))
            self._kept[range_m] = self._make(range_m)
        return self._kept[range_m]

    def _make(self, range_m: float) -> Precision:
        area = self.nodes.area_m2
        operator = sparse.diags_array(8.0 / range_m**2 * area) + self.nodes.stiffness
        matrix = sparse.csc_array(operator @ sparse.diags_array(1.0 / area) @ operator)
        factor = Factor(matrix)
        variance = factor.marginal_variances()
        scale = sparse.diags_array(np.sqrt(variance))
        log_determinant = factor.log_determinant() + float(np.log(variance).sum())
        return Precision(sparse.csc_array(scale @ matrix @ scale), log_determinant)


def drift_precision(times_s: Floats, correlation_s: float) -> Precision:
    """Return the precision (T, T) of a drift of unit variance at increasing times (T,) [s].

    An Ornstein-Uhlenbeck process: correlation exp(-dt / correlation_s).
    """
    if not len(times_s):
        return Precision(sparse.csc_array((0, 0)), 0.0)
    kept = np.exp(-np.diff(times_s) / correlation_s)
    gain = 1.0 / np.maximum(1.0 - kept**2, 1e-9)
    diagonal = np.ones(len(times_s))
    diagonal[1:] += kept**2 * gain
    diagonal[:-1] += kept**2 * gain
    beside = -kept * gain
    matrix = sparse.diags_array([beside, diagonal, beside], offsets=[-1, 0, 1], format="csc")
    return Precision(sparse.csc_array(matrix), float(np.log(gain).sum()))
