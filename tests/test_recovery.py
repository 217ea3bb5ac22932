# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Map recovery: what it must never do on any grid, and what it must achieve in known rooms."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from scanned_rooms import WORLD, scanned_room
from scipy import ndimage

from slarm_graph.config import MappingConfig, RadioConfig, RecoveryConfig
from slarm_graph.eval.radio_accuracy import radio_accuracy
from slarm_graph.geographic import CellState
from slarm_graph.grid import GridGeometry, OccupancyGrid
from slarm_graph.radio.radio_map import radio_map, theoretical_radio_map
from slarm_graph.raster.distance import within
from slarm_graph.recovery.coverage import visited_cells
from slarm_graph.recovery.grid_cleaning import clean_grid
from slarm_graph.recovery.recover import _faces, recover, recover_scans, with_sizes_of
from slarm_graph.recovery.returns import gather_returns
from slarm_graph.trajectory import Trajectory
from slarm_graph.truth_map import truth_map


def grid_of(rows):
    """A grid from text: `#` occupied, `.` free, blank unknown; the first row is the highest."""
    table = {"#": 1.0, ".": 0.0, " ": np.nan}
    values = np.array([[table[c] for c in row] for row in rows[::-1]], dtype=np.float32)
    return OccupancyGrid(GridGeometry(0.0, 0.0, 0.05, *values.shape), values)


def path(*points):
    poses = np.array([[x, y, 0.0] for x, y in points])
    return Trajectory(np.arange(len(poses)) * 1_000_000_000, poses)


@st.composite
def random_grids(draw):
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    shape = tuple(rng.integers(3, 40, 2))
    resolution = float(rng.choice([0.05, 0.1, 0.25]))
    noise = rng.random(shape)
    if rng.random() < 0.5:
        noise = ndimage.gaussian_filter(noise, 1.0)
        noise = (noise - noise.min()) / max(float(np.ptp(noise)), 1e-9)
    values = np.where(noise > 0.75, 1.0, np.where(noise < 0.65, 0.0, np.nan)).astype(np.float32)
    grid = OccupancyGrid(GridGeometry(-1.0, 0.5, resolution, *map(int, shape)), values)
    x_min, x_max, y_min, y_max = grid.geometry.extent_m
    count = int(rng.integers(1, 6))
    points = rng.uniform([x_min, y_min], [x_max, y_max], (count, 2))
    return grid, path(*points)


@settings(deadline=None, max_examples=150)
@given(
    random_grids(),
    st.sampled_from([0.0, 0.1]),
    st.booleans(),
    st.sampled_from([(), ((0.3, 0.2, 1.0), (0.5, 0.5, 0.9, 0.785), (2.0, 1.0, 1.5, 0.6))]),
)
def test_invariants_on_any_grid(drawn, expansion_radius_m, straighten, known_sizes):
    grid, trajectory = drawn
    config = RecoveryConfig(
        expansion_radius_m=expansion_radius_m, straighten=straighten, known_sizes=known_sizes
    )
    recovered = recover(grid, trajectory, config)
    visited = visited_cells(grid.geometry, trajectory)
    # No visited cell becomes an obstacle, nor anything but accessible.
    drivable = (CellState.ACCESSIBLE, CellState.EXPANSION, CellState.ENCLOSED)
    assert np.isin(
        recovered.states[visited], drivable if expansion_radius_m else drivable[:1]
    ).all()
    np.testing.assert_array_equal(recovered.coverage.visited, visited)
    # Passable space stays free, hence keeps its connections.
    room_cells = ndimage.distance_transform_edt(~(grid.occupied & ~visited))
    fits = room_cells > config.robot_radius_m / grid.geometry.resolution_m
    passable = clean_grid(grid, visited, config).reached & ((grid.free & fits) | visited)
    within = np.isin(recovered.states, (CellState.ACCESSIBLE, CellState.EXPANSION))
    still = within | (recovered.states == CellState.ENCLOSED)
    assert not np.any(passable & ~still)
    before, _ = ndimage.label(passable)
    after, _ = ndimage.label(still)
    for label in range(1, before.max() + 1):
        assert len(np.unique(after[before == label])) == 1
        if expansion_radius_m == 0.0 and (visited & (before == label)).any():
            assert within[before == label].all()
    # What is accessible can be driven to.
    ways, _ = ndimage.label(recovered.accessible)
    if recovered.accessible[visited].any():
        assert set(np.unique(ways)) <= {0, *np.unique(ways[visited])}
    # Heights exist exactly on obstacles, and changes are counted.
    assert ((recovered.heights_m > 0) == recovered.obstacle).all()
    assert 0 <= recovered.changed_cells <= grid.probability.size


def test_specks_go_walls_stay_and_pinholes_close():
    rows = [
        "####################",
        "#..................#",
        "#..................#",
        "#......#...........#",
        "#..................#",
        "#...................",
        "#..................#",
        "#..................#",
        "####################",
    ]
    recovered = recover(grid_of(rows), path((0.2, 0.2), (0.7, 0.2)), RecoveryConfig())
    states = recovered.states[::-1]
    assert states[3, 7] == CellState.ACCESSIBLE
    assert states[5, 19] == CellState.OBSTACLE
    assert (states[0] == CellState.OBSTACLE).all()
    assert (states[1:-1, 1:-1] == CellState.ACCESSIBLE).all()


def test_unseen_inside_of_a_block_is_never_accessible():
    rows = ["." * 30] * 8 + ["." * 8 + "#" * 12 + "." * 10]
    rows += ["." * 8 + "#" + " " * 10 + "#" + "." * 10] * 6
    rows += ["." * 8 + "#" * 12 + "." * 10] + ["." * 30] * 8
    recovered = recover(grid_of(rows), path((0.1, 0.1), (1.4, 0.1)), RecoveryConfig())
    block = recovered.states[8:16, 8:20]
    assert not (block == CellState.ACCESSIBLE).any()
    assert (recovered.states[:8] == CellState.ACCESSIBLE).all()


def test_free_space_behind_a_wall_is_enclosed():
    rows = ["." * 10 + "#" + "." * 10] * 12
    recovered = recover(grid_of(rows), path((0.1, 0.1), (0.4, 0.4)), RecoveryConfig())
    assert (recovered.states[:, :10] == CellState.ACCESSIBLE).all()
    assert (recovered.states[:, 11:] == CellState.ENCLOSED).all()


def test_a_beam_through_a_window_leads_nowhere():
    rows = [
        "." * 20 + "#" + "." * 20 if n in (2, 11) else "." * 20 + "#" + " " * 20 for n in range(14)
    ]
    rows[2] = "." * 41
    rows[11] = rows[10] = "." * 41
    rows += ["." * 20 + "#" + "." * 20] * 6 + ["." * 41] * 4 + ["." * 20 + "#" + "." * 20] * 6
    recovered = recover(
        grid_of(rows), path((0.1, 0.1), (0.9, 1.2)), RecoveryConfig(straighten=False)
    )
    states = recovered.states[::-1]
    assert (states[:, :20] == CellState.ACCESSIBLE).all()
    # Lines of one and two cells lead nowhere beyond their first centimetres, a door of four does.
    for row in (2, 10, 11):
        assert (states[row, 24:] == CellState.ENCLOSED).all()
    assert (states[14:, 21:] == CellState.ACCESSIBLE).all()


def test_what_the_expansion_radius_cuts_off_is_out_of_reach():
    rows = ["." * 9 + "#" + "." * 9] * 9
    rows[4] = rows[5] = "." * 19
    grid = grid_of(rows)
    wide = OccupancyGrid(GridGeometry(0.0, 0.0, 0.25, *grid.geometry.shape), grid.probability)
    for radius_m, beyond in ((0.0, CellState.ACCESSIBLE), (0.25, CellState.ENCLOSED)):
        config = RecoveryConfig(expansion_radius_m=radius_m, straighten=False)
        recovered = recover(wide, path((0.3, 0.3), (1.5, 1.2)), config)
        assert (recovered.states[1:-1, 12:-1] == beyond).all()


def test_expansion_radius_is_rounded_up_to_cells():
    rows = ["." * 12 + "#" * 3] * 9
    config = RecoveryConfig(expansion_radius_m=0.06)
    recovered = recover(grid_of(rows), path((0.1, 0.1), (0.2, 0.2)), config)
    assert (recovered.states[:, 10:12] == CellState.EXPANSION).all()
    # Beyond the lattice nothing is known, so that its rim is kept from as well.
    assert (recovered.states[2:-2, 2:10] == CellState.ACCESSIBLE).all()
    assert (recovered.states[:2] != CellState.ACCESSIBLE).all()


def test_thin_curved_wall_survives_straightening():
    values = np.zeros((80, 80), dtype=np.float32)
    angle = np.linspace(0.2, 1.3, 400)
    values[(60 * np.sin(angle)).astype(int), (60 * np.cos(angle)).astype(int)] = 1.0
    grid = OccupancyGrid(GridGeometry(0.0, 0.0, 0.05, 80, 80), values)
    recovered = recover(grid, path((0.3, 0.3), (3.8, 3.8)), RecoveryConfig(speck_cells=0))
    near = ndimage.distance_transform_edt(~recovered.obstacle)
    visited = visited_cells(grid.geometry, path((0.3, 0.3), (3.8, 3.8)))
    assert near[(values > 0) & ~ndimage.binary_dilation(visited, iterations=3)].max() <= 1.5


@given(
    st.tuples(st.floats(-2, 2), st.floats(-2, 2), st.floats(0.03, 0.4), st.floats(0.03, 0.4)),
    st.integers(0, 2**32 - 1),
)
def test_another_lattice_is_looked_up_at_its_centres(frame, seed):
    x_m, y_m, mine_m, its_m = frame
    rng = np.random.default_rng(seed)
    mine = GridGeometry(0.3, -0.7, mine_m, 13, 9)
    layer = rng.integers(1, 1000, mine.shape)
    target = GridGeometry(x_m, y_m, its_m, 7, 11)
    expected = mine.sample(layer, target.centers(), outside=0)
    np.testing.assert_array_equal(mine.resample(layer, target, outside=0), expected)


@pytest.mark.parametrize("radius_m", [0.0, 0.05, 0.112, 0.3, 0.4, 0.45, 0.9])
def test_cells_within_a_distance(radius_m):
    rng = np.random.default_rng(3)
    geometry = GridGeometry(0.0, 0.0, 0.05, 40, 30)
    mask = rng.random(geometry.shape) < 0.01
    off = geometry.centers()[:, :, None] - geometry.center_of(np.argwhere(mask))
    near = (np.linalg.norm(off, axis=-1) <= radius_m + 1e-6).any(axis=-1)
    np.testing.assert_array_equal(within(mask, radius_m, geometry.resolution_m), near)
    assert not within(np.zeros_like(mask), radius_m, geometry.resolution_m).any()


def test_footprint_is_the_disc_around_the_path():
    rows = ["." * 40] * 30
    recovered = recover(grid_of(rows), path((0.5, 0.75), (1.5, 0.75)), RecoveryConfig())
    centers = recovered.geometry.centers()
    inside = np.hypot(np.maximum(np.abs(centers[..., 0] - 1.0) - 0.5, 0.0), centers[..., 1] - 0.75)
    clear = np.abs(inside - 0.18) > 1e-3
    np.testing.assert_array_equal(recovered.coverage.footprint[clear], (inside < 0.18)[clear])


def test_returns_are_gathered_without_moving_their_mean():
    rng = np.random.default_rng(0)
    points = rng.normal(0.0, 1.0, (5000, 2))
    returns = gather_returns(points, 0.1)
    assert returns.weights.sum() == 5000
    np.testing.assert_allclose(
        np.average(returns.points, axis=0, weights=returns.weights), points.mean(axis=0)
    )
    assert not len(gather_returns(np.zeros((0, 2)), 0.1).points)


@pytest.mark.parametrize("resolution", [0.05, 0.1, 0.25])
def test_the_papers_room_is_recovered(resolution):
    scans, trajectory = scanned_room(sigma_m=0.01, drift_m=0.005)
    truth = truth_map(WORLD, resolution)
    config = with_sizes_of(WORLD, RecoveryConfig())
    recovered = recover_scans(scans, trajectory, MappingConfig(), config, geometry=truth.geometry)
    heights = sorted(s.height_m for s in recovered.solids if math.isfinite(s.height_m))
    assert heights == [1.5, 1.5, 1.5, 1.8]
    score = radio_accuracy(
        truth.reachable,
        theoretical_radio_map(WORLD, truth.geometry, RadioConfig()),
        recovered,
        radio_map(recovered, WORLD.access_points, RadioConfig()),
    )
    assert score.accuracy > 0.98
    assert score.false_accessible < 0.01
    assert score.coverage_observed > 0.98


def test_walls_are_placed_within_millimetres():
    scans, trajectory = scanned_room(sigma_m=0.01, drift_m=0.0)
    geometry = GridGeometry.covering(*WORLD.extent_m(), 0.05)
    recovered = recover_scans(
        scans,
        trajectory,
        MappingConfig(),
        with_sizes_of(WORLD, RecoveryConfig()),
        geometry=geometry,
    )
    ring = next(s for s in recovered.solids if s.height_m == 1.8)
    low, high = ring.corners_m.min(axis=0), ring.corners_m.max(axis=0)
    np.testing.assert_allclose([*low, *high], [-3.5, -1.75, 3.5, 1.75], atol=0.005)


def test_without_known_sizes_heights_are_the_default():
    scans, trajectory = scanned_room(sigma_m=0.01, drift_m=0.0)
    geometry = GridGeometry.covering(*WORLD.extent_m(), 0.1)
    config = RecoveryConfig(default_height_m=1.2)
    recovered = recover_scans(scans, trajectory, MappingConfig(), config, geometry=geometry)
    assert recovered.height_source == "default"
    assert {s.height_m for s in recovered.solids} == {1.2}


def test_faces_are_slim_rectangles_that_free_sides_lengthen_and_blocked_ones_shorten():
    ring = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 2.0], [1.0, 2.5], [0.0, 2.0]])
    free, blocked = (shapely.polygons(quads) for quads in _faces([ring], 0.05))
    assert len(free) + len(blocked) == 5
    sides = shapely.linestrings(np.stack([ring, np.roll(ring, -1, axis=0)], axis=1))
    for quads, sign in ((free, 1.0), (blocked, -1.0)):
        for quad in quads:
            side = min(sides, key=lambda line: line.centroid.distance(quad.centroid))
            assert quad.is_valid
            half_m = shapely.hausdorff_distance(quad.exterior, side)
            half_m = min(half_m, shapely.distance(quad.exterior, side.centroid))
            assert 0.0 < half_m <= 0.0101
            assert quad.area == pytest.approx(2.0 * half_m * (side.length + 2.0 * sign * half_m))
    normals = np.roll(ring, -1, axis=0) - ring
    right_or_above = (np.column_stack([-normals[:, 1], normals[:, 0]]) @ [1.0, 0.01]) > 0.0
    assert len(free) == right_or_above.sum()


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("axis", [0, 1])
def test_cleaning_treats_all_borders_alike(seed, axis):
    """What is mirrored before comes out mirrored; small unknown patches touch every border."""
    rng = np.random.default_rng(seed)
    probability = rng.choice(
        np.array([0.0, 1.0, np.nan], dtype=np.float32), (24, 30), p=[0.9, 0.02, 0.08]
    )
    geometry, visited = GridGeometry(0.0, 0.0, 0.05, 24, 30), np.zeros((24, 30), dtype=bool)
    visited[12, 15] = True
    probability[12, 15] = 0.0
    there = clean_grid(OccupancyGrid(geometry, probability), visited, RecoveryConfig())
    flipped = np.ascontiguousarray(np.flip(probability, axis))
    mirrored = clean_grid(
        OccupancyGrid(geometry, flipped),
        np.ascontiguousarray(np.flip(visited, axis)),
        RecoveryConfig(),
    )
    for name in ("occupied", "free", "reached"):
        np.testing.assert_array_equal(
            np.flip(getattr(mirrored, name), axis), getattr(there, name), err_msg=name
        )
