# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Graph SLAM end to end in the paper's room, and on recordings of the SLAM benchmark."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from slarm_graph.backends.path_interpolation import bracketing_anchors, interpolate_corrections
from slarm_graph.backends.pose_graph import PoseGraphBackend
from slarm_graph.backends.pose_graph_optimizer import marginal_covariances
from slarm_graph.backends.robust_optimization import optimize_robustly
from slarm_graph.config import (
    FrontendConfig,
    LidarConfig,
    PoseGraphConfig,
    SimulationConfig,
    SourceConfig,
    WheelConfig,
)
from slarm_graph.constraint import Constraint, ConstraintKind, PoseGraph
from slarm_graph.errors import RunFailed
from slarm_graph.eval.relations import read_relations, relation_errors
from slarm_graph.exploration.survey import position_rmse_m
from slarm_graph.files.worlds import load_world
from slarm_graph.frontends.recordings.sources import open_source
from slarm_graph.frontends.simulation.simulator import SimulatedWorld
from slarm_graph.frontends.simulation.world_recording import tour
from slarm_graph.geometry import Floats, Pose2, between, compose, invert
from slarm_graph.readings import LaserScan, Reading

Drive = tuple[list[Reading], Floats]


def drive(*, laps: int, noiseless: bool = False) -> Drive:
    """Drive through the paper's room; return readings and true poses (N, 3)."""
    config = SimulationConfig()
    if noiseless:
        wheels = WheelConfig(
            left_slip=0.0, right_slip=0.0, random_slip_m_per_sqrt_m=0.0, wheel_base_error=0.0
        )
        config = SimulationConfig(lidar=LidarConfig(sigma_m=0.0), wheels=wheels)
    room = load_world("paper_room")
    world = SimulatedWorld(room, config, np.random.default_rng(0))
    readings, truth = [], []
    for _ in range(laps):
        for command in tour(room, config)(world):
            readings.append(world.read())
            truth.append(world.truth_of_reading().as_array())
            world.drive(command)
    return readings, np.array(truth)


def run(readings: list[Reading]) -> PoseGraphBackend:
    backend = PoseGraphBackend(PoseGraphConfig(), FrontendConfig(), np.random.default_rng(0))
    for reading in readings:
        backend.update(reading)
    return backend


def from_start(poses: Floats, start: Floats) -> Floats:
    """Move poses so that the first one is `start`."""
    return compose(compose(start, invert(poses[0])), poses)


def rmse_m(poses: Floats, truth: Floats) -> float:
    return float(np.sqrt(np.mean(np.sum((poses[:, :2] - truth[:, :2]) ** 2, axis=1))))


@pytest.fixture(scope="module")
def lap() -> Drive:
    return drive(laps=1)


@pytest.fixture(scope="module")
def finished(lap: Drive) -> PoseGraphBackend:
    return run(lap[0])


def test_error_in_the_papers_room(lap: Drive, finished: PoseGraphBackend) -> None:
    readings, truth = lap
    result = finished.result()
    assert len(result.trajectory) == len(readings)
    assert [r.stamp_ns for r in readings] == result.trajectory.stamps_ns.tolist()
    assert rmse_m(from_start(result.trajectory.poses, truth[0]), truth) < 0.015


def test_noiseless_world_returns_the_truth() -> None:
    readings, truth = drive(laps=1, noiseless=True)
    result = run(readings).result()
    assert rmse_m(from_start(result.trajectory.poses, truth[0]), truth) < 0.006


def test_closures_are_listed_and_in_the_graph(finished: PoseGraphBackend) -> None:
    result = finished.result()
    (table,) = result.tables
    assert table.name == "loop_closures"
    assert result.pose_graph is not None
    verdicts = [row[table.columns.index("verdict")] for row in table.rows]
    closures = [c for c in result.pose_graph.constraints if c.kind is ConstraintKind.LOOP_CLOSURE]
    assert 0 < verdicts.count("accepted") == len(closures)


def test_every_pose_has_a_covariance(lap: Drive, finished: PoseGraphBackend) -> None:
    result = finished.result()
    graph, known = result.pose_graph, result.covariances
    assert graph is not None
    assert known is not None
    assert known.shape == (len(result.trajectory), 3, 3)
    assert np.linalg.eigvalsh(known).min() > -1e-12
    # The first pose is where it is by definition, and the last node is as sure as GTSAM says,
    # which has residuals turn its Jacobians: they are left out.
    np.testing.assert_allclose(known[0], 0.0, atol=1e-15)
    told = [
        replace(c, i_from_j=Pose2.from_array(between(graph.poses[c.i], graph.poses[c.j])))
        for c in graph.constraints
    ]
    (last,) = marginal_covariances(replace(graph, constraints=tuple(told)), [len(graph.poses) - 1])
    assert np.abs(known - last).max(axis=(1, 2)).min() < 1e-9
    assert position_rmse_m(result) == pytest.approx(
        np.sqrt(np.mean(known[:, 0, 0] + known[:, 1, 1]))
    )


def test_same_readings_give_the_same_bytes(lap: Drive, finished: PoseGraphBackend) -> None:
    again = run(lap[0]).result()
    result = finished.result()
    assert again.trajectory.poses.tobytes() == result.trajectory.poses.tobytes()
    assert again.tables == result.tables


def test_snapshot_resumes_to_the_same_bytes(lap: Drive, finished: PoseGraphBackend) -> None:
    readings, _ = lap
    half = run(readings[: len(readings) // 2])
    resumed = PoseGraphBackend(PoseGraphConfig(), FrontendConfig(), np.random.default_rng(5))
    resumed.restore(half.snapshot())
    for reading in readings[len(readings) // 2 :]:
        resumed.update(reading)
    expected = finished.result().trajectory.poses
    assert resumed.result().trajectory.poses.tobytes() == expected.tobytes()


def test_result_may_be_asked_for_at_any_time(lap: Drive) -> None:
    readings, truth = lap
    backend = PoseGraphBackend(PoseGraphConfig(), FrontendConfig(), np.random.default_rng(0))
    for count, reading in enumerate(readings, start=1):
        backend.update(reading)
        if count % 150 == 1:
            result = backend.result()
            assert len(result.trajectory) == count
            last = result.trajectory.poses[-1]
            assert np.allclose(backend.map_from_robot().as_array(), last, atol=0.02)
    poses = backend.result().trajectory.poses
    assert rmse_m(from_start(poses, truth[0]), truth) < 0.015


def test_present_pose_follows_the_robot(lap: Drive, finished: PoseGraphBackend) -> None:
    _, truth = lap
    assert (
        PoseGraphBackend(
            PoseGraphConfig(), FrontendConfig(), np.random.default_rng(0)
        ).map_from_robot()
        == Pose2()
    )
    first = finished.result().trajectory.poses[0]
    moved = finished.map_from_robot().as_array()
    expected = between(truth[0], truth[-1])
    error = between(expected, between(first, moved))
    assert np.hypot(error[0], error[1]) < 0.03
    assert abs(error[2]) < 0.01


def test_results_can_be_asked_for_on_the_way(lap: Drive) -> None:
    """A closed loop asks for the map so far again and again, with and without new closures."""
    backend = PoseGraphBackend(PoseGraphConfig(), FrontendConfig(), np.random.default_rng(0))
    for count, reading in enumerate(lap[0], start=1):
        backend.update(reading)
        if count % 45 == 0:
            assert len(backend.result().trajectory) == count


def test_injected_false_closures_change_little() -> None:
    readings, truth = drive(laps=3)
    backend = run(readings)
    graph = backend._builder.close_loops().graph  # as it is settled: before covariances are learned
    anchors = backend._builder._graph.keyframes[:: PoseGraphConfig().node_keyframes]
    true_nodes = truth[[a.scan for a in anchors]]
    clean = optimize_robustly(graph)
    spoilt = optimize_robustly(with_false_closures(graph, share=0.3))
    reference = rmse_m(from_start(clean.graph.poses, true_nodes[0]), true_nodes)
    error = rmse_m(from_start(spoilt.graph.poses, true_nodes[0]), true_nodes)
    assert error <= 1.2 * reference
    assert spoilt.weights[len(graph.constraints) :].max() < 0.01


def with_false_closures(graph: PoseGraph, *, share: float) -> PoseGraph:
    """Add closures between random nodes, as precise as the true ones, until `share` are false."""
    rng = np.random.default_rng(7)
    true = [c for c in graph.constraints if c.kind is ConstraintKind.LOOP_CLOSURE]
    false = []
    for _ in range(int(share / (1.0 - share) * len(true))):
        i, j = sorted(int(v) for v in rng.choice(len(graph.poses), size=2, replace=False))
        wrong = Pose2(*(rng.normal(size=3) * [2.0, 2.0, 1.0]))
        covariance = true[int(rng.integers(len(true)))].covariance
        false.append(Constraint(i, j, wrong, covariance, ConstraintKind.LOOP_CLOSURE))
    return replace(graph, constraints=graph.constraints + tuple(false))


@pytest.mark.parametrize("seed", range(3))
def test_a_slip_of_the_odometry_gives_way_to_closures(seed: int) -> None:
    rng = np.random.default_rng(seed)
    ring = np.array([[np.cos(a), np.sin(a), a + np.pi / 2] for a in np.linspace(0, 12.5, 120)])
    truth = ring * [8.0, 8.0, 1.0]
    covariance = np.diag([0.01, 0.01, 0.004]) ** 2
    constraints = []
    for i, j in [(k, k + 1) for k in range(119)] + [(k, k + 60) for k in range(60)]:
        noise = rng.normal(size=3) * [0.01, 0.01, 0.004]
        measured = Pose2.from_array(compose(between(truth[i], truth[j]), noise))
        kind = ConstraintKind.ODOMETRY if j == i + 1 else ConstraintKind.LOOP_CLOSURE
        constraints.append(Constraint(i, j, measured, covariance, kind))
    constraints[80] = replace(
        constraints[80], i_from_j=constraints[80].i_from_j @ Pose2(-0.4, 0.0, 0.0)
    )
    poses = [truth[0]]
    for c in constraints[:119]:
        poses.append(compose(poses[-1], c.i_from_j.as_array()))
    found = optimize_robustly(PoseGraph(np.array(poses), tuple(constraints)))
    assert rmse_m(found.graph.poses, truth) < 0.06
    assert np.mean(found.weights > 0.5) > 0.95


def test_blind_scans_are_refused_at_the_end() -> None:
    scan = LaserScan(np.full(90, np.nan, dtype=np.float32), -1.5, 0.03, 0.1, 30.0)
    backend = run([Reading(k * 100_000_000, scan) for k in range(1, 5)])
    with pytest.raises(RunFailed, match="no scan"):
        backend.result()


def test_spread_keeps_known_poses_and_shapes_between_them() -> None:
    rng = np.random.default_rng(2)
    local = np.cumsum(rng.normal(size=(30, 3)) * 0.1, axis=0)
    at = np.array([0, 10, 20])
    shift = np.array([1.0, 2.0, 0.5])
    even = np.ones(30)
    rigid = interpolate_corrections(local, at, compose(shift, local[at]), even)
    assert np.allclose(rigid, compose(shift, local), atol=1e-12)
    bend = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.01]])
    bent = compose(shift, local[at]) + bend
    moved = interpolate_corrections(local, at, bent, even)
    assert np.allclose(moved[at], bent, atol=1e-12)
    assert np.allclose(between(moved[20], moved[29]), between(local[20], local[29]), atol=1e-12)


def test_spread_undoes_a_drift_that_grows_with_the_variance() -> None:
    """Brute force: the truth comes back at every scan, however uneven the doubt is."""
    rng = np.random.default_rng(1)
    variances = rng.uniform(0.0, 1.0, 40)
    truth = np.column_stack([np.cumsum(rng.normal(0.0, 0.1, (40, 2)), axis=0), np.zeros(40)])
    local = truth + np.cumsum(variances)[:, None] * np.array([0.02, -0.03, 0.0])
    at = np.array([0, 9, 11, 39])
    assert np.allclose(interpolate_corrections(local, at, truth[at], variances), truth, atol=1e-12)
    evenly = truth + np.arange(40)[:, None] * [0.02, -0.03, 0.0]
    assert not np.allclose(
        interpolate_corrections(evenly, at, truth[at], variances), truth, atol=0.01
    )


@pytest.mark.parametrize("at", [[3], [0, 4], [2, 9], [1, 2, 7, 11]])
def test_every_scan_lies_between_known_ones_by_variance(at: list[int]) -> None:
    """By a search for each; what follows the last goes on from the last two, if there are two."""
    variances = np.random.default_rng(0).uniform(10.0, 100.0, 12)
    before, after, share = bracketing_anchors(np.array(at), variances)
    for scan in range(12):
        one = max([k for k, known in enumerate(at[:-1]) if known <= scan], default=0)
        other = min(one + 1, len(at) - 1)
        assert (before[scan], after[scan]) == (one, other)
        done = variances[at[one] + 1 : scan + 1].sum()
        if other > one:
            whole = variances[at[one] + 1 : at[other] + 1].sum()
            assert share[scan] == pytest.approx(done / whole)
        else:
            assert share[scan] == 0.0 if scan <= at[0] else share[scan] > 1.0


def test_a_silence_takes_what_it_was_off_by() -> None:
    """Four scans that were matched before it, and three after, stay where their nodes have them."""
    local = np.array([[0.1 * k, 0.0, 0.0] for k in range(8)])
    variances = np.full(8, 1e-4)
    variances[4], local[4:, 1] = 9.0, 7.0
    found = interpolate_corrections(
        local, np.array([0, 7]), np.array([[0.0, 0.0, 0.0], [0.7, 0.0, 0.0]]), variances
    )
    assert np.abs(found[:, 1]).max() < 1e-3


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "odom", "translation_m", "rotation_deg"),
    [
        ("intel", None, 0.0220, 0.34),
        ("fr079", None, 0.0430, 0.53),
        ("mit-csail", None, 0.0300, 0.36),
        ("fr079", "none", 0.0860, 1.06),
        ("mit-csail", "none", 0.0600, 0.72),
    ],
)
def test_benchmark_relations(
    shared_data: Path, name: str, odom: str | None, translation_m: float, rotation_deg: float
) -> None:
    folder = shared_data / "benchmark"
    readings = list(open_source(folder / f"{name}.bag", SourceConfig(odom=odom)))
    result = run(readings).result()
    mount = readings[0].scan.robot_from_laser
    errors = relation_errors(read_relations(folder / f"{name}.relations"), result.trajectory, mount)
    assert len(errors.translation_m) == errors.total
    assert errors.translation_m.mean() <= translation_m
    assert np.degrees(errors.rotation_rad).mean() <= rotation_deg
