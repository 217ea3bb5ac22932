# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""A sliding window has the residuals of the whole graph, with older nodes fixed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from slarm_graph.backends.robust_optimization import _mixture
from slarm_graph.backends.sliding_window import sliding_window
from slarm_graph.constraint import Constraint, ConstraintKind, PoseGraph
from slarm_graph.geometry import Floats, Pose2, between, compose, wrap_angles

COUNT = 12
STEP, CLOSURE = ConstraintKind.SCAN_MATCH, ConstraintKind.LOOP_CLOSURE


def constraint(rng: np.random.Generator, i: int, j: int, kind: ConstraintKind) -> Constraint:
    root = rng.normal(size=(3, 3))
    return Constraint(i, j, Pose2(*rng.normal(size=3)), 0.1 * (root @ root.T + np.eye(3)), kind)


def residuals(graph: PoseGraph) -> Floats:
    """Residuals (M, 3) of constraints, in the frames of their later ends."""
    away = [
        between(between(graph.poses[c.i], graph.poses[c.j]), c.i_from_j.as_array())
        for c in graph.constraints
    ]
    return np.array([[x, y, wrap_angles(turn)] for x, y, turn in away])


@pytest.mark.parametrize("first", [1, 5, 11])
def test_constraints_into_the_window_count_and_older_nodes_are_fixed(first: int) -> None:
    rng = np.random.default_rng(first)
    constraints = []
    for j in range(1, COUNT):
        constraints.append(constraint(rng, j - 1, j, STEP))
        constraints += [constraint(rng, int(i), j, CLOSURE) for i in rng.integers(0, j, 2)]
    nodes = list(rng.normal(size=(COUNT, 3)))
    part = sliding_window(nodes, constraints, first)
    kept = [c for c in reversed(constraints) if c.j >= first]
    assert [(c.kind, id(c.covariance)) for c in part.constraints] == [
        (c.kind, id(c.covariance)) for c in kept
    ]
    # Wherever the new nodes are moved to.
    nodes[first:] = list(rng.normal(size=(COUNT - first, 3)))
    whole = PoseGraph(np.array(nodes), tuple(kept))
    moved = replace(part, poses=np.array([np.zeros(3), *nodes[first:]]))
    np.testing.assert_allclose(residuals(moved), residuals(whole), atol=1e-12)
    assert len(part.poses) == COUNT - first + 1


@pytest.mark.parametrize("seed", range(5))
def test_contradictory_steps_become_their_mixture(seed: int) -> None:
    """Weighted by the inverse variance along their difference."""
    rng = np.random.default_rng(seed)
    one = constraint(rng, 3, 4, STEP)
    apart = rng.normal(size=3) * [1.0, 1.0, 0.3]
    end = compose(one.i_from_j.as_array(), apart)
    other = replace(constraint(rng, 3, 4, ConstraintKind.ODOMETRY), i_from_j=Pose2.from_array(end))
    along = [apart @ np.linalg.solve(c.covariance, apart) for c in (one, other)]
    share = along[1] / sum(along)
    found = _mixture(one, other)
    mean = between(one.i_from_j.as_array(), found.i_from_j.as_array())
    np.testing.assert_allclose(mean, share * apart, atol=1e-9)
    spread = np.zeros((3, 3))
    for weight, c, at in ((1.0 - share, one, 0.0), (share, other, 1.0)):
        off = (at - share) * apart
        spread += weight * (c.covariance + np.outer(off, off))
    np.testing.assert_allclose(found.covariance, spread, rtol=1e-9)
    # What either leaves open decides where it is said.
    doubted = _mixture(replace(one, unfailed=4.0 * one.covariance), other)
    nearer = between(doubted.i_from_j.as_array(), end)
    assert np.linalg.norm(nearer) < np.linalg.norm(between(found.i_from_j.as_array(), end))
