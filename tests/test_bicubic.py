# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Bicubic interpolation, spelled out in vectors, against sums of Keys' kernel."""

from __future__ import annotations

import numpy as np
import pytest

from slarm_graph.frontends.scans.likelihood_grid import Lattice, interpolate, likelihoods
from slarm_graph.geometry import Floats, Pose2

SIDE_M, CORNER = 0.1, np.array([-0.4, 0.3])
"""Of a cell, and the middle of cell (0, 0)."""


def keys(apart: Floats) -> Floats:
    """Weight of cells so far away (N,) [cells]; Keys 1981, eq. (4) with a = -1/2."""
    d = np.abs(apart)
    near, far = 1.5 * d**3 - 2.5 * d**2 + 1.0, -0.5 * d**3 + 2.5 * d**2 - 4.0 * d + 2.0
    return np.select([d < 1.0, d < 2.0], [near, far], 0.0)


def slope(apart: Floats) -> Floats:
    """Derivative of it."""
    d = np.abs(apart)
    near, far = 4.5 * d**2 - 5.0 * d, -1.5 * d**2 + 5.0 * d - 4.0
    return np.sign(apart) * np.select([d < 1.0, d < 2.0], [near, far], 0.0)


def raster(seed: int) -> Lattice:
    values = np.random.default_rng(seed).normal(size=(9, 12)).astype(np.float32)
    return Lattice(values, float(CORNER[0]), float(CORNER[1]), SIDE_M, 0.05)


@pytest.mark.parametrize("seed", range(5))
def test_values_and_slopes_are_sums_over_all_cells(seed: int) -> None:
    rng, lattice = np.random.default_rng(seed + 100), raster(seed)
    points = CORNER + SIDE_M * rng.uniform([1.0, 1.0], [9.99, 6.99], (60, 2))
    points[0] = CORNER + SIDE_M * np.array([1.0 + 1e-9, 6.0 + 1e-9])
    for x, y in points:
        along = (x - CORNER[0]) / SIDE_M - np.arange(12)
        up = (y - CORNER[1]) / SIDE_M - np.arange(9)
        expected = [
            keys(up) @ lattice.values @ keys(along),
            keys(up) @ lattice.values @ slope(along) / SIDE_M,
            slope(up) @ lattice.values @ keys(along) / SIDE_M,
        ]
        np.testing.assert_allclose(interpolate(lattice, x, y), expected, atol=1e-6)


def test_outside_of_the_cells_that_it_needs_all_is_zero() -> None:
    """One cell before and two after; a cell's middle is the value of the cell."""
    lattice = raster(0)
    for col, row in [(0.99, 3.0), (3.0, 0.99), (10.0, 3.0), (3.0, 7.0), (-50.0, 3.0), (3.0, 99.0)]:
        x, y = CORNER + SIDE_M * (np.array([col, row]) + 1e-9)
        assert interpolate(lattice, x, y) == (0.0, 0.0, 0.0)
    for col, row in [(1, 1), (9, 6), (4, 2)]:
        x, y = CORNER + SIDE_M * (np.array([col, row]) + 1e-9)
        assert interpolate(lattice, x, y)[0] == pytest.approx(lattice.values[row, col], abs=1e-6)


def test_points_are_looked_up_in_the_frame_of_a_pose() -> None:
    lattice, pose = raster(1), Pose2(0.1, 0.6, 0.4)
    points = np.random.default_rng(2).uniform(-0.2, 0.2, (30, 2))
    expected = [interpolate(lattice, x, y)[0] for x, y in pose.transform(points)]
    np.testing.assert_allclose(likelihoods(lattice, points, pose.as_array()), expected, atol=1e-9)
