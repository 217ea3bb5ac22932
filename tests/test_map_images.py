# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Images of maps that are larger than many programs read."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
import pytest

from slarm_graph.app import map_images
from slarm_graph.app.map_images import save_map
from slarm_graph.app.run_folder import RunFolder
from slarm_graph.files.maps import read_map
from slarm_graph.grid import GridGeometry


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
    save_map(RunFolder(tmp_path), "map", geometry, occupied, free, "split")
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
    save_map(RunFolder(tmp_path), "map", geometry, occupied, free, "coarse")
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
        save_map(RunFolder(tmp_path), "map", geometry, occupied, free)
    assert "11 x 4 cells" in caplog.text and "mapping.large_image=split" in caplog.text
    assert read_map(tmp_path / "map.yaml").geometry.shape == (4, 11)
