# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The tile pool against a naive copy of everything, and its books."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slarm_graph.backends.particle_maps import (
    TILE_BITS,
    TILE_CELLS,
    ParticleMaps,
    memory_notice,
    most_tiles,
)
from slarm_graph.config import ParticleMapsConfig
from slarm_graph.errors import BadInput
from slarm_graph.geometry import Floats
from slarm_graph.snapshots import restore_state, state_of

RESOLUTION_M = 0.1
NaiveMap = dict[tuple[int, int], Floats]


def naive_insert(cells: NaiveMap, points: Floats, pose: Floats) -> None:
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for px, py, nx, ny in points:
        x = (pose[0] + c * px - s * py) / RESOLUTION_M
        y = (pose[1] + s * px + c * py) / RESOLUTION_M
        row, col = math.floor(y), math.floor(x)
        offset = [1.0, x - col - 0.5, y - row - 0.5, c * nx - s * ny, s * nx + c * ny]
        cells[row, col] = cells.get((row, col), np.zeros(5)) + offset


def as_naive(maps: ParticleMaps, particle: int) -> NaiveMap:
    found: NaiveMap = {}
    for tile_row, tile_col in np.argwhere(maps.tables[particle] >= 0):
        tile = maps.cells[maps.tables[particle, tile_row, tile_col]]
        for at in np.flatnonzero(tile[:, 0]):
            row = ((int(tile_row) + int(maps.corner[0])) << TILE_BITS) + int(at) // TILE_CELLS
            col = ((int(tile_col) + int(maps.corner[1])) << TILE_BITS) + int(at) % TILE_CELLS
            found[row, col] = tile[at].astype(np.float64)
    return found


def check_books(maps: ParticleMaps) -> None:
    """Every tile is counted once per table that uses it, and no other is taken."""
    used = maps.tables[maps.tables >= 0]
    assert np.array_equal(np.bincount(used, minlength=len(maps.references)), maps.references)


def random_scan(rng: np.random.Generator, count: int = 30) -> Floats:
    normals = rng.uniform(-np.pi, np.pi, count)
    ends = rng.uniform(-4.0, 4.0, (count, 2))
    return np.column_stack([ends, np.cos(normals), np.sin(normals)])


@pytest.mark.parametrize("seed", range(3))
def test_random_operations_equal_deep_copies(seed: int) -> None:
    rng = np.random.default_rng(seed)
    particles = 6
    maps = ParticleMaps.empty(particles, RESOLUTION_M)
    naive: list[NaiveMap] = [{} for _ in range(particles)]
    for _ in range(25):
        if rng.random() < 0.4:
            ancestors = np.sort(rng.integers(0, particles, particles))
            maps.resample(ancestors)
            naive = [dict(naive[a]) for a in ancestors]
        else:
            points = random_scan(rng)
            poses = rng.uniform([-8, -8, -np.pi], [8, 8, np.pi], (particles, 3))
            maps.insert(points, poses)
            for cells, pose in zip(naive, poses, strict=True):
                naive_insert(cells, points, pose)
        check_books(maps)
    for particle, expected in enumerate(naive):
        found = as_naive(maps, particle)
        assert found.keys() == expected.keys()
        for cell, values in expected.items():
            assert np.allclose(found[cell], values, atol=1e-5)


def test_resampling_copies_no_cell() -> None:
    rng = np.random.default_rng(0)
    maps = ParticleMaps.empty(8, RESOLUTION_M)
    maps.insert(random_scan(rng), np.zeros((8, 3)))
    cells, before = maps.cells, maps.cells.copy()
    maps.resample(np.zeros(8, dtype=np.int64))
    assert maps.cells is cells
    assert np.array_equal(maps.cells, before)
    assert np.count_nonzero(maps.references) == np.count_nonzero(maps.tables[0] >= 0)


def test_only_touched_tiles_are_detached() -> None:
    rng = np.random.default_rng(0)
    maps = ParticleMaps.empty(2, RESOLUTION_M)
    maps.insert(random_scan(rng, 200), np.zeros((2, 3)))
    maps.resample(np.zeros(2, dtype=np.int64))
    shared = np.count_nonzero(maps.references)
    here = np.array([[0.05, 0.05, 1.0, 0.0]])
    maps.insert(here, np.zeros((2, 3)))
    assert np.count_nonzero(maps.references) == shared + 1


def test_nothing_leaks_in_a_hundred_thousand_resamplings() -> None:
    rng = np.random.default_rng(1)
    maps = ParticleMaps.empty(4, RESOLUTION_M)
    points = random_scan(rng, 8)
    capacities = set()
    for step in range(100_000):
        maps.resample(rng.integers(0, 4, 4))
        if step % 50 == 0:
            maps.insert(points, rng.uniform(-1.0, 1.0, (4, 3)))
            capacities.add(len(maps.cells))
    check_books(maps)
    assert len(capacities) == 1
    assert np.count_nonzero(maps.references) <= maps.tables.size


def test_the_pool_ends_where_it_is_told() -> None:
    config = ParticleMapsConfig(delta_m=RESOLUTION_M, max_memory_mb=0.02)
    maps = ParticleMaps.empty(3, RESOLUTION_M, most_tiles(config))
    with pytest.raises(BadInput, match=r"more than 0 MB; lower gmapping\.particles"):
        maps.insert(random_scan(np.random.default_rng(0)), np.zeros((3, 3)))


@pytest.mark.parametrize(("allowed", "tiles"), [(0.1, 1), (1.9, 1), (2.1, 2), (1000.1, 1000)])
def test_as_many_tiles_are_allowed_as_fit_at_least_one(allowed: float, tiles: int) -> None:
    """By what arrays take."""
    tile_mb = ParticleMaps.empty(1, RESOLUTION_M).cells[0].nbytes / 1e6
    assert most_tiles(ParticleMapsConfig(max_memory_mb=allowed * tile_mb)) == tiles


def test_much_memory_is_told_before() -> None:
    assert memory_notice(30, ParticleMapsConfig()) == ()
    (notice,) = memory_notice(1000, ParticleMapsConfig(delta_m=0.02))
    # half of 2500 x 2500 cells of twenty bytes each, a thousand times
    assert "1000 particles with 0.02 m cells may need 62500 MB for 50 m x 50 m" in notice


def test_a_snapshot_holds_the_cells_and_little_else() -> None:
    rng, maps = np.random.default_rng(3), ParticleMaps.empty(4, RESOLUTION_M)
    for _ in range(6):
        maps.insert(random_scan(rng), rng.normal(0.0, 2.0, (4, 3)))
        maps.resample(rng.integers(0, 4, 4))
    packed = state_of(maps)
    assert len(packed.tree) + len(packed.data) < 0.1 * maps.memory_bytes
    restored = ParticleMaps.empty(4, RESOLUTION_M)
    restore_state(packed, restored)
    scan, poses = random_scan(rng), rng.normal(0.0, 2.0, (4, 3))
    for each in (maps, restored):
        each.insert(scan, poses)
        check_books(each)
    assert np.array_equal(maps.tables, restored.tables)
    for particle in range(4):
        one, other = as_naive(maps, particle), as_naive(restored, particle)
        assert one.keys() == other.keys()
        assert all(np.array_equal(one[at], other[at]) for at in one)


def test_a_growing_pool_keeps_its_cells() -> None:
    rng, maps = np.random.default_rng(4), ParticleMaps.empty(3, RESOLUTION_M)
    naive: NaiveMap = {}
    poses = np.zeros((3, 3))
    before = len(maps.cells)
    while len(maps.cells) < 3 * before:
        scan = random_scan(rng)
        maps.insert(scan, poses)
        naive_insert(naive, scan, poses[0])
        poses = poses + np.array([5.0, 0.0, 0.0])
    found = as_naive(maps, 0)
    assert found.keys() == naive.keys()
    assert all(np.allclose(found[at], naive[at], atol=1e-4) for at in found)
