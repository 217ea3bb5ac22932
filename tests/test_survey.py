# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""When the map that is driven on is drawn anew: now and then, and soon after a jump."""

from __future__ import annotations

import math
from collections.abc import Sequence
from types import SimpleNamespace

import numpy as np
import pytest

from slarm_graph.backend import SlamResult
from slarm_graph.config import ExploreConfig, MappingConfig
from slarm_graph.exploration import survey
from slarm_graph.exploration.survey import Survey
from slarm_graph.geometry import Pose2, compose
from slarm_graph.reading_log import ReadingLog
from slarm_graph.readings import LaserScan, Reading, Signal
from slarm_graph.snapshots import State
from slarm_graph.trajectory import Trajectory

START = Pose2(2.0, 2.0, 0.3)
SCAN = LaserScan(np.full(8, 1.0), -3.0, 0.75, 0.1, 5.0)


class Scripted:
    """A backend that drives on evenly and is moved by a jump at some readings."""

    def __init__(self, jumps: dict[int, Pose2]) -> None:
        self._jumps, self._stamps_ns = jumps, list[int]()
        self._poses: list[Pose2] = []
        self.asked: list[int] = []

    def update(self, reading: Reading) -> None:
        self._stamps_ns.append(reading.stamp_ns)
        step = Pose2(0.001, 0.0, 0.0) @ self._jumps.get(len(self._stamps_ns), Pose2())
        self._poses.append(self._poses[-1] @ step if self._poses else Pose2(5.0, 1.0, 1.0))

    def map_from_robot(self) -> Pose2:
        return self._poses[-1]

    def result(self) -> SlamResult:
        self.asked.append(len(self._stamps_ns))
        poses = np.array([pose.as_array() for pose in self._poses])
        return SlamResult(Trajectory(np.array(self._stamps_ns), poses))

    def snapshot(self) -> State:
        return {}

    def restore(self, state: State) -> None:
        del state


def surveyed(
    monkeypatch: pytest.MonkeyPatch,
    jumps: dict[int, Pose2],
    count: int,
    *,
    has_odometry: bool = True,
) -> tuple[Survey, list[int], list[bool]]:
    """The survey, the readings at which it was drawn anew, and after which it was stale."""
    calm = SimpleNamespace(verdict="consistent")
    monkeypatch.setattr(survey, "contradictions", lambda *_: calm)
    backend, stale = Scripted(jumps), []
    extent_m = (0.0, 4.0, 0.0, 4.0)
    whole = Survey(
        backend, ExploreConfig(), MappingConfig(), extent_m=extent_m, start=START, log=ReadingLog()
    )
    for k in range(count):
        odom = Pose2(0.001 * k, 0.0, 0.0) if has_odometry else None
        whole.take_in(Reading((k + 1) * 100_000_000, SCAN, odom), Pose2())
        stale.append(whole.is_stale)
    return whole, backend.asked, stale


def test_it_is_drawn_anew_ever_more_seldom(monkeypatch: pytest.MonkeyPatch) -> None:
    """After 150 readings, and then after 1.7 times as many and 150."""
    whole, drawn, stale = surveyed(monkeypatch, {}, 420)
    assert drawn == [150, 405]
    # Stale is what is older than 150 readings, and what was never drawn.
    expected = [150 < k < 405 and k - 150 > 150 for k in range(1, 421)]
    assert stale == expected
    assert (whole.readings, whole.steps) == (420, 420)
    assert whole.dt_s == pytest.approx(0.1)


def test_what_is_old_is_told_by_the_length_of_the_drive(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where all of a drive is the share that is too little, and a half of it."""
    monkeypatch.setattr(survey, "_STALE_SHARE", 1)
    _, _, stale = surveyed(monkeypatch, {}, 404)
    assert not any(stale)
    monkeypatch.setattr(survey, "_STALE_SHARE", 2)
    _, _, stale = surveyed(monkeypatch, {}, 404)
    assert stale == [k - 150 > k // 2 for k in range(1, 405)]
    assert stale.index(True) == 300


@pytest.mark.parametrize(
    ("jump", "is_one"),
    [
        (Pose2(0.055, 0.0, 0.0), False),
        (Pose2(0.0, -0.065, 0.0), True),
        (Pose2(0.0, 0.0, math.radians(1.9)), False),
        (Pose2(0.0, 0.0, -math.radians(2.1)), True),
    ],
)
def test_a_jump_has_it_drawn_anew_soon(
    monkeypatch: pytest.MonkeyPatch, jump: Pose2, is_one: bool
) -> None:
    """At least fifty readings after the last time; what odometry tells as well is none."""
    _, drawn, stale = surveyed(monkeypatch, {20: jump, 60: jump, 130: jump}, 140)
    assert drawn == ([50, 100] if is_one else [])
    told = [20 <= k < 50 or 60 <= k < 100 or k >= 130 for k in range(1, 141)]
    assert stale == (told if is_one else [False] * 140)
    _, drawn, _ = surveyed(monkeypatch, {20: jump}, 140, has_odometry=False)
    assert drawn == []


def test_without_a_new_reading_the_last_result_stands(monkeypatch: pytest.MonkeyPatch) -> None:
    """A result costs seconds; it is no part of a snapshot, which would be larger by it."""
    whole, drawn, _ = surveyed(monkeypatch, {}, 20)
    assert whole.rebuild() is whole.rebuild()
    assert drawn == [20]
    whole.take_in(Reading(2_100_000_000, SCAN, Pose2(0.02, 0.0, 0.0)), Pose2())
    assert len(whole.rebuild().trajectory.stamps_ns) == 21
    assert drawn == [20, 21]
    assert whole.kept_state()["_corrected"] is None


def test_the_first_reading_is_at_the_start(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever the backend's frame is; from there on its poses are moved alike."""
    whole, _, _ = surveyed(monkeypatch, {}, 40)
    np.testing.assert_allclose(whole.believed.poses[0], START.as_array(), atol=1e-12)
    end = (START @ Pose2(0.039, 0.0, 0.0)).as_array()
    np.testing.assert_allclose(whole.believed.poses[-1], end, atol=1e-12)
    np.testing.assert_allclose(whole.pose.as_array(), end, atol=1e-12)
    assert whole.truth.poses.tolist() == [[0.0, 0.0, 0.0]] * 40


def test_it_is_judged_where_it_has_grown_by_a_tenth_and_always_while_it_is_torn(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    whole, _, _ = surveyed(monkeypatch, {}, 100)
    judged, torn = list[int](), []

    def verdict(scans: Sequence[LaserScan], trajectory: Trajectory) -> SimpleNamespace:
        assert len(scans) == len(trajectory.stamps_ns) == whole.readings
        judged.append(whole.readings)
        is_torn = whole.readings in (112, 113)
        return SimpleNamespace(verdict="inconsistent" if is_torn else "consistent")

    monkeypatch.setattr(survey, "contradictions", verdict)
    for k in range(101, 130):
        whole.take_in(Reading(k * 100_000_000, SCAN), Pose2())
        whole.rebuild()
        torn += [k] if whole.is_torn else []
    assert judged == [101, 112, 113, 114, 126]
    assert torn == [112, 113]


def test_what_was_heard_was_heard_where_the_robot_was(monkeypatch: pytest.MonkeyPatch) -> None:
    """As estimated online, until the map is drawn anew along a corrected path."""
    whole, _, _ = surveyed(monkeypatch, {}, 9)
    for k in (10, 11, 12):
        signals = (Signal("ap", -60.0),) if k != 11 else ()
        whole.take_in(Reading(k * 100_000_000, SCAN, signals=signals), Pose2())
    online = whole.believed.poses
    np.testing.assert_array_equal(whole.live.heard_m, online[[9, 11], :2])
    corrected = compose(
        np.array([0.3, -0.2, 0.1]), np.array(whole._backend.result().trajectory.poses)
    )
    result = SlamResult(Trajectory(whole.log.stamps_ns, corrected))
    monkeypatch.setattr(whole._backend, "result", lambda: result)
    whole.rebuild()
    moved = compose(whole.world_from_map.as_array(), corrected)
    np.testing.assert_allclose(whole.live.heard_m, moved[[9, 11], :2])
