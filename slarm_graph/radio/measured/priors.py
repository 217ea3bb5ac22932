# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Gaussian priors as sparse precisions: a field bounded by walls, and a drift over time.

The field's precision is (outer^2 - Laplacian) (inner^2 - Laplacian) on the floor, a field of two
scales (nested: Bolin and Lindgren 2011). Between them it is as rough as one of exponential
correlation, which shadowing has (Gudmundson 1991), though its matrix is as sparse as that of
equal scales, the smooth Matern field of Lindgren, Rue and Lindstroem (2011, eq. (10)). That one
takes the field on both sides of a shadow's edge for nearly the same, and is overconfident of wall
losses. Walls bound the floor, so that the field correlates along paths around them and not through
them (Bakka et al. 2019). The finite-volume matrix is positive definite, whatever their shape. Near
walls the variance would grow; it is normalised to be the same everywhere.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from scipy import sparse, special

from slarm_graph.geometry import Floats
from slarm_graph.radio.measured.factor import Factor, Ints
from slarm_graph.radio.measured.nodes import Nodes

_CACHED_RANGES = 8
"""Precisions of so many ranges are cached for the optimiser; memory, not results."""


_INNER = 8.0
"""Inner over outer scale. Against exp(-d / 2 m) over 8 m the correlation is off by 0.014 rms (5:
0.019, 12: 0.020; equal scales: 0.041), and over 0.2 m it has fallen by 0.055 of 0.095 (equal:
0.032)."""

_OUTER_RANGE = 1.2680
"""Outer scale times range, such that the correlation at the range is that of a Matern field of
smoothness 1, 0.14, which defines a range (Lindgren, Rue and Lindstroem 2011)."""


def field_correlation(distance_m: Floats, range_m: float) -> Floats:
    """Correlation of the field far from walls, about 0.14 at the range."""
    scaled = _OUTER_RANGE * np.asarray(distance_m, dtype=np.float64) / range_m
    near = scaled < 1e-6
    away = np.where(near, 1.0, scaled)
    fallen = (special.k0(away) - special.k0(_INNER * away)) / math.log(_INNER)
    return np.where(near, 1.0, fallen)


@dataclass(frozen=True, slots=True)
class Precision:
    """A sparse precision matrix and its log determinant."""

    matrix: sparse.csc_array
    log_determinant: float


@dataclass(slots=True)
class FloorField:
    """Unit-variance fields on the nodes of a floor, cached by range."""

    nodes: Nodes
    _cache: dict[float, Precision] = field(default_factory=dict)
    _order: Ints | None = None

    def unit_precision(self, range_m: float) -> Precision:
        """Return the precision (M, M) of a field of unit variance and a range [m]."""
        if range_m not in self._cache:
            if len(self._cache) >= _CACHED_RANGES:
                self._cache.pop(next(iter(self._cache)))
            self._cache[range_m] = self._make(range_m)
        return self._cache[range_m]

    def _make(self, range_m: float) -> Precision:
        area = self.nodes.area_m2
        outer, inner = (
            sparse.diags_array((scale * _OUTER_RANGE / range_m) ** 2 * area) + self.nodes.stiffness
            for scale in (1.0, _INNER)
        )
        matrix = sparse.csc_array(outer @ sparse.diags_array(1.0 / area) @ inner)
        factor = Factor(matrix, self._order)
        self._order = factor.order
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
    decay = np.exp(-np.diff(times_s) / correlation_s)
    gain = 1.0 / np.maximum(1.0 - decay**2, 1e-9)
    diagonal = np.ones(len(times_s))
    diagonal[1:] += decay**2 * gain
    diagonal[:-1] += decay**2 * gain
    off_diagonal = -decay * gain
    matrix = sparse.diags_array(
        [off_diagonal, diagonal, off_diagonal], offsets=[-1, 0, 1], format="csc"
    )
    return Precision(sparse.csc_array(matrix), float(np.log(gain).sum()))
