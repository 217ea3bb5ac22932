# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Known optima, gauge, robustness and the systems on which naive solvers give up."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import gtsam
import numpy as np
import pytest

from slarm_graph.backends.pose_graph_optimizer import (
    Kernel,
    chi2,
    marginal_covariances,
    optimize,
    optimize_from_anywhere,
    optimize_gnc,
)
from slarm_graph.constraint import Constraint, ConstraintKind, PoseGraph
from slarm_graph.files.g2o import read_g2o
from slarm_graph.geometry import Floats, Pose2, between, compose, wrap_angles

TIGHT = np.diag([0.02**2, 0.02**2, 0.01**2])


def corridor(count: int, *, noise: float = 1.0, seed: int = 0) -> PoseGraph:
    """Drive straight ahead in steps of 1 m, odometry only."""
    rng = np.random.default_rng(seed)
    sigma = np.array([0.02, 0.02, 0.002])
    constraints, poses = [], [np.zeros(3)]
    for k in range(count - 1):
        step = np.array([1.0, 0.0, 0.0]) + noise * sigma * rng.normal(size=3)
        poses.append(compose(poses[-1], step))
        constraints.append(
            Constraint(k, k + 1, Pose2(*step), np.diag(sigma**2), ConstraintKind.ODOMETRY)
        )
    return PoseGraph(np.array(poses), tuple(constraints))


def laps(
    count: int, closures: int, *, false_share: float, seed: int
) -> tuple[PoseGraph, Floats, int]:
    """Drive round a building's ring corridor; return graph, truth and number of true closures."""
    rng = np.random.default_rng(seed)
    side, truth = 20.0, [np.zeros(3)]
    for k in range(1, count):
        turn = np.pi / 2 if k % int(side) == 0 else 0.0
        truth.append(compose(truth[-1], np.array([1.0, 0.0, turn])))
    true = np.array(truth)
    pairs = [(k, k + 1) for k in range(count - 1)]
    lap = int(4 * side)
    starts = rng.choice(count - lap, size=closures, replace=False)
    pairs += [(int(i), int(i) + lap) for i in starts]
    constraints = []
    for i, j in pairs:
        measured = compose(between(true[i], true[j]), 0.02 * rng.normal(size=3) * [1, 1, 0.3])
        kind = ConstraintKind.ODOMETRY if j == i + 1 else ConstraintKind.LOOP_CLOSURE
        constraints.append(Constraint(i, j, Pose2(*measured), TIGHT, kind))
    for _ in range(int(false_share * closures)):
        i, j = sorted(int(v) for v in rng.choice(count, size=2, replace=False))
        wrong = Pose2(*(rng.normal(size=3) * [1.0, 1.0, 0.3]))
        constraints.append(Constraint(i, j, wrong, TIGHT, ConstraintKind.LOOP_CLOSURE))
    poses = [np.zeros(3)]
    for c in constraints[: count - 1]:
        poses.append(compose(poses[-1], c.i_from_j.as_array()))
    return PoseGraph(np.array(poses), tuple(constraints)), true, closures


def rmse_m(poses: Floats, truth: Floats) -> float:
    """Position error without alignment: pose 0 is held at the truth."""
    return float(np.sqrt(np.mean(np.sum((poses[:, :2] - truth[:, :2]) ** 2, axis=1))))


@pytest.mark.parametrize(
    ("name", "optimum"),
    [
        ("intel.g2o", 45.0042),
        ("CSAIL.g2o", 40.5509),
        ("MIT.g2o", 41.2069),
        ("manhattan.g2o", 3549.0411),
        ("manhattan_truth/manhattanOlson3500.g2o", 146.0787),
    ],
)
def test_known_optima(shared_data: Path, name: str, optimum: float) -> None:
    graph = read_g2o(shared_data / "pose_graphs" / name).graph
    found = optimize_from_anywhere(graph)
    assert found.chi2 == pytest.approx(optimum, rel=1e-4)
    assert chi2(replace(graph, poses=found.poses)) == pytest.approx(found.chi2, rel=1e-9)


def test_m3500_error(shared_data: Path) -> None:
    folder = shared_data / "pose_graphs" / "manhattan_truth"
    truth = np.loadtxt(folder / "manhattanOlson3500_nodes_groundTruth.dat")[:, :2]
    found = optimize(read_g2o(folder / "manhattanOlson3500.g2o").graph).poses[:, :2]
    a, b = found - found.mean(axis=0), truth - truth.mean(axis=0)
    u, _, vt = np.linalg.svd(a.T @ b)
    aligned = a @ (u @ vt)
    assert np.sqrt(np.mean(np.sum((aligned - b) ** 2, axis=1))) <= 0.80


def test_first_pose_stays() -> None:
    graph, _, _ = laps(200, 30, false_share=0.0, seed=1)
    start = np.array([3.0, -2.0, 1.0])
    moved = replace(graph, poses=compose(start, graph.poses))
    found = optimize(moved)
    assert np.allclose(found.poses[0], start, atol=1e-9)
    relative = between(start, found.poses)
    expected = optimize(graph).poses
    assert np.allclose(relative[:, :2], expected[:, :2], atol=1e-5)
    assert np.allclose(wrap_angles(relative[:, 2] - expected[:, 2]), 0.0, atol=1e-6)


def test_noiseless_graph_returns_truth() -> None:
    graph, truth, _ = laps(200, 30, false_share=0.0, seed=1)
    exact = tuple(
        replace(c, i_from_j=Pose2(*between(truth[c.i], truth[c.j]))) for c in graph.constraints
    )
    found = optimize_from_anywhere(replace(graph, constraints=exact))
    assert np.allclose(found.poses[:, :2], truth[:, :2], atol=1e-6)
    assert found.chi2 < 1e-9


@pytest.mark.parametrize("seed", range(3))
def test_false_closures_are_rejected(seed: int) -> None:
    clean, truth, true_count = laps(400, 60, false_share=0.0, seed=seed)
    spoilt, _, _ = laps(400, 60, false_share=0.3 / 0.7, seed=seed)
    reference = rmse_m(optimize_gnc(clean).poses, truth)
    found = optimize_gnc(spoilt)
    assert rmse_m(found.poses, truth) <= 1.2 * reference
    closure_weights = found.weights[len(truth) - 1 :]
    assert closure_weights[:true_count].mean() > 0.95
    assert closure_weights[true_count:].max() < 0.01


def test_cauchy_softens_false_closures() -> None:
    spoilt, truth, _ = laps(300, 60, false_share=0.1, seed=4)
    plain, robust = optimize(spoilt), optimize(spoilt, kernel=Kernel.CAUCHY)
    assert rmse_m(robust.poses, truth) < 0.5 * rmse_m(plain.poses, truth)


@pytest.mark.parametrize("slip_sigmas", [math.inf, 2.5])
@pytest.mark.parametrize("kernel", list(Kernel))
def test_weights_are_those_of_the_kernels_at_what_is_left(
    kernel: Kernel, slip_sigmas: float
) -> None:
    """From the definitions: Cauchy 1 / (1 + r^2 / k^2), Huber min(1, k / r), of whitened errors."""
    spoilt, _, _ = laps(200, 30, false_share=0.2, seed=4)
    found = optimize(spoilt, kernel=kernel, slip_sigmas=slip_sigmas)
    for weight, c in zip(found.weights, spoilt.constraints, strict=True):
        there = between(found.poses[c.i], found.poses[c.j])
        error = between(c.i_from_j.as_array(), there)
        turned = gtsam.Pose2.Logmap(gtsam.Pose2(*error))
        r = math.sqrt(turned @ np.linalg.inv(c.covariance) @ turned)
        if c.kind is not ConstraintKind.LOOP_CLOSURE:
            k = slip_sigmas
            expected = 1.0 if math.isinf(k) else 1.0 / (1.0 + r * r / k**2)
        elif kernel is Kernel.CAUCHY:
            expected = 1.0 / (1.0 + r * r)
        else:
            expected = 1.0 if kernel is Kernel.NONE else min(1.0, 1.345 / max(r, 1e-9))
        assert weight == pytest.approx(expected, rel=2e-2, abs=1e-6)


@pytest.mark.parametrize("count", [1000, pytest.param(10000, marks=pytest.mark.slow)])
def test_straight_corridor(count: int) -> None:
    graph = corridor(count)
    shaken = replace(graph, poses=graph.poses + 1e-3)
    found = optimize(shaken)
    assert np.isfinite(found.poses).all()
    assert found.chi2 < 1e-4


def test_corridor_covariance_grows() -> None:
    graph = corridor(1000)
    near, far = marginal_covariances(graph, [10, 999])
    assert 0.0 < near[1, 1] < far[1, 1]
    # Heading is a random walk: 999 steps of (0.002 rad)^2.
    assert far[2, 2] == pytest.approx(999 * 0.002**2, rel=1e-3)


@pytest.mark.slow
def test_hundred_thousand_factors() -> None:
    graph, truth, _ = laps(60_000, 45_000, false_share=0.0, seed=0)
    exact = replace(graph, poses=truth)
    found = optimize(exact)
    assert len(graph.constraints) > 100_000
    assert rmse_m(found.poses, truth) < 1.0


@pytest.mark.parametrize(
    ("covariance", "said"),
    [
        (np.full((3, 3), np.nan), "finite"),
        (np.array([[1.0, 0.5, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]), "symmetric"),
        (np.diag([1.0, -1.0, 1.0]), "eigenvalues"),
        (np.diag([1.0, 1.0, 1e-14]), "eigenvalues"),
        (np.diag([1e7, 1.0, 1.0]), "eigenvalues"),
    ],
)
def test_bad_covariances_are_refused(covariance: Floats, said: str) -> None:
    graph = corridor(4)
    bad = replace(graph.constraints[1], covariance=covariance)
    with pytest.raises(ValueError, match=rf"constraint 1 \(1 to 2\).*{said}"):
        optimize(replace(graph, constraints=(graph.constraints[0], bad, graph.constraints[2])))


def test_poses_that_are_not_finite_are_refused() -> None:
    graph = corridor(4)
    with pytest.raises(ValueError, match="not finite"):
        optimize(replace(graph, poses=np.full((4, 3), np.nan)))


def test_heartbeat_beats_and_an_interrupt_gets_through() -> None:
    graph, _, _ = laps(400, 60, false_share=0.0, seed=0)
    beats: list[str] = []
    optimize(graph, heartbeat=beats.append)
    assert beats

    def interrupt(_message: str) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        optimize(graph, heartbeat=interrupt)
    with pytest.raises(KeyboardInterrupt):
        optimize_gnc(graph, heartbeat=interrupt)
