# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Covariances of steps of graph and filter: with sweeps, and after scans that fit nowhere."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest

from slarm_graph.backend import silent
from slarm_graph.backends import submap_graph
from slarm_graph.backends.gmapping import GmappingBackend
from slarm_graph.backends.graph_building import GraphBuilder
from slarm_graph.backends.graph_checks import check_graph
from slarm_graph.backends.graph_constraints import matched_step, wheels_step
from slarm_graph.backends.proposal import Measurement
from slarm_graph.backends.robust_optimization import optimize_robustly
from slarm_graph.backends.submap_graph import SubmapGraph
from slarm_graph.config import (
    FrontendConfig,
    GmappingConfig,
    LidarConfig,
    PoseGraphConfig,
    SimulationConfig,
)
from slarm_graph.constraint import Constraint, ConstraintKind, PoseGraph
from slarm_graph.files.worlds import load_world
from slarm_graph.frontends.scans.closures import GATE_SIGMAS, Closure
from slarm_graph.frontends.scans.submaps import Keyframe
from slarm_graph.frontends.scans.tracker import ScanTracker
from slarm_graph.frontends.scans.wheel_motion import WheelMotion
from slarm_graph.frontends.simulation.world_recording import SourceFromWorld, waypoints
from slarm_graph.geometry import Floats, Pose2
from slarm_graph.readings import Reading


def drive(lidar: LidarConfig) -> list[Reading]:
    room, config = load_world("paper_room"), SimulationConfig(lidar=lidar)
    return list(SourceFromWorld(room, config, seed=0, script=waypoints(ROUTE)))


ROUTE = np.array([[-3.0, -2.8], [4.4, -2.0], [4.4, 2.0]])
LAG = np.diag([0.04, 0.02, 0.1]) ** 2


def keyframe(k: int, lag: Floats) -> Keyframe:
    wheels = WheelMotion(np.array([0.5, 0.0, 0.0]), 1e-6 * np.eye(3), 1e-6 * np.eye(3))
    covariance = np.diag([1e-5, 1e-5, 1e-6])
    return Keyframe(k, np.zeros((0, 2)), Pose2(0.5 * k), covariance, np.zeros(2), wheels, lag)


def test_matches_of_sweeps_keep_their_covariance() -> None:
    swept, still = ([keyframe(k, lag) for k in range(5)] for lag in (LAG, np.zeros((3, 3))))
    np.testing.assert_array_equal(
        matched_step(1, swept).covariance, matched_step(1, still).covariance
    )


def test_odometry_is_read_at_the_stamps_at_both_ends() -> None:
    swept, still = ([keyframe(k, lag) for k in range(5)] for lag in (LAG, np.zeros((3, 3))))
    lagging, exact = wheels_step(1, swept), wheels_step(1, still)
    assert lagging is not None and exact is not None
    more = lagging.covariance - exact.covariance
    # Two metres on, what the heading is off at the first end has become a step to the side.
    np.testing.assert_allclose(
        np.diag(more), [2 * 0.04**2, 2 * 0.02**2 + (2 * 0.1) ** 2, 2 * 0.1**2]
    )


def test_reading_errors_of_odometry_count_at_both_ends_and_not_between() -> None:
    reading = np.array([0.05, 0.0, 0.02]) ** 2
    plain = [keyframe(k, np.zeros((3, 3))) for k in range(5)]
    wheels = replace(keyframe(0, LAG).wheels, reading_variances=reading)
    rough = [replace(k, wheels=wheels) for k in plain]
    exact, read = wheels_step(1, plain), wheels_step(1, rough)
    assert exact is not None and read is not None
    more = read.covariance - exact.covariance
    np.testing.assert_allclose(np.diag(more), [2 * 0.05**2, (2 * 0.02) ** 2, 2 * 0.02**2])


def test_no_step_is_less_certain_than_an_uninformed_one() -> None:
    """Minutes of silence, in which a robot at 1 m/s may have gone anywhere and turned at will."""
    lost = np.diag([1e12, 1e12, 1e8])
    silent = [keyframe(k, np.zeros((3, 3))) for k in range(5)]
    wheels = WheelMotion(np.array([0.5, 0.0, 0.0]), lost, lost)
    silent = [replace(k, wheels=wheels, covariance=lost) for k in silent]
    by_wheels = wheels_step(1, silent)
    assert by_wheels is not None
    steps_of_graph = [matched_step(1, silent), by_wheels]
    for step in steps_of_graph:
        sd_m, _, sd_rad = np.sqrt(np.diag(step.covariance))
        assert 100.0 < sd_m <= 301.0
        assert sd_rad == pytest.approx(np.pi / np.sqrt(3.0))
    check_graph(PoseGraph(np.zeros((2, 3)), tuple(steps_of_graph)))


def test_where_nothing_was_matched_odometry_counts_once() -> None:
    """A restarted local map is placed by odometry: no second measurement."""
    keyframes = [
        replace(keyframe(k, np.zeros((3, 3))), covariance=1e-2 * np.eye(3)) for k in (0, 1)
    ]
    keyframes[1] = replace(keyframes[1], is_matched=False)
    graph = SubmapGraph(PoseGraphConfig(node_m=0.3))
    for k in keyframes:
        graph.add(k)
    wheels = wheels_step(1, keyframes)
    assert wheels is not None
    sigma_m, sigma_rad = graph.sigmas_between(0, 1)
    assert sigma_m**2 == pytest.approx(np.trace(wheels.covariance[:2, :2]), rel=1e-4)
    assert sigma_rad**2 == pytest.approx(wheels.covariance[2, 2], rel=1e-4)
    alone = [replace(k, wheels=None) for k in keyframes]
    assert matched_step(1, alone).covariance[0, 0] == pytest.approx(3e-2, rel=1e-2)


def test_measurements_a_building_apart_leave_a_solvable_graph() -> None:
    sure = np.diag([1e-4, 1e-4, 1e-4])
    steps = [
        Constraint(0, 1, Pose2(x), sure, kind)
        for x, kind in ((5000.0, ConstraintKind.ODOMETRY), (0.0, ConstraintKind.SCAN_MATCH))
    ]
    solution = optimize_robustly(
        PoseGraph(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]), tuple(steps))
    )
    check_graph(solution.graph)


def test_a_node_begins_where_matches_and_odometry_together_have_it() -> None:
    """Matches fell short by 0.1 m a step, and know it: old places are looked for farther on."""
    graph = SubmapGraph(PoseGraphConfig())
    for k in range(8):
        vague = replace(keyframe(k, np.zeros((3, 3))), local_from_robot=Pose2(0.4 * k))
        graph.add(replace(vague, covariance=np.diag([1e-2, 1e-5, 1e-6])))
    poses = graph.poses()
    assert len(poses) == 2
    steps = graph.node_scans()[1]
    assert poses[1, 0] == pytest.approx(0.5 * steps, abs=0.01)
    assert graph.sigmas_between(0, 1)[0] < 0.03


@pytest.mark.parametrize(
    ("config", "length"),
    [
        (PoseGraphConfig(node_keyframes=4, node_m=100.0), 4),
        (PoseGraphConfig(node_keyframes=100, node_m=1.5), 3),
        (PoseGraphConfig(node_keyframes=100, node_m=1.4), 3),
    ],
)
def test_a_node_is_full_by_keyframes_or_way_and_its_submap_reaches_half_of_it_beyond(
    config: PoseGraphConfig, length: int
) -> None:
    """Keyframes are half a metre apart; a submap is there as soon as all it holds is."""
    graph = SubmapGraph(config)
    for k in range(21):
        graph.add(keyframe(k, np.zeros((3, 3))))
        starts, margin = list(range(0, k + 1, length)), length // 2
        assert graph.node_scans().tolist() == starts
        np.testing.assert_allclose(graph.path_lengths_m(), 0.5 * np.array(starts))
        assert [(s.first, s.last, s.anchor) for s in graph.submaps] == [
            (max(0, start - margin), start + length + margin, start)
            for start in starts
            if start + length + margin <= k + 1
        ]


def there_and_back() -> SubmapGraph:
    """Nodes of two keyframes, a decimetre apart, forty ahead and forty back."""
    graph = SubmapGraph(PoseGraphConfig(node_keyframes=2, recent_keyframes=10))
    for k in range(81):
        x = 0.1 * min(k, 80 - k)
        wheels = replace(keyframe(0, LAG).wheels, motion=np.array([0.1 if k <= 40 else -0.1, 0, 0]))
        still = replace(keyframe(k, np.zeros((3, 3))), local_from_robot=Pose2(x), wheels=wheels)
        graph.add(replace(still, view_center_m=np.array([0.2 * (k % 4), -0.2])))
    return graph


def test_old_submaps_are_looked_for_where_the_newest_keyframe_may_see_them() -> None:
    """By distance of what is seen, up to three metres and what the graph is uncertain of."""
    graph = there_and_back()
    found, newest = graph.expectations(), len(graph.poses()) - 1
    seen_m = np.array([0.1 * min(k, 80 - k) + 0.2 * (k % 4) for k in range(81)])
    old = [n for n, s in enumerate(graph.submaps) if s.last <= 81 - 10]
    expected = {}
    for n in old:
        sigma_m, sigma_rad = graph.sigmas_between(n, newest)
        run = graph.submaps[n]
        if abs(seen_m[run.first : run.last].mean() - seen_m[80]) < 3.0 + GATE_SIGMAS * sigma_m:
            expected[n] = (sigma_m, sigma_rad)
    assert sorted(found.submap.tolist()) == sorted(expected)
    assert 5 < len(expected) < len(old)
    sigmas = np.column_stack([found.sigma_m, found.sigma_rad]).tolist()
    assert dict(zip(found.submap.tolist(), map(tuple, sigmas), strict=True)) == expected


def test_a_closure_counts_at_once_for_what_the_graph_is_sure_of() -> None:
    graph = there_and_back()
    before_m, _ = graph.sigmas_between(3, 38)
    closure = Closure(3, 76, np.array([-0.2, 0.0, 0.0]), 1e8 * np.eye(3), 0.9, False)
    graph.add_closures([closure])
    sigmas = graph.sigmas_between(3, 38)
    assert sigmas[0] < 0.9 * before_m
    assert graph.with_closures(graph.closures).sigmas_between(3, 38) == pytest.approx(sigmas)


@pytest.mark.parametrize(
    ("off", "optimised"),
    [
        ((0.0, 0.0, 0.0), []),
        ((0.008, -0.008, 0.0024), []),
        ((0.009, -0.009, 0.0), list(range(1, 31))),
        ((0.0, 0.0, -0.0026), list(range(1, 31))),
    ],
)
def test_closures_are_awaited_unless_one_is_far_off(
    monkeypatch: pytest.MonkeyPatch, off: tuple[float, float, float], optimised: list[int]
) -> None:
    """By more than a quarter of a cell, or 0.0025 rad; not by one that is rejected."""
    graph, when = there_and_back(), list[int]()
    assert len(graph.poses()) == 41

    def leave(problem: PoseGraph, **_: object) -> PoseGraph:
        when.append(len(graph.closures) // 2)
        return problem

    monkeypatch.setattr(submap_graph.optimizer, "optimize", leave)
    pose = np.array([-0.2, 0.0, 0.0]) + off
    for _ in range(30):
        rejected = Closure(3, 76, pose + 3.0, np.eye(3), 0.9, False, "somewhere else")
        graph.add_closures([Closure(3, 76, pose, np.eye(3), 0.9, False), rejected])
    assert when == optimised
    assert len(graph.closures) == 60
    assert len(graph.pose_graph().constraints) == 2 * 40 + 30


def test_a_large_graph_is_optimised_whole_whenever_it_has_grown_by_a_quarter(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Else its newest hundred nodes, and one that stands for all before."""
    graph, sizes = SubmapGraph(PoseGraphConfig(node_keyframes=2)), dict[int, int]()

    def leave(problem: PoseGraph, **_: object) -> PoseGraph:
        sizes[len(graph.poses())] = len(problem.poses)
        return problem

    monkeypatch.setattr(submap_graph.optimizer, "optimize", leave)
    for k in range(2 * 320):
        graph.add(keyframe(k, np.zeros((3, 3))))
        if k % 2 == 0 and k // 2 + 1 in (50, 160, 200, 201, 251, 252, 315, 316):
            poses = graph.poses()
            graph._optimize(silent)
            np.testing.assert_allclose(graph.poses(), poses, atol=1e-9)
    whole = {50: 50, 160: 160, 201: 201, 252: 252, 316: 316}
    assert sizes == whole | {200: 101, 251: 101, 315: 101}


def step_sigmas(readings: Iterable[Reading]) -> Floats:
    """Median standard deviations (3,) of the matched steps of the graph."""
    tracker, builder = (
        ScanTracker(FrontendConfig()),
        GraphBuilder(PoseGraphConfig(), FrontendConfig()),
    )
    for reading in readings:
        builder.add_scan(tracker.track(reading))
    edges = builder.close_loops().graph.constraints
    steps = [e.covariance for e in edges if e.kind is ConstraintKind.SCAN_MATCH]
    return np.sqrt(np.median([np.diag(s) for s in steps], axis=0))


@pytest.fixture(scope="module")
def lap() -> list[Reading]:
    return drive(LidarConfig())


def test_steps_of_a_sweeping_laser_are_as_sure_as_of_one_that_does_not(lap: list[Reading]) -> None:
    swept = drive(LidarConfig(sweep_s=0.1))
    assert np.all(step_sigmas(swept) < 2.0 * step_sigmas(lap))


def broken_off(readings: list[Reading]) -> list[Reading]:
    """Every tenth scan breaks off seven times after its first return, as with a loose cable."""
    out: list[Reading] = []
    for i, reading in enumerate(readings):
        out.append(reading)
        few = np.full_like(reading.scan.ranges_m, np.inf)
        few[0] = reading.scan.ranges_m[0]
        for k in range(7 if i % 10 == 0 else 0):
            stamp_ns = reading.stamp_ns + (k + 1) * 10**7
            out.append(
                replace(reading, stamp_ns=stamp_ns, scan=replace(reading.scan, ranges_m=few))
            )
    return out


def test_a_match_ends_the_uncertainty_before_it(lap: list[Reading]) -> None:
    assert np.all(step_sigmas(broken_off(lap)) < 2.0 * step_sigmas(lap))


def test_the_filter_is_not_lost_where_the_frontend_has_matched_again(lap: list[Reading]) -> None:
    measurements = filtered(broken_off(lap))
    assert len(measurements) > 5
    assert not any(m.is_lost for m in measurements)


def test_the_filter_is_lost_after_a_step_without_a_match(lap: list[Reading]) -> None:
    """For a second the laser shows a place of its own, to which no match leads."""
    rng = np.random.default_rng(0)
    elsewhere = rng.uniform(1.0, 8.0, len(lap[0].scan.ranges_m)).astype(np.float32)
    astray = [
        replace(r, scan=replace(r.scan, ranges_m=elsewhere)) if 40 <= i < 50 else r
        for i, r in enumerate(lap)
    ]
    assert any(m.is_lost for m in filtered(astray))


def filtered(readings: list[Reading]) -> list[Measurement]:
    """Measurements of the particle filter of a drive."""
    settings = GmappingConfig(particles=2)
    backend = GmappingBackend(settings, FrontendConfig(), np.random.default_rng(0))
    for reading in readings:
        backend.update(reading)
    return backend._state.measurements
