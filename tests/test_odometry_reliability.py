# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""When odometry contradicts a match, and when it has failed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from slarm_graph.config import FrontendConfig, SimulationConfig
from slarm_graph.files.worlds import load_world
from slarm_graph.frontends.scans.odometry_fusion import log_likelihood_ratios
from slarm_graph.frontends.scans.odometry_reliability import OdometryReliability
from slarm_graph.frontends.scans.small_pose import BASIN_COVARIANCE, SEARCH_REACH
from slarm_graph.frontends.scans.tracker import ScanTracker
from slarm_graph.frontends.simulation.world_recording import SourceFromWorld, waypoints
from slarm_graph.geometry import Pose2
from slarm_graph.readings import Reading

GOES, STANDS = np.array([0.1, 0.0, 0.02]), np.zeros(3)
AGREES_NAT, DISAGREES_NAT = 5.0, -300.0


def stepped(
    reliability: OdometryReliability, log_odds: float, increment: np.ndarray = GOES
) -> bool:
    """Let a step pass and be judged; return whether odometry spoke against its match."""
    reliability.begin_step()
    reliability.predict(increment)
    reliability.update(log_odds, 0.0)
    return reliability.contradicts_matches()


@pytest.mark.parametrize(("every", "expected"), [(50, True), (5, False)])
def test_odometry_that_fails_often_does_not(every: int, expected: bool) -> None:
    """Where it rarely does, the match that says so may be the false one."""
    reliability, spoke = OdometryReliability(), not expected
    for k in range(1, 900):
        fails = k % every == 0
        speaks = stepped(reliability, DISAGREES_NAT if fails else AGREES_NAT)
        spoke = speaks if fails else spoke
    assert spoke == expected


def test_nor_does_what_was_just_seen_to_fail() -> None:
    """Encoders hang for three steps: only in the first the match may be the false one."""
    reliability = OdometryReliability()
    assert all(stepped(reliability, AGREES_NAT) for _ in range(100))
    hung = [stepped(reliability, DISAGREES_NAT, STANDS) for _ in range(3)]
    assert hung == [True, False, False]
    assert reliability.p_working < 0.01
    after = [stepped(reliability, AGREES_NAT) for _ in range(20)]
    assert after[-1]
    assert reliability.p_working > 0.9


@pytest.mark.parametrize("steps", [3, 60])
def test_encoders_that_hang_for_long_hang_while_the_robot_turns_on_the_spot(steps: int) -> None:
    """A gyroscope turns beside frozen encoders; wheels that slip in a turn soon hold again."""
    reliability, turns = OdometryReliability(), np.array([0.0, 0.0, 0.1])
    for _ in range(100):
        stepped(reliability, AGREES_NAT)
    for _ in range(steps):
        stepped(reliability, DISAGREES_NAT, turns)
    for _ in range(10):  # the robot stands, and odometry says so
        stepped(reliability, AGREES_NAT, turns)
    assert (reliability.p_working > 0.9) == (steps == 3)
    for _ in range(20):
        stepped(reliability, AGREES_NAT)
    assert reliability.p_working > 0.9


@pytest.mark.parametrize(("log_vouched", "expected"), [(2.6, True), (2.9, False)])
def test_nor_against_what_the_velocity_vouches_for(log_vouched: float, expected: bool) -> None:
    """One match in 300 is false, two steps of 301 have failed: 2.73 nat are 30.66 times as many."""
    reliability = OdometryReliability()
    reliability.begin_step()
    reliability.predict(GOES)
    reliability.update(DISAGREES_NAT, log_vouched)
    assert reliability.contradicts_matches() == expected
    reliability.begin_step()  # what a match was vouched with is its own
    assert reliability.contradicts_matches() == (reliability.failure_rate < 30.66 / 300)


WHEELS, VELOCITY = np.array([0.7, -0.2, 0.1]), np.array([0.1, 0.0, 0.02])
SHARP, WIDE = np.diag([0.01, 0.01, 0.01]) ** 2, np.diag([0.03, 0.02, 0.04]) ** 2


def densities(found: np.ndarray) -> tuple[float, float]:
    """Of a motion by the wheels over the velocity, and by the velocity over a false match."""
    return log_likelihood_ratios(WHEELS, SHARP, VELOCITY, WIDE, found, SHARP)


def test_odometry_slipped_where_the_match_goes_on_as_before() -> None:
    by_wheels, vouched = densities(VELOCITY + np.array([0.01, 0.0, 0.005]))
    assert by_wheels < -10.0
    assert vouched > 8.0


def test_a_match_that_leads_elsewhere_is_as_likely_a_false_one() -> None:
    """Of a jump of 0.6 m and 19 degrees that neither wheels nor velocity know of."""
    by_wheels, vouched = densities(np.array([-0.53, 0.1, -0.3]))
    assert vouched < -3.0
    assert abs(by_wheels) < 30.0


def test_false_matches_lie_at_every_scale_alike() -> None:
    """Their density integrates to 1 between what is one place and as far as is searched."""
    nothing = 1e-12 * np.eye(3)
    broad = np.diag([1e6, 1e6, 1e6])
    flat = -0.5 * float(np.log(np.linalg.det(2.0 * np.pi * broad)))
    axes = np.sqrt(np.diag(BASIN_COVARIANCE))

    def density(times: float) -> float:
        found = WHEELS + np.array([times * axes[0], 0.0, 0.0])
        return float(
            np.exp(flat - log_likelihood_ratios(WHEELS, nothing, WHEELS, broad, found, nothing)[1])
        )

    times = np.geomspace(1.0, SEARCH_REACH[0] / axes[0], 2001)
    shells = 4.0 * np.pi * np.prod(axes) * times**2 * [density(t) for t in times]
    assert np.trapezoid(shells, times) == pytest.approx(1.0, rel=1e-3)
    assert density(0.3) == pytest.approx(density(1.0))


def test_a_slip_in_a_room_contradicts_no_match(room: Sequence[Reading]) -> None:
    """Wheels that spin for a scan are told from a match that is false: the graph has one path."""
    tracker = ScanTracker(FrontendConfig())
    held = []
    for k, reading in enumerate(room):
        pose = reading.odom_from_robot
        assert pose is not None
        slipped = Pose2(pose.x + (0.5 if k >= 60 else 0.0), pose.y, pose.theta)
        wheels = tracker.track(replace(reading, odom_from_robot=slipped)).wheels
        held.append(0.0 if wheels is None else float(np.sqrt(wheels.covariance_if_working[0, 0])))
    assert held[60] > 0.2
    assert max(held[40:60]) < 0.05
    assert max(held[65:]) < 0.05


@pytest.fixture(scope="module")
def room() -> list[Reading]:
    """A drive along a corridor of the paper's room."""
    config, way = SimulationConfig(), np.array([[-3.0, -2.8], [3.4, -2.0]])
    source = SourceFromWorld(load_world("paper_room"), config, seed=0, script=waypoints(way))
    return list(source)[:90]
