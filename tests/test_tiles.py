# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""What is done in the tiles of a grid alone is what is done on all of it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scanned_rooms import scanned_room

from slarm_graph.access_points import AccessPoint, RadioMap
from slarm_graph.config import MappingConfig, RadioConfig, RecoveryConfig
from slarm_graph.eval.gain_figure import gain_curves, gain_figure
from slarm_graph.eval.report_figures import geographic_figure, map_picture
from slarm_graph.files.coverage import read_coverage, write_coverage
from slarm_graph.files.maps import masks_of, write_trinary
from slarm_graph.geographic import GeographicMap
from slarm_graph.grid import GridGeometry, Mask, OccupancyGrid
from slarm_graph.mapping import end_points_m, mapper, render
from slarm_graph.radio.files import read_radio_npz, write_radio_csv, write_radio_npz
from slarm_graph.radio.netcdf import read_radio_netcdf, write_radio_netcdf
from slarm_graph.radio.radio_map import radio_map
from slarm_graph.radio.shadows import boxes_of_cells, shadowed_cells
from slarm_graph.raster import bands
from slarm_graph.raster.bands import (
    by_windows,
    cells_of,
    copy_of,
    every_so_many,
    in_runs,
    looked_up,
    put,
)
from slarm_graph.raster.distance import within
from slarm_graph.raster.fill import Polygons
from slarm_graph.raster.layers import blank_layer, new_layer
from slarm_graph.raster.outlines import outlines_m
from slarm_graph.raster.patches import joined, larger_than
from slarm_graph.tiles import TILE_CELLS, KnownTiles, known_tiles
from slarm_graph.trajectory import Trajectory

SEEDS = pytest.mark.parametrize("seed", range(6))


@pytest.fixture(autouse=True)
def _small_bands(monkeypatch: pytest.MonkeyPatch) -> None:
    """Several bands even of small grids."""
    monkeypatch.setattr(bands, "_BAND_CELLS", 60_000)


def some_places(seed: int) -> tuple[Mask, KnownTiles]:
    """Cells at random in a few places of a grid of random size, and the tiles of these places."""
    rng = np.random.default_rng(seed)
    shape = tuple(rng.integers(400, 1100, 2).tolist())
    mask = np.zeros(shape, dtype=np.bool_)
    boxes = []
    for _ in range(rng.integers(1, 5)):
        low = np.array([rng.integers(0, n) for n in shape])
        high = np.minimum(low + rng.integers(1, 90, 2), shape)
        part = np.s_[low[0] : high[0], low[1] : high[1]]
        mask[part] |= rng.random(mask[part].shape) < rng.uniform(0.2, 0.9)
        boxes.append((low, high - 1))
    low, high = (np.array([box[k] for box in boxes]) for k in range(2))
    return mask, KnownTiles.none(mask.shape).with_boxes(low, high)


@SEEDS
def test_tiles_know_their_cells_and_columns(seed: int) -> None:
    mask, tiles = some_places(seed)
    known = np.kron(tiles.known, np.ones((TILE_CELLS, TILE_CELLS), dtype=np.bool_))
    known = known[: mask.shape[0], : mask.shape[1]]
    assert tiles.cells == known.sum()
    assert tiles.share == pytest.approx(known.mean())
    assert known[mask].all()
    whole = by_windows(tiles, 0, lambda w: np.ones_like(mask[w]))
    assert not (known & ~whole).any()
    far = within(known, 30.0, 1.0)
    grown = by_windows(tiles.grown(30), 0, lambda w: np.ones_like(mask[w]))
    assert not (far & ~grown).any()


@SEEDS
def test_masks_of_tiles_are_those_of_the_grid(seed: int) -> None:
    mask, tiles = some_places(seed)
    rng = np.random.default_rng(seed)
    seeds = mask & (rng.random(mask.shape) < 0.01)
    same = np.testing.assert_array_equal
    same(larger_than(mask, 5, tiles), larger_than(mask, 5))
    same(within(mask, 7.3, 1.0, tiles), within(mask, 7.3, 1.0))
    same(within(mask, 33.3, 1.0, tiles), within(mask, 33.3, 1.0))
    if seeds.any():
        same(joined(mask, seeds, tiles), joined(mask, seeds))
    same(cells_of(mask, tiles), np.argwhere(mask))
    same(copy_of(mask, tiles), mask)
    layer = mask.astype(np.uint8)
    put(layer, seeds, 7, tiles)
    same(layer, np.where(seeds, 7, mask))


@SEEDS
def test_layers_are_looked_up_and_written_out_as_they_are(seed: int) -> None:
    mask, tiles = some_places(seed)
    layer = np.where(mask, np.float32(1.5), np.float32(np.nan))
    found = [
        np.full(run, np.nan) if isinstance(run, int) else run.ravel()
        for run in in_runs(layer, tiles, np.nan)
    ]
    np.testing.assert_array_equal(np.concatenate(found), layer.ravel())
    window = np.s_[17 : mask.shape[0] - 40, 30 : mask.shape[1] - 3]
    np.testing.assert_array_equal(looked_up(layer, tiles, window, np.nan), layer[window])
    for step in (1, 7, 80):
        few = every_so_many(layer, tiles, step, np.nan)
        np.testing.assert_array_equal(few, layer[::step, ::step])


@SEEDS
def test_what_is_left_out_is_what_is_blank(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Rows with nothing, rows known throughout, and stretches between: in every order."""
    monkeypatch.setattr(bands, "_FEW_CELLS", 70)
    monkeypatch.setattr(bands, "_BAND_CELLS", 20_000)
    rng = np.random.default_rng(seed)
    tiles = KnownTiles((600, 330), rng.random((10, 6)) < rng.uniform(0.2, 0.8, (10, 1)))
    tiles.known[rng.random(10) < 0.4] = True
    tiles.known[rng.random(10) < 0.3] = False
    known = np.kron(tiles.known, np.ones((TILE_CELLS, TILE_CELLS), dtype=np.bool_))[:600, :330]
    layer = np.where(known, rng.integers(1, 200, known.shape), 0).astype(np.uint8)
    runs = list(in_runs(layer, tiles))
    found = [np.zeros(run, np.uint8) if isinstance(run, int) else run.ravel() for run in runs]
    np.testing.assert_array_equal(np.concatenate(found), layer.ravel())
    assert any(isinstance(run, int) for run in runs)


@SEEDS
def test_outlines_and_boxes_of_tiles_are_those_of_the_grid(seed: int) -> None:
    mask, tiles = some_places(seed)
    geometry = GridGeometry(-3.0, 2.0, 0.1, *mask.shape)
    for one, other in zip(
        outlines_m(geometry, mask, tiles), outlines_m(geometry, mask), strict=True
    ):
        np.testing.assert_array_equal(one, other)
    heights = mask.astype(np.uint8)
    boxes, tops = boxes_of_cells(heights, 0.0, known_tiles(tiles))
    every, all_tops = boxes_of_cells(heights, 0.0, known_tiles(mask.shape))
    np.testing.assert_array_equal(boxes, every)
    np.testing.assert_array_equal(tops, all_tops)
    corners = boxes[:40, [0, 1, 2, 1, 2, 3, 0, 3]].reshape(-1, 2).astype(np.float64)
    starts, scales = np.arange(0, len(corners) + 1, 4), np.tile([1.0, 9.0], (len(corners) // 4, 1))
    given = np.array([100.3, 90.2]), corners, starts, scales, 1.0
    whole = by_windows(tiles, 0, lambda w: shadowed_cells(mask.shape, *given)[w])
    np.testing.assert_array_equal(shadowed_cells(tiles, *given), whole)


@SEEDS
def test_a_flood_goes_on_through_what_lies_outside(seed: int) -> None:
    """Unknown cells around what is known, joined around it or enclosed by it."""
    mask, tiles = some_places(seed)
    rng = np.random.default_rng(seed)
    inside = by_windows(tiles, 0, lambda w: np.ones_like(mask[w]))
    unknown = ~(mask & (rng.random(mask.shape) < 0.95))
    seeds = np.zeros_like(mask)
    rows, cols = np.nonzero(unknown & inside & ~by_windows(tiles, 1, lambda w: ~inside[w]))
    pick = rng.integers(len(rows))
    seeds[rows[pick], cols[pick]] = True
    found = joined(unknown & inside, seeds, tiles, through=True)
    np.testing.assert_array_equal(found, joined(unknown, seeds) & inside)


@SEEDS
def test_windows_of_polygons_are_cut_out_of_the_whole(seed: int) -> None:
    rng = np.random.default_rng(seed)
    geometry = GridGeometry(0.0, 0.0, 1.0, 300, 420)
    middles = rng.uniform(-20, 440, (12, 1, 2))
    triangles = middles + rng.uniform(-60, 60, (12, 3, 2))
    plans = Polygons.on(geometry, triangles)
    window = np.s_[31:222, 64:333]
    np.testing.assert_array_equal(plans.any(window), plans.any()[window])
    np.testing.assert_array_equal(plans.odd(window), plans.odd()[window])
    tiles = plans.tiles_of(KnownTiles.none(geometry.shape))
    np.testing.assert_array_equal(by_windows(tiles, 0, plans.any), plans.any())


@pytest.mark.skipif(sys.platform != "linux", reason="maps pages as Linux does")
def test_a_blank_layer_is_nan_until_it_is_written() -> None:
    tiles = KnownTiles.none((5000, 4000)).with_boxes(np.array([[9, 9]]), np.array([[9, 9]]))
    layer = blank_layer((2, 5000, 4000), tiles)
    layer[1, 9, 5:9] = 2.0
    assert np.isnan(layer[0]).all()
    assert np.flatnonzero(~np.isnan(layer[1])).tolist() == list(range(9 * 4000 + 5, 9 * 4000 + 9))
    assert np.isnan(blank_layer((7, 5), None)).all()
    assert not new_layer((5000, 4000), np.float32, tiles).any()


Maps = tuple[OccupancyGrid, GeographicMap, RadioMap]


def far_apart(config: MappingConfig) -> Maps:
    """Maps of a room that was left, with nothing seen, for the same room far off."""
    scans, path = scanned_room(0.01, 0.0)
    half = len(scans) // 2
    poses = path.poses.copy()
    poses[half:, :2] += [41.0, 27.0]
    path = Trajectory(path.stamps_ns, poses)
    grid = render(scans, path, config)
    recovery = RecoveryConfig(expansion_radius_m=0.1)
    geographic = recovery_of(grid, path, recovery, scans, config)
    points = [AccessPoint("AP1", 2.0, 1.0, 2.5), AccessPoint("AP2", 40.0, 27.0, 2.0)]
    return grid, geographic, radio_map(geographic, points, RadioConfig())


def recovery_of(grid, path, recovery, scans, config):  # type: ignore[no-untyped-def]
    from slarm_graph.recovery.recover import recover
    from slarm_graph.recovery.returns import gather_returns

    returns = gather_returns(end_points_m(scans, path, config), grid.geometry.resolution_m)
    return recover(grid, path, recovery, returns=returns)


@pytest.fixture(scope="module")
def dense_and_tiled() -> tuple[Maps, Maps]:
    """Make the same maps with and without tiles."""
    dense = far_apart(MappingConfig())
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(mapper, "_LARGE_CELLS", 1)
        patch.setattr(bands, "_BAND_CELLS", 60_000)
        return dense, far_apart(MappingConfig())


def test_maps_in_tiles_are_those_of_the_whole_grid(dense_and_tiled: tuple[Maps, Maps]) -> None:
    (grid, geographic, radio), (tiled_grid, tiled_map, tiled_radio) = dense_and_tiled
    assert grid.tiles is None
    assert tiled_radio.tiles is not None
    assert tiled_radio.tiles.share < 0.6
    assert tiled_grid.geometry == grid.geometry
    same = np.testing.assert_array_equal
    same(tiled_grid.probability, grid.probability)
    same(tiled_map.states, geographic.states)
    same(tiled_map.heights_m, geographic.heights_m)
    for name in ("observed", "visited", "footprint"):
        same(getattr(tiled_map.coverage, name), getattr(geographic.coverage, name))
    assert tiled_map.changed_cells == geographic.changed_cells
    for name in ("path_loss_db", "line_of_sight", "sight_probability", "sight_unknown"):
        same(getattr(tiled_radio, name), getattr(radio, name))
    assert radio.sight_unknown.any()
    assert tiled_radio.gain_span_db() == radio.gain_span_db()


def test_files_of_tiles_are_those_of_the_whole_grid(
    dense_and_tiled: tuple[Maps, Maps], tmp_path: Path
) -> None:
    for name, (grid, geographic, radio) in zip("dt", dense_and_tiled, strict=True):
        write_trinary(tmp_path / f"{name}.pgm", grid.where, masks_of(grid))
        write_coverage(tmp_path / f"{name}.coverage.npz", geographic)
        write_radio_npz(tmp_path / f"{name}.npz", radio)
        write_radio_netcdf(tmp_path / f"{name}.nc", radio)
        write_radio_csv(tmp_path / f"{name}.csv", radio)
    for kind in ("pgm", "csv"):
        assert (tmp_path / f"t.{kind}").read_bytes() == (tmp_path / f"d.{kind}").read_bytes()
    d, t = (read_coverage(tmp_path / f"{name}.coverage.npz") for name in "dt")
    np.testing.assert_array_equal(d.states, t.states)
    np.testing.assert_array_equal(d.coverage.footprint, t.coverage.footprint)
    for read, kind in ((read_radio_npz, "npz"), (read_radio_netcdf, "nc")):
        one, other = read(tmp_path / f"d.{kind}"), read(tmp_path / f"t.{kind}")
        for layer in ("path_loss_db", "line_of_sight", "sight_probability", "sight_unknown"):
            np.testing.assert_array_equal(getattr(one, layer), getattr(other, layer))


def test_pictures_of_tiles_are_those_of_the_whole_grid(
    dense_and_tiled: tuple[Maps, Maps],
) -> None:
    dense, tiled = dense_and_tiled
    assert map_picture(dense[0]) == map_picture(tiled[0])
    assert geographic_figure(dense[1]) == geographic_figure(tiled[1])
    for draw in (gain_figure, gain_curves):
        assert draw(dense[2]) == draw(tiled[2])


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_a_box_of_a_kilometre_takes_what_is_mapped_of_it() -> None:
    """Two rooms a kilometre apart: 400 million cells, of which 0.1 % are looked at."""
    code = (
        "import numpy as np\n"
        "from scanned_rooms import scanned_room\n"
        "from slarm_graph.app.allocation import configure_allocator\n"
        "from slarm_graph.app.ending import memory_mb\n"
        "from slarm_graph.config import MappingConfig\n"
        "from slarm_graph.mapping import render\n"
        "from slarm_graph.trajectory import Trajectory\n"
        "configure_allocator()\n"
        "scans, path = scanned_room(0.01, 0.0)\n"
        "render(scans, path, MappingConfig())\n"
        "path.poses[len(scans) // 2 :, :2] += 1000.0\n"
        "before = memory_mb()\n"
        "grid = render(scans, path, MappingConfig())\n"
        "assert grid.geometry.rows * grid.geometry.cols > 400e6\n"
        "assert grid.tiles.cells < 0.001 * 400e6\n"
        "print(memory_mb() - before)\n"
    )
    run = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        cwd=Path(__file__).parent,
    )
    assert float(run.stdout) < 64.0, "of 1,700 MB"
