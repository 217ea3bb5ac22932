# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Starts of an optimisation: exact without noise, with it the least squares of dense algebra."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from slarm_graph.backends.pose_graph_start import spanning_tree_poses, starting_poses
from slarm_graph.constraint import Constraint, ConstraintKind, PoseGraph
from slarm_graph.geometry import Floats, Pose2, between, compose, wrap_angles

COUNT = 9
EVERY = ["the given poses", "a spanning tree", "averaged rotations", "unwrapped headings"]


def drawn(seed: int, noise: Floats) -> tuple[PoseGraph, Floats]:
    """A graph of a chain and closures, either way round and some twice, and its true poses."""
    rng = np.random.default_rng(seed)
    truth = rng.uniform([-5.0, -5.0, -3.0], [5.0, 5.0, 3.0], (COUNT, 3))
    truth[0, 2] = 0.7
    pairs = [*itertools.pairwise(range(COUNT)), (8, 0), (0, 4), (7, 1), (0, 4)]
    constraints = []
    for i, j in pairs:
        sigmas = rng.uniform(0.5, 2.0, 3)
        step = compose(between(truth[i], truth[j]), noise * sigmas * rng.normal(size=3))
        kind = ConstraintKind.ODOMETRY if j == i + 1 else ConstraintKind.LOOP_CLOSURE
        constraints.append(Constraint(i, j, Pose2.from_array(step), np.diag(sigmas**2), kind))
    given = truth + np.where(np.arange(COUNT)[:, None] > 0, rng.normal(size=(COUNT, 3)), 0.0)
    return PoseGraph(given, tuple(constraints)), truth


def best(graph: PoseGraph, steps: Floats, weights: Floats) -> Floats:
    """Values (N,) whose differences are nearest to steps (M,), the first being 0; dense."""
    rows = np.zeros((len(steps), COUNT))
    for k, c in enumerate(graph.constraints):
        rows[k, c.j], rows[k, c.i] = 1.0, -1.0
    roots = np.sqrt(weights)
    found = np.linalg.lstsq(rows[:, 1:] * roots[:, None], steps * roots, rcond=None)[0]
    return np.concatenate([[0.0], found])


def positions(graph: PoseGraph, headings: Floats) -> Floats:
    """Best positions (N, 2) for headings (N,)."""
    turned = [
        Pose2(0.0, 0.0, headings[c.i]).transform(np.array([c.i_from_j.x, c.i_from_j.y]))
        for c in graph.constraints
    ]
    weights = [2.0 / np.trace(c.covariance[:2, :2]) for c in graph.constraints]
    axes = [best(graph, np.array(turned)[:, k], np.array(weights)) for k in (0, 1)]
    return np.stack(axes, axis=1) + graph.poses[0, :2]


@pytest.mark.parametrize("seed", range(5))
def test_every_start_is_the_truth_without_noise(seed: int) -> None:
    graph, truth = drawn(seed, np.zeros(3))
    starts = list(starting_poses(graph))
    assert [name for name, _ in starts] == EVERY
    np.testing.assert_array_equal(starts[0][1], graph.poses)
    for _, poses in starts[1:]:
        off = poses - truth
        np.testing.assert_allclose(off[:, :2], 0.0, atol=1e-9)
        np.testing.assert_allclose(wrap_angles(off[:, 2]), 0.0, atol=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_with_noise_they_are_least_squares(seed: int) -> None:
    graph, truth = drawn(seed, np.array([0.1, 0.1, 0.03]))
    turns = np.array([c.i_from_j.theta for c in graph.constraints])
    sure = np.array([1.0 / c.covariance[2, 2] for c in graph.constraints])
    poses = dict(starting_poses(graph))
    ends = np.array([(c.i, c.j) for c in graph.constraints])
    off = wrap_angles(turns - (truth[ends[:, 1], 2] - truth[ends[:, 0], 2]))
    headings = truth[:, 2] + best(graph, off, sure)
    found = poses["unwrapped headings"]
    np.testing.assert_allclose(wrap_angles(found[:, 2] - headings), 0.0, atol=1e-9)
    np.testing.assert_allclose(found[:, :2], positions(graph, headings), atol=1e-9)
    # z_j - z_i exp(i theta_ij) = 0 for all, in the mean, with z_0 as it is.
    rows = np.zeros((len(ends), COUNT), dtype=np.complex128)
    for k, (i, j) in enumerate(ends):
        rows[k, j], rows[k, i] = 1.0, -np.exp(1j * turns[k])
    rows *= np.sqrt(sure)[:, None]
    z = np.linalg.lstsq(rows[:, 1:], -rows[:, 0] * np.exp(0.7j), rcond=None)[0]
    found = poses["averaged rotations"]
    headings = np.concatenate([[0.7], np.angle(z)])
    np.testing.assert_allclose(wrap_angles(found[:, 2] - headings), 0.0, atol=1e-9)
    np.testing.assert_allclose(found[:, :2], positions(graph, headings), atol=1e-9)


def test_a_tree_takes_the_fewest_constraints_and_the_last_of_equals() -> None:
    graph, _ = drawn(0, np.array([0.1, 0.1, 0.03]))
    found, step = spanning_tree_poses(graph), [c.i_from_j for c in graph.constraints]
    first = Pose2.from_array(graph.poses[0])
    ways = {
        2: first @ step[0] @ step[1],
        3: first @ step[11] @ step[3].inverse(),
        5: first @ step[11] @ step[4],
        8: first @ step[8].inverse(),
    }
    for node, way in ways.items():
        np.testing.assert_allclose(between(way.as_array(), found[node]), 0.0, atol=1e-9)


def test_a_chain_has_but_the_start_that_was_given() -> None:
    """Of it nothing can be had by closures; with one there is more to try."""
    graph, _ = drawn(0, np.zeros(3))
    chain = replace(graph, constraints=graph.constraints[: COUNT - 1])
    assert [name for name, _ in starting_poses(chain)] == EVERY[:1]
    closed = replace(graph, constraints=graph.constraints[:COUNT])
    assert [name for name, _ in starting_poses(closed)] == EVERY


def test_whole_turns_are_taken_anew_when_headings_have_moved() -> None:
    """Two headings go apart by 6 rad, which the third constraint then sees from the other side."""
    told = [
        (0, 1, 3.0, 0.1),
        (0, 1, 0.0, 1.0),
        (0, 2, -3.0, 0.1),
        (0, 2, 0.0, 1.0),
        (1, 2, 0.0, 0.2),
    ]
    constraints = tuple(
        Constraint(i, j, Pose2(0.0, 0.0, turn), np.eye(3) * sigma**2, ConstraintKind.LOOP_CLOSURE)
        for i, j, turn, sigma in told
    )
    graph = PoseGraph(np.zeros((3, 3)), constraints)
    headings = dict(starting_poses(graph))["unwrapped headings"][:, 2]
    pull = np.zeros(3)
    for i, j, turn, sigma in told:
        miss = wrap_angles(turn - (headings[j] - headings[i]))
        pull[[i, j]] += np.array([-1.0, 1.0]) * miss / sigma**2
    np.testing.assert_allclose(pull, 0.0, atol=1e-9)
    assert abs(headings[1] - 3.0) < 0.2
