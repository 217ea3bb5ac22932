# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""A recording converted to any other kind is the same recording."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from ros_bags import maker_of, write_recording
from rosbags.highlevel import AnyReader

from slarm_graph.config import SourceConfig
from slarm_graph.errors import BadInput
from slarm_graph.files.worlds import world_path
from slarm_graph.frontends.recordings.carmen_format import Carmen
from slarm_graph.frontends.recordings.convert import convert
from slarm_graph.frontends.recordings.formats import format_of, format_written_as
from slarm_graph.frontends.recordings.ros_format import Ros
from slarm_graph.frontends.recordings.ros_writing import GROUND_TRUTH_TOPIC, write_readings
from slarm_graph.frontends.recordings.sources import open_source
from slarm_graph.frontends.recordings.world_format import WorldFile
from slarm_graph.geometry import Pose2
from slarm_graph.readings import LaserScan, Reading

ENDINGS = ["a.bag", "a.mcap", "a.db3", "a_folder", "a.clf", "a.log.gz"]


def drive(count: int = 20, *, odom: bool = True) -> list[Reading]:
    rng = np.random.default_rng(0)
    out = []
    for k in range(count):
        ranges = (1.0 + 5.0 * rng.random(90)).astype(np.float32)
        ranges[::7] = np.nan
        scan = LaserScan(ranges, -1.5, 0.03, 0.1, 10.0, Pose2(0.2, -0.1, math.pi), 0.0005)
        pose = Pose2(0.1 * k, -0.05 * k, 3.0 + 0.02 * k) if odom else None
        out.append(Reading(1_700_000_000_000_000_123 + k * 10**8, scan, pose))
    return out


def assert_same(got: list[Reading], want: list[Reading]) -> None:
    assert [r.stamp_ns for r in got] == [r.stamp_ns for r in want]
    for one, other in zip(got, want, strict=True):
        if other.odom_from_robot is None:
            assert one.odom_from_robot is None
        else:
            step = other.odom_from_robot.between(one.odom_from_robot)
            assert np.abs(step.as_array()).max() < 1e-8
        assert np.array_equal(one.scan.is_return(), other.scan.is_return())
        np.testing.assert_allclose(one.scan.points_m(), other.scan.points_m(), atol=2e-4)


def read(path: Path) -> list[Reading]:
    return list(open_source(path, SourceConfig()))


@pytest.mark.parametrize("first", ["a.clf", "a.bag"])
@pytest.mark.parametrize("second", ["b.bag", "b.mcap", "b.db3", "b_folder"])
def test_compressed_on_wish(tmp_path, first, second):
    format_written_as(tmp_path / first).write(tmp_path / first, drive())
    sizes = []
    for compress in (False, True):
        convert(tmp_path / first, tmp_path / second, overwrite=True, compress=compress)
        there = tmp_path / second
        files = (
            [path for path in there.iterdir() if path.suffix == ".mcap"]
            if (there.is_dir())
            else [there]
        )
        sizes.append(sum(path.stat().st_size for path in files))
    assert sizes[1] < 0.97 * sizes[0]
    assert_same(read(tmp_path / second), read(tmp_path / first))


@pytest.mark.parametrize("first", ENDINGS)
@pytest.mark.parametrize("second", ["b.bag", "b.mcap", "b.clf"])
def test_there_and_on(tmp_path: Path, first: str, second: str) -> None:
    start = tmp_path / "start.mcap"
    assert write_readings(start, drive()) == 20
    convert(start, tmp_path / first)
    said = convert(tmp_path / first, tmp_path / second)
    assert str(tmp_path / second) in said
    assert_same(read(tmp_path / second), drive())
    left = {path.name for path in tmp_path.iterdir()}
    assert left == {"start.mcap", first, second}


def test_without_odometry(tmp_path: Path) -> None:
    write_readings(tmp_path / "a.bag", drive(odom=False))
    convert(tmp_path / "a.bag", tmp_path / "a.clf")
    assert (tmp_path / "a.clf").read_text().count("RAWLASER1") == 20
    got = read(tmp_path / "a.clf")
    assert all(reading.odom_from_robot is None for reading in got)
    assert [r.stamp_ns for r in got] == [r.stamp_ns for r in drive()]


@pytest.mark.parametrize("name", ["a.bag", "a.mcap"])
def test_every_topic_is_kept_between_ros_1_and_2(tmp_path: Path, name: str) -> None:
    kind = "db3" if name.endswith("bag") else "bag"
    make = maker_of(kind)
    twist = make.t["geometry_msgs/msg/Vector3"](1.0, 2.0, 3.0)
    messages = [("/speed", 5.0, twist), ("/scan", 5.1, make.laser_scan(5.1, [2.0, 3.0]))]
    source = write_recording(tmp_path / ("src.bag" if kind == "bag" else "src"), messages, kind)
    convert(source, tmp_path / name)
    with AnyReader([tmp_path / name]) as reader:
        got = [
            (c.topic, stamp, reader.deserialize(raw, c.msgtype))
            for c, stamp, raw in reader.messages()
        ]
    assert [(topic, stamp) for topic, stamp, _ in got] == [
        ("/speed", 5 * 10**9),
        ("/scan", 51 * 10**8),
    ]
    assert (got[0][2].x, got[0][2].z) == (1.0, 3.0)
    assert got[1][2].ranges.tolist() == [2.0, 3.0]


def test_ground_truth_is_written_beside(tmp_path: Path) -> None:
    truth = [(r.stamp_ns, Pose2(1.0, 2.0, 0.5)) for r in drive()]
    write_readings(tmp_path / "a.mcap", drive(), truth=truth)
    with AnyReader([tmp_path / "a.mcap"]) as reader:
        wanted = [c for c in reader.connections if c.topic == GROUND_TRUTH_TOPIC]
        poses = [reader.deserialize(raw, c.msgtype) for c, _, raw in reader.messages(wanted)]
    assert len(poses) == 20
    assert poses[3].pose.position.y == 2.0
    assert 2 * math.atan2(
        poses[3].pose.orientation.z, poses[3].pose.orientation.w
    ) == pytest.approx(0.5)
    assert_same(read(tmp_path / "a.mcap"), drive())


def test_nothing_is_overwritten_unasked(tmp_path: Path) -> None:
    write_readings(tmp_path / "a.bag", drive())
    (tmp_path / "b.bag").write_text("precious")
    with pytest.raises(BadInput, match=r"b\.bag exists already; remove it or use --overwrite"):
        convert(tmp_path / "a.bag", tmp_path / "b.bag")
    assert (tmp_path / "b.bag").read_text() == "precious"
    convert(tmp_path / "a.bag", tmp_path / "b.bag", overwrite=True)
    assert len(read(tmp_path / "b.bag")) == 20
    with pytest.raises(BadInput, match="no such folder"):
        convert(tmp_path / "a.bag", tmp_path / "none" / "b.bag")
    with pytest.raises(BadInput, match="no such file"):
        convert(tmp_path / "no.bag", tmp_path / "c.bag")


def test_what_cannot_be_converted_leaves_nothing_behind(tmp_path: Path) -> None:
    (tmp_path / "text.bag").write_text("hello")
    for name in ("b.bag", "b.clf", "folder"):
        with pytest.raises(BadInput):
            convert(tmp_path / "text.bag", tmp_path / name)
    assert [path.name for path in tmp_path.iterdir()] == ["text.bag"]


def test_of_a_damaged_bag_the_scans_are_saved(tmp_path: Path) -> None:
    write_readings(tmp_path / "a.bag", drive())
    whole = (tmp_path / "a.bag").read_bytes()
    (tmp_path / "cut.bag").write_bytes(whole[: int(0.8 * len(whole))])
    said = convert(tmp_path / "cut.bag", tmp_path / "b.mcap")
    assert "only scans and odometry" in said
    saved = read(tmp_path / "b.mcap")
    assert 0 < len(saved) <= 20
    assert_same(saved, read(tmp_path / "cut.bag"))


def test_a_folder_without_metadata(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    write_readings(tmp_path / "folder" / "a.db3", drive())
    assert "every message" in convert(tmp_path / "folder", tmp_path / "b.bag")
    assert_same(read(tmp_path / "b.bag"), drive())


@pytest.mark.parametrize("name", ENDINGS)
def test_what_a_format_writes_is_of_that_format(tmp_path: Path, name: str) -> None:
    target = format_written_as(tmp_path / name)
    assert target.write(tmp_path / name, drive()) == 20
    kind = format_of([tmp_path / name])
    assert type(kind) is type(target) is (Carmen if ".clf" in name or ".log" in name else Ros)
    assert not list(kind.check([tmp_path / name], SourceConfig()))


def test_a_world_is_read_and_not_written(tmp_path: Path) -> None:
    kind = format_of([world_path("paper_room")])
    assert isinstance(kind, WorldFile)
    with pytest.raises(BadInput, match="worlds are read, not written"):
        kind.write(tmp_path / "a.yaml", drive())
