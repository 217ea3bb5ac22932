# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Images of maps that are larger than many programs read."""

from __future__ import annotations

import logging
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from slarm_graph.app import map_images
from slarm_graph.app.map_images import of_layers, save_map
from slarm_graph.app.run_folder import RunFolder
from slarm_graph.files.maps import read_map, trinary_image, write_trinary
from slarm_graph.grid import GridGeometry
from slarm_graph.raster import bands


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(map_images, "MOST_IMAGE_CELLS", 10)


def _layers(rng: np.random.Generator, geometry: GridGeometry) -> tuple[np.ndarray, np.ndarray]:
    kinds = rng.choice(3, geometry.shape, p=(0.1, 0.8, 0.1))
    return kinds == 0, kinds == 1


@pytest.mark.usefixtures("small")
def test_split_into_parts_that_lie_where_they_belong(tmp_path: Path) -> None:
    geometry = GridGeometry(-3.0, 2.0, 0.1, 23, 14)
    occupied, free = _layers(np.random.default_rng(0), geometry)
    save_map(RunFolder(tmp_path), "map", geometry, of_layers(occupied, free), "split")
    parts = sorted(tmp_path.glob("map_*.yaml"))
    assert [path.stem for path in parts] == [f"map_{r}_{c}" for r in range(3) for c in range(2)]
    seen = np.zeros(geometry.shape, dtype=int)
    for path in parts:
        grid = read_map(path)
        centers = grid.geometry.centers()
        cells = geometry.cell_of(centers)
        rows, cols = cells[..., 0], cells[..., 1]
        np.testing.assert_array_equal(grid.occupied, occupied[rows, cols])
        np.testing.assert_array_equal(grid.free, free[rows, cols])
        np.add.at(seen, (rows, cols), 1)
    assert (seen == 1).all()


@pytest.mark.usefixtures("small")
def test_coarser_cells_are_occupied_by_any_and_free_by_all_of_theirs(tmp_path: Path) -> None:
    geometry = GridGeometry(-3.0, 2.0, 0.1, 23, 14)
    occupied, free = _layers(np.random.default_rng(1), geometry)
    save_map(RunFolder(tmp_path), "map", geometry, of_layers(occupied, free), "coarse")
    grid = read_map(tmp_path / "map.yaml")
    assert grid.geometry.shape == (8, 5) and grid.geometry.resolution_m == pytest.approx(0.3)
    for row in range(8):
        for col in range(5):
            block = np.s_[3 * row : 3 * row + 3, 3 * col : 3 * col + 3]
            assert grid.occupied[row, col] == occupied[block].any()
            assert grid.free[row, col] == free[block].all()


@pytest.mark.usefixtures("small")
def test_whole_and_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    geometry = GridGeometry(0.0, 0.0, 0.1, 4, 11)
    occupied, free = _layers(np.random.default_rng(2), geometry)
    with caplog.at_level(logging.WARNING):
        save_map(RunFolder(tmp_path), "map", geometry, of_layers(occupied, free))
    assert "11 x 4 cells" in caplog.text and "mapping.large_image=split" in caplog.text
    assert read_map(tmp_path / "map.yaml").geometry.shape == (4, 11)


def test_an_image_is_written_in_bands_as_in_one_piece(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bands, "_BAND_CELLS", 30)
    geometry = GridGeometry(-3.0, 2.0, 0.1, 23, 14)
    occupied, free = _layers(np.random.default_rng(3), geometry)
    write_trinary(tmp_path / "m.pgm", geometry.shape, of_layers(occupied, free))
    image = cv2.imread(str(tmp_path / "m.pgm"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(image, trinary_image(occupied, free))


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_a_mask_takes_memory_where_it_is_true() -> None:
    """Cells at both ends of every row of 256 pages: those between them are not written."""
    code = (
        "import numpy as np\n"
        "from slarm_graph.app.allocation import configure_allocator\n"
        "from slarm_graph.app.ending import memory_mb\n"
        "from slarm_graph.raster import bands\n"
        "configure_allocator()\n"
        "row = np.zeros((1, 2**20), dtype=np.bool_)\n"
        "row[0, 0] = row[0, -1] = True\n"
        "before = memory_mb()\n"
        "mask = bands.by_windows((64, 2**20), 0, "
        "lambda w: np.repeat(row, w[0].stop - w[0].start, 0))\n"
        "print(memory_mb() - before)\n"
        "assert mask.sum() == 128"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert float(done.stdout) < 16.0, "of 67 MB"
