# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The matcher of a name is what the tracker refines by, with its own settings."""

from __future__ import annotations

import numpy as np
import pytest
from test_tracker import drive, position_errors_m

from slarm_graph import backends
from slarm_graph.config import FrontendConfig, RunConfig, SimulationConfig
from slarm_graph.constraint import MatchResult
from slarm_graph.files.configs import load_config
from slarm_graph.frontends.scans import BUILT_IN
from slarm_graph.frontends.scans.tracker import ScanTracker, TrackedScan
from slarm_graph.geometry import Floats, Pose2
from slarm_graph.readings import Reading
from slarm_graph.snapshots import restore_state, state_of


@pytest.fixture(scope="module")
def lap() -> tuple[list[Reading], Floats]:
    readings, truth = drive(SimulationConfig())
    return readings[:80], truth[:80]


def followed(readings: list[Reading], config: FrontendConfig) -> list[TrackedScan]:
    tracker = ScanTracker(config)
    return [tracker.track(reading) for reading in readings]


@pytest.mark.parametrize("matcher", sorted(BUILT_IN))
def test_every_matcher_follows_the_robot(lap: tuple[list[Reading], Floats], matcher: str) -> None:
    tracked = followed(lap[0], FrontendConfig(matcher=matcher))
    assert np.max(position_errors_m(tracked, lap[1])) < 0.05
    assert sum(bool(scan.match) for scan in tracked) >= len(tracked) - 2


def test_another_matcher_gives_other_poses(lap: tuple[list[Reading], Floats]) -> None:
    ends = {
        matcher: followed(lap[0], FrontendConfig(matcher=matcher))[-1].local_from_robot
        for matcher in BUILT_IN
    }
    assert len({(pose.x, pose.y, pose.theta) for pose in ends.values()}) == len(BUILT_IN)


class Blind:
    """A matcher that never finds anything, and counts how often it was asked."""

    asked = 0

    def __init__(self, settings: object, matching: object) -> None:
        del settings, matching

    def match(self, source: Floats, target: Floats, *, target_from_source: Pose2) -> MatchResult:
        del source, target
        Blind.asked += 1
        return MatchResult(target_from_source, reason="blind")


def test_what_a_matcher_does_not_find_is_predicted(
    lap: tuple[list[Reading], Floats], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(BUILT_IN, "blind", f"{__name__}:Blind")
    tracked = followed(lap[0][:20], FrontendConfig(matcher="blind"))
    assert Blind.asked >= len(tracked) - 1
    assert not any(scan.match for scan in tracked)


def test_backends_hand_the_matcher_s_settings_down(lap: tuple[list[Reading], Floats]) -> None:
    def end(*settings: str) -> Floats:
        config: RunConfig = load_config(None, ["frontend.matcher=icp", *settings])
        backend = backends.make("pose_graph", config, np.random.default_rng(0), lambda _: None)
        for reading in lap[0][:30]:
            backend.update(reading)
        return backend.map_from_robot().as_array()

    assert not np.array_equal(end(), end("icp.max_distance_m=0.05"))
    assert np.array_equal(end(), end("icp.max_distance_m=0.5"))


def test_a_tracker_with_a_matcher_goes_on_from_its_state(
    lap: tuple[list[Reading], Floats],
) -> None:
    readings, config = lap[0][:40], FrontendConfig(matcher="icp")
    tracker, resumed = ScanTracker(config), ScanTracker(config)
    for reading in readings[:20]:
        tracker.track(reading)
    restore_state(state_of(tracker), resumed)
    for reading in readings[20:]:
        one, other = tracker.track(reading), resumed.track(reading)
        assert np.array_equal(one.local_from_robot.as_array(), other.local_from_robot.as_array())
