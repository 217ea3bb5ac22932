# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""A Kalman filter of a state that keeps its value but for noise.

The library's own (filterpy's) loads statistics and plotting with it: 45 MB and a second of every
run, for two short formulas. It is the oracle of the tests.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slarm_graph.geometry import Floats


@dataclass
class KalmanFilter:
    """State and covariance, in the letters of the literature.

    Parameters
    ----------
    x : (N,) float64
    P : (N, N) float64
    """

    x: Floats
    P: Floats

    def predict(self, Q: Floats) -> None:
        """Let time pass: the state stays, noise of covariance Q (N, N) is added."""
        self.P = self.P + Q

    def update(self, z: Floats, R: Floats, H: Floats) -> None:
        """Take in a measurement z (M,) = H x with noise of covariance R (M, M); Joseph's form."""
        cross = self.P @ H.T
        gain = cross @ np.linalg.inv(H @ cross + R)
        self.x = self.x + gain @ (z - H @ self.x)
        rest = np.eye(len(self.x)) - gain @ H
        self.P = rest @ self.P @ rest.T + gain @ R @ gain.T
