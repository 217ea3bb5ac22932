# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The Kalman filter against filterpy's."""

from __future__ import annotations

import numpy as np
from filterpy.kalman import KalmanFilter as Reference

from slarm_graph.frontends.scans.kalman import kalman_update


def spread(rng: np.random.Generator, size: int) -> np.ndarray:
    root = rng.normal(size=(size, size))
    return root @ root.T + 0.1 * np.eye(size)


def test_it_is_filterpys() -> None:
    rng = np.random.default_rng(0)
    x, covariance = rng.normal(size=3), spread(rng, 3)
    reference = Reference(dim_x=3, dim_z=3)
    reference.x, reference.P = x, covariance
    for _ in range(200):
        q, r, z = spread(rng, 3), spread(rng, 3), rng.normal(size=3)
        h = rng.uniform(0.01, 2.0) * np.eye(3)
        covariance = covariance + q
        reference.predict(Q=q)
        x, covariance = kalman_update(x, covariance, z - h @ x, r, h)
        reference.update(z, R=r, H=h)
        # A small matrix is inverted by other means: not the same bits.
        np.testing.assert_allclose(x, reference.x, rtol=1e-10, atol=1e-12)
        np.testing.assert_allclose(covariance, reference.P, rtol=1e-10, atol=1e-12)
