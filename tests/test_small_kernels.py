# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Compiled short cuts against what they stand for, to the last bit."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slarm_graph.consistency.views import _all_beams
from slarm_graph.frontends.scans import likelihood_grid
from slarm_graph.frontends.scans.likelihood_grid import Lattice
from slarm_graph.frontends.scans.quantiles import median, quantile
from slarm_graph.frontends.scans.small_matrix import (
    add_diagonal3,
    eigen2,
    matmul3,
    matvec3,
    sandwich3,
)
from slarm_graph.frontends.scans.small_pose import log_det_2pi
from slarm_graph.frontends.scans.static_returns import _CELL_M, _among, _occupied_cells
from slarm_graph.geometry import Floats, one_per_cell


@pytest.mark.parametrize("seed", range(20))
def test_products_are_those_of_numpy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b, v = rng.normal(size=(3, 3)), rng.normal(size=(3, 3)), rng.normal(size=3)
    # BLAS rounds as its processor does: the last bit is that of those with fused operations.
    np.testing.assert_allclose(matmul3(a, b), a @ b, rtol=1e-14, atol=1e-14)
    np.testing.assert_allclose(matmul3(a, b.T), a @ b.T, rtol=1e-14, atol=1e-14)
    np.testing.assert_allclose(sandwich3(a, b), a @ b @ a.T, rtol=1e-14, atol=1e-13)
    np.testing.assert_allclose(matvec3(a, v), a @ v, rtol=1e-14, atol=1e-14)
    np.testing.assert_array_equal(add_diagonal3(a, v), a + np.diag(v))


@pytest.mark.parametrize("seed", range(5))
def test_volume_is_that_of_numpy(seed: int) -> None:
    root = np.random.default_rng(seed).normal(size=(3, 3))
    covariance = root @ root.T
    expected = np.linalg.slogdet(2.0 * np.pi * covariance).logabsdet
    assert log_det_2pi(covariance) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("coupling", [0.0, 1e-9, 0.3, -2.0, 1e8])
def test_axes_are_those_of_numpy(coupling: float) -> None:
    for diagonal in ([1.0, 3.0], [3.0, 1.0], [2.0, 2.0], [1e6, 1e-3]):
        m = np.diag([*diagonal, 5.0]) + coupling * np.array([[0, 1, 9], [1, 0, 9], [9, 9, 0]])
        values, axes = eigen2(m)
        scale = np.abs(m[:2, :2]).max()
        np.testing.assert_allclose(values, np.linalg.eigvalsh(m[:2, :2]), atol=1e-14 * scale)
        np.testing.assert_allclose(axes @ axes.T, np.eye(2), atol=1e-15)
        np.testing.assert_allclose((axes * values) @ axes.T, m[:2, :2], atol=1e-14 * scale)


@pytest.mark.parametrize("count", [0, 1, 2, 3000])
def test_the_first_point_of_a_cell_is_kept(count: int) -> None:
    points = np.random.default_rng(count).normal(size=(count, 2)) * 3.0
    points[: count // 4] = -0.0
    _, first = np.unique(np.floor(points / 0.1), axis=0, return_index=True)
    np.testing.assert_array_equal(one_per_cell(points, 0.1), points[np.sort(first)])


def test_a_wide_grid_is_drawn_as_a_narrow_one() -> None:
    rng = np.random.default_rng(0)
    starts = rng.uniform(-1.0, 9.0, (200, 2))
    ends = starts + rng.choice([0.0, 0.05, 2.0], (200, 1)) * rng.normal(size=(200, 2))
    ends[:20, 0] = starts[:20, 0]
    grids = [Lattice(np.zeros((70, 60), dtype=np.float32), 0.0, -1.0, 0.15, 0.35) for _ in "ab"]
    segments = np.concatenate([starts, ends], axis=1)
    likelihood_grid._splat(grids[0], 1.05, segments)
    likelihood_grid._splat_wide(grids[1], 1.05, segments)
    assert grids[0].values.any()
    np.testing.assert_array_equal(grids[0].values, grids[1].values)


def test_interpolation_is_the_convolution_with_keys_kernel() -> None:
    """Summed over all cells of the raster, with the kernel as its inventor wrote it."""
    rng = np.random.default_rng(0)
    grid = Lattice(rng.random((9, 7)).astype(np.float32), 1.0, -2.0, 0.5, 0.1)

    def kernel(away: Floats) -> tuple[Floats, Floats]:
        s, sign = np.abs(away), np.sign(away)
        near, far = s < 1.0, (s >= 1.0) & (s < 2.0)
        value = near * ((1.5 * s - 2.5) * s * s + 1.0)
        value += far * (((-0.5 * s + 2.5) * s - 4.0) * s + 2.0)
        slope = near * (4.5 * s - 5.0) * s + far * ((-1.5 * s + 5.0) * s - 4.0)
        return value, sign * slope

    for u, v in rng.uniform((1.0, 1.0), (4.999, 6.999), (200, 2)):
        along, up = kernel(u - np.arange(7)), kernel(v - np.arange(9))
        expected = [up[0] @ grid.values @ along[0]]
        expected += [up[0] @ grid.values @ along[1] / 0.5, up[1] @ grid.values @ along[0] / 0.5]
        found = likelihood_grid.interpolate(grid, 1.0 + 0.5 * u, -2.0 + 0.5 * v)
        np.testing.assert_allclose(found, expected, atol=1e-12)
    assert likelihood_grid.interpolate(grid, 1.4, 0.0) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("count", [1, 2, 5, 40, 181])
def test_a_median_is_that_of_numpy(count: int) -> None:
    values = np.random.default_rng(count).exponential(size=count)
    assert median(values) == np.median(values)


@pytest.mark.parametrize("count", [1, 2, 5, 40, 181])
@pytest.mark.parametrize("share", [0.0, 0.1, 0.75, 1.0])
def test_a_quantile_is_that_of_numpy(count: int, share: float) -> None:
    rng = np.random.default_rng(count)
    for values in (rng.exponential(size=count), rng.integers(0, 3, count).astype(np.float64)):
        assert quantile(values, share) == np.quantile(values, share)


@pytest.mark.parametrize("stride_m", [0.05, 0.6])
def test_segments_touch_the_cells_of_points_along_them(stride_m: float) -> None:
    ends = np.cumsum(np.random.default_rng(0).normal(size=(151, 2)) * stride_m, axis=0)
    segments = np.hstack([ends[:-1], ends[1:]])
    segments[::7, 2:] = segments[::7, :2]
    cells = set()
    for start, end in zip(segments[:, :2], segments[:, 2:], strict=True):
        steps = 1 + math.ceil(2.0 * math.dist(start, end) / _CELL_M)
        along = np.linspace(0.0, 1.0, steps)[:, None] if steps > 1 else np.zeros((1, 1))
        cells |= set(map(tuple, np.floor((start + along * (end - start)) / _CELL_M).tolist()))
    touched = _occupied_cells(segments)
    assert len(touched) == len(cells)
    assert set(touched.tolist()) == {int(col) * 2**31 + int(row) for col, row in cells}


def test_cells_are_found_among_others() -> None:
    rng = np.random.default_rng(0)
    cells, known = rng.integers(0, 50, 40), np.unique(rng.integers(-5, 60, 30))
    np.testing.assert_array_equal(_among(cells, known), np.isin(cells, known))
    assert not _among(cells, known[:0]).any()


def test_beams_look_through_less_where_walls_are_grazed() -> None:
    returns = np.stack([np.linspace(0.5, 20.0, 60), np.full(60, 2.0)], axis=1)
    laser, ends = np.zeros(2), np.array([0, len(returns)])
    beams, low, high = _all_beams(returns, ends, laser[None])
    lengths = np.hypot(*beams[:, 2:4].T)
    np.testing.assert_array_equal(beams[:, 2:4], returns[np.hypot(*returns.T) < 15.0])
    assert (beams[:, :2] == laser).all()
    assert (np.diff(lengths - beams[:, 4]) >= -1e-12).all()
    np.testing.assert_array_equal(low, laser)
    np.testing.assert_array_equal(high, beams[:, 2:4].max(axis=0))


def test_beams_of_several_scans_are_those_of_each() -> None:
    """Also of one without returns; a gap at the end of one scan is none of the next."""
    rng = np.random.default_rng(2)
    scans = [rng.uniform(-9.0, 9.0, (count, 2)) for count in (5, 0, 7)]
    lasers = rng.uniform(-1.0, 1.0, (3, 2))
    alone = [
        _all_beams(scan, np.array([0, len(scan)]), laser[None])[0]
        for scan, laser in zip(scans, lasers, strict=True)
    ]
    ends = np.cumsum([0, *map(len, scans)])
    beams, low, high = _all_beams(np.concatenate(scans), ends, lasers)
    np.testing.assert_array_equal(beams, np.concatenate(alone))
    corners = beams[:, :4].reshape(-1, 2)
    np.testing.assert_array_equal([low, high], [corners.min(axis=0), corners.max(axis=0)])


def test_a_beam_clears_cells_up_to_short_of_the_wall_that_it_meets() -> None:
    """The wall runs to the nearer of two neighbours; as far off it as the beam is oblique."""
    rng = np.random.default_rng(6)
    laser = np.array([2.0, -1.0])
    scan = laser + rng.uniform(-14.0, 14.0, (200, 2)).round(1)
    scan[50:60] = laser + np.arange(1, 11)[:, None] * [0.8, 0.6]  # along the beam
    beams, _, _ = _all_beams(scan, np.array([0, len(scan)]), laser[None])
    expected = []
    for i, point in enumerate(scan):
        ray, around = point - laser, [k for k in (i + 1, i - 1) if 0 <= k < len(scan)]
        wall = scan[min(around, key=lambda k: math.dist(scan[k], point))] - point
        if np.hypot(*ray) < 15.0:
            sine = abs(np.cross([*ray, 0.0], [*wall, 0.0])[2])
            sine /= max(np.hypot(*ray) * np.hypot(*wall), 1e-9)
            expected.append(np.hypot(*ray) - max(0.4, 0.25 / max(sine, 0.01)))
    assert 0 < len(expected) < len(scan)
    np.testing.assert_allclose(beams[:, 4], expected, atol=1e-6)
    alone, _, _ = _all_beams(scan[:1], np.array([0, 1]), laser[None])
    assert alone[0, 4] == np.hypot(*(scan[0] - laser)) - 0.4
