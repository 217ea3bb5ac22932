# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Covariances along a path, against dense inverses of graphs with a pose for every scan."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from slarm_graph import read_trajectory_covariance, write_trajectory_covariance
from slarm_graph.app.outputs import save_slam
from slarm_graph.app.run_folder import create_run_folder
from slarm_graph.app.run_report import uncertainty
from slarm_graph.backend import SlamResult
from slarm_graph.backends.path_covariance import (
    interpolate_covariances,
    node_covariances,
    path_covariances,
    sample_covariances,
)
from slarm_graph.backends.pose_graph_optimizer import marginal_covariances
from slarm_graph.constraint import Constraint, ConstraintKind, PoseGraph
from slarm_graph.errors import BadInput
from slarm_graph.eval.assessment import assess
from slarm_graph.eval.metric_parts import Subject
from slarm_graph.eval.position_uncertainty import uncertainty_metrics
from slarm_graph.files.trajectory_covariances import TrajectoryCovariance
from slarm_graph.geometry import Pose2, adjoints, between, compose
from slarm_graph.grid import GridGeometry, OccupancyGrid
from slarm_graph.trajectory import Trajectory

BETWEEN = 5
STEP = np.array([0.3, 0.05, 0.2])
Q = np.array([[4e-4, 5e-5, 1e-5], [5e-5, 9e-4, 2e-5], [1e-5, 2e-5, 1e-4]])
EVEN = np.full(100, 0.01)
"""Variances of the steps to scans that are all as sure."""


def bent_path(scans: int) -> np.ndarray:
    """Poses (scans, 3) of a drive along a bend, begun with the robot turned."""
    poses = [np.array([1.0, 2.0, 2.1])]
    for _ in range(scans - 1):
        poses.append(compose(poses[-1], STEP))
    return np.array(poses)


def constraint(poses: np.ndarray, i: int, j: int, covariance: np.ndarray, kind: str) -> Constraint:
    told = Pose2.from_array(between(poses[i], poses[j]))
    return Constraint(i, j, told, 0.5 * (covariance + covariance.T), ConstraintKind(kind))


def coarse_and_fine(nodes: int, closed: bool) -> tuple[PoseGraph, PoseGraph, np.ndarray]:
    """One drive as a graph of nodes, as one of all its scans, and the scans nodes stand at."""
    poses = bent_path(BETWEEN * (nodes - 1) + 1)
    at = BETWEEN * np.arange(nodes)
    steps = [constraint(poses[at], k, k + 1, Q, "scan_match") for k in range(nodes - 1)]
    fine = []
    for k in range(len(poses) - 1):
        after = BETWEEN * (k // BETWEEN + 1)
        carry = adjoints(between(poses[k + 1], poses[after]))
        fine.append(constraint(poses, k, k + 1, carry @ (Q / BETWEEN) @ carry.T, "scan_match"))
    if closed:
        loop = np.diag([1e-4, 2e-4, 1e-5])
        steps.append(constraint(poses[at], 0, nodes - 2, loop, "loop_closure"))
        fine.append(constraint(poses, 0, int(at[-2]), loop, "loop_closure"))
    return PoseGraph(poses[at], tuple(steps)), PoseGraph(poses, tuple(fine)), at


def dense(graph: PoseGraph) -> np.ndarray:
    """Covariances (N, 3, 3) out of the inverse of the dense information, numerically derived."""
    count, eps = len(graph.poses), 1e-6
    rows = []
    for c in graph.constraints:
        root = np.linalg.inv(np.linalg.cholesky(c.covariance))
        row = np.zeros((3, 3 * count))
        for which in (c.i, c.j):
            for axis in range(3):
                ends = []
                for sign in (1.0, -1.0):
                    poses = graph.poses.copy()
                    moved = Pose2.exp(sign * eps * np.eye(3)[axis])
                    poses[which] = (Pose2.from_array(poses[which]) @ moved).as_array()
                    seen = Pose2.from_array(between(poses[c.i], poses[c.j]))
                    ends.append(c.i_from_j.between(seen).log())
                row[:, 3 * which + axis] = (ends[0] - ends[1]) / (2.0 * eps)
        rows.append(root @ row)
    jacobian = np.concatenate(rows)[:, 3:]
    whole = np.zeros((3 * count, 3 * count))
    whole[3:, 3:] = np.linalg.inv(jacobian.T @ jacobian)
    return np.array([whole[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] for k in range(count)])


@pytest.mark.parametrize("closed", [False, True])
def test_bridge_is_exact_for_equal_steps(closed: bool) -> None:
    coarse, fine, at = coarse_and_fine(6, closed)
    found = path_covariances(coarse, at, fine.poses, EVEN[: len(fine.poses)])
    assert found is not None
    np.testing.assert_allclose(found, dense(fine), rtol=1e-5, atol=1e-9)


def test_nodes_agree_with_gtsam() -> None:
    coarse, _, _ = coarse_and_fine(8, True)
    nodes = node_covariances(coarse)
    assert nodes is not None
    expected = marginal_covariances(coarse, range(8))
    np.testing.assert_allclose(nodes.own, expected, rtol=1e-6, atol=1e-10)


def test_a_long_path_without_loops_adds_up_its_steps() -> None:
    coarse, _, _ = coarse_and_fine(1500, False)
    nodes = node_covariances(coarse)
    assert nodes is not None
    expected = np.zeros((3, 3))
    for k in range(1499):
        carry = adjoints(between(coarse.poses[k + 1], coarse.poses[k]))
        np.testing.assert_allclose(nodes.cross[k], expected @ carry.T, rtol=1e-6, atol=1e-12)
        expected = carry @ expected @ carry.T + Q
        np.testing.assert_allclose(nodes.own[k + 1], expected, rtol=1e-6, atol=1e-12)


def test_scans_after_the_last_node_go_on() -> None:
    coarse, fine, at = coarse_and_fine(4, False)
    fewer = PoseGraph(coarse.poses[:-1], coarse.constraints[:-1])
    found = path_covariances(fewer, at[:-1], fine.poses, EVEN[: len(fine.poses)])
    assert found is not None
    # Without a loop nothing is learnt from what comes after: as if the step had been measured,
    # but that each share is seen from the node before.
    carry = adjoints(between(fine.poses[-1], coarse.poses[-2]))
    expected = carry @ (dense(fine)[at[-2]] + Q) @ carry.T
    np.testing.assert_allclose(found[-1], expected, rtol=1e-5)


def test_covariances_are_in_the_robots_frame() -> None:
    """A robot that drives sideways through the map is unsure ahead, which is the map's y."""
    poses = np.array([[0.0, float(k), np.pi / 2] for k in range(3)])
    ahead = np.diag([0.04, 0.0001, 1e-8])
    steps = tuple(constraint(poses[::2], k, k + 1, ahead, "scan_match") for k in range(1))
    found = path_covariances(PoseGraph(poses[::2], steps), np.array([0, 2]), poses, EVEN[:3])
    assert found is not None
    np.testing.assert_allclose(np.diag(found[1])[:2], [0.02, 0.00005], rtol=1e-3)


def test_wheels_beside_matches_make_a_step_surer() -> None:
    coarse, fine, at = coarse_and_fine(2, False)
    twice = replace(
        coarse,
        constraints=(*coarse.constraints, constraint(coarse.poses, 0, 1, Q, "odometry")),
    )
    alone, both = (
        path_covariances(graph, at, fine.poses, EVEN[: len(fine.poses)])
        for graph in (coarse, twice)
    )
    assert alone is not None
    np.testing.assert_allclose(both, alone / 2.0, rtol=1e-9)


def test_unknown_where_nothing_ties_nodes() -> None:
    coarse, fine, at = coarse_and_fine(3, True)
    assert (
        path_covariances(
            replace(coarse, constraints=coarse.constraints[1:]),
            at,
            fine.poses,
            EVEN[: len(fine.poses)],
        )
        is None
    )
    assert (
        path_covariances(PoseGraph(fine.poses[:1]), at[:1], fine.poses, EVEN[: len(fine.poses)])
        is None
    )


def test_the_unsure_step_has_the_doubt() -> None:
    """Nine tenths of a step's variance in its first half leave a tenth of it to the second."""
    poses = np.array([[float(k), 0.0, 0.0] for k in range(3)])
    wide = np.diag([0.04, 0.04, 1e-8])
    steps = (constraint(poses[::2], 0, 1, wide, "scan_match"),)
    found = path_covariances(
        PoseGraph(poses[::2], steps), np.array([0, 2]), poses, np.array([7.0, 0.9, 0.1])
    )
    assert found is not None
    np.testing.assert_allclose(np.diag(found[1])[:2], 0.9 * 0.04, rtol=1e-3)


def test_spread_of_particles_in_the_best_ones_frame() -> None:
    best = np.array([[2.0, 1.0, np.pi / 2]])
    ahead = compose(best, np.array([[0.3, 0.0, 0.0]]))
    paths = np.stack([best, ahead], axis=1)
    floor = np.diag([1e-4, 1e-4, 1e-6])
    found = sample_covariances(paths, best, np.array([0.75, 0.25]), floor)
    np.testing.assert_allclose(found[0], floor + np.diag([0.25 * 0.09, 0.0, 0.0]), atol=1e-12)


def test_filling_carries_along_a_lever() -> None:
    poses = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, np.pi / 2], [1.0, 1.0, np.pi / 2]])
    known = np.array([np.diag([0.0, 0.0, 0.01]), np.diag([0.0, 0.0, 0.04])])
    found = interpolate_covariances(known, np.array([0, 2]), poses, EVEN[:3])
    np.testing.assert_allclose(found[[0, 2]], known, atol=1e-15)
    # Half of either: from behind a turn of 0.1 moves the robot 0.1 m to the map's y, which is
    # ahead; from ahead a turn of 0.2 moves it 0.2 m to the map's x, which is aside.
    np.testing.assert_allclose(np.diag(found[1]), [0.005, 0.02, 0.025], atol=1e-12)
    last = interpolate_covariances(known[:1], np.array([0]), poses, EVEN[:3])[2]
    np.testing.assert_allclose(last, carried_by_hand(poses, known[0]), atol=1e-12)


def carried_by_hand(poses: np.ndarray, known: np.ndarray) -> np.ndarray:
    adjoint = adjoints(between(poses[2], poses[0]))
    return np.asarray(adjoint @ known @ adjoint.T)


def test_adjoints_are_those_of_single_poses() -> None:
    poses = bent_path(7)
    np.testing.assert_array_equal(adjoints(poses), [adjoints(pose) for pose in poses])


def test_a_run_folder_tells_where_the_backend_knows(tmp_path: Path) -> None:
    path = Trajectory(np.array([1, 5]), np.zeros((2, 3)))
    grid = OccupancyGrid(GridGeometry(0.0, 0.0, 0.1, 2, 2), np.full((2, 2), 0.5, np.float32))
    for name, known in (("knows", np.stack([Q, 2.0 * Q])), ("not", None)):
        save_slam(create_run_folder(tmp_path, name), SlamResult(path, known), grid)
    found = read_trajectory_covariance(tmp_path / "knows" / "trajectory_covariance.npz")
    np.testing.assert_array_equal(found.stamps_ns, path.stamps_ns)
    np.testing.assert_array_equal(found.covariances[1], 2.0 * Q)
    assert not (tmp_path / "not" / "trajectory_covariance.npz").exists()


def test_the_report_tells_the_worst_position() -> None:
    known = np.stack([np.diag([0.01, 0.0001, 9.0]), np.diag([0.04, 0.09, 9.0])])
    # 95 % of a normal distribution in the plane lie within 2.448 standard deviations.
    assert uncertainty(known) == "; position uncertain by up to 0.73 m (95 %)"
    assert not uncertainty(None)
    (told,) = uncertainty_metrics(known)
    assert (told.name, told.value) == ("position_uncertainty_m", pytest.approx(0.3 * 2.4477, 1e-3))
    (none,) = uncertainty_metrics(np.diag([-1e-20, -1e-20, 1.0])[None])
    assert none.value == 0.0
    assert uncertainty_metrics(None) == uncertainty_metrics(known[:0]) == ()
    line = Trajectory(np.arange(2), np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]))
    assert told in assess(Subject(line, covariances=known))
    moving = [m for m in assess(Subject(line, moving_share=0.03)) if m.name == "moving_share"]
    assert [m.value for m in moving] == [0.03]
    assert "moving_share" not in {m.name for m in assess(Subject(line))}


def test_file_round_trip(tmp_path: Path) -> None:
    known = TrajectoryCovariance(np.array([1, 5]), np.arange(18.0).reshape(2, 3, 3))
    for name in ("a.npz", "b.npz"):
        write_trajectory_covariance(tmp_path / name, known)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    found = read_trajectory_covariance(tmp_path / "a.npz")
    np.testing.assert_array_equal(found.stamps_ns, known.stamps_ns)
    np.testing.assert_array_equal(found.covariances, known.covariances)
    write_trajectory_covariance(tmp_path / "a.npz", replace(known, stamps_ns=np.array([1])))
    with pytest.raises(BadInput, match="1 stamps and covariances"):
        read_trajectory_covariance(tmp_path / "a.npz")
