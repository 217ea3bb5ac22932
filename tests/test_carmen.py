# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""CARMEN logs, line by line."""

from __future__ import annotations

import gzip
import math
from pathlib import Path

import numpy as np
import pytest

from slarm_graph.config import SourceConfig
from slarm_graph.errors import BadInput
from slarm_graph.frontends.recordings.check import check
from slarm_graph.frontends.recordings.sources import open_source
from slarm_graph.readings import Reading, Source


def flaser(stamp_s: float, ranges: list[float], pose: tuple[float, float, float]) -> str:
    told = " ".join(f"{r:.2f}" for r in ranges)
    x, y, a = pose
    return (
        f"FLASER {len(ranges)} {told} {x} {y} {a} {x} {y} {a} {stamp_s:.6f} host {stamp_s - 5:.6f}"
    )


def log(path: Path, *lines: str) -> Path:
    text = "# CARMEN Logfile\nPARAM robot_length 0.5 nohost 0\n" + "\n".join(lines) + "\n"
    if path.suffix == ".gz":
        path.write_bytes(gzip.compress(text.encode()))
    else:
        path.write_text(text)
    return path


def opened(path: Path, **config: object) -> Source:
    return open_source(path, SourceConfig(**config))


def readings(path: Path, **config: object) -> list[Reading]:
    return list(opened(path, **config))


@pytest.mark.parametrize(
    ("beams", "first_deg", "step_deg"),
    [
        (180, -90, 1.0),
        (181, -90, 1.0),
        (360, -90, 0.5),
        (361, -90, 0.5),
        (541, -135, 0.5),
        (1081, -135, 0.25),
    ],
)
def test_angles_follow_from_the_number_of_readings(
    tmp_path: Path, beams: int, first_deg: float, step_deg: float
) -> None:
    path = log(tmp_path / "a.log", flaser(10.0, [2.0] * beams, (0, 0, 0)))
    scan = readings(path)[0].scan
    assert math.degrees(scan.angle_min_rad) == pytest.approx(first_deg)
    assert math.degrees(scan.angle_increment_rad) == pytest.approx(step_deg)


@pytest.mark.parametrize("name", ["a.clf", "a.log.gz", "whatever"])
def test_flaser_carries_its_odometry(tmp_path: Path, name: str) -> None:
    lines = [flaser(1.5 + k, [2.0, 3.0 + k, 81.83], (0.1 * k, -0.2, 3.0)) for k in range(4)]
    path = log(tmp_path / name, *lines)
    got = readings(path)
    assert [r.stamp_ns for r in got] == [1_500_000_000 + k * 10**9 for k in range(4)]
    assert got[3].odom_from_robot.as_array() == pytest.approx([0.3, -0.2, 3.0])
    np.testing.assert_array_equal(got[1].scan.ranges_m, np.array([2.0, 4.0, np.nan], np.float32))
    assert all(r.odom_from_robot is None for r in readings(path, odom="none"))


def test_stamps_keep_their_last_digit(tmp_path: Path) -> None:
    line = flaser(1.0, [2.0] * 3, (0, 0, 0)).replace("1.000000 host", "1134864629.895182 host")
    assert readings(log(tmp_path / "a.log", line))[0].stamp_ns == 1134864629895182000


def test_robotlaser_carries_its_own_angles_and_mounting(tmp_path: Path) -> None:
    head = "ROBOTLASER1 0 -1.0 2.0 0.5 30.0 0.01 0 5"
    ranges, remissions = "1 2 3 4 50", "3 7 8 9"
    lines = [
        f"{head} {ranges} {remissions} {x + 0.3} 1 0 {x} 1 0 0 0 0 0 0 {10 + x} host {x}"
        for x in (0.0, 0.5, 1.0)
    ]
    got = readings(log(tmp_path / "a.log", *lines))
    scan = got[1].scan
    assert (scan.angle_min_rad, scan.angle_increment_rad) == (-1.0, 0.5)
    np.testing.assert_array_equal(scan.ranges_m, np.array([1, 2, 3, 4, np.nan], np.float32))
    assert scan.range_max_m == 30.0
    assert scan.robot_from_laser.x == pytest.approx(0.3)
    assert got[1].odom_from_robot.x == 0.5


def test_rawlaser_takes_odometry_from_odom_lines(tmp_path: Path) -> None:
    lines = [f"ODOM {0.1 * k} 0 0 0.1 0 0 {10 + 0.1 * k:.1f} host {0.1 * k:.1f}" for k in range(20)]
    raw = "RAWLASER1 0 -1.57 3.14 0.785 80 0.01 0 5 1 2 3 4 5 0"
    lines += [f"{raw} {10.05 + 0.1 * k:.2f} host {0.05 + 0.1 * k:.2f}" for k in range(19)]
    source = opened(log(tmp_path / "a.log", *lines))
    at = [r.odom_from_robot.x for r in source]
    np.testing.assert_allclose(at, 0.05 + 0.1 * np.arange(19), atol=1e-9)


def test_lines_without_remissions_are_read(tmp_path: Path) -> None:
    raw = "RAWLASER1 0 -1.57 3.14 0.785 80 0.01 0 5 1 2 3 4 5 10.0 host 0.0"
    assert len(readings(log(tmp_path / "a.log", raw))) == 1
    robot = "ROBOTLASER1 0 -1 2 0.5 30 0.01 0 5 1 2 3 4 5 0.3 1 0 0 1 0 0 0 0 0 0 10.0 host 0"
    got = readings(log(tmp_path / "b.log", robot))[0]
    assert (got.odom_from_robot.y, got.scan.robot_from_laser.x) == (1.0, 0.3)


def test_one_laser_of_several(tmp_path: Path) -> None:
    front = flaser(10.0, [2.0] * 181, (0, 0, 0))
    rear = front.replace("FLASER", "RLASER").replace("2.00", "3.00")
    path = log(tmp_path / "a.log", front, rear)
    assert readings(path)[0].scan.ranges_m[0] == 2.0
    assert readings(path, scan_topic="RLASER")[0].scan.ranges_m[0] == 3.0
    assert opened(path).info().notices == ("using FLASER; choose another with --scan (RLASER)",)
    with pytest.raises(BadInput, match="has no RAWLASER1 lines; it has FLASER, RLASER"):
        opened(path, scan_topic="RAWLASER1")


def test_bad_lines_are_skipped_and_told_with_their_number(tmp_path: Path) -> None:
    good = [flaser(10.0 + k, [2.0] * 5, (0, 0, 0)) for k in range(6)]
    bad = ["FLASER 5 1 2 3", "FLASER five", "ODOM 1 2 x 0 0 0 1.0 host 1.0", "GPS 1 2 3 h 4"]
    source = opened(log(tmp_path / "a.log", *good, *bad))
    assert len(list(source)) == 6
    notices = " | ".join(source.info().notices)
    assert "a.log:9: FLASER line skipped" in notices
    assert "a.log:11: ODOM line skipped" in notices
    assert "messages of other kinds ignored: 1 GPS" in notices


def test_a_log_without_lasers_is_refused(tmp_path: Path) -> None:
    path = log(tmp_path / "a.log", "ODOM 0 0 0 0 0 0 1.0 host 1.0")
    with pytest.raises(BadInput, match="holds no FLASER, ROBOTLASER or RAWLASER line"):
        opened(path)
    broken = log(tmp_path / "b.log", "FLASER 5 1 2 3")
    with pytest.raises(BadInput, match=r"no laser line .*b\.log:3: FLASER"):
        opened(broken)


def test_a_truncated_gzip_is_used_as_far_as_it_goes(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    lines = [flaser(10.0 + k, (1 + rng.random(100)).tolist(), (k, 0, 0)) for k in range(200)]
    path = log(tmp_path / "a.log.gz", *lines)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    source = opened(path)
    assert 50 < len(list(source)) < 150
    assert any("ends early" in notice for notice in source.info().notices)


def test_ipc_stamps_that_stand_still_give_way_to_the_loggers(tmp_path: Path) -> None:
    lines = [
        flaser(10.0 + k, [2.0 + k] * 5, (0, 0, 0)).replace(f"{10.0 + k:.6f} host", "0 host")
        for k in range(3)
    ]
    assert [r.stamp_ns for r in readings(log(tmp_path / "a.log", *lines))] == [
        5 * 10**9,
        6 * 10**9,
        7 * 10**9,
    ]


@pytest.mark.parametrize("cut", [20, 100, 400])
def test_a_gzipped_log_that_is_cut_is_told_or_used(tmp_path: Path, cut: int) -> None:
    lines = [f"FLASER 3 2.0 3.0 4.{k % 10} 0 0 0 {k} 0 0 {k}.5 host {k}\n" for k in range(3000)]
    packed = gzip.compress("".join(lines).encode())
    path = tmp_path / "a.clf.gz"
    path.write_bytes(packed[: cut if cut < 400 else len(packed) // 2])
    diagnosis = check(path)
    assert "ends early" in diagnosis.text()
    assert (diagnosis.exit_code == 2) == (diagnosis.readings == 0)


def test_a_log_that_unpacks_to_gigabytes_is_not_unpacked(tmp_path: Path) -> None:
    path = tmp_path / "a.clf.gz"
    path.write_bytes(gzip.compress(b"PARAM a 0\n" * 10_000_000))
    with pytest.raises(BadInput, match="unpacks to more than"):
        open_source(path, SourceConfig())
