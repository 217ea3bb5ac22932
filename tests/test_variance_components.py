# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Covariances of constraints that are learned, against those that their errors were drawn from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from slarm_graph.backends import variance_components
from slarm_graph.backends.graph_building import GraphBuilder
from slarm_graph.backends.graph_constraints import closure_constraint
from slarm_graph.backends.pose_graph_optimizer import optimize
from slarm_graph.backends.variance_components import calibrated, reoptimized
from slarm_graph.config import FrontendConfig, PoseGraphConfig, SimulationConfig
from slarm_graph.constraint import Constraint, ConstraintKind, PoseGraph
from slarm_graph.files.worlds import load_world
from slarm_graph.frontends.scans.closures import Closure
from slarm_graph.frontends.scans.submaps import Keyframe
from slarm_graph.frontends.scans.tracker import ScanTracker
from slarm_graph.frontends.simulation.world_recording import SourceFromWorld, waypoints
from slarm_graph.geometry import Floats, Pose2, between

SCAN_MATCH, ODOMETRY, CLOSURE = (
    ConstraintKind.SCAN_MATCH,
    ConstraintKind.ODOMETRY,
    ConstraintKind.LOOP_CLOSURE,
)
TRUE = {
    SCAN_MATCH: np.diag([0.01, 0.01, 0.004]) ** 2,
    ODOMETRY: np.diag([0.02, 0.01, 0.01]) ** 2,
    CLOSURE: np.diag([0.02, 0.02, 0.006]) ** 2,
}
LAP = 40


def laps(claimed: dict[ConstraintKind, float], count: int = 3 * LAP) -> PoseGraph:
    """Rounds of a circle, each tied to the first; covariances are claimed that many times true."""
    rng = np.random.default_rng(3)
    angles = 2.0 * np.pi * np.arange(count) / LAP
    truth = np.stack([6.0 * np.sin(angles), -6.0 * np.cos(angles), angles], axis=1)
    ties = [(k, k + 1, kind) for k in range(count - 1) for kind in (SCAN_MATCH, ODOMETRY)]
    ties += [(k % LAP, k, CLOSURE) for k in range(LAP, count)]
    drawn = []
    for i, j, kind in ties:
        error = rng.multivariate_normal(np.zeros(3), TRUE[kind])
        told = Pose2.from_array(between(truth[i], truth[j])) @ Pose2.exp(error)
        drawn.append(Constraint(i, j, told, claimed[kind] * TRUE[kind], kind))
    graph = PoseGraph(truth, tuple(drawn))
    return replace(graph, poses=optimize(graph).poses)


def factors(graph: PoseGraph, kind: ConstraintKind) -> Floats:
    """By how much (M,) the covariances of a kind are larger than the true ones."""
    return np.array(
        [c.covariance[0, 0] / TRUE[kind][0, 0] for c in graph.constraints if c.kind is kind]
    )


@pytest.mark.parametrize("claimed", [0.25, 1.0, 9.0])
def test_learned_covariances_are_those_that_errors_were_drawn_from(claimed: float) -> None:
    found = calibrated(laps(dict.fromkeys(TRUE, claimed)))
    for kind in TRUE:
        assert factors(found, kind) == pytest.approx(1.0, rel=0.2)


def test_each_kind_has_a_factor_of_its_own() -> None:
    """Poses follow what was claimed surest, so that its residuals come out somewhat small."""
    found = calibrated(laps({SCAN_MATCH: 1.0, ODOMETRY: 2.0, CLOSURE: 4.0}))
    for kind in TRUE:
        assert factors(found, kind) == pytest.approx(1.0, rel=0.45)


def test_what_neighbours_share_is_left_as_it_is_claimed() -> None:
    graph = laps(dict.fromkeys(TRUE, 9.0))
    found = calibrated(halves(graph, SCAN_MATCH))
    assert (factors(found, SCAN_MATCH) > 4.5).all()
    assert (factors(found, SCAN_MATCH) < 5.0).all()
    assert factors(found, CLOSURE) == pytest.approx(1.0, rel=0.35)


def test_a_chain_tells_nothing_of_its_errors() -> None:
    graph = laps(dict.fromkeys(TRUE, 9.0))
    steps = tuple(c for c in graph.constraints if c.kind is SCAN_MATCH)
    chain = replace(graph, constraints=steps)
    assert factors(calibrated(chain), SCAN_MATCH) == pytest.approx(9.0)


def test_graphs_without_constraints_or_of_a_single_pose_are_handed_back() -> None:
    alone = PoseGraph(np.zeros((1, 3)))
    assert calibrated(alone) is alone


def test_poses_follow_what_closures_turned_out_to_be_worth() -> None:
    """The same draws under their true covariances say where poses belong."""
    graph, right = (
        laps({SCAN_MATCH: 1.0, ODOMETRY: 1.0, CLOSURE: 25.0}),
        laps(dict.fromkeys(TRUE, 1.0)),
    )
    found = reoptimized(graph)
    before, after = (np.abs(g.poses - right.poses)[:, :2].max() for g in (graph, found))
    assert after < 0.3 * before
    assert found.constraints == graph.constraints


def halves(graph: PoseGraph, kind: ConstraintKind) -> PoseGraph:
    """The same where half of the covariances of a kind is what neighbours share."""
    half = [
        replace(c, shared=0.5 * c.covariance) if c.kind is kind else c for c in graph.constraints
    ]
    return replace(graph, constraints=tuple(half))


def test_what_closures_share_is_learned_for_covariances_and_not_for_poses() -> None:
    graph = laps({SCAN_MATCH: 1.0, ODOMETRY: 1.0, CLOSURE: 25.0})
    mixed = halves(graph, CLOSURE)
    found, free = calibrated(mixed), calibrated(graph)
    np.testing.assert_allclose(factors(found, CLOSURE), factors(free, CLOSURE))
    moved, moved_freely = (np.abs(reoptimized(g).poses - graph.poses).max() for g in (mixed, graph))
    assert 0.0 < moved < 0.5 * moved_freely


def test_poses_go_on_with_what_odometry_claims() -> None:
    """It was learned along the way: with nothing else to be learned nothing moves."""
    graph = laps({SCAN_MATCH: 1.0, ODOMETRY: 25.0, CLOSURE: 1.0})
    told = [replace(c, shared=c.covariance) for c in graph.constraints if c.kind is not ODOMETRY]
    fixed = replace(
        graph, constraints=(*told, *(c for c in graph.constraints if c.kind is ODOMETRY))
    )
    np.testing.assert_allclose(reoptimized(fixed).poses, graph.poses, atol=1e-5)


def test_of_a_closure_the_match_is_shared_and_the_rest_a_floor() -> None:
    """Seen from the anchor, half a metre on; two fifths of a cell are no match's."""
    here, there = (
        Keyframe(k, np.zeros((0, 2)), Pose2(0.5 * k), np.eye(3), np.zeros(2)) for k in range(2)
    )
    information = np.diag([1.0 / 0.03**2 - 1.0, 1.0 / 0.01**2 - 1.0, 1.0 / 0.02**2 - 10.0])
    closure = Closure(0, 0, np.array([1.0, 2.0, 0.0]), information, 0.9, False)
    told = closure_constraint(closure, 3, here, there)
    assert told.shared is not None
    arm = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.5], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(told.shared, arm @ np.diag([0.03, 0.01, 0.02]) ** 2 @ arm.T)
    floor = arm @ np.diag([0.02, 0.02, 0.006]) ** 2 @ arm.T
    np.testing.assert_allclose(told.covariance - told.shared, floor, atol=1e-12)


def test_a_closed_path_runs_through_the_nodes_as_adjusted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(variance_components, "_MIN_REDUNDANCY", 1.0)
    tracker = ScanTracker(FrontendConfig())
    builder = GraphBuilder(PoseGraphConfig(), FrontendConfig())
    ways = np.array([[-3.0, -2.8], [4.4, -2.0], [4.4, 2.0], [4.4, -2.0], [-3.0, -2.8]])
    ways = np.concatenate([ways, ways[1:3]])
    room = load_world("paper_room")
    for reading in SourceFromWorld(room, SimulationConfig(), seed=0, script=waypoints(ways)):
        builder.add_scan(tracker.track(reading))
    closed = builder.close_loops()
    assert any(c.kind is CLOSURE for c in closed.graph.constraints)
    np.testing.assert_allclose(closed.poses[closed.scans], closed.graph.poses, atol=1e-9)
    by_claims = optimize(closed.graph).poses
    assert np.abs(reoptimized(closed.graph).poses - closed.graph.poses)[:, :2].max() < 2e-4
    assert np.abs(by_claims - closed.graph.poses)[:, :2].max() > 5e-4
