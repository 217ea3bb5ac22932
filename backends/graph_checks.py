# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Validate a pose graph before optimisation: finite, symmetric, well-conditioned."""

from __future__ import annotations

import numpy as np

from slarm_graph.constraint import PoseGraph
from slarm_graph.geometry import Floats

_EIGENVALUES = (1e-12, 1e6)
"""Of covariances: standard deviations from a micrometre to a kilometre."""


def check_graph(graph: PoseGraph) -> None:
    """Raise on graphs that an optimiser would silently turn into NaN.

    Raises
    ------
    ValueError
        Naming the first constraint that is not finite or whose covariance is not symmetric with
        eigenvalues within [1e-12, 1e6]; or when a pose is not finite.
    """
    if not np.isfinite(graph.poses).all():
        raise ValueError("a pose of the graph is not finite")
    constraints = graph.constraints
    if not constraints:
        return
    stack = np.array([c.covariance for c in constraints])
    measured = np.array([(c.i_from_j.x, c.i_from_j.y, c.i_from_j.theta) for c in constraints])
    good = np.isfinite(stack).all(axis=(1, 2)) & np.isfinite(measured).all(axis=1)
    safe = np.where(good[:, None, None], stack, np.eye(3))
    eigenvalues = np.linalg.eigvalsh(safe)
    good &= np.isclose(safe, safe.transpose(0, 2, 1), rtol=1e-6, atol=1e-15).all(axis=(1, 2))
    good &= (eigenvalues[:, 0] >= _EIGENVALUES[0]) & (eigenvalues[:, 2] <= _EIGENVALUES[1])
    if not good.all():
        k = int(np.argmin(good))
        c = constraints[k]
        check_covariance(c.covariance, f"constraint {k} ({c.i} to {c.j})")
        raise ValueError(f"constraint {k} ({c.i} to {c.j}) is not finite: {c.i_from_j}")


def check_covariance(covariance: Floats, what: str) -> None:
    """Raise on a covariance that GTSAM would silently turn into NaN.

    Raises
    ------
    ValueError
        Unless finite, symmetric and with eigenvalues within [1e-12, 1e6].
    """
    if covariance.shape != (3, 3) or not np.isfinite(covariance).all():
        raise ValueError(f"covariance of {what} is not a finite 3 x 3 matrix")
    if not np.allclose(covariance, covariance.T, rtol=1e-6, atol=1e-15):
        raise ValueError(f"covariance of {what} is not symmetric")
    eigenvalues = np.linalg.eigvalsh(covariance)
    if eigenvalues[0] < _EIGENVALUES[0] or eigenvalues[-1] > _EIGENVALUES[1]:
        raise ValueError(
            f"covariance of {what} has eigenvalues {eigenvalues}, outside 1e-12 .. 1e6"
        )
