# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The tracker in simulated worlds with known truth, and against what recordings do to it."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree
from test_moving_returns import scan_of

from slarm_graph.backends.graph_building import GraphBuilder
from slarm_graph.config import (
    FrontendConfig,
    LidarConfig,
    PoseGraphConfig,
    SimulationConfig,
    SourceConfig,
)
from slarm_graph.files.worlds import load_world
from slarm_graph.frontends.recordings.sources import open_source
from slarm_graph.frontends.scans.pose_candidates import PoseCandidate, PosePrior
from slarm_graph.frontends.scans.tracker import ScanTracker, TrackedScan
from slarm_graph.frontends.simulation.world_recording import SourceFromWorld, waypoints
from slarm_graph.geometry import Floats, Pose2, between, compose, wrap_angles
from slarm_graph.readings import LaserScan, Reading
from slarm_graph.world import WorldMap

Spoil = Callable[[int, Reading], Reading]

ROUTE = np.array([[-3.0, -2.8], [4.4, -2.0], [4.4, -1.0]])


def drive(config: SimulationConfig, seed: int = 0) -> tuple[list[Reading], Floats]:
    """Drive along a corridor, then on against a box with spinning wheels; readings and truth."""
    source = SourceFromWorld(load_world("paper_room"), config, seed=seed, script=waypoints(ROUTE))
    readings = list(source)
    return readings, source.truth().poses


def follow(readings: Sequence[Reading]) -> list[TrackedScan]:
    tracker = ScanTracker(FrontendConfig())
    return [tracker.track(reading) for reading in readings]


def position_errors_m(tracked: Sequence[TrackedScan], truth: Floats) -> Floats:
    """Distance from the truth at every scan, both starting at the same pose."""
    poses = compose(truth[0], np.array([t.local_from_robot.as_array() for t in tracked]))
    return np.hypot(*(poses - truth)[:, :2].T)


@pytest.fixture(scope="module")
def lap() -> tuple[list[Reading], Floats]:
    return drive(SimulationConfig())


@pytest.mark.parametrize(
    ("beams", "step_s", "deskew", "sweep_s"),
    [
        (361, 1e-3, True, 0.36),
        (361, 1e-3, False, 0.0),
        (361, 0.0, True, 0.0),
        (361, -1e-3, True, 0.0),
        (101, 0.0099, True, 0.99),
        (101, 0.0101, True, 0.0),
        (1, 1e-3, True, 0.0),
        (0, 1e-3, True, 0.0),
    ],
)
def test_a_sweep_takes_a_step_less_than_it_has_beams(
    beams: int, step_s: float, deskew: bool, sweep_s: float
) -> None:
    """Of a second or more it is not to be believed."""
    scan = LaserScan(np.ones(beams), 0.0, 0.01, 0.1, 5.0, time_increment_s=step_s)
    tracker = ScanTracker(FrontendConfig(deskew=deskew))
    assert tracker._sweep_s(scan) == pytest.approx(sweep_s)


def without_odometry(_i: int, reading: Reading) -> Reading:
    return replace(reading, odom_from_robot=None)


def with_frozen_odometry(_i: int, reading: Reading) -> Reading:
    return replace(reading, odom_from_robot=Pose2(1.0, 2.0, 3.0))


def with_half_as_much_again(_i: int, reading: Reading) -> Reading:
    o = reading.odom_from_robot
    assert o is not None
    return replace(reading, odom_from_robot=Pose2(1.5 * o.x, 1.5 * o.y, 1.5 * o.theta))


def with_odometry_dropping_out(i: int, reading: Reading) -> Reading:
    return without_odometry(i, reading) if i > 60 else reading


def with_outliers(i: int, reading: Reading) -> Reading:
    rng = np.random.default_rng(i)
    ranges = reading.scan.ranges_m.copy()
    hit = rng.random(len(ranges)) < 0.3
    ranges[hit] = rng.uniform(0.2, 8.0, np.count_nonzero(hit))
    return replace(reading, scan=replace(reading.scan, ranges_m=ranges))


def with_empty_scans(i: int, reading: Reading) -> Reading:
    if i % 10 < 7:
        return reading
    empty = np.full(len(reading.scan.ranges_m), np.inf, dtype=np.float32)
    return replace(reading, scan=replace(reading.scan, ranges_m=empty))


@pytest.mark.parametrize(
    ("spoil", "limit_m"),
    [
        (lambda _i, reading: reading, 0.01),
        (without_odometry, 0.01),
        (with_frozen_odometry, 0.01),
        (with_half_as_much_again, 0.01),
        (with_odometry_dropping_out, 0.01),
        (with_outliers, 0.03),
        (with_empty_scans, 0.03),
    ],
)
def test_stays_with_the_truth(
    lap: tuple[list[Reading], Floats], spoil: Spoil, limit_m: float
) -> None:
    readings, truth = lap
    tracked = follow([spoil(i, reading) for i, reading in enumerate(readings)])
    errors = position_errors_m(tracked, truth)
    # An empty scan is placed by prediction alone; the matched ones around it are what counts.
    placed = [k for k, t in enumerate(tracked) if t.match]
    assert np.sqrt(np.mean(errors[placed] ** 2)) < limit_m
    assert len(placed) > 0.65 * len(tracked)


@pytest.mark.parametrize("odometry", [True, False])
def test_motion_within_a_sweep_is_undone(odometry: bool) -> None:
    readings, truth = drive(SimulationConfig(lidar=LidarConfig(sweep_s=0.1)))
    if not odometry:
        readings = [without_odometry(0, reading) for reading in readings]
    tracked = follow(readings)
    assert np.sqrt(np.mean(position_errors_m(tracked, truth) ** 2)) < 0.02


@pytest.mark.parametrize(("beams", "limit_m"), [(45, 0.1), (91, 0.03), (1081, 0.03)])
def test_any_number_of_beams(beams: int, limit_m: float) -> None:
    readings, truth = drive(SimulationConfig(lidar=LidarConfig(beams=beams)))
    assert position_errors_m(follow(readings), truth).max() < limit_m


@pytest.mark.slow
def test_twenty_beams_do_not_lose_the_robot() -> None:
    """One drive is a draw of 0.03 to 1.9 m, so little is seen while the wheels spin.

    The mean of a hundred is known to 0.055 m; that of ten was 0.52 and 0.78 m by revisions of which
    a hundred have 0.592 and 0.609.
    """
    worst = []
    for seed in range(100):
        readings, truth = drive(SimulationConfig(lidar=LidarConfig(beams=20)), seed)
        worst.append(position_errors_m(follow(readings), truth).max())
    assert np.mean(worst) < 0.7


def test_pose_errors_are_as_large_as_the_covariance_says() -> None:
    """NEES of the motion between scans, per degree of freedom, over several drives."""
    nees: list[float] = []
    for seed in range(3):
        readings, truth = drive(SimulationConfig(), seed)
        tracked = follow(readings)[1:]
        error = between(
            between(truth[:-1], truth[1:]), np.array([t.motion.as_array() for t in tracked])
        )
        error[:, 2] = wrap_angles(error[:, 2])
        covariance = np.array([t.local_covariance for t in tracked])
        nees += list(np.einsum("ni,nij,nj->n", error, np.linalg.inv(covariance), error) / 3.0)
    assert 0.5 < np.mean(nees) < 2.0


def test_odometry_holds_the_way_along_a_bare_corridor() -> None:
    corridor = WorldMap(
        "corridor",
        (),
        np.array([[0.0, 0.0], [60.0, 0.0], [60.0, 2.0], [0.0, 2.0]]),
        3.0,
        (),
        Pose2(15.0, 1.0, 0.0),
    )
    source = SourceFromWorld(corridor, seed=0, script=waypoints(np.array([[35.0, 1.0]])))
    readings = list(source)
    tracked = follow(readings)
    travelled_m = float(np.ptp(source.truth().poses[:, 0]))
    assert position_errors_m(tracked, source.truth().poses)[-1] < 0.03 * travelled_m
    # In the middle, far from both ends, the match itself knows nothing of the way along.
    sigma = np.sqrt(np.diag(tracked[len(tracked) // 2].local_covariance))
    assert sigma[0] > 3.0 * sigma[1]


def test_scans_without_returns_fail_with_a_reason() -> None:
    nothing = LaserScan(np.full(180, np.inf), -1.57, 0.0175, 0.1, 8.0)
    tracked = follow([Reading(k * 10**8, nothing) for k in range(12)])
    assert not any(t.match for t in tracked)
    assert all("returns" in t.match.reason or t.match.reason == "first scan" for t in tracked)
    assert all(np.isfinite(t.local_from_robot.as_array()).all() for t in tracked)


def test_finds_its_way_after_a_gap(lap: tuple[list[Reading], Floats]) -> None:
    readings, truth = lap
    kept = [*range(60), *range(78, len(readings))]
    tracked = follow([without_odometry(k, readings[k]) for k in kept])
    assert position_errors_m(tracked, truth[kept]).max() < 0.05


def test_a_pickled_tracker_goes_on_alike(lap: tuple[list[Reading], Floats]) -> None:
    readings, _ = lap
    tracker = ScanTracker(FrontendConfig())
    for reading in readings[:80]:
        tracker.track(reading)
    copy = pickle.loads(pickle.dumps(tracker))
    for reading in readings[80:110]:
        ours, theirs = tracker.track(reading), copy.track(reading)
        assert ours.local_from_robot == theirs.local_from_robot
        assert ours.is_keyframe == theirs.is_keyframe


def test_local_frame_and_motion_agree(lap: tuple[list[Reading], Floats]) -> None:
    pose = Pose2()
    for tracked in follow(lap[0][:60]):
        pose = pose @ tracked.motion
        np.testing.assert_allclose(pose.as_array(), tracked.local_from_robot.as_array(), atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["intel", "fr079", "mit-csail"])
@pytest.mark.parametrize("odometry", [True, False])
def test_real_recordings_are_tracked_throughout(shared_data, name: str, odometry: bool) -> None:
    readings = list(open_source(shared_data / "benchmark" / f"{name}.bag", SourceConfig()))
    if not odometry:
        readings = [without_odometry(0, reading) for reading in readings]
    tracked = follow(readings)
    failed = sum(not t.match for t in tracked)
    assert failed <= 0.002 * len(tracked) + 1


def test_odometry_that_stands_still_does_not_hold_the_robot_back(shared_data) -> None:
    """In its last seconds this robot drives back while its odometry's position does not change.

    The oracle is its own map from before: the last scans must lie on the walls seen then.
    """
    bag = shared_data / "robot_bags" / "dec13_target_before.bag"
    readings = list(open_source(bag, SourceConfig()))
    placed = [t.local_from_robot.transform(t.points_m) for t in follow(readings)]
    away_m, _ = cKDTree(np.concatenate(placed[:815])).query(np.concatenate(placed[-15:]))
    assert np.mean(away_m < 0.1) > 0.7


def test_a_scan_that_decides_for_another_hypothesis_revises_the_one_before(
    lap: tuple[list[Reading], Floats], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two places fit scan 2; scan 3 fits beside the less likely one, and there alone."""
    fits = {0: [0.0], 1: [0.02], 2: [0.04, 1.04], 3: [1.06], 4: [1.08]}
    now = 0

    def candidates(
        _points: Floats, _map: object, prior: PosePrior, **_: object
    ) -> list[PoseCandidate]:
        contradicted = now == 3 and prior.base[0] < 0.5
        return [
            PoseCandidate(
                np.array([x, 0.0, 0.0]), 1e6 * np.eye(3), 0.9, 99, 1, -n - 20.0 * contradicted
            )
            for n, x in enumerate(fits[now])
        ]

    tracker = ScanTracker(FrontendConfig())
    monkeypatch.setattr(tracker._matcher, "candidates", candidates)
    builder = GraphBuilder(PoseGraphConfig(), FrontendConfig())
    tracked = []
    for now, reading in enumerate(lap[0][:5]):  # noqa: B007
        tracked.append(tracker.track(replace(reading, odom_from_robot=None)))
        builder.add_scan(replace(tracked[-1], odom_from_robot=Pose2()))
    assert tracked[2].local_from_robot.x < 0.5, "the likelier place was told at first"
    assert [len(t.revised) > 0 for t in tracked] == [False, False, False, True, False]
    assert tracked[3].revised[-1][0] > 0.5
    assert tracked[3].motion.x < 0.5, "from where the scan before is believed to be now"
    assert builder.odometry_trajectory().poses[2, 0] > 0.5


def test_a_jump_does_not_decide_for_itself(
    lap: tuple[list[Reading], Floats], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A place three metres off fits better for two scans; then only the way on fits."""
    now = 0

    def candidates(
        _points: Floats, _map: object, prior: PosePrior, **_: object
    ) -> list[PoseCandidate]:
        on, jumped = 0.02 * now, prior.base[0] > 1.5
        at = {on: 0.0} if now < 2 else {on: -2.0 - 40.0 * jumped, on + 3.0: -40.0 * (now > 3)}
        return sorted(
            (
                PoseCandidate(np.array([x, 0.0, 0.0]), 1e6 * np.eye(3), 0.9, 99, 1, w)
                for x, w in at.items()
            ),
            key=lambda place: -place.log_posterior,
        )

    tracker = ScanTracker(FrontendConfig())
    monkeypatch.setattr(tracker._matcher, "candidates", candidates)
    xs = []
    for now, reading in enumerate(lap[0][:6]):  # noqa: B007
        xs.append(tracker.track(replace(reading, odom_from_robot=None)).local_from_robot.x)
    assert xs[2] > 2.5, "the likelier place was told at first"
    assert xs[5] < 0.5


def test_a_log_may_begin_at_zero() -> None:
    walls = np.array([[-2.0, -2.0, -2.0, 4.0], [-2.0, 4.0, 5.0, 4.0], [5.0, 4.0, 5.0, -2.0]])
    pillar, tracked = np.array([[3.0, 0.0, 0.25]]), []
    for first_ns in (0, 1):
        tracker = ScanTracker(FrontendConfig())
        for k in range(3):
            noise_m = np.random.default_rng(k).normal(0.0, 0.01, 361)
            scan = scan_of(pillar, walls, np.array([0.1 * k, 0.0, 0.0]), noise_m)
            last = tracker.track(Reading(first_ns + k * 200_000_000, scan, None))
        tracked.append(last)
    np.testing.assert_allclose(tracked[0].local_covariance, tracked[1].local_covariance, rtol=1e-6)
    assert tracked[0].local_from_robot.as_array() == pytest.approx(
        tracked[1].local_from_robot.as_array(), abs=1e-7
    )
