# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The measured radio map of a made-up floor whose truth is known."""

from __future__ import annotations

from dataclasses import replace

import netCDF4
import numpy as np
import pytest

from slarm_graph.access_points import AccessPoint
from slarm_graph.config import MeasuredConfig, RadioConfig
from slarm_graph.errors import BadInput
from slarm_graph.geographic import CellState, Coverage, GeographicMap
from slarm_graph.grid import GridGeometry
from slarm_graph.radio.measured.blocks import find_blocks
from slarm_graph.radio.measured.build_map import build_measured_map
from slarm_graph.radio.measured.files import (
    LAYERS,
    read_measured_npz,
    write_access_points_csv,
    write_measured_csv,
    write_measured_netcdf,
    write_measured_npz,
)
from slarm_graph.radio.measured.fit import Problem
from slarm_graph.radio.measured.locate import _over_map, _Search
from slarm_graph.radio.measured.mean_function import MeanFunction
from slarm_graph.radio.measured.nodes import make_nodes
from slarm_graph.radio.measured.pictures import write_measured_png
from slarm_graph.radio.measured.priors import FloorField
from slarm_graph.radio.measured.readings import Receiver, RssReadings

GRID = GridGeometry(0.0, 0.0, 0.1, 60, 90)
AP = AccessPoint("ap", 1.5, 1.2, 2.4)
RADIO = RadioConfig()
CONFIG = MeasuredConfig(node_side_m=0.4)
LEVEL, EXPONENT, WALL = -42.0, 2.4, 6.0


def floor():
    states = np.full(GRID.shape, CellState.ACCESSIBLE, dtype=np.uint8)
    states[:50, 30] = CellState.OBSTACLE
    states[25, 31:80] = CellState.OBSTACLE
    heights = np.where(states == CellState.OBSTACLE, np.inf, 0.0).astype(np.float32)
    nothing = np.zeros(GRID.shape, dtype=bool)
    return GeographicMap(GRID, states, heights, "infinite", Coverage(nothing, nothing, nothing))


def true_level(geographic, points, **how):
    mean = MeanFunction(geographic, AP, RADIO.antenna_height_m, RADIO.mount_radius_m, **how)
    return mean.map_design(points) @ [LEVEL, EXPONENT, WALL]


def drive(rng, count):
    """Random points, in the order of a tour along x."""
    points = rng.uniform([0.2, 0.2], [8.8, 5.8], (count, 2))
    return points[np.argsort(points[:, 0])]


def placed(points, rss):
    return RssReadings(points, 0.5 * np.arange(len(rss)), rss, np.zeros(len(rss), dtype=np.int64))


@pytest.fixture(scope="module")
def noisy():
    rng = np.random.default_rng(2)
    geographic = floor()
    points = drive(rng, 900)
    rss = true_level(geographic, points) + 3.0 * rng.normal(size=900)
    return geographic, build_measured_map(
        geographic, {"ap": placed(points, rss)}, [AP], RADIO, CONFIG
    )


def test_the_models_terms_are_found(noisy):
    _, made = noisy
    terms = made.fitted[0]
    for value, truth, sd in zip(
        (terms.level_at_1_m_dbm, terms.exponent, terms.wall_db),
        (LEVEL, EXPONENT, WALL),
        terms.sd,
        strict=True,
    ):
        assert abs(value - truth) < 3.0 * sd
    assert terms.sd[2] < 1.0
    assert terms.noise_sd_db == pytest.approx(3.0, rel=0.12)


def test_map_is_near_the_truth_and_knows_how_near(noisy):
    geographic, made = noisy
    cells = np.argwhere(geographic.accessible)
    truth = true_level(geographic, GRID.center_of(cells))
    error = made.mean_dbm[0][tuple(cells.T)] - truth
    sd = made.mean_sd_db[0][tuple(cells.T)]
    assert np.sqrt((error**2).mean()) < 1.0
    assert (np.abs(error) < 1.96 * sd).mean() > 0.9
    assert (made.reading_sd_db[0][tuple(cells.T)] > sd).all()
    assert np.isnan(made.mean_dbm[0][~geographic.accessible]).all()


def test_doubt_of_a_links_walls_is_that_of_walls_a_cell_off():
    """Second implementation: the walls are moved, not the links."""
    geographic, rng = floor(), np.random.default_rng(6)
    points = rng.uniform([1.0, 1.0], [8.0, 5.0], (300, 2))
    counts = []
    for rows, cols in ((0, 0), (0, 1), (0, -1), (1, 0), (-1, 0)):
        heights = np.roll(geographic.heights_m, (rows, cols), axis=(0, 1))
        moved = replace(geographic, heights_m=heights)
        counts.append(MeanFunction(moved, AP, 0.5, 0.25).link_crossings(points).counts[0])
    design, map_variance_db2 = MeanFunction(geographic, AP, 0.5, 0.25).map_design_and_variance(
        points
    )
    np.testing.assert_allclose(design[:, 2], -np.mean(counts, axis=0))
    np.testing.assert_allclose(map_variance_db2, 25.0 * np.var(counts, axis=0))
    assert 0.02 < (map_variance_db2 > 0.0).mean() < 0.4


def with_block():
    """The floor and a block of 1.2 m, and a pillar no deeper than a wall."""
    geographic = floor()
    heights = geographic.heights_m.copy()
    heights[36:48, 60:72] = heights[10:16, 20:26] = np.inf
    states = np.where(heights > 0.0, CellState.OBSTACLE, geographic.states).astype(np.uint8)
    return replace(geographic, heights_m=heights, states=states)


def test_blocks_are_what_is_deeper_than_any_wall():
    found = find_blocks(with_block())
    assert found.count == 1
    inside = np.zeros(GRID.shape, dtype=np.int16)
    inside[39:45, 63:69] = 1
    np.testing.assert_array_equal(found.insides, inside)
    assert find_blocks(floor()).count == 0


def test_a_link_is_through_a_block_whose_inside_it_passes():
    mean = MeanFunction(with_block(), AP, 0.5, 0.25, find_blocks(with_block()))
    points = np.array([[8.5, 5.4], [8.5, 3.0], [5.8, 5.2]])
    design = mean.map_design(points)
    np.testing.assert_array_equal(design[:, 3], [-1.0, 0.0, 0.0])
    np.testing.assert_array_equal(design[:, :3], replace(mean, blocks=None).map_design(points))


def test_a_hollow_block_leaves_the_loss_of_a_wall_in_its_interval():
    """Its two walls are one on the map, which without a term of its own makes it 6.6 dB."""
    rng, geographic = np.random.default_rng(8), with_block()
    points = drive(rng, 1500)
    points = points[geographic.heights_m[tuple(GRID.cell_of(points).T)] == 0.0]
    mean = MeanFunction(geographic, AP, 0.5, 0.25, find_blocks(geographic), face_error_cells=0)
    rss = mean.map_design(points) @ [LEVEL, EXPONENT, WALL, WALL] + 2.0 * rng.normal(
        size=len(points)
    )
    made = build_measured_map(geographic, {"ap": placed(points, rss)}, [AP], RADIO, CONFIG)
    assert abs(made.fitted[0].wall_db - WALL) < 0.3
    assert abs(made.fitted[0].wall_db - WALL) < 1.96 * made.fitted[0].sd[2]


def test_readings_of_one_piece_of_floor_share_the_doubt_of_their_walls():
    """Oracle: dense covariance of readings with an error in common, and what their mean says."""
    nodes = make_nodes(GRID, floor().free, 0.4, 10_000)
    centers = nodes.centers_m[[3, 3, 3, 40, 40, 90]]
    shared = nodes.points_in_node(centers)
    np.testing.assert_array_equal(shared, [3, 3, 3, 2, 2, 1])
    noise, doubt = 4.0, 9.0
    for count in (1, 2, 3):
        together = noise * np.eye(count) + doubt * np.ones((count, count))
        says = np.ones(count) @ np.linalg.solve(together, np.ones(count))
        alone = noise + doubt * shared[shared == count][0]
        assert says == pytest.approx(count / alone)
    mean, here = MeanFunction(floor(), AP, 0.5, 0.25), drive(np.random.default_rng(1), 400)
    found = Problem.of(FloorField(nodes), mean, placed(here, np.zeros(400)), Receiver())
    map_variance_db2 = mean.map_design_and_variance(here)[1]
    assert map_variance_db2.max() > 0.0
    np.testing.assert_allclose(
        found.map_variance_db2, map_variance_db2 * nodes.points_in_node(here)
    )


@pytest.mark.parametrize("off", [(1, 0), (0, -1)])
def test_walls_a_cell_off_do_not_make_their_loss_less(off):
    """Without doubt at the shadows' edges it comes out at 3.0 and 4.5 dB here, sure to 0.3."""
    rng, geographic = np.random.default_rng(8), floor()
    points = drive(rng, 1500)
    moved = replace(geographic, heights_m=np.roll(geographic.heights_m, off, axis=(0, 1)))
    rss = true_level(moved, points, face_error_cells=0) + 2.0 * rng.normal(size=len(points))
    made = build_measured_map(geographic, {"ap": placed(points, rss)}, [AP], RADIO, CONFIG)
    assert abs(made.fitted[0].wall_db - WALL) < 1.0
    assert made.fitted[0].sd[2] < 0.5


def test_what_was_not_heard_counts():
    """Far off nothing is heard: left out, the map is too strong there; counted, it is not."""
    rng = np.random.default_rng(5)
    geographic = floor()
    points = drive(rng, 1200)
    rss = true_level(geographic, points) + 3.0 * rng.normal(size=len(points))
    far = points[:, 0] > 5.0
    rss[rss < -62.0] = np.nan
    errors = []
    for silent in (True, False):
        kept = np.ones(len(rss), dtype=bool) if silent else np.isfinite(rss)
        made = build_measured_map(
            geographic,
            {"ap": placed(points[kept], rss[kept])},
            [AP],
            RADIO,
            MeasuredConfig(node_side_m=0.4, threshold_dbm=-62.0),
        )
        cells = GRID.cell_of(points[far])
        values = made.mean_dbm[0][tuple(cells.T)]
        errors.append(float(np.nanmean(values - true_level(geographic, points[far]))))
    assert abs(errors[0]) < 1.0
    assert errors[1] > errors[0] + 1.0


def test_outliers_do_not_pull():
    rng = np.random.default_rng(7)
    geographic = floor()
    points = drive(rng, 600)
    rss = true_level(geographic, points) + 2.0 * rng.normal(size=600)
    rss[::12] -= 25.0
    made = build_measured_map(geographic, {"ap": placed(points, rss)}, [AP], RADIO, CONFIG)
    cells = np.argwhere(geographic.accessible)
    truth = true_level(geographic, GRID.center_of(cells))
    assert abs(np.mean(made.mean_dbm[0][tuple(cells.T)] - truth)) < 1.0


def test_too_few_readings_are_told():
    geographic = floor()
    few = placed(np.full((3, 2), 1.0), np.full(3, -50.0))
    with pytest.raises(BadInput, match="heard 3 times"):
        build_measured_map(geographic, {"ap": few}, [AP], RADIO, CONFIG)


def test_an_unknown_access_point_is_found():
    rng = np.random.default_rng(11)
    geographic = floor()
    points = drive(rng, 900)
    rss = true_level(geographic, points) + 2.0 * rng.normal(size=900)
    made = build_measured_map(geographic, {"someone": placed(points, rss)}, [], RADIO, CONFIG)
    found, sd = made.access_points[0], made.fitted[0].position_sd_m
    assert np.hypot(found.x_m - AP.x_m, found.y_m - AP.y_m) < 0.5
    assert max(sd[:2]) < 0.5
    assert abs(found.z_m - AP.z_m) < 3.0 * sd[2]


def test_without_a_position_there_is_still_a_map():
    rng = np.random.default_rng(3)
    geographic = floor()
    points = drive(rng, 500)
    rss = true_level(geographic, points) + 2.0 * rng.normal(size=500)
    config = MeasuredConfig(node_side_m=0.4, locate=False)
    made = build_measured_map(geographic, {"someone": placed(points, rss)}, [], RADIO, config)
    cells = np.argwhere(geographic.accessible)
    error = made.mean_dbm[0][tuple(cells.T)] - true_level(geographic, GRID.center_of(cells))
    assert np.sqrt((error**2).mean()) < 3.0
    assert np.isnan(made.access_points[0].x_m)


def test_files_keep_everything(noisy, tmp_path):
    _, made = noisy
    write_measured_npz(tmp_path / "m.npz", made)
    back = read_measured_npz(tmp_path / "m.npz")
    assert back.geometry == made.geometry
    assert back.access_points == made.access_points
    assert back.fitted == made.fitted
    for name in LAYERS:
        np.testing.assert_array_equal(getattr(back, name), getattr(made, name))
    write_measured_netcdf(tmp_path / "m.nc", made)
    with netCDF4.Dataset(tmp_path / "m.nc") as file:
        np.testing.assert_array_equal(file["mean_dbm"][:].filled(np.nan), made.mean_dbm)
        assert file["mean_dbm"].units == "dBm"
        np.testing.assert_allclose(file["x"][:2], [0.05, 0.15])
    write_measured_csv(tmp_path / "m.csv", made)
    lines = (tmp_path / "m.csv").read_text().splitlines()
    assert len(lines) == 1 + int(np.isfinite(made.mean_dbm).sum())
    write_access_points_csv(tmp_path / "ap.csv", made)
    assert "wall_db" in (tmp_path / "ap.csv").read_text()
    write_measured_png(tmp_path / "m.png", made)
    assert (tmp_path / "m.png").stat().st_size > 10_000
    (tmp_path / "m.npz").write_bytes(b"no")
    with pytest.raises(BadInput, match="not a measured radio map"):
        read_measured_npz(tmp_path / "m.npz")


def test_designs_from_several_positions_are_those_of_each():
    rng = np.random.default_rng(9)
    geographic = floor()
    low = np.where(geographic.heights_m > 0.0, np.float32(1.4), np.float32(0.0))
    points = drive(rng, 40)
    heard = replace(placed(points, rng.normal(size=40)), headings_rad=rng.uniform(-3.0, 3.0, 40))
    mean = MeanFunction(
        replace(geographic, heights_m=low), AP, RADIO.antenna_height_m, RADIO.mount_radius_m
    )
    positions = np.array([[1.0, 1.5, 2.5], [4.2, 1.1, 0.5], [1.0, 1.5, 0.5], [4.2, 1.1, 8.0]])
    found = mean.reading_designs_from(heard, positions)
    assert len(np.unique(found[:, :, 2].sum(axis=1))) == 3
    for position, design in zip(positions, found, strict=True):
        there = replace(mean, access_point=AccessPoint("there", *position), face_error_cells=0)
        np.testing.assert_allclose(design, there.reading_design_and_variance(heard)[0])


def test_part_of_the_readings_rules_out_only_what_all_rule_out():
    """Screened evidence is the full one where that is near the best, and the best is the same."""
    rng = np.random.default_rng(8)
    geographic = floor()
    points = drive(rng, 900)
    rss = true_level(geographic, points) + 2.0 * rng.normal(size=900)
    mean = MeanFunction(geographic, AP, RADIO.antenna_height_m, RADIO.mount_radius_m)
    field = FloorField(make_nodes(GRID, geographic.free, 0.8, 500))
    search = _Search(field, mean, placed(points, rss))
    lattice = _over_map(mean)
    screened = search.evidences(lattice)
    full = search._evidences_at(lattice)
    for position in lattice[::60]:
        there = replace(mean, access_point=AccessPoint("there", *position), face_error_cells=0)
        design = there.reading_design_and_variance(search._heard)[0]
        told = search._model.condition(design, search._coefficients, search._values).log_evidence
        assert search._evidences_at(position[None]) == pytest.approx(told)
    kept = np.isfinite(screened)
    np.testing.assert_allclose(screened[kept], full[kept], rtol=1e-9)
    assert screened.argmax() == full.argmax()
    assert full[~kept].max() < full.max() - 15.0
    assert kept.mean() < 0.5
