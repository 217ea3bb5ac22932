# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Loop closures that particles missed, and the second pass of the filter."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from test_gmapping import ate_m, made, recorded, run

from slarm_graph.backend import Table
from slarm_graph.backends.gmapping import GmappingBackend
from slarm_graph.backends.graph_building import ClosedGraph
from slarm_graph.backends.second_pass import (
    MISSED_SIGMAS,
    closure_mahalanobis,
    filter_along,
    mean_reverted,
    second_moments,
)
from slarm_graph.config import PoseGraphConfig
from slarm_graph.constraint import Constraint, ConstraintKind, PoseGraph
from slarm_graph.geometry import Floats, Pose2, between, compose
from slarm_graph.trajectory import Trajectory

CELL_M = 0.05
SIGMAS = np.array([0.01, 0.02, 0.003])


def square(*closures: Pose2) -> ClosedGraph:
    """Five nodes round a square of 4 m, with closures that see the last from the first."""
    corners = np.array(
        [(0, 0, 0), (4, 0, np.pi / 2), (4, 4, np.pi), (0, 4, -np.pi / 2), (0, 0, 0)], dtype=float
    )
    covariance = np.diag(SIGMAS) ** 2
    step = Constraint(0, 1, Pose2(4, 0, np.pi / 2), covariance, ConstraintKind.SCAN_MATCH)
    loops = tuple(
        Constraint(0, 4, seen, covariance, ConstraintKind.LOOP_CLOSURE) for seen in closures
    )
    scans = np.array([0, 2, 4, 6, 8])
    poses, none = np.repeat(corners, 2, axis=0)[:9], np.zeros((9, 3, 3))
    graph, table = PoseGraph(corners, (step, *loops)), Table("c", (), ())
    return ClosedGraph(graph, scans, poses, np.ones(9), table, none, np.zeros((9, 3)))


@pytest.mark.parametrize(
    ("axis", "allowed"),
    [(0, CELL_M / np.sqrt(12)), (1, CELL_M / np.sqrt(12)), (2, 0.02 / np.sqrt(12))],
)
def test_a_closure_is_contradicted_beyond_999_in_1000(axis: int, allowed: float) -> None:
    bound = np.sqrt(16.266) * np.hypot(SIGMAS[axis], allowed)  # chi-square, 3 degrees of freedom
    for off, expected in ((0.99 * bound, 0), (1.01 * bound, 1)):
        closed = square(Pose2())
        path = closed.poses.copy()
        path[-1, axis] += off
        assert missed_count(closed, path, CELL_M) == expected
        sigmas = off / np.hypot(SIGMAS[axis], allowed)
        assert closure_mahalanobis(closed, path, CELL_M) == pytest.approx([sigmas])


def test_only_closures_count_and_each_by_itself() -> None:
    closed = square(Pose2(), Pose2(1, 0, 0), Pose2(0, 0, 2 * np.pi - 1e-9))
    assert missed_count(closed, closed.poses, CELL_M) == 1
    assert missed_count(square(), bent(closed.poses) + 9.0, CELL_M) == 0


def missed_count(closed: ClosedGraph, path: Floats, cell_m: float) -> int:
    return int((closure_mahalanobis(closed, path, cell_m) > MISSED_SIGMAS).sum())


def test_second_moments_are_covariance_plus_squared_offset() -> None:
    """Against errors drawn from the graph's covariance, about the path."""
    closed, rng = chained(), np.random.default_rng(0)
    known = second_moments(closed.poses, closed)
    beside = np.array([0.03, -0.05, 0.4])
    path = compose(closed.poses, beside)
    found = second_moments(path, closed)
    assert known is not None
    assert found is not None
    np.testing.assert_allclose(known[0], closed.lag_covariances[0], atol=1e-12)
    errors = rng.multivariate_normal(np.zeros(3), known[-1], 200_000)
    off = between(path[-1], compose(closed.poses[-1], errors))
    np.testing.assert_allclose(found[-1], off.T @ off / len(off), rtol=0.02, atol=2e-6)


def test_a_graph_without_covariances_gives_no_second_moments() -> None:
    closed = chained()
    gap = PoseGraph(closed.graph.poses, closed.graph.constraints[:1])
    assert second_moments(closed.poses, replace(closed, graph=gap)) is None


def chained() -> ClosedGraph:
    """A square of 4 m of which every side was measured, and sweeps that lag."""
    closed = square(Pose2())
    covariance, poses = np.diag(SIGMAS) ** 2, [Pose2.from_array(p) for p in closed.graph.poses]
    steps = tuple(
        Constraint(k, k + 1, a.between(b), covariance, ConstraintKind.SCAN_MATCH)
        for k, (a, b) in enumerate(itertools.pairwise(poses))
    )
    lags = np.tile(np.diag([1e-5, 2e-5, 3e-6]), (len(closed.poses), 1, 1))
    graph = PoseGraph(closed.graph.poses, steps)
    return replace(closed, graph=graph, lag_covariances=lags)


def bent(poses: Floats) -> Floats:
    """A path that turns five degrees too far at every step."""
    out = poses.copy()
    turn = np.radians(5.0)
    for k in range(1, len(poses)):
        step = Pose2.from_array(poses[k - 1]).between(Pose2.from_array(poses[k]))
        out[k] = compose(out[k - 1], np.array([step.x, step.y, step.theta + turn]))
    return out


def test_the_filter_follows_the_given_path() -> None:
    readings, truth = recorded(noiseless=True)
    backend = made(particles=3)
    run(backend, readings)
    state = backend._state
    stamps_ns = truth.stamps_ns[state.updates]
    given = truth.poses[state.updates]
    passes = [
        filter_along(
            poses,
            state.filter.first_points,
            state.measurements,
            backend._config,
            np.random.default_rng(0),
        )
        for poses in (given, bent(given))
    ]
    assert {p.scale_m for p in passes} == {backend._config.likelihood.sigma_m}
    paths = [particles.best_path() for particles in passes]
    there = Trajectory(stamps_ns, given)
    assert ate_m(Trajectory(stamps_ns, paths[0]), there) < 0.01
    assert ate_m(Trajectory(stamps_ns, paths[1]), there) > 0.05


def torn(places: PoseGraphConfig | None) -> GmappingBackend:
    """A filter after most of a tour, whose particles all believe to be a metre off since half."""
    backend = made(particles=5, places=places)
    for reading in recorded()[0][:-20]:
        backend.update(reading)
    backend._wait_for_filter()
    particles = backend._state.filter
    particles.ancestry._poses[len(particles.ancestry) // 2 :, :, 0] += 1.0
    particles.poses[:, 0] += 1.0
    return backend


def test_a_second_pass_recovers_particles_that_missed_the_loops() -> None:
    readings, truth = recorded()
    backend = torn(PoseGraphConfig())
    result = backend.result()
    so_far = Trajectory(truth.stamps_ns[:-20], truth.poses[:-20])
    assert ate_m(result.trajectory, so_far) < 0.03
    assert any("went over the recording again" in notice for notice in result.notices)
    assert {t.name for t in result.tables} == {"particles", "weighted_mean", "loop_closures"}
    here = Pose2.from_array(result.trajectory.poses[-1]).between(backend.map_from_robot())
    assert np.allclose(here.as_array(), 0.0, atol=1e-9)
    again = backend.result()
    assert np.array_equal(again.trajectory.poses, result.trajectory.poses)
    assert again.notices == result.notices
    for reading in readings[-20:]:
        backend.update(reading)
    assert ate_m(backend.result().trajectory, truth) < 0.03


def test_particles_alone_stay_where_they_are() -> None:
    _, truth = recorded()
    so_far = Trajectory(truth.stamps_ns[:-20], truth.poses[:-20])
    assert ate_m(torn(None).result().trajectory, so_far) > 0.3


def test_deviations_from_the_path_decay_in_its_own_frame() -> None:
    path = np.array([3.0, -2.0, np.pi / 2])
    off = np.array([[0.5, 0.2, 0.1], [0.0, 0.0, 0.0]])
    left = between(path, mean_reverted(compose(path, off), path, 10.0))
    assert np.allclose(left, off / np.e)
    assert np.allclose(mean_reverted(compose(path, off), path, 0.0), compose(path, off))
