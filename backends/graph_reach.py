# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""How sure a graph is of where its nodes lie relative to each other."""

from __future__ import annotations

import math
from array import array

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import dijkstra

from slarm_graph.constraint import Constraint, ConstraintKind
from slarm_graph.geometry import Floats

HEADING_VARIANCE_PER_M, POSITION_VARIANCE_PER_M = 2e-5, 1e-4
"""Drift of lidar odometry in buildings [rad^2/m, m^2/m]: 0.26 degrees and 1 cm after a metre, 2.6
degrees and 10 cm after a hundred."""


class GraphReach:
    """Uncertainty between nodes from the shortest paths through the graph.

    Every constraint has a length: that of the way driven, or longer where its covariance is larger
    than such a way would make it. Heading and position variances grow with the length of a path,
    and heading errors turn into position errors along it.
    """

    def __init__(self) -> None:
        self._at: dict[tuple[int, int], int] = {}
        self._ends = array("q")
        self._lengths = array("d")
        self._paths_m: Floats | None = None
        self._paths_of = (0, 0)

    def add(self, edge: Constraint) -> None:
        """Take in a constraint; of parallel ones the surest counts."""
        c = edge.covariance
        length = max(
            float(c[2, 2]) / HEADING_VARIANCE_PER_M,
            float(c[0, 0] + c[1, 1]) / POSITION_VARIANCE_PER_M,
        )
        if edge.kind is ConstraintKind.ODOMETRY:
            length = max(length, math.hypot(edge.i_from_j.x, edge.i_from_j.y))
        at = self._at.setdefault((edge.i, edge.j), len(self._lengths))
        if at == len(self._lengths):
            self._ends.extend((edge.i, edge.j))
            self._lengths.append(length)
        self._lengths[at] = min(self._lengths[at], length)

    def outdate(self) -> None:
        """Have paths found anew when next asked."""
        self._paths_m = None

    def sigmas(self, count: int, node: int = -1) -> tuple[Floats, Floats]:
        """Standard deviations (N,) of position [m] and heading [rad] of N nodes seen from one.

        Parameters
        ----------
        count : int
            Number of nodes N.
        node : int
            From which; the last by default.
        """
        node %= count
        if self._paths_m is None or self._paths_of != (count, node):
            self._paths_m, self._paths_of = self._find_paths(count, node), (count, node)
        heading = HEADING_VARIANCE_PER_M * self._paths_m
        position = POSITION_VARIANCE_PER_M * self._paths_m
        position = position + heading * (0.25 * self._paths_m) ** 2
        return np.sqrt(position), np.sqrt(heading)

    def _find_paths(self, count: int, node: int) -> Floats:
        ends = np.frombuffer(self._ends, dtype=np.int64).reshape(-1, 2)
        lengths = np.frombuffer(self._lengths)
        links = sparse.csr_matrix((lengths, (ends[:, 0], ends[:, 1])), (count, count))
        return np.asarray(dijkstra(links, directed=False, indices=node))
