# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""NEES and chi2 per degree of freedom are 1 where noise is what its covariance says."""

import numpy as np
from benchmark_scripts import script

from slarm_graph.backends.path_covariance import path_covariances
from slarm_graph.backends.pose_graph_optimizer import optimize
from slarm_graph.backends.variance_components import redundancies
from slarm_graph.constraint import Constraint, ConstraintKind, PoseGraph
from slarm_graph.geometry import Pose2, between, compose
from slarm_graph.trajectory import Trajectory

bench = script("bench_covariance")

NODES = 12
Q = np.array([[4e-4, 5e-5, 1e-5], [5e-5, 9e-4, 2e-5], [1e-5, 2e-5, 1e-4]])
STAMPS = np.arange(NODES) * 10**8


def true_poses() -> np.ndarray:
    """Poses (NODES, 3) along a bend, begun with the robot turned."""
    poses = [np.array([1.0, 2.0, 2.1])]
    for _ in range(NODES - 1):
        poses.append(compose(poses[-1], np.array([0.3, 0.05, 0.2])))
    return np.array(poses)


def measured_graph(truth: np.ndarray, rng: np.random.Generator, noise: float = 1.0) -> PoseGraph:
    """A chain measured twice, two closures, with so many times the noise of Q, at its optimum."""
    root = noise * np.linalg.cholesky(Q)
    pairs = [(k, k + 1, kind) for k in range(NODES - 1) for kind in ("scan_match", "odometry")]
    pairs += [(0, NODES - 2, "loop_closure"), (1, NODES - 3, "loop_closure")]
    constraints = []
    for i, j, kind in pairs:
        true = Pose2.from_array(between(truth[i], truth[j]))
        told = true @ Pose2.exp(root @ rng.standard_normal(3))
        constraints.append(Constraint(i, j, told, Q, ConstraintKind(kind)))
    graph = PoseGraph(truth, tuple(constraints))
    return PoseGraph(optimize(graph).poses, graph.constraints)


def test_both_are_one_over_many_draws() -> None:
    rng, truth = np.random.default_rng(1), true_poses()
    means, ratios = [], []
    for _ in range(300):
        graph = measured_graph(truth, rng)
        known = path_covariances(graph, np.arange(NODES), graph.poses, np.ones(NODES))
        seen, true = Trajectory(STAMPS, graph.poses), Trajectory(STAMPS, truth)
        means.append(bench.nees(seen, known, true).mean())
        kinds = bench.chi2_by_kind(graph)
        ratios.append([chi2 / dof for _, chi2, dof in kinds.values()])
    # Three standard errors of 300 draws: 0.09 of NEES; 0.04 of all, steps and wheels, 0.12 of two
    # closures.
    assert abs(np.mean(means) - 1.0) < 0.09
    assert (np.abs(np.mean(ratios, axis=0) - 1.0) < [0.04, 0.05, 0.05, 0.12]).all()


def whitened(graph: PoseGraph, tangents: np.ndarray) -> np.ndarray:
    """Residuals (3 M,) with every pose but the first moved by a tangent (N - 1, 3)."""
    moved = [Pose2.from_array(graph.poses[0])]
    for pose, tangent in zip(graph.poses[1:], tangents, strict=True):
        moved.append(Pose2.from_array(pose) @ Pose2.exp(tangent))
    root = np.linalg.inv(np.linalg.cholesky(Q))
    off = [c.i_from_j.between(moved[c.i].between(moved[c.j])).log() for c in graph.constraints]
    return np.concatenate([root @ each for each in off])


def test_redundancy_is_what_a_dense_projection_leaves() -> None:
    graph = measured_graph(true_poses(), np.random.default_rng(0), noise=0.0)
    steps = 1e-6 * np.eye(3 * (NODES - 1)).reshape(-1, NODES - 1, 3)
    ends = [whitened(graph, step) - whitened(graph, -step) for step in steps]
    jacobian = np.stack(ends, axis=1) / 2e-6
    followed = np.diag(jacobian @ np.linalg.pinv(jacobian)).reshape(-1, 3).sum(axis=1)
    found = redundancies(graph)
    assert found is not None
    np.testing.assert_allclose(found, 3.0 - followed, atol=1e-6)
    np.testing.assert_allclose(found.sum(), 3 * len(found) - 3 * (NODES - 1), rtol=1e-9)
