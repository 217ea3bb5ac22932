# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Recordings in other units, without frames, written backwards: the right value or one line."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from driven_bags import T0, drive, noticed, readings, told
from ros_bags import IDENTITY, Recorded, maker_of, write_recording

from slarm_graph import backends
from slarm_graph.config import RunConfig, SourceConfig
from slarm_graph.errors import RunFailed
from slarm_graph.frontends.recordings.check import check
from slarm_graph.geometry import between

Field = Callable[[object], None]


def changed(change: Field, topic: str = "/scan", kind: str = "bag") -> list[Recorded]:
    """A drive of which every message of a topic is changed in place."""
    messages = drive(kind)
    for name, _, message in messages:
        if name == topic:
            change(message)
    return messages


def in_millimetres(scan: object) -> None:
    scan.ranges *= 1000  # type: ignore[attr-defined]
    scan.range_min, scan.range_max = 100.0, 10_000.0  # type: ignore[attr-defined]


def only_ranges(scan: object) -> None:
    scan.ranges *= 1000  # type: ignore[attr-defined]


def in_degrees(scan: object) -> None:
    for name in ("angle_min", "angle_max", "angle_increment"):
        setattr(scan, name, float(np.rad2deg(getattr(scan, name))))


@pytest.mark.parametrize("kind", ["bag", "mcap", "db3"])
@pytest.mark.parametrize(
    ("change", "words", "remedy"),
    [
        (in_millimetres, "source.range_unit_m=0.001", SourceConfig(range_unit_m=0.001)),
        (only_ranges, "source.range_unit_m=0.001", SourceConfig(range_unit_m=0.001)),
        (in_degrees, "source.angle_unit_rad=0.0174533", SourceConfig(angle_unit_rad=0.0174533)),
    ],
)
def test_other_units_are_told_and_can_be_given(
    tmp_path: Path, kind: str, change: Field, words: str, remedy: SourceConfig
) -> None:
    right = readings(write_recording(tmp_path / "right", drive(kind), kind))
    path = write_recording(tmp_path / "other", changed(change, kind=kind), kind)
    assert words in told(path)
    diagnosis = check(path)
    assert diagnosis.exit_code == 2
    assert words in diagnosis.text()
    assert check(path, remedy).exit_code == 0
    for one, other in zip(right, readings(path, remedy), strict=True):
        assert np.allclose(one.scan.ranges_m, other.scan.ranges_m, rtol=1e-5)
        assert other.scan.angle_increment_rad == pytest.approx(
            one.scan.angle_increment_rad, rel=1e-4
        )
        assert other.scan.range_max_m == pytest.approx(one.scan.range_max_m)


def test_far_codes_for_no_return_are_no_unit(tmp_path: Path) -> None:
    def mostly_nothing(scan: object) -> None:
        scan.ranges[6:] = 65_535.0  # type: ignore[attr-defined]

    path = write_recording(tmp_path / "a.bag", changed(mostly_nothing))
    assert all(np.count_nonzero(np.isfinite(r.scan.ranges_m)) == 6 for r in readings(path))


def test_odometry_in_millimetres_is_told(tmp_path: Path) -> None:
    def scale(odometry: object) -> None:
        odometry.pose.pose.position.x *= 1e5  # type: ignore[attr-defined]

    diagnosis = check(write_recording(tmp_path / "a.bag", changed(scale, "/odom")))
    assert "positions are not metres" in diagnosis.text()


def test_scans_without_a_frame_are_the_one_laser_there_is(tmp_path: Path) -> None:
    make, messages = maker_of("bag"), drive(laser="")
    tf = make.transforms(T0, ("base_link", "laser", (0.3, 0.0, 0.2), IDENTITY))
    one = write_recording(tmp_path / "a.bag", [("/tf_static", T0, tf), *messages])
    assert readings(one)[0].scan.robot_from_laser.x == pytest.approx(0.3)
    assert "name no frame: taken to be laser of tf" in noticed(one)
    second = make.transforms(T0, ("base_link", "rear", (-0.3, 0.0, 0.2), IDENTITY))
    several = [("/tf_static", T0, tf), ("/tf_static", T0, second), *messages]
    two = write_recording(tmp_path / "b.bag", several)
    assert "frame_id is empty" in told(two)
    given = SourceConfig(static_tf=("base_link front 0.5 0 0 0",))
    assert readings(two, given)[0].scan.robot_from_laser.x == pytest.approx(0.5)


def test_a_recording_written_backwards_is_sorted(tmp_path: Path) -> None:
    right = readings(write_recording(tmp_path / "a.bag", drive()))
    messages = drive()
    stamps = [stamp_s for _, stamp_s, _ in messages]
    turned = [(t, s, m) for s, (t, _, m) in zip(stamps, reversed(messages), strict=True)]
    path = write_recording(tmp_path / "b.bag", turned)
    assert "the stamps of the scans run backwards throughout, sorted" in noticed(path)
    assert [r.stamp_ns for r in readings(path)] == [r.stamp_ns for r in right]
    assert check(path).exit_code == 1


def test_many_segments_are_not_told_at_length(tmp_path: Path) -> None:
    messages = [("/scan", s - 0.0, m) for t, s, m in drive(scans=200) if t == "/scan"]
    make = maker_of("bag")
    loops = [
        (t, s, make.laser_scan(T0 + 0.25 * (k % 10), [2.0 + 0.001 * k] * 30, frame="base_link"))
        for k, (t, s, _) in enumerate(messages)
    ]
    line = told(write_recording(tmp_path / "a.bag", loops))
    assert "--segment 1 ... 20" in line
    assert "14 more" in line


def test_a_stamp_a_fortnight_off_is_dropped_by_check_as_by_the_run(tmp_path: Path) -> None:
    make, messages = maker_of("bag"), drive()
    row = next(k for k, m in enumerate(messages) if m[0] == "/scan" and m[1] > T0 + 2)
    far = make.laser_scan(T0 + 1.2e6, 2.0 + np.arange(60) / 60, frame="base_link")
    messages[row] = ("/scan", messages[row][1], far)
    path = write_recording(tmp_path / "a.bag", messages)
    assert len(readings(path)) == 39
    diagnosis = check(path)
    assert diagnosis.exit_code == 1
    assert "1 of 40 stamps more than a week off" in diagnosis.text()


@pytest.mark.parametrize("name", ["pose_graph", "gmapping"])
def test_odometry_is_kept_where_nothing_can_be_matched(name: str, shared_data: Path) -> None:
    source = readings(shared_data / "cases/scan_four_beams/rec.bag")
    backend = backends.make(name, RunConfig(), np.random.default_rng(0), lambda _message: None)
    for reading in source:
        backend.update(reading)
    poses = backend.result().trajectory.poses
    odometry = np.array([r.odom_from_robot.as_array() for r in source if r.odom_from_robot])
    away = poses - between(odometry[0], odometry)
    assert np.hypot(away[:, 0], away[:, 1]).max() < 0.15


def test_without_odometry_there_is_nothing_to_keep(shared_data: Path) -> None:
    path = shared_data / "cases/scan_four_beams/rec.bag"
    backend = backends.make(
        "pose_graph", RunConfig(), np.random.default_rng(0), lambda _message: None
    )
    for reading in readings(path, SourceConfig(odom="none")):
        backend.update(reading)
    with pytest.raises(RunFailed, match="no odometry"):
        backend.result()
