# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Posterior variance of the shadowing field from the positions of readings alone.

The posterior variance of a Gaussian process does not depend on the values that are measured, so
that a path can be judged before it is driven.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from slarm_graph.geometry import Floats
from slarm_graph.radio.measured.factor import Factor
from slarm_graph.radio.measured.nodes import Nodes
from slarm_graph.radio.measured.priors import FloorField, field_correlation

Indices = NDArray[np.int64]

_FROM_CENTRE = (math.sqrt(2.0) + math.asinh(1.0)) / 6.0
"""Mean distance of a square's points from its centre, over its side: 0.383, by integration."""


@dataclass(frozen=True, slots=True)
class Shadowing:
    """Hyperparameters of the shadowing field and of the readings' noise.

    Parameters
    ----------
    range_m : float
        Distance at which the field's correlation has fallen to 0.14 [m].
    field_sd_db, noise_sd_db : float
    """

    range_m: float
    field_sd_db: float
    noise_sd_db: float


class FieldVariance:
    """Posterior variance of a field on the nodes of a floor, given where readings were taken.

    Parameters
    ----------
    nodes : Nodes
    heard_m : (N, 2) float64
        Positions of the readings [m].
    shadowing : Shadowing
    """

    def __init__(self, nodes: Nodes, heard_m: Floats, shadowing: Shadowing) -> None:
        self.nodes, self._noise_db2 = nodes, shadowing.noise_sd_db**2
        unit = FloorField(nodes).unit_precision(shadowing.range_m).matrix
        away_m = _FROM_CENTRE * np.sqrt(nodes.area_m2)
        alike = field_correlation(away_m, shadowing.range_m)
        # Readings deviate from a node's value together: they were taken beside its centre.
        self._within_node_db2 = shadowing.field_sd_db**2 * (1.0 - alike**2)
        counts = np.bincount(nodes.at(heard_m), minlength=len(nodes))
        information = sparse.diags_array(
            counts / (self._noise_db2 + counts * self._within_node_db2)
        )
        self._factor = Factor(sparse.csc_array(unit / shadowing.field_sd_db**2 + information))
        self.variance_db2 = self._factor.marginal_variances()

    def rms_db(self, where: NDArray[np.bool_]) -> float:
        """Root of the area-weighted mean variance over nodes (M,) [dB]."""
        area = self.nodes.area_m2[where]
        total = float(area.sum())
        return float(np.sqrt(self.variance_db2[where] @ area / total)) if total else 0.0

    def variance_reductions(self, paths: Sequence[Indices], readings: float) -> Floats:
        """Return by how much paths would lower the variance, integrated over the floor [dB^2 m^2].

        Parameters
        ----------
        paths : sequence of (K,) int64
            Nodes that are passed, each once.
        readings : float
            Number taken in every node that is passed.
        """
        passed, place = np.unique(np.concatenate(paths), return_inverse=True)
        unit = np.zeros((len(self.nodes), len(passed)))
        unit[passed, np.arange(len(passed))] = 1.0
        columns = self._factor.solve(unit)
        among, over = columns[passed], columns.T @ (self.nodes.area_m2[:, None] * columns)
        ends = np.cumsum([len(path) for path in paths])[:-1]
        variance_reductions = []
        for path in np.split(place, ends):
            block = np.ix_(path, path)
            noise_db2 = self._noise_db2 / readings + self._within_node_db2[passed[path]]
            noisy = among[block] + np.diag(noise_db2)
            variance_reductions.append(float(np.trace(np.linalg.solve(noisy, over[block]))))
        return np.array(variance_reductions)
