# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The example scripts run, are short, and come to the right figures."""

from __future__ import annotations

import runpy
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from test_cli import room_bag

from slarm_graph import (
    Constraint,
    OccupancyGrid,
    PoseGraph,
    Trajectory,
    read_g2o,
    read_map,
    read_radio_npz,
    read_trajectory,
    write_g2o,
    write_map,
    write_trajectory,
)
from slarm_graph.constraint import ConstraintKind
from slarm_graph.geometry import Pose2
from slarm_graph.grid import GridGeometry

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"


def example(name: str) -> Callable[..., None]:
    main: Callable[..., None] = runpy.run_path(str(EXAMPLES / f"{name}.py"))["main"]
    return main


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A robot drives 1.5 m through a room."""
    return room_bag(tmp_path_factory.mktemp("bags") / "room.bag", 30)


@pytest.fixture
def room(tmp_path: Path) -> Path:
    """A map of a room of 4 x 3 m."""
    occupied = np.zeros((30, 40), dtype=np.bool_)
    occupied[[0, -1]] = occupied[:, [0, -1]] = True
    grid = OccupancyGrid(GridGeometry(0.0, 0.0, 0.1, 30, 40), occupied, ~occupied)
    write_map(tmp_path / "room.yaml", grid)
    return tmp_path / "room.yaml"


def test_every_script_is_short_and_tested() -> None:
    here = Path(__file__).read_text()
    for path in EXAMPLES.glob("*.py"):
        assert len(path.read_text().splitlines()) < 40, path
        assert f'example("{path.stem}")' in here, path


def test_run_bag(bag: Path, tmp_path: Path) -> None:
    example("run_bag")(str(bag), str(tmp_path), "pose_graph")
    assert read_trajectory(tmp_path / "trajectory.tum").path_length_m() == pytest.approx(1.45, 0.05)
    assert read_map(tmp_path / "map.yaml").occupied.sum() > 100


def test_match_two_scans(bag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    example("match_two_scans")(str(bag), "0", "4")
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(":")[0] for line in lines] == ["likelihood", "icp", "correlative"]
    for line in lines:
        assert float(line.split()[1]) == pytest.approx(0.2, abs=0.01)


def test_radio_over_map(room: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    example("radio_over_map")(str(room), str(tmp_path / "out"), "2", "1.5", "2")
    assert "expected gain -" in capsys.readouterr().out
    assert len(read_radio_npz(tmp_path / "out" / "radio_map.npz").access_points) == 1
    assert (tmp_path / "out" / "radio_map.png").is_file()


def test_evaluate_trajectory(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    stamps = np.arange(50) * 100_000_000
    poses = np.stack([np.cos(stamps * 1e-9), np.sin(stamps * 1e-9), stamps * 1e-9], axis=1)
    write_trajectory(tmp_path / "truth.tum", Trajectory(stamps, poses))
    write_trajectory(tmp_path / "moved.tum", Trajectory(stamps, poses).transformed(Pose2(1, 2, 3)))
    example("evaluate_trajectory")(str(tmp_path / "truth.tum"), str(tmp_path / "moved.tum"))
    assert "ATE, RMSE: 0.0000 m" in capsys.readouterr().out


def test_graphs_and_maps(room: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    sigma = np.diag([0.01, 0.01, 0.01]) ** 2
    step = (Pose2(1.0, 0.0, 0.0), sigma, ConstraintKind.ODOMETRY)
    graph = PoseGraph(np.zeros((3, 3)), (Constraint(0, 1, *step), Constraint(1, 2, *step)))
    write_g2o(tmp_path / "graph.g2o", graph)
    example("graphs_and_maps")(str(tmp_path / "graph.g2o"), str(room), str(tmp_path / "out"))
    best = read_g2o(tmp_path / "out" / "graph.g2o").graph
    np.testing.assert_allclose(best.poses[:, 0], [0.0, 1.0, 2.0], atol=1e-9)
    assert "136 occupied and 1064 free cells" in capsys.readouterr().out
    np.testing.assert_array_equal(read_map(tmp_path / "out" / "map.yaml").free, read_map(room).free)
