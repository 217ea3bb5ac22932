# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""A diagnosis names every defect that was put into a recording, and survives any file."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from ros_bags import IDENTITY, Recorded, Writer, maker_of, write_recording

from slarm_graph.config import SourceConfig
from slarm_graph.frontends.recordings.check import check
from slarm_graph.frontends.recordings.findings import Diagnosis, Finding
from slarm_graph.frontends.recordings.sources import open_source

T0 = 1000.0


def drive(make: Writer, **scan: object) -> list[Recorded]:
    rng = np.random.default_rng(0)
    out: list[Recorded] = []
    for k in range(60):
        t = T0 + 0.1 * k
        ranges = 2.0 + rng.random(40)
        out.append(("/scan", t, make.laser_scan(t, ranges, frame="base_link", **scan)))
        out.append(("/odom", t, make.odom(t, x=0.05 * k)))
    return out


def of(path: Path, where: str, words: str) -> Finding:
    found = [f for f in check(path).findings if where in f.where and words in f.what]
    assert len(found) == 1, check(path).text()
    return found[0]


def test_a_good_recording_has_nothing_wrong(tmp_path: Path) -> None:
    diagnosis = check(write_recording(tmp_path / "a.bag", drive(maker_of("bag"))))
    assert diagnosis.exit_code == 0, diagnosis.text()
    assert diagnosis.readings == 60
    assert not diagnosis.findings
    scan = next(topic for topic in diagnosis.topics if topic.name == "/scan")
    assert (scan.count, scan.frame, round(scan.rate_hz)) == (60, "base_link", 10)
    assert sum(count for _, count in scan.step_histogram) == 59
    assert diagnosis.text().endswith("60 readings can be used, nothing wrong")


Change = Callable[[Writer, list[Recorded]], list[Recorded]]


def _zero_stamps(make: Writer, messages: list[Recorded]) -> list[Recorded]:
    return [(t, s, make.laser_scan(0.0, [2.0 + s] * 9)) for t, s, m in messages if t == "/scan"]


def _late(make: Writer, messages: list[Recorded]) -> list[Recorded]:
    out = list(messages)
    out[20], out[24] = (("/scan", out[20][1], out[24][2]), ("/scan", out[24][1], out[20][2]))
    return out


def _twice(make: Writer, messages: list[Recorded]) -> list[Recorded]:
    return [*messages[:20], ("/scan", messages[20][1], messages[20][2]), *messages[20:]]


def _silence(make: Writer, messages: list[Recorded]) -> list[Recorded]:
    return [m for m in messages if m[0] == "/odom" or not T0 + 2 < m[1] < T0 + 4]


def _another_clock(make: Writer, messages: list[Recorded]) -> list[Recorded]:
    return [(t, s + 500.0, m) for t, s, m in messages]


def _stuck(make: Writer, messages: list[Recorded]) -> list[Recorded]:
    return [
        (t, s, make.laser_scan(s, [2.0] * 9, frame="base_link") if t == "/scan" else m)
        for t, s, m in messages
    ]


def _at_maximum(make: Writer, messages: list[Recorded]) -> list[Recorded]:
    far = [10.0, 10.0, 3.0]
    return [
        (t, s, make.laser_scan(s, [*far, 2.0 + 1e-3 * s], frame="base_link") if t == "/scan" else m)
        for t, s, m in messages
    ]


def _empty(make: Writer, messages: list[Recorded]) -> list[Recorded]:
    out = list(messages)
    out[30] = ("/scan", out[30][1], make.laser_scan(out[30][1], [np.inf] * 9, frame="base_link"))
    return out


def _leap(make: Writer, messages: list[Recorded]) -> list[Recorded]:
    return [
        (t, s, make.odom(s, x=100.0) if t == "/odom" and s > T0 + 3 else m) for t, s, m in messages
    ]


def _still(make: Writer, messages: list[Recorded]) -> list[Recorded]:
    return [(t, s, make.odom(s) if t == "/odom" else m) for t, s, m in messages]


def _no_child(make: Writer, messages: list[Recorded]) -> list[Recorded]:
    return [(t, s, make.odom(s, x=s, child="") if t == "/odom" else m) for t, s, m in messages]


def _bad_quaternions(make: Writer, messages: list[Recorded]) -> list[Recorded]:
    bad = (0.0, 0.0, 0.0, 0.0)
    return [
        (t, s, make.odom(s, quaternion=bad) if t == "/odom" and s > T0 + 5 else m)
        for t, s, m in messages
    ]


def _map(make: Writer, messages: list[Recorded]) -> list[Recorded]:
    tf = make.transforms(T0, ("map", "odom", (0.0, 0.0, 0.0), IDENTITY))
    return [("/tf", T0, tf), *messages]


def _two_parents(make: Writer, messages: list[Recorded]) -> list[Recorded]:
    place = (0.0, 0.0, 0.0)
    tf = make.transforms(T0, ("odom", "laser", place, IDENTITY), ("x", "laser", place, IDENTITY))
    return [("/tf", T0, tf), *messages]


@pytest.mark.parametrize(
    ("change", "severity", "where", "words"),
    [
        (_zero_stamps, "warning", "/scan", "all stamps are 0"),
        (_late, "note", "/scan", "2 of 60 out of order, at most 200 ms"),
        (_twice, "warning", "/scan", "1 of 61 repeating the stamp before"),
        (_silence, "warning", "/scan", "gaps: 1 (longest 2.00 s, usual 0.100 s)"),
        (_another_clock, "note", "/scan", "stamps are 500.000 s behind the time of recording"),
        (_stuck, "warning", "/scan", "the scan data never change"),
        (_at_maximum, "warning", "/scan", "50% of all returns are exactly range_max"),
        (_empty, "warning", "/scan", "1 of 60 scans without a return"),
        (_leap, "warning", "/odom", "leaps faster than 5 m/s: 1"),
        (_still, "warning", "/odom", "the pose never changes"),
        (_no_child, "note", "/odom", "child_frame_id is empty"),
        (_bad_quaternions, "warning", "/odom", "9 of 60 poses invalid"),
        (_map, "note", "tf", "map -> odom is almost always the output of another SLAM"),
        (_two_parents, "warning", "tf", "laser has several parents: odom, x"),
    ],
)
def test_every_defect_is_named(
    tmp_path: Path, change: Change, severity: str, where: str, words: str
) -> None:
    make = maker_of("bag")
    path = write_recording(tmp_path / "a.bag", change(make, drive(make)))
    finding = of(path, where, words)
    assert finding.severity == severity
    assert json.loads(json.dumps(check(path).as_json()))["exit_code"] == check(path).exit_code


@pytest.mark.parametrize(
    ("scan", "severity", "words"),
    [
        ({"limits": (0.1, 0.0)}, "error", "60 of 60 scans with impossible limits"),
        ({"angles": (0.0, 0.0)}, "warning", "without an angle between beams"),
        ({"angles": (0.0, 0.2)}, "note", "spanning more than a full turn"),
        ({"times": (0.01, 0.0)}, "warning", "lasting longer than the 0.100 s between scans"),
    ],
)
def test_every_impossible_scan_is_named(
    tmp_path: Path, scan: dict[str, object], severity: str, words: str
) -> None:
    path = write_recording(tmp_path / "a.bag", drive(maker_of("bag"), **scan))
    assert of(path, "/scan", words).severity == severity


def test_clock_jump_and_unconnected_frames_are_errors(tmp_path: Path) -> None:
    messages = drive(maker_of("bag"))
    twice = write_recording(tmp_path / "a.bag", messages + [(t, s + 6, m) for t, s, m in messages])
    assert of(twice, "/scan", "the clock jumps back once").severity == "error"
    assert check(twice, SourceConfig(segment=1)).readings == 60
    make = maker_of("bag")
    lost = [("/scan", s, make.laser_scan(s, [2.0] * 9)) if t == "/scan" else (t, s, m)
            for t, s, m in messages]  # fmt: skip
    assert "no path laser -> base_link" in check(write_recording(tmp_path / "b.bag", lost)).text()


def test_ranges_that_are_a_code_are_told_until_the_limit_is_set(tmp_path: Path) -> None:
    make = maker_of("bag")
    # One beam of eleven, one return of four.
    beams = [10.0, 2.1, 2.2, *[np.nan] * 7]
    scans = [
        (t, s, make.laser_scan(s, [*beams, 2.0 + 1e-3 * s], frame="base_link"))
        for t, s, _ in drive(make)
        if t == "/scan"
    ]
    path = write_recording(tmp_path / "a.bag", scans)
    words = "25% of all returns are exactly range_max"
    assert of(path, "/scan", words).severity == "warning"
    assert any(words in notice for notice in open_source(path).info().notices)
    mended = SourceConfig(range_max_m=9.99)
    assert words not in check(path, mended).text()
    assert words not in "".join(open_source(path, mended).info().notices)


def test_limits_that_are_set_take_the_place_of_impossible_ones(tmp_path: Path) -> None:
    scans = drive(maker_of("bag"), limits=(0.1, 0.0))
    path = write_recording(tmp_path / "a.bag", scans)
    assert check(path).exit_code == 2
    assert check(path, SourceConfig(range_max_m=10.0)).exit_code == 0


def test_a_chosen_segment_is_judged_by_itself(tmp_path: Path) -> None:
    messages = drive(maker_of("bag"))
    make = maker_of("bag")
    # The clock begins anew half way, at the very stamps of the first half, and elsewhere.
    again = [
        (t, s + 6, make.odom(s, x=50.0 + s - T0) if t == "/odom" else m) for t, s, m in messages
    ]
    path = write_recording(tmp_path / "a.bag", messages + again)
    told = [finding.what for finding in check(path).findings]
    assert len(told) == 3
    assert all("the clock" in what for what in told)
    for number in (1, 2):
        assert check(path, SourceConfig(segment=number)).exit_code == 0


def test_odometry_whose_clock_alone_jumps_is_no_reason_to_choose_a_segment(tmp_path: Path) -> None:
    make = maker_of("bag")
    messages = [
        (t, s, make.odom(s - 500.0 * (s > T0 + 3), x=s) if t == "/odom" else m)
        for t, s, m in drive(make)
    ]
    path = write_recording(tmp_path / "a.bag", messages)
    assert of(path, "/odom", "the clock jumps back once").severity == "warning"
    assert check(path).readings == 60


def test_imu_without_gravity_is_noted(shared_data: Path) -> None:
    diagnosis = check(shared_data / "odd_bags/tilting_laser.bag")
    assert diagnosis.exit_code == 2
    assert "tilted 40.0 deg" in diagnosis.text()


@pytest.mark.parametrize("name", ["no.bag", "empty.bag", "text.bag", "folder"])
def test_no_recording_at_all(tmp_path: Path, name: str) -> None:
    (tmp_path / "empty.bag").touch()
    (tmp_path / "text.bag").write_text("hello")
    (tmp_path / "folder").mkdir()
    diagnosis = check(tmp_path / name)
    assert diagnosis.exit_code == 2
    assert len(diagnosis.findings) == 1
    assert diagnosis.text().endswith("cannot be used as it is")


_SHARED = [HealthCheck.function_scoped_fixture, HealthCheck.too_slow]


@pytest.mark.parametrize("kind", ["bag", "db3", "mcap", "clf"])
@settings(max_examples=15, deadline=None, suppress_health_check=_SHARED)
@given(data=st.data())
def test_any_damage_ends_in_a_diagnosis(tmp_path: Path, kind: str, data: st.DataObject) -> None:
    whole = _whole(tmp_path, kind)
    raw = bytearray(whole.read_bytes())
    for _ in range(data.draw(st.integers(0, 8))):
        raw[data.draw(st.integers(0, len(raw) - 1))] = data.draw(st.integers(0, 255))
    broken = tmp_path / f"broken.{kind}"
    broken.write_bytes(raw[: data.draw(st.integers(0, len(raw)))])
    diagnosis = check(broken)
    assert isinstance(diagnosis, Diagnosis)
    json.dumps(diagnosis.as_json())
    assert not any("not foreseen" in finding.advice for finding in diagnosis.findings)


def _whole(folder: Path, kind: str) -> Path:
    """A small intact recording of a kind, made once per test."""
    path = folder / "whole" if kind in ("db3", "mcap") else folder / f"whole.{kind}"
    if not path.exists() and kind == "clf":
        line = "FLASER 3 2.0 3.0 4.0 0 0 0 {k} 0 0 {k}.5 host {k}\n"
        path.write_text("".join(line.format(k=k) for k in range(30)))
    elif not path.exists():
        write_recording(path, drive(maker_of(kind))[:20], kind)
    return next(path.glob(f"*.{kind}")) if path.is_dir() else path


def test_a_diagnosis_agrees_with_what_a_run_gets(shared_data: Path) -> None:
    for name in ("robot_bags/feb13_col.bag", "ros2/mit-csail_db3"):
        source = open_source(shared_data / name, SourceConfig())
        assert check(shared_data / name).readings == len(list(source))
