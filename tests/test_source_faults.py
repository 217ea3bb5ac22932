# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""What recordings do wrong, mended where it can be and told in one line where not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from driven_bags import NONE, T0, drive, noticed, opened, readings, told
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from ros_bags import IDENTITY, Recorded, maker_of, write_recording

from slarm_graph.config import SourceConfig
from slarm_graph.errors import BadInput


def test_laser_frame_not_in_tf_tells_both_trees_and_the_option(tmp_path: Path) -> None:
    make = maker_of("bag")
    tf = make.transforms(
        T0,
        ("base_link", "imu", (0.0, 0.0, 0.0), IDENTITY),
        ("lidar_mount", "laser", (0.0, 0.0, 0.0), IDENTITY),
    )
    path = write_recording(tmp_path / "a.bag", [("/tf_static", T0, tf), *drive(laser="laser")])
    text = told(path)
    assert "no path laser -> base_link" in text
    assert "tree 1 = base_link>imu" in text
    assert "tree 2 = lidar_mount>laser" in text
    assert "--static-tf 'base_link lidar_mount x y z yaw'" in text
    mended = SourceConfig(static_tf=("base_link lidar_mount 0.2 0 0.3 1.5",))
    placed = readings(path, mended)[0].scan.robot_from_laser
    assert (placed.x, placed.theta) == pytest.approx((0.2, 1.5))
    wrong = SourceConfig(static_tf=("base_link lidar_mount 0.2",))
    assert "expected 'parent child x y z yaw [pitch roll]'" in told(path, wrong)


def test_no_odometry_goes_on(tmp_path: Path) -> None:
    path = write_recording(tmp_path / "a.bag", drive(odom=False))
    assert all(r.odom_from_robot is None for r in readings(path))
    assert "no odometry found" in noticed(path)
    assert "using scan matching only" in noticed(path)


def test_odometry_not_wanted(tmp_path: Path) -> None:
    path = write_recording(tmp_path / "a.bag", drive())
    assert all(r.odom_from_robot is None for r in readings(path, NONE))
    assert "no odometry on topic /wheel" in told(path, SourceConfig(odom="/wheel"))


def test_odometry_stops_half_way(tmp_path: Path) -> None:
    path = write_recording(tmp_path / "a.bag", drive(until_s=2.0))
    known = [r.odom_from_robot is not None for r in readings(path)]
    assert known[:20] == [True] * 20
    assert not any(known[23:])
    assert "scan matching only there" in noticed(path)


def test_odometry_on_another_clock(tmp_path: Path) -> None:
    make = maker_of("bag")
    messages = [(t, s, make.odom(s + 900.0, x=s) if t == "/odom" else m) for t, s, m in drive()]
    path = write_recording(tmp_path / "a.bag", messages)
    assert all(r.odom_from_robot is None for r in readings(path))
    assert (
        "the odometry (1900.000 s to 1903.900 s) does not overlap the scans "
        "(1000.000 s to 1003.900 s): using scan matching only"
    ) in noticed(path)


def test_a_missing_increment_follows_from_the_last_angle(tmp_path: Path) -> None:
    messages = drive(angles=(-1.5, 0.05))
    for _, _, message in messages:
        if hasattr(message, "ranges"):
            message.angle_increment = 0.0
    path = write_recording(tmp_path / "a.bag", messages)
    assert readings(path)[0].scan.angle_increment_rad == pytest.approx(0.05)
    flat = write_recording(tmp_path / "b.bag", drive(angles=(1.0, 0.0)))
    assert "40 of 40 scans not used: 40 no angle between beams" in told(flat)


def test_all_stamps_zero_uses_record_time(tmp_path: Path) -> None:
    make = maker_of("bag")
    scans = [("/scan", T0 + k, make.laser_scan(0.0, [2.0 + k] * 9)) for k in range(5)]
    path = write_recording(tmp_path / "a.bag", scans)
    assert [r.stamp_ns for r in readings(path)] == [round((T0 + k) * 1e9) for k in range(5)]
    assert "all stamps in /scan are 0: using the time of recording" in noticed(path)


def test_one_zero_stamp_is_left_out_and_told(tmp_path: Path) -> None:
    messages = drive()
    messages[10] = ("/scan", messages[10][1], maker_of("bag").laser_scan(0.0, [2.0] * 9))
    source = opened(write_recording(tmp_path / "a.bag", messages))
    assert len(list(source)) == 39
    assert [s.reason for s in source.scan_statuses() if s.reason] == ["stamp is 0"]
    assert len(source.scan_statuses()) == 40


def test_reversed_and_repeated_stamps_are_sorted_and_told_apart(tmp_path: Path) -> None:
    make, messages = maker_of("bag"), drive()
    scans = [m for m in messages if m[0] == "/scan"]
    scans[7], scans[8] = scans[8], scans[7]
    again = ("/scan", scans[20][1] + 0.01, scans[20][2])
    other = (
        "/scan",
        scans[30][1] + 0.01,
        make.laser_scan(scans[30][1], [3.0] * 60, frame="base_link"),
    )
    in_order = [
        (t, T0 + 0.05 * k, m)
        for k, (t, _, m) in enumerate([*scans[:21], again, *scans[21:], other])
    ]
    source = opened(write_recording(tmp_path / "a.bag", in_order))
    stamps = [r.stamp_ns for r in source]
    assert len(stamps) == 40
    assert np.all(np.diff(stamps) > 0)
    reasons = [s.reason for s in source.scan_statuses() if s.reason]
    assert reasons == ["duplicate of the scan before", "same stamp as another scan"]
    assert any("out of order (at most 900 ms), sorted" in n for n in source.info().notices)


def test_clock_jumps_back_lists_segments(tmp_path: Path) -> None:
    make = maker_of("bag")
    second = [
        (t, s + 4.0, make.odom(s - 0.02, x=50.0 + s - T0) if t == "/odom" else m)
        for t, s, m in drive(seed=1)
    ]
    path = write_recording(tmp_path / "a.bag", drive() + second)
    text = told(path)
    assert "the clock goes back by 3.9 s at scan 40" in text
    assert "--segment 1 ... 2" in text
    source = opened(path, SourceConfig(segment=2))
    got = list(source)
    assert len(got) == 40
    assert got[5].odom_from_robot.x == pytest.approx(50.52, abs=0.03)
    assert readings(path, SourceConfig(segment=1))[5].odom_from_robot.x < 1.0
    assert got[5].scan.ranges_m[0] == pytest.approx(
        readings(write_recording(tmp_path / "b.bag", drive(seed=1)))[5].scan.ranges_m[0]
    )
    assert sum(s.reason == "not in segment 2" for s in source.scan_statuses()) == 40
    assert "there are only 2" in told(path, SourceConfig(segment=3))


def test_a_late_message_is_no_clock_jump(tmp_path: Path) -> None:
    messages = drive()
    late = messages.pop(10)
    path = write_recording(tmp_path / "a.bag", [*messages, (late[0], T0 + 4.0, late[2])])
    assert len(readings(path)) == 40


def test_beam_count_may_change(tmp_path: Path) -> None:
    make = maker_of("bag")
    counts = [360, 1080, 7, 1080, 360]
    scans = [("/scan", T0 + k, make.laser_scan(T0 + k, [2.0] * n)) for k, n in enumerate(counts)]
    got = readings(write_recording(tmp_path / "a.bag", scans))
    assert [len(r.scan.ranges_m) for r in got] == counts


def test_more_than_a_turn_is_kept(tmp_path: Path) -> None:
    path = write_recording(tmp_path / "a.bag", drive(angles=(0.0, 2 * np.pi / 59)))
    assert len(readings(path)[0].scan.ranges_m) == 60


@pytest.mark.parametrize(
    ("limits", "line"),
    [
        ((0.1, 0.0), "range_max is 0 in /scan; set --set source.range_max_m=..."),
        ((5.0, 1.0), "range_min 5 and range_max 1 in /scan leave no range"),
        ((0.1, float("nan")), "range_max is nan in /scan"),
    ],
)
def test_impossible_range_limits(tmp_path: Path, limits: tuple[float, float], line: str) -> None:
    path = write_recording(tmp_path / "a.bag", drive(limits=limits))
    assert line in told(path)
    fixed = SourceConfig(range_min_m=0.1, range_max_m=9.0)
    assert readings(path, fixed)[0].scan.range_max_m == 9.0


@pytest.mark.parametrize(
    ("value", "holds"),
    [(np.inf, "60 inf"), (np.nan, "60 nan"), (99.0, "60 outside the range limits")],
)
def test_no_scan_has_a_return(tmp_path: Path, value: float, holds: str) -> None:
    make = maker_of("bag")
    scans = [("/scan", T0 + k, make.laser_scan(T0 + k, [value] * 60)) for k in range(10)]
    text = told(write_recording(tmp_path / "a.bag", scans))
    assert text == (
        f"/scan: 10 of 10 scans without a return; first: scan t=1000.000 s: no valid beam ({holds})"
    )


def test_a_scan_without_returns_is_left_out_and_told(tmp_path: Path) -> None:
    messages = drive()
    stamp = messages[10][1]
    messages[10] = (
        "/scan",
        stamp,
        maker_of("bag").laser_scan(stamp, [np.inf] * 60, frame="base_link"),
    )
    source = opened(write_recording(tmp_path / "a.bag", messages))
    assert [s.reason for s in source.scan_statuses() if s.reason] == ["no valid beam (60 inf)"]
    assert "1 of 40 scans not used: 1 no valid beam" in source.info().notices


def test_a_scan_of_an_unknown_frame_is_left_out_and_told(tmp_path: Path) -> None:
    messages = drive()
    stamp = messages[10][1]
    messages[10] = ("/scan", stamp, maker_of("bag").laser_scan(stamp, [2.0] * 60, frame="other"))
    source = opened(write_recording(tmp_path / "a.bag", messages))
    reasons = [s.reason for s in source.scan_statuses() if s.reason]
    assert len(reasons) == 1
    assert reasons[0].startswith("no path other -> base_link in tf")


def test_the_same_scan_again_and_again(tmp_path: Path) -> None:
    make = maker_of("bag")
    scans = [("/scan", T0 + k, make.laser_scan(T0 + k, [2.0] * 9)) for k in range(9)]
    path = write_recording(tmp_path / "a.bag", scans)
    assert len(readings(path)) == 9
    assert "warning: the scan data never change" in noticed(path)


def test_most_scans_unusable_is_refused(tmp_path: Path) -> None:
    make = maker_of("bag")
    scans = [
        ("/scan", T0 + k, make.laser_scan(T0 + k, [np.nan if k % 4 else 2.0] * 60))
        for k in range(12)
    ]
    assert "9 of 12 scans not used: 9 no valid beam" in told(
        write_recording(tmp_path / "a.bag", scans)
    )


def test_odometry_with_zero_quaternions(tmp_path: Path) -> None:
    make = maker_of("bag")
    zero = (0.0, 0.0, 0.0, 0.0)
    bad = [(t, s, make.odom(s, quaternion=zero) if t == "/odom" else m) for t, s, m in drive()]
    some = [b if 20 < k < 30 else m for k, (m, b) in enumerate(zip(drive(), bad, strict=True))]
    assert "5 of 40 poses in /odom unusable, bridged" in noticed(
        write_recording(tmp_path / "a.bag", some)
    )
    assert "no pose is valid" in told(write_recording(tmp_path / "b.bag", bad))


def test_map_to_odom_in_tf_is_ignored(tmp_path: Path) -> None:
    tf = maker_of("bag").transforms(T0, ("map", "odom", (5.0, 0.0, 0.0), IDENTITY))
    path = write_recording(tmp_path / "a.bag", [("/tf", T0, tf), *drive()])
    assert readings(path)[5].odom_from_robot.x == pytest.approx(0.5)
    assert "tf map -> odom is another SLAM's output: ignored" in noticed(path)


def test_odometry_from_tf(tmp_path: Path) -> None:
    make, messages = maker_of("bag"), drive(odom=False, laser="laser")
    mount = make.transforms(T0, ("base_footprint", "laser", (0.3, 0.0, 0.2), IDENTITY))
    messages.append(("/tf_static", T0 + 4.0, mount))  # late, yet valid for all time
    for k in range(41):
        t = T0 + 0.1 * k
        edge = ("odom", "base_footprint", (0.1 * k, 0.0, 0.0), IDENTITY)
        messages.append(("/tf", t, make.transforms(t, edge)))
    path = write_recording(tmp_path / "a.bag", messages)
    got = readings(path)
    assert got[13].odom_from_robot.x == pytest.approx(1.3)
    assert got[13].scan.robot_from_laser.x == pytest.approx(0.3)
    assert "odometry from tf odom -> base_footprint" in noticed(path)


def test_faked_odometry_that_never_moves_is_not_used(tmp_path: Path) -> None:
    make, rng = maker_of("bag"), np.random.default_rng(0)
    messages: list[Recorded] = []
    for k in range(40):
        t = T0 + 0.1 * k
        messages.append(
            ("/scan", t, make.laser_scan(t, 1.0 + 8 * rng.random(60), frame="base_link"))
        )
        messages.append(("/odom", t, make.odom(t)))
    path = write_recording(tmp_path / "a.bag", messages)
    assert all(r.odom_from_robot is None for r in readings(path))
    assert "never changes although scans do" in noticed(path)


def test_several_odometry_topics(tmp_path: Path) -> None:
    messages = drive()
    both = [*messages, *(("/visual", s, m) for t, s, m in messages if t == "/odom")]
    path = write_recording(tmp_path / "a.bag", both)
    assert "using /odom, not /visual" in noticed(path)
    renamed = [("/wheel" if t == "/odom" else t, s, m) for t, s, m in both]
    text = told(write_recording(tmp_path / "b.bag", renamed))
    assert "2 Odometry topics; choose with --odom /visual or --odom /wheel or --odom none" in text


def test_stamps_moved_to_the_first_beam(tmp_path: Path) -> None:
    path = write_recording(tmp_path / "a.bag", drive(times=(0.001, 0.1)))
    last = readings(path, SourceConfig(stamp_at="last"))
    assert last[0].stamp_ns == pytest.approx((T0 - 0.059) * 1e9, abs=100)
    assert last[0].scan.time_increment_s == pytest.approx(0.001)
    shared = write_recording(tmp_path / "b.bag", drive(times=(0.0, 0.06)))
    assert readings(shared)[0].scan.time_increment_s == pytest.approx(0.001)


def test_ranges_follow_rep_117(tmp_path: Path) -> None:
    make = maker_of("bag")
    values = [0.05, 0.1, 5.0, 10.0, 10.5, np.inf, -np.inf, np.nan, 0.0]
    path = write_recording(
        tmp_path / "a.bag", [("/scan", T0 + k, make.laser_scan(T0 + k, values)) for k in range(2)]
    )
    got = readings(path)[0].scan
    nan = np.nan
    want = [nan, 0.1, 5.0, 10.0, nan, np.inf, -np.inf, nan, nan]
    np.testing.assert_array_equal(got.ranges_m, np.array(want, np.float32))
    assert got.is_return().tolist() == [k in (1, 2, 3) for k in range(9)]
    silent = readings(path, SourceConfig(clear_on_inf=False))[0].scan
    assert not silent.is_clear().any()


@settings(
    max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_damaged_bags_never_crash(tmp_path: Path, data: st.DataObject) -> None:
    whole = tmp_path / "whole.bag"
    if not whole.exists():
        write_recording(whole, drive(scans=5))
    raw = bytearray(whole.read_bytes())
    for _ in range(data.draw(st.integers(0, 6))):
        raw[data.draw(st.integers(13, len(raw) - 1))] = data.draw(st.integers(0, 255))
    cut = data.draw(st.integers(1, len(raw)))
    broken = tmp_path / "broken.bag"
    broken.write_bytes(raw[:cut])
    try:
        list(opened(broken))
    except BadInput as error:
        assert "\n" not in str(error)
