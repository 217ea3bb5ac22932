# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""What is handed to other tools, read by them: evo, ROS 2 messages, shapely; and worlds."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import shapely
from evo.core import metrics as evo_metrics
from evo.tools import file_interface
from rosbags.highlevel import AnyReader
from test_cli import run

from slarm_graph.access_points import AccessPoint, RadioMap
from slarm_graph.app.map_images import save_map
from slarm_graph.app.outputs import save_radio, save_trajectory
from slarm_graph.app.run_folder import create_run_folder
from slarm_graph.config import RadioConfig
from slarm_graph.files.coverage import write_coverage
from slarm_graph.files.trajectories import read_trajectory
from slarm_graph.files.worlds import load_world, shipped_worlds
from slarm_graph.geographic import as_geographic
from slarm_graph.grid import GridGeometry, OccupancyGrid
from slarm_graph.trajectory import Trajectory


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A run folder with a path, truth, a map with a pillar and a radio map."""
    made = create_run_folder(tmp_path, "run")
    stamps = 1_700_000_000_000_000_000 + 100_000_000 * np.arange(50, dtype=np.int64)
    angle = np.linspace(0.0, 3.0, 50)
    poses = np.column_stack([np.cos(angle), np.sin(angle), angle + np.pi / 2])
    off = np.random.default_rng(0).normal(0, 0.02, poses.shape)
    save_trajectory(made, "trajectory", Trajectory(stamps, poses + off))
    save_trajectory(made, "ground_truth", Trajectory(stamps, poses))
    cells = np.zeros((30, 40), dtype=np.float32)
    cells[10:14, 20:25] = 1.0
    geometry = GridGeometry(-2.0, -1.5, 0.1, 30, 40)
    grid = OccupancyGrid(geometry, cells)
    save_map(made, "map", geometry, grid.occupied, grid.free)
    with made.replacing("coverage.npz") as temporary:
        write_coverage(temporary, as_geographic(grid))
    loss = np.where(grid.free, 60.0 + geometry.centers()[..., 0], np.nan).astype(np.float32)
    points = (AccessPoint("AP 1", 0.0, 0.0, 2.5),)
    radio = RadioMap(geometry, points, loss[None], grid.free[None], 0.5, "InF-SH", 7.0, "x")
    save_radio(made, radio, RadioConfig())
    return made.path


def exported(folder: Path, form: str) -> Path:
    target = folder.parent / f"out.{form}"
    assert run("export", folder, "--as", form, "--to", target) == 0
    return target


def test_evo_opens_the_result_and_finds_the_same_figures(folder: Path) -> None:
    result = file_interface.load_res_file(exported(folder, "evo"), load_trajectories=True)
    ref = file_interface.read_tum_trajectory_file(folder / "ground_truth.tum")
    est = file_interface.read_tum_trajectory_file(folder / "trajectory.tum")
    est.align(ref)
    ape = evo_metrics.APE(evo_metrics.PoseRelation.translation_part)
    ape.process_data((ref, est))
    for name, value in ape.get_all_statistics().items():
        assert result.stats[name] == pytest.approx(value, abs=1e-9), name
    np.testing.assert_allclose(result.np_arrays["error_array"], ape.error, atol=1e-9)
    assert set(result.trajectories) == {"ground_truth", "run"}


def test_rpg_gets_its_folder(folder: Path) -> None:
    place = exported(folder, "rpg")
    names = {"stamped_groundtruth.txt", "stamped_traj_estimate.txt", "eval_cfg.yaml"}
    assert {path.name for path in place.iterdir()} == names
    assert len(read_trajectory(place / "stamped_traj_estimate.txt")) == 50


def test_ros_2_reads_paths_maps_transforms_and_radio_map(folder: Path) -> None:
    target = exported(folder, "mcap")
    with AnyReader([target]) as reader:
        found = {c.topic: reader.deserialize(raw, c.msgtype) for c, _, raw in reader.messages()}
        counts = {c.topic: c.msgcount for c in reader.connections}
    path = read_trajectory(folder / "trajectory.tum")
    assert counts["/tf"] == len(found["/path"].poses) == len(path)
    last = found["/path"].poses[-1].pose.position
    assert (last.x, last.y) == pytest.approx(tuple(path.poses[-1, :2]))
    grid = found["/map"]
    assert (grid.info.width, grid.info.height) == (40, 30)
    assert grid.data.reshape(30, 40)[12, 22] == 100
    assert grid.data.reshape(30, 40)[0, 0] == 0
    assert grid.info.origin.position.x == -2.0
    radio = found["/radio/AP_1"].data.reshape(30, 40)
    assert (radio[0, 0], radio[0, -1], radio[12, 22]) == (100, 0, -1)
    cloud = found["/radio/AP_1/points"]
    points = np.frombuffer(cloud.data.tobytes(), "<f4").reshape(cloud.width, -1)
    assert [field.name for field in cloud.fields][:4] == ["x", "y", "z", "gain_db"]
    np.testing.assert_allclose(points[:, 3], -60.0 - points[:, 0], atol=1e-4)


def test_geojson_has_the_path_and_the_obstacles_to_the_cell(folder: Path) -> None:
    features = json.loads(exported(folder, "geojson").read_text())["features"]
    line, pillar = (shapely.geometry.shape(feature["geometry"]) for feature in features)
    assert len(line.coords) == 50
    assert pillar.area == pytest.approx(20 * 0.01)
    assert pillar.bounds == pytest.approx((0.0, -0.5, 0.5, -0.1))


def test_what_needs_truth_says_so(folder: Path) -> None:
    (folder / "ground_truth.tum").unlink()
    assert run("export", folder, "--as", "evo") == 2
    assert run("export", folder / "nowhere", "--as", "mcap") == 2


def test_worlds_are_listed_and_the_template_is_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("worlds") == 0
    listed = capsys.readouterr().out
    assert all(name in listed for name in shipped_worlds())
    assert run("worlds", "--template") == 0
    file = tmp_path / "mine.yaml"
    file.write_text(capsys.readouterr().out)
    assert load_world(file).name == "my_world"
    assert run("worlds", "--check", file) == 0
    file.write_text("name: x\nboundary_m: 3\nwrong: 1\n")
    assert run("worlds", "--check", file) == 2
    told = capsys.readouterr().err
    assert told.count("\n") >= 3
    assert "boundary_m" in told
    assert "wrong" in told
