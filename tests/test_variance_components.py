# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Covariances of constraints that are learned, against those that their errors were drawn from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from slarm_graph.backends.pose_graph_optimizer import optimize
from slarm_graph.backends.variance_components import calibrated
from slarm_graph.constraint import Constraint, ConstraintKind, PoseGraph
from slarm_graph.geometry import Floats, Pose2, between

ODOMETRY, WHEELS, CLOSURE = (
    ConstraintKind.ODOMETRY,
    ConstraintKind.WHEELS,
    ConstraintKind.LOOP_CLOSURE,
)
TRUE = {
    ODOMETRY: np.diag([0.01, 0.01, 0.004]) ** 2,
    WHEELS: np.diag([0.02, 0.01, 0.01]) ** 2,
    CLOSURE: np.diag([0.02, 0.02, 0.006]) ** 2,
}
LAP = 40


def laps(claimed: dict[ConstraintKind, float], count: int = 3 * LAP) -> PoseGraph:
    """Rounds of a circle, each tied to the first; covariances are claimed that many times true."""
    rng = np.random.default_rng(3)
    angles = 2.0 * np.pi * np.arange(count) / LAP
    truth = np.stack([6.0 * np.sin(angles), -6.0 * np.cos(angles), angles], axis=1)
    ties = [(k, k + 1, kind) for k in range(count - 1) for kind in (ODOMETRY, WHEELS)]
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
    found = calibrated(laps({ODOMETRY: 1.0, WHEELS: 2.0, CLOSURE: 4.0}))
    for kind in TRUE:
        assert factors(found, kind) == pytest.approx(1.0, rel=0.45)


def test_what_neighbours_share_is_left_as_it_is_claimed() -> None:
    graph = laps(dict.fromkeys(TRUE, 9.0))
    half = [
        replace(c, shared=0.5 * c.covariance) if c.kind is ODOMETRY else c
        for c in graph.constraints
    ]
    found = calibrated(replace(graph, constraints=tuple(half)))
    assert (factors(found, ODOMETRY) > 4.5).all()
    assert (factors(found, ODOMETRY) < 5.0).all()
    assert factors(found, CLOSURE) == pytest.approx(1.0, rel=0.35)


def test_a_chain_tells_nothing_of_its_errors() -> None:
    graph = laps(dict.fromkeys(TRUE, 9.0))
    steps = tuple(c for c in graph.constraints if c.kind is ODOMETRY)
    chain = replace(graph, constraints=steps)
    assert factors(calibrated(chain), ODOMETRY) == pytest.approx(9.0)


def test_graphs_without_constraints_or_of_a_single_pose_are_handed_back() -> None:
    alone = PoseGraph(np.zeros((1, 3)))
    assert calibrated(alone) is alone
