# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Distances, patches and walks over cells, against brute force and second implementations."""

import math

import numpy as np
import pytest
from scipy import ndimage
from shapely import LineString, box

from slarm_graph.grid import Mask
from slarm_graph.raster.distance import clearance, distance_to, nearest_of, within
from slarm_graph.raster.lines import first_crossing
from slarm_graph.raster.patches import joined, larger_than, patches, small_patches


def some_cells(seed: int, share: float = 0.1) -> Mask:
    """Cells at random in a grid of random size."""
    rng = np.random.default_rng(seed)
    return rng.random(rng.integers(3, 40, 2)) < share


@pytest.mark.parametrize("seed", range(5))
def test_distances_are_exact(seed: int) -> None:
    mask = some_cells(seed)
    mask[0, 0] = True
    np.testing.assert_allclose(distance_to(mask), ndimage.distance_transform_edt(~mask), rtol=1e-6)
    framed = ndimage.distance_transform_edt(np.pad(~mask, 1))[1:-1, 1:-1]
    np.testing.assert_allclose(clearance(~mask), framed, rtol=1e-6)
    nearest = np.stack(np.unravel_index(nearest_of(mask), mask.shape))
    assert mask[tuple(nearest)].all()
    off = np.linalg.norm(nearest - np.indices(mask.shape), axis=0)
    assert (off <= 1.05 * distance_to(mask) + 1e-6).all()


def test_nothing_is_infinitely_far() -> None:
    assert np.isinf(distance_to(np.zeros((4, 5), dtype=np.bool_))).all()
    assert not within(np.zeros((4, 5), dtype=np.bool_), 100.0, 0.1).any()
    assert (clearance(np.ones((3, 3), dtype=np.bool_)) == [[1, 1, 1], [1, 2, 1], [1, 1, 1]]).all()


@pytest.mark.parametrize("radius_m", [0.0, 0.1, 0.25, 0.9, 1.3])
def test_within_takes_in_what_is_exactly_at_the_radius(radius_m: float) -> None:
    mask = some_cells(3, 0.01)
    mask[1, 2] = True
    far = ndimage.distance_transform_edt(~mask) * 0.1
    np.testing.assert_array_equal(within(mask, radius_m, 0.1), far <= radius_m + 1e-6)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("over_corners", [False, True])
def test_patches_are_scipys(seed: int, over_corners: bool) -> None:
    mask = some_cells(seed, 0.5)
    labels, sizes = patches(mask, over_corners=over_corners)
    true, count = ndimage.label(mask, np.ones((3, 3)) if over_corners else None)
    assert len(sizes) == count + 1
    assert len(set(zip(labels.ravel(), true.ravel(), strict=True))) == count + 1
    np.testing.assert_array_equal(np.bincount(labels[mask], minlength=count + 1), sizes)


def test_joined_cells_are_those_of_the_seeds_or_the_largest_patch() -> None:
    mask = np.array([[1, 1, 0, 1], [0, 0, 1, 0], [1, 0, 1, 1]], dtype=np.bool_)
    seeds = np.zeros_like(mask)
    assert joined(mask, seeds).sum() == 3
    seeds[0, 0] = seeds[1, 1] = True
    np.testing.assert_array_equal(np.argwhere(joined(mask, seeds)), [[0, 0], [0, 1]])
    assert not joined(np.zeros_like(mask), seeds).any()
    np.testing.assert_array_equal(np.argwhere(~larger_than(mask, 1) & mask), [[2, 0]])


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("most", [0, 1, 4, 12, 2000])
def test_small_patches_are_scipys_without_those_barred(seed: int, most: int) -> None:
    mask = some_cells(seed, 0.15 + 0.02 * seed)
    barred = np.random.default_rng(seed).random(mask.shape) < 0.02
    labels, count = ndimage.label(mask, np.ones((3, 3)))
    is_small = np.bincount(labels.ravel(), minlength=count + 1) <= most
    is_small[labels[barred]] = is_small[0] = False
    np.testing.assert_array_equal(small_patches(mask, barred, most), is_small[labels])


@pytest.mark.parametrize("seed", range(20))
def test_a_walk_touches_the_cells_that_its_segment_crosses(seed: int) -> None:
    start, end = np.random.default_rng(seed).uniform(0.0, 8.0, (2, 2))
    col, step_col, next_x, every_x = first_crossing(start[0], end[0] - start[0])
    row, step_row, next_y, every_y = first_crossing(start[1], end[1] - start[1])
    walked = {(col, row)}
    while min(next_x, next_y) < 1.0:
        if next_x < next_y:
            col, next_x = col + step_col, next_x + every_x
        else:
            row, next_y = row + step_row, next_y + every_y
        walked.add((col, row))
    segment = LineString([start, end])
    crossed = {
        (c, r) for c in range(8) for r in range(8) if segment.intersects(box(c, r, c + 1, r + 1))
    }
    assert walked == crossed


def test_a_ray_that_does_not_move_never_leaves() -> None:
    assert first_crossing(2.5, 0.0)[2:] == (math.inf, math.inf)
