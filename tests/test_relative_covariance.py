# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Relative covariances between nodes, against Monte Carlo draws and against sums by hand."""

from __future__ import annotations

import numpy as np
import pytest

from slarm_graph.backends.relative_covariance import RelativeCovariances
from slarm_graph.backends.robust_optimization import fused_step
from slarm_graph.constraint import Constraint, ConstraintKind
from slarm_graph.geometry import Floats, Pose2, between, compose


def path(count: int, rng: np.random.Generator) -> tuple[Floats, list[Floats]]:
    """Draw a bent path of nodes (N, 3) and the covariance (3, 3) of every step."""
    poses = [np.array([3.0, -1.0, 0.4])]
    covariances = []
    for _ in range(count - 1):
        step = np.array([rng.uniform(0.5, 2.5), rng.uniform(-0.3, 0.3), rng.uniform(-0.8, 0.8)])
        poses.append(compose(poses[-1], step))
        root = rng.normal(size=(3, 3)) * [[0.02], [0.01], [0.004]]
        covariances.append(root @ root.T + 1e-8 * np.eye(3))
    return np.array(poses), covariances


def relative_of(poses: Floats, covariances: list[Floats]) -> RelativeCovariances:
    relative = RelativeCovariances()
    for i, covariance in enumerate(covariances):
        measured = Pose2.from_array(between(poses[i], poses[i + 1]))
        relative.add(Constraint(i, i + 1, measured, covariance, ConstraintKind.SCAN_MATCH))
    return relative


def test_steps_add_up_to_the_covariance_of_drawn_paths() -> None:
    rng = np.random.default_rng(4)
    poses, covariances = path(14, rng)
    found = relative_of(poses, covariances).covariances(poses, 13)
    draws = 20_000
    ends = np.tile(poses[3], (draws, 1))
    for i in range(3, 13):
        step = between(poses[i], poses[i + 1])
        ends = compose(
            compose(ends, step), rng.multivariate_normal(np.zeros(3), covariances[i], draws)
        )
    scatter = np.cov(between(poses[13], ends).T)
    scale = np.sqrt(np.outer(np.diag(scatter), np.diag(scatter)))
    assert np.abs(found[3] - scatter).max() < 0.04 * scale.max()
    assert np.allclose(np.diag(found[3]) / np.diag(scatter), 1.0, atol=0.06)
    assert not found[13].any()


def test_a_precise_closure_is_the_shorter_path() -> None:
    poses, covariances = path(14, np.random.default_rng(5))
    relative = relative_of(poses, covariances)
    before = relative.covariances(poses, 13)
    tight = np.diag([1e-6, 1e-6, 1e-8])
    measured = Pose2.from_array(between(poses[0], poses[13]))
    relative.add(Constraint(0, 13, measured, tight, ConstraintKind.LOOP_CLOSURE))
    after = relative.covariances(poses, 13)
    assert np.allclose(after[0], tight)
    assert np.trace(after[1]) < np.trace(before[1])
    assert np.allclose(after[12], before[12])


def test_of_parallel_constraints_the_most_precise_counts() -> None:
    poses, covariances = path(3, np.random.default_rng(6))
    measured = Pose2.from_array(between(poses[1], poses[2]))
    for order in ((1.0, 100.0), (100.0, 1.0)):
        relative = relative_of(poses, covariances[:1])
        for scale in order:
            covariance = scale * covariances[1]
            relative.add(Constraint(1, 2, measured, covariance, ConstraintKind.SCAN_MATCH))
        assert np.allclose(relative.covariances(poses, 2)[1], covariances[1])


@pytest.mark.parametrize("apart_m", [0.02, 0.9])
def test_two_measurements_of_a_step_are_fused_or_inflated(apart_m: float) -> None:
    """Fused where they agree, the gradient is zero; else the other lies within two sigmas."""
    one = Constraint(
        0, 1, Pose2(1.0, 0.0, 0.1), np.diag([0.04, 0.02, 0.01]) ** 2, ConstraintKind.SCAN_MATCH
    )
    there = one.i_from_j @ Pose2(apart_m, 0.0, 0.0)
    other = Constraint(0, 1, there, np.diag([0.08, 0.03, 0.02]) ** 2, ConstraintKind.ODOMETRY)
    fused = fused_step(one, other)
    covariance = fused.covariance
    if apart_m < 0.1:
        information = np.linalg.inv(one.covariance) + np.linalg.inv(other.covariance)
        assert np.allclose(covariance, np.linalg.inv(information))
        pulls = [
            np.linalg.solve(c.covariance, fused.i_from_j.between(c.i_from_j).as_array())
            for c in (one, other)
        ]
        assert np.allclose(sum(pulls), 0.0, atol=1e-9)
        return
    assert fused.i_from_j == one.i_from_j
    miss = one.i_from_j.between(other.i_from_j).as_array()
    assert miss @ np.linalg.solve(covariance, miss) < 4.0


def test_a_constraint_of_uncertain_heading_is_no_short_path() -> None:
    poses, _ = path(2, np.random.default_rng(7))
    measured = Pose2.from_array(between(poses[0], poses[1]))
    relative = RelativeCovariances()
    for variances in ([1e-4, 1e-4, 1e-2], [2e-4, 2e-4, 1e-6]):
        covariance = np.diag(variances)
        relative.add(Constraint(0, 1, measured, covariance, ConstraintKind.SCAN_MATCH))
    assert np.allclose(np.diag(relative.covariances(poses, 1)[0]), [2e-4, 2e-4, 1e-6])


@pytest.mark.parametrize("turn_rad", [-2.9, -0.8, 1.5, 3.1])
def test_an_unknown_heading_leaves_a_circle(turn_rad: float) -> None:
    """Fifty metres on from a step of unknown heading, and a metre on from it where it is known."""
    poses = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [51.0, 3.0, 0.2]])
    step = np.diag([0.1, 0.1, 2.0]) ** 2
    covariances = [step, np.diag([0.2, 0.2, 0.01]) ** 2]
    found = relative_of(poses, covariances).covariances(poses, 2)[0]
    turned = compose(compose(poses[1], np.array([0.0, 0.0, turn_rad])), between(poses[1], poses[2]))
    miss = between(poses[2], turned)
    miss[2] = (miss[2] + np.pi) % (2.0 * np.pi) - np.pi
    assert miss @ np.linalg.solve(found, miss) < 16.27
    assert np.linalg.eigvalsh(found[:2, :2])[-1] < 60.0**2


def test_a_heading_is_no_more_uncertain_than_uniform() -> None:
    """A sigma of several turns or of one: a point 50 m on lies on a circle, sigma 50 m an axis."""
    poses = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [51.0, 0.0, 0.0]])
    second = np.diag([0.2, 0.2, 0.01]) ** 2
    for heading_rad in (1.0, 3.0, 20.0):
        first = np.diag([0.1, 0.1, heading_rad]) ** 2
        found = relative_of(poses, [first, second]).covariances(poses, 2)[0]
        np.testing.assert_allclose(np.diag(found)[:2], 50.0**2, rtol=1e-3)
