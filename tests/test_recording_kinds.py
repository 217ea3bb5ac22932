# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Faults of recordings by kind: check and run share one rule, and say the same of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from driven_bags import T0, drive, noticed, opened, readings, told
from ros_bags import IDENTITY, Recorded, maker_of, write_recording

from slarm_graph.config import RunConfig, SourceConfig
from slarm_graph.frontends.recordings.check import check


def findings(path: Path, config: SourceConfig | None = None) -> str:
    return "; ".join(f.what for f in check(path, config).findings if f.severity != "note")


def drop_reasons(path: Path) -> list[str]:
    return [status.reason for status in opened(path).scan_statuses() if status.reason]


@pytest.mark.parametrize("low", [0.0, 0.05])
def test_a_range_of_zero_is_never_a_return(tmp_path: Path, low: float) -> None:
    make = maker_of("bag")
    scans = [
        ("/scan", T0 + k, make.laser_scan(T0 + k, [0.0, 1.0 + k, 0.0], limits=(low, 9.0)))
        for k in range(4)
    ]
    path = write_recording(tmp_path / "a.bag", scans)
    assert [r.scan.is_return().tolist() for r in readings(path)] == [[False, True, False]] * 4
    zeros = [("/scan", s, make.laser_scan(s, [0.0] * 9, limits=(low, 9.0))) for _, s, _ in scans]
    nothing = write_recording(tmp_path / "b.bag", zeros)
    assert "without a return" in told(nothing)
    assert check(nothing).exit_code == 2


@pytest.mark.parametrize("times", [(1e6, 1e8), (0.01, 0.0), (0.0, 1e8), (np.inf, np.nan)])
def test_a_sweep_longer_than_the_scan_period_is_ignored(
    tmp_path: Path, times: tuple[float, float]
) -> None:
    path = write_recording(tmp_path / "a.bag", drive(times=times))
    for config in (SourceConfig(), SourceConfig(stamp_at="last")):
        got = readings(path, config)
        assert all(r.scan.time_increment_s == 0.0 for r in got)
        assert got[0].stamp_ns == round(T0 * 1e9)
    words = "40 of 40 scans lasting longer than the 0.100 s between scans"
    assert f"warning: {words}" in noticed(path)
    assert words in findings(path)


def test_deskewing_turned_off_reaches_every_stage() -> None:
    off = RunConfig.model_validate({"frontend": {"deskew": False}})
    assert not off.source_as_used().sweep_times
    assert RunConfig().source_as_used() == SourceConfig()


def test_a_sweep_of_time_that_is_not_believed_is_zero(tmp_path: Path) -> None:
    path = write_recording(tmp_path / "a.bag", drive(times=(0.001, 0.1)))
    assert readings(path)[0].scan.time_increment_s == pytest.approx(0.001)
    assert readings(path, SourceConfig(sweep_times=False))[0].scan.time_increment_s == 0.0


def _stuck(rows: range, *, moving: bool = True) -> list[Recorded]:
    make, messages = maker_of("bag"), drive()
    scans = [m for t, _, m in messages if t == "/scan"]
    for k in rows:
        stamp_s = T0 + 0.1 * k
        copy = make.laser_scan(stamp_s, scans[rows[0]].ranges, frame="base_link")  # type: ignore[attr-defined]
        scans[k] = copy
    odom = [m for t, _, m in messages if t == "/odom"]
    if not moving:
        odom = [make.odom(T0 + 0.1 * k - 0.02, x=min(k, 10) * 0.1) for k in range(40)]
    out: list[Recorded] = []
    for k in range(40):
        out += [("/scan", T0 + 0.1 * k, scans[k]), ("/odom", T0 + 0.1 * k, odom[k])]
    return out


def test_frozen_scans_are_dropped_while_the_robot_moves(tmp_path: Path) -> None:
    path = write_recording(tmp_path / "a.bag", _stuck(range(10, 20)))
    assert drop_reasons(path) == ["repeats an earlier scan to the bit although the robot moves"] * 9
    assert len(readings(path)) == 31
    assert "9 of 40 scans not used: 9 repeats an earlier scan" in findings(path)
    many = write_recording(tmp_path / "b.bag", _stuck(range(5, 35)))
    assert len(readings(many)) == 11
    still = write_recording(tmp_path / "c.bag", _stuck(range(12, 30), moving=False))
    assert drop_reasons(still) == []


def test_few_beams_are_warned_of(tmp_path: Path) -> None:
    make = maker_of("bag")
    scans = [
        ("/scan", T0 + k / 10, make.laser_scan(T0 + k / 10, [1, 2, 3, 4 + k / 100]))
        for k in range(9)
    ]
    path = write_recording(tmp_path / "a.bag", scans)
    assert "most scans have 4 returns or fewer" in findings(path)
    assert "most scans have 4 returns or fewer" in noticed(path)


def _odometry(change: dict[int, float | str]) -> list[Recorded]:
    make, out = maker_of("bag"), []
    for topic, s, m in drive():
        k = round((s - T0) * 10)
        if topic == "/odom" and k in change:
            value = change[k]
            m = make.odom(s - 0.02, x=float(value))
        out.append((topic, s, m))
    return out


@pytest.mark.parametrize(
    "change",
    [
        {20: 1e256},
        {20: np.nan, 21: -np.inf},
        {20: 1e9},
        {20: 300.0},
        {20: 300.0, 21: -1e4, 22: 300.0},
        {0: 500.0},
        {39: 1e30},
    ],
)
def test_poses_that_are_elsewhere_for_a_moment_are_bridged(
    tmp_path: Path, change: dict[int, float]
) -> None:
    path = write_recording(tmp_path / "a.bag", _odometry(change))
    for k, reading in enumerate(readings(path)):
        if reading.odom_from_robot is not None:
            assert reading.odom_from_robot.x == pytest.approx(0.1 * k, abs=0.11)
    assert f"{len(change)} of 40 poses in /odom unusable, bridged" in noticed(path)
    assert f"{len(change)} of 40 poses invalid" in findings(path)


def test_odometry_that_was_reset_is_left_as_it_is(tmp_path: Path) -> None:
    path = write_recording(
        tmp_path / "a.bag", _odometry({k: 500.0 + 0.1 * k for k in range(20, 40)})
    )
    assert readings(path)[30].odom_from_robot.x > 400.0  # type: ignore[union-attr]
    assert "unusable" not in noticed(path)


def test_one_stamp_a_century_off_is_not_two_recordings(tmp_path: Path) -> None:
    make, messages = maker_of("bag"), drive()
    row = next(n for n, (t, s, _) in enumerate(messages) if t == "/scan" and s > T0 + 2)
    messages[row] = ("/scan", messages[row][1], make.laser_scan(2e9, np.arange(1, 9.0)))
    path = write_recording(tmp_path / "a.bag", messages)
    assert drop_reasons(path) == ["stamp is more than a week off"]
    assert len(readings(path)) == 39


def _two_robots(tf: dict[str, str], odom: bool = True) -> list[Recorded]:
    """Two robots, one mirrored; `tf` says on which topic each publishes its tf."""
    make, messages = maker_of("bag"), []
    rng = np.random.default_rng(0)
    for robot, sign in (("robot1", 1.0), ("robot2", -1.0)):
        mount = (sign * 0.2, 0.0, 0.1)
        static = make.transforms(T0, ("base_link", "laser", mount, IDENTITY))
        messages.append((f"{tf[robot]}_static", T0, static))
        for k in range(40):
            t = T0 + 0.1 * k
            x = sign * (1.0 + 0.1 * k)
            scan = make.laser_scan(t, 2.0 + rng.random(60))
            messages.append((f"/{robot}/scan", t, scan))
            edge = make.transforms(t, ("odom", "base_link", (x, 0.0, 0.0), IDENTITY))
            messages.append((tf[robot], t, edge))
            if odom:
                messages.append((f"/{robot}/odom", t, make.odom(t, x=x)))
    return sorted(messages, key=lambda m: m[1])


@pytest.mark.parametrize("odom", [True, False])
def test_every_robot_has_its_own_tf_and_odometry(tmp_path: Path, odom: bool) -> None:
    messages = _two_robots({"robot1": "/robot1/tf", "robot2": "/robot2/tf"}, odom)
    path = write_recording(tmp_path / "a.bag", messages)
    for robot, sign in (("robot1", 1.0), ("robot2", -1.0)):
        got = readings(path, SourceConfig(scan_topic=f"/{robot}/scan"))
        assert got[0].scan.robot_from_laser.x == pytest.approx(sign * 0.2)
        assert got[10].odom_from_robot.x == pytest.approx(sign * 2.0)  # type: ignore[union-attr]
    assert "choose with --scan /robot1/scan or --scan /robot2/scan" in told(path)


def test_two_robots_on_one_tf_topic_are_told(tmp_path: Path) -> None:
    messages = _two_robots({"robot1": "/tf", "robot2": "/tf"}, odom=False)
    path = write_recording(tmp_path / "a.bag", messages)
    text = told(path, SourceConfig(scan_topic="/robot1/scan"))
    assert "tf odom -> base_link jumps back and forth between two places" in text
    with_odom = _two_robots({"robot1": "/tf", "robot2": "/tf"})
    path = write_recording(tmp_path / "b.bag", with_odom)
    config = SourceConfig(scan_topic="/robot1/scan")
    assert "tf_static base_link -> laser has 2 different values" in noticed(path, config)


def test_tf_of_nobody_in_particular_is_refused_with_the_topics(tmp_path: Path) -> None:
    messages = _two_robots({"robot1": "/a/tf", "robot2": "/b/tf"})
    path = write_recording(tmp_path / "a.bag", messages)
    config = SourceConfig(scan_topic="/robot1/scan")
    assert "/a/tf, /a/tf_static, /b/tf, /b/tf_static" in told(path, config)
    chosen = SourceConfig(scan_topic="/robot1/scan", tf_namespace="/b")
    assert readings(path, chosen)[0].scan.robot_from_laser.x == pytest.approx(-0.2)


@pytest.mark.parametrize(
    ("scan_frame", "tf_frame", "child"),
    [
        ("laser", "robot1/laser", "robot1/base_link"),
        ("/robot1/laser", "laser", "base_link"),
        ("robot1_laser", "laser", "robot1/base_link"),
        ("laser", "robot1_laser", "base_link"),
    ],
)
def test_frames_that_differ_by_a_prefix_only(
    tmp_path: Path, scan_frame: str, tf_frame: str, child: str
) -> None:
    make = maker_of("bag")
    messages = [
        (t, s, make.odom(s - 0.02, x=s - T0, child=child) if t == "/odom" else m)
        for t, s, m in drive(laser=scan_frame)
    ]
    base = "robot1/base_link" if "/" in tf_frame else "base_link"
    static = make.transforms(T0, (base, tf_frame, (0.3, 0.0, 0.0), IDENTITY))
    path = write_recording(tmp_path / "a.bag", [("/tf_static", T0, static), *messages])
    assert readings(path)[0].scan.robot_from_laser.x == pytest.approx(0.3)


def test_two_publishers_on_one_odometry_topic(tmp_path: Path) -> None:
    make, messages = maker_of("bag"), drive()
    messages += [
        ("/odom", s + 0.05, make.odom(s + 0.03, x=-3.0)) for t, s, _ in messages if t == "/odom"
    ]
    messages.sort(key=lambda m: m[1])
    path = write_recording(tmp_path / "a.bag", messages)
    assert "/odom jumps back and forth between two places" in told(path)
