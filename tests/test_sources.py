# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Recordings of every kind become readings; what cannot be opened is told in one line."""

from __future__ import annotations

import shutil
import sqlite3
from pathlib import Path

import numpy as np
import pytest
from driven_bags import T0, drive, noticed, opened, readings, told
from ros_bags import KINDS, maker_of, write_recording

from slarm_graph.config import SourceConfig

# Every kind of recording ------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_gives_the_same_readings(tmp_path: Path, kind: str) -> None:
    path = write_recording(tmp_path / f"drive.{'bag' if kind == 'bag' else 'd'}", drive(kind), kind)
    got = readings(path)
    assert [r.stamp_ns for r in got] == [round((T0 + 0.1 * k) * 1e9) for k in range(40)]
    at = np.array([r.odom_from_robot.x for r in got[1:]])
    # The last odometry is 20 ms older than the last scan: held, not extrapolated.
    np.testing.assert_allclose(at[:-1], 0.1 * np.arange(1, 39), atol=1e-6)
    assert at[-1] == pytest.approx(3.88)
    assert len(got[0].scan.ranges_m) == 60


@pytest.mark.parametrize("kind", ["db3", "mcap"])
def test_ros2_storage_is_found_however_it_is_named(tmp_path: Path, kind: str) -> None:
    folder = write_recording(tmp_path / "rec", drive(kind), kind)
    want = [r.stamp_ns for r in readings(folder)]
    lone = next(folder.glob(f"*.{kind}"))
    assert [r.stamp_ns for r in readings(lone)] == want
    assert [r.stamp_ns for r in readings(folder / "metadata.yaml")] == want
    unnamed = tmp_path / "recording"
    shutil.copy(lone, unnamed)
    assert [r.stamp_ns for r in readings(unnamed)] == want
    (folder / "metadata.yaml").unlink()
    assert [r.stamp_ns for r in readings(folder)] == want
    assert "no usable metadata.yaml" in noticed(folder)


def test_metadata_with_an_empty_storage_id_is_gone_round(tmp_path: Path) -> None:
    folder = write_recording(tmp_path / "rec", drive("db3"), "db3")
    meta = folder / "metadata.yaml"
    meta.write_text(
        meta.read_text().replace("storage_identifier: sqlite3", "storage_identifier: ''")
    )
    assert len(readings(folder)) == 40


def test_db3_without_type_definitions_is_read(tmp_path: Path) -> None:
    folder = write_recording(tmp_path / "rec", drive("db3"), "db3")
    with sqlite3.connect(next(folder.glob("*.db3"))) as database:
        database.execute("DELETE FROM message_definitions")
    database.close()
    assert len(readings(folder)) == 40


@pytest.mark.parametrize("compression", ["BZ2", "LZ4"])
def test_compressed_bags(tmp_path: Path, compression: str) -> None:
    path = write_recording(tmp_path / "a.bag", drive(), compression=compression)
    assert len(readings(path)) == 40


@pytest.mark.parametrize(
    ("kind", "mode"),
    [
        ("db3", "FILE"),
        ("db3", "MESSAGE"),
        ("mcap", "FILE"),
        ("mcap", "MESSAGE"),
        ("mcap", "STORAGE"),
    ],
)
def test_compressed_ros2_recordings(tmp_path: Path, kind: str, mode: str) -> None:
    folder = write_recording(tmp_path / "rec", drive(kind), kind, compression=mode)
    assert len(readings(folder)) == 40
    assert "no usable metadata" not in noticed(folder)


def test_several_bags_are_put_together_in_order_of_time(tmp_path: Path) -> None:
    messages = drive()
    first = write_recording(tmp_path / "b_first.bag", messages[:40])
    second = write_recording(tmp_path / "a_second.bag", messages[40:])
    got = readings([second, first])
    assert len(got) == 40
    assert all(r.odom_from_robot is not None for r in got)


def test_the_old_tf_message_type_is_read(shared_data: Path) -> None:
    got = readings(shared_data / "robot_bags" / "jan17_expt08.bag", SourceConfig(odom="tf"))
    assert got[400].odom_from_robot is not None


# The bad-input matrix ---------------------------------------------------------------------------


def test_missing_path(tmp_path: Path) -> None:
    assert told(tmp_path / "no.bag") == f"no such file: {tmp_path / 'no.bag'}"


def test_empty_file_and_text_named_bag(tmp_path: Path) -> None:
    empty, text = tmp_path / "empty.bag", tmp_path / "text.bag"
    empty.touch()
    text.write_text("hello world, this is no bag\n")
    assert told(empty) == f"{empty} is empty"
    assert told(text) == f"{text} is not a ROS bag or CARMEN log (first bytes 'hello wo')"


def test_empty_folder(tmp_path: Path) -> None:
    assert "without a recording" in told(tmp_path)


def test_truncated_bag_is_used_as_far_as_it_goes(tmp_path: Path) -> None:
    path = write_recording(tmp_path / "cut.bag", drive(scans=400))
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 2 // 3])
    source = opened(path)
    assert 100 < len(list(source)) < 400
    assert "cut.bag ends early" in source.info().notices[0]


@pytest.mark.parametrize("mode", ["", "STORAGE"])
def test_truncated_mcap_is_used_as_far_as_it_goes(tmp_path: Path, mode: str) -> None:
    folder = write_recording(tmp_path / "m", drive("mcap", scans=4000), "mcap", compression=mode)
    lone = next(folder.glob("*.mcap"))
    lone.write_bytes(lone.read_bytes()[: lone.stat().st_size * 2 // 3])
    for path in (lone, folder):
        source = opened(path)
        got = list(source)
        assert 1000 < len(got) < 4000
        assert got[900].odom_from_robot is not None
        assert any("m.mcap ends early" in notice for notice in source.info().notices)
    lone.write_bytes(lone.read_bytes()[:60])
    assert "mcap recover" in told(lone)


def test_truncated_db3_is_used_as_far_as_it_goes(tmp_path: Path) -> None:
    folder = write_recording(tmp_path / "d", drive("db3", scans=400), "db3")
    lone = next(folder.glob("*.db3"))
    raw = lone.read_bytes()
    lone.write_bytes(raw[: len(raw) // 2])
    source = opened(lone)
    assert 100 < len(list(source)) < 300
    assert any("rows that cannot be read are passed over" in n for n in source.info().notices)
    lone.write_bytes(raw[:5000])
    assert str(lone) in told(lone)


def test_old_bag_format(shared_data: Path) -> None:
    text = told(shared_data / "odd_bags" / "rosrecord_v1_2.bag")
    assert "old format ROSRECORD V1.2" in text
    assert "rosbag fix" in text


def test_no_laser_scan_lists_what_there_is(tmp_path: Path) -> None:
    path = write_recording(tmp_path / "a.bag", [m for m in drive() if m[0] == "/odom"])
    text = told(path)
    assert text.startswith("no LaserScan topic in the recording")
    assert "/odom (nav_msgs/msg/Odometry, 40 messages, 10.0 Hz)" in text


def test_clouds_without_scans_tell_how_to_make_scans_of_them(tmp_path: Path) -> None:
    cloud = maker_of("bag")
    fields: list[object] = []
    message = cloud.t["sensor_msgs/msg/PointCloud2"](
        cloud.header(1, "laser"), 1, 0, fields, False, 12, 0, np.zeros(0, np.uint8), True
    )
    text = told(write_recording(tmp_path / "a.bag", [("/points", 1.0, message)]))
    assert "record a scan of /points, as pointcloud_to_laserscan makes it" in text


def test_two_laser_scans_list_frames_rates_and_the_flag(tmp_path: Path) -> None:
    make = maker_of("bag")
    scans = [
        (f"/{n}", T0 + 0.1 * k, make.laser_scan(T0 + 0.1 * k, [2.0] * 9, frame=f"{n}_laser"))
        for k in range(11)
        for n in ("front", "rear")
    ]
    path = write_recording(tmp_path / "two.bag", scans)
    text = told(path)
    assert "2 LaserScan topics; choose with --scan /front or --scan /rear" in text
    assert "/front (sensor_msgs/msg/LaserScan in front_laser, 11 messages, 10.0 Hz)" in text
    assert len(readings(path, SourceConfig(scan_topic="/rear"))) == 11
    assert len(readings(path, SourceConfig(scan_topic="front"))) == 11
    assert "no scans on topic /side" in told(path, SourceConfig(scan_topic="/side"))
