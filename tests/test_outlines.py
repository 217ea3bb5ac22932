# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Outlines of masks and back: round trips on random masks, and areas."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from slarm_graph.grid import GridGeometry
from slarm_graph.polygons import contains, signed_area_m2
from slarm_graph.raster.fill import Polygons
from slarm_graph.raster.outlines import outlines_m, simplified_m

MASKS = hnp.arrays(bool, hnp.array_shapes(min_dims=2, max_dims=2, max_side=14))


@settings(deadline=None, max_examples=150)
@given(MASKS, st.sampled_from([0.05, 0.1, 0.3]))
def test_outlines_give_the_mask_back(mask, resolution):
    geometry = GridGeometry(0.3, -1.0, resolution, *mask.shape)
    outlines = outlines_m(geometry, mask)
    np.testing.assert_array_equal(Polygons.on(geometry, outlines).odd(), mask)
    area = sum(signed_area_m2(outline) for outline in outlines)
    assert area == pytest.approx(mask.sum() * resolution**2, abs=1e-9)


def test_the_mask_is_on_the_left_and_holes_run_clockwise():
    mask = np.ones((5, 6), dtype=bool)
    mask[2, 2:4] = False
    outer, hole = outlines_m(GridGeometry(0.0, 0.0, 1.0, 5, 6), mask)
    assert signed_area_m2(outer) == 30.0
    assert signed_area_m2(hole) == -2.0
    assert len(hole) == len(outer) == 4


def test_cells_that_touch_at_a_corner_are_apart():
    assert len(outlines_m(GridGeometry(0.0, 0.0, 1.0, 2, 2), np.eye(2, dtype=bool))) == 2


def test_any_of_convex_polygons_equals_containment():
    rng = np.random.default_rng(0)
    geometry = GridGeometry(-1.0, -1.0, 0.1, 20, 25)
    triangles = [rng.uniform(-1.5, 1.8, (3, 2)) for _ in range(6)]
    expected = np.zeros(geometry.shape, dtype=bool)
    for triangle in triangles:
        expected |= contains(triangle, geometry.centers())
    np.testing.assert_array_equal(Polygons.on(geometry, triangles).any(), expected)


def test_simplifying_keeps_corners_and_drops_stairs():
    mask = np.zeros((30, 30), dtype=bool)
    mask[5:25, 5:25] = True
    mask[5, 8:12] = False
    geometry = GridGeometry(0.0, 0.0, 0.05, 30, 30)
    (outline,) = outlines_m(geometry, mask)
    assert len(outline) == 8
    corners = simplified_m(outline, 0.075)
    assert len(corners) == 4
    assert {tuple(corner) for corner in corners} <= {tuple(corner) for corner in outline}
