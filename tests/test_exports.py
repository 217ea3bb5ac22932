# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""What is handed to other tools, read by them: evo, ROS 2, pandas, xarray, GTSAM; and worlds."""

from __future__ import annotations

import csv
import json
import re
import struct
from pathlib import Path

import gtsam
import numpy as np
import pandas
import pytest
import shapely
import xarray
import yaml
from evo.core import metrics as evo_metrics
from evo.core import sync
from evo.tools import file_interface
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from test_cli import room_bag, run

from slarm_graph.access_points import AccessPoint, RadioMap
from slarm_graph.app.map_images import save_map
from slarm_graph.app.outputs import save_radio, save_trajectory
from slarm_graph.app.run_folder import create_run_folder
from slarm_graph.config import RadioConfig
from slarm_graph.files.coverage import write_coverage
from slarm_graph.files.maps import masks_of
from slarm_graph.files.trajectories import read_trajectory
from slarm_graph.files.worlds import load_world, shipped_worlds
from slarm_graph.geographic import as_geographic
from slarm_graph.grid import GridGeometry, OccupancyGrid
from slarm_graph.radio.files import write_radio_npz
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
    save_map(made, "map", geometry, masks_of(grid))
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
    path = read_trajectory(folder / "trajectory.tum")
    # As rpg_trajectory_evaluation reads them: stamp, position, quaternion x y z w.
    read = np.loadtxt(place / "stamped_traj_estimate.txt")
    np.testing.assert_allclose(read[:, 0], path.stamps_ns * 1e-9, atol=1e-6)
    np.testing.assert_allclose(read[:, 1:3], path.poses[:, :2], atol=1e-9)
    turned = np.column_stack([np.sin(path.poses[:, 2] / 2), np.cos(path.poses[:, 2] / 2)])
    off = np.abs(np.sum(read[:, 6:] * turned, axis=1)) - 1.0
    np.testing.assert_allclose(off, 0.0, atol=1e-9)


def rpg_errors(place: Path) -> np.ndarray:
    """Position errors by rpg_trajectory_evaluation's rules, written anew.

    Whichever poses are closest in time, less than 0.02 s, are a pair first; `se3` turns and shifts
    as many as `align_num_frames` says, -1 for all.
    """
    truth = np.loadtxt(place / "stamped_groundtruth.txt")
    estimate = np.loadtxt(place / "stamped_traj_estimate.txt")
    apart = np.abs(estimate[:, None, 0] - truth[None, :, 0])
    pairs: dict[int, int] = {}
    for flat in np.argsort(apart, axis=None, kind="stable"):
        i, j = (int(k) for k in np.unravel_index(flat, apart.shape))
        if apart[i, j] >= 0.02:
            break
        if i not in pairs and j not in pairs.values():
            pairs[i] = j
    config = yaml.safe_load((place / "eval_cfg.yaml").read_text())
    assert config == {"align_type": "se3", "align_num_frames": -1}
    theirs, ours = truth[list(pairs.values()), 1:4], estimate[list(pairs), 1:4]
    u, _, vt = np.linalg.svd((theirs - theirs.mean(0)).T @ (ours - ours.mean(0)))
    turn = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    moved = (ours - ours.mean(0)) @ turn.T + theirs.mean(0)
    return np.linalg.norm(theirs - moved, axis=1)


def test_rpg_comes_to_the_same_errors(folder: Path) -> None:
    lines = (folder / "trajectory.tum").read_text().splitlines()
    (folder / "trajectory.tum").write_text("\n".join([*lines[:20], *lines[23:]]) + "\n")
    ref = file_interface.read_tum_trajectory_file(folder / "ground_truth.tum")
    est = file_interface.read_tum_trajectory_file(folder / "trajectory.tum")
    ref, est = sync.associate_trajectories(ref, est)
    est.align(ref)
    ape = evo_metrics.APE(evo_metrics.PoseRelation.translation_part)
    ape.process_data((ref, est))
    errors = rpg_errors(exported(folder, "rpg"))
    np.testing.assert_allclose(errors, ape.error, atol=1e-9)
    result = file_interface.load_res_file(exported(folder, "evo"))
    np.testing.assert_allclose(errors, result.np_arrays["error_array"], atol=1e-9)


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


def test_every_access_point_has_a_topic_that_ros_2_allows(folder: Path) -> None:
    geometry = GridGeometry(-2.0, -1.5, 0.1, 30, 40)
    names = ("AP 1", "AP_1", "5 GHz", "Küche", r"$\frac{$", "日本", "AP 1", "AP 1 7")
    points = tuple(AccessPoint(name, 0.0, 0.0, 2.5) for name in names)
    loss = np.full((len(names), *geometry.shape), 60.0, dtype=np.float32)
    radio = RadioMap(geometry, points, loss, loss > 0, 0.5, "InF-SH", 7.0, "x")
    write_radio_npz(folder / "radio_map.npz", radio)
    with AnyReader([exported(folder, "mcap")]) as reader:
        found = {c.topic: c.msgcount for c in reader.connections if c.topic.startswith("/radio/")}
    assert len(found) == 2 * len(names)
    assert set(found.values()) == {1}
    # https://design.ros2.org/articles/topic_and_service_names.html
    allowed = re.compile(r"(/[A-Za-z](_?[A-Za-z0-9])*)+")
    assert all(allowed.fullmatch(topic) for topic in found), found


def test_a_grid_lies_in_the_mcap_as_ros_2_defines_it(folder: Path) -> None:
    """Second implementation: nav_msgs/OccupancyGrid in CDR, field by field."""
    with exported(folder, "mcap").open("rb") as file:
        reader = make_reader(file)
        assert reader.get_header().profile == "ros2"
        ((schema, channel, message),) = reader.iter_messages(["/map"])
    assert schema is not None
    assert (schema.name, schema.encoding) == ("nav_msgs/msg/OccupancyGrid", "ros2msg")
    assert schema.data.decode().split("=" * 80)[0].split() == (
        ["std_msgs/Header", "header", "nav_msgs/MapMetaData", "info", "int8[]", "data"]
    )
    assert channel.message_encoding == "cdr"
    raw = message.data
    assert raw[:4] == b"\0\1\0\0", "little endian"
    _sec, _nanosec, length = struct.unpack_from("<iII", raw, 4)
    assert raw[16 : 16 + length] == b"map\0"
    at = 16 + -(-length // 4) * 4
    _, _, resolution, width, height = struct.unpack_from("<iIfII", raw, at)
    at = 4 + -(-(at + 20 - 4) // 8) * 8  # doubles are aligned by eight behind the header
    origin = struct.unpack_from("<7d", raw, at)
    assert (round(resolution, 6), width, height) == (0.1, 40, 30)
    assert origin == pytest.approx((-2.0, -1.5, 0.0, 0.0, 0.0, 0.0, 1.0))
    (count,) = struct.unpack_from("<I", raw, at + 56)
    cells = np.frombuffer(raw, np.int8, count, at + 60).reshape(30, 40)
    assert (cells[12, 22], cells[0, 0]) == (100, 0)
    assert len(raw) == at + 60 + count


@pytest.mark.parametrize("release", [Stores.ROS2_HUMBLE, Stores.ROS2_JAZZY])
def test_the_mcap_explains_its_messages_as_ros_2_defines_them(
    folder: Path, release: Stores
) -> None:
    """To a reader that knows no types, as Foxglove's, and to those of both releases in use."""
    known, told = get_typestore(release), get_typestore(Stores.EMPTY)
    found = set()
    with exported(folder, "mcap").open("rb") as file:
        for schema, _, message in make_reader(file).iter_messages():
            assert schema is not None
            if schema.name not in told.fielddefs:
                told.register(get_types_from_msg(schema.data.decode(), schema.name))
            own = told.deserialize_cdr(message.data, schema.name)
            assert bytes(told.serialize_cdr(own, schema.name)) == message.data
            theirs = known.deserialize_cdr(message.data, schema.name)
            assert bytes(known.serialize_cdr(theirs, schema.name)) == message.data
            found.add(schema.name)
    assert found == {
        *("nav_msgs/msg/Path", "nav_msgs/msg/OccupancyGrid", "tf2_msgs/msg/TFMessage"),
        "sensor_msgs/msg/PointCloud2",
    }
    for name, (_, fields) in told.fielddefs.items():
        assert fields == known.fielddefs[name][1], name


def test_pandas_gtsam_and_xarray_read_what_runs_and_comparisons_leave(tmp_path: Path) -> None:
    bag = room_bag(tmp_path / "a.bag", 30)
    words = ("--backends", "gmapping,pose_graph", "--ap", 0, 0, 2, "--out", tmp_path)
    assert run("compare", bag, *words, "--name", "c") == 0
    tables = {file.relative_to(tmp_path / "c"): file for file in (tmp_path / "c").rglob("*.csv")}
    for name, file in tables.items():
        read = pandas.read_csv(file, comment="#")
        assert read.columns.is_unique, name
        lines = [line for line in file.read_text().splitlines() if not line.startswith("#")]
        assert len(read) == len(list(csv.reader(lines))) - 1, name
        for column in read.columns:
            if column.endswith(("_m", "_rad", "_s", "_ns", "_db", "_dbm")) and len(read):
                assert pandas.api.types.is_numeric_dtype(read[column]), (name, column)
    assert {path.name for path in tables} >= {
        *("comparison.csv", "summary.csv", "scans.csv", "metrics.csv", "radio_map.csv"),
        *("particles.csv", "loop_closures.csv", "conflicts.csv"),
    }
    made = tmp_path / "c" / "a_pose_graph_0"
    with xarray.open_dataset(made / "radio_map.nc") as radio:
        assert np.isfinite(radio["path_loss_db"]).sum() == len(
            pandas.read_csv(made / "radio_map.csv", comment="#")
        )
    graph, values = gtsam.readG2o(str(made / "graph.g2o"), False)
    assert values.size() > 0
    assert graph.error(values) < 1.0


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
