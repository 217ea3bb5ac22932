# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Covariances of every pose of a trajectory, in the robot's body frame [m, m, rad].

Errors are tangents in the body frame of the pose they belong to, as in GTSAM: the true pose is
`pose @ exp(error)`. An error at frame a becomes one at a frame b fixed to it by the adjoint of
`b_from_a`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import bsr_matrix, csc_array

from slarm_graph.backends.path_interpolation import bracketing_anchors
from slarm_graph.backends.selected_inverse import elimination_order, selected_inverse
from slarm_graph.constraint import ConstraintKind, PoseGraph
from slarm_graph.geometry import Floats, adjoints, between, symmetric, transform_covariances


@dataclass(frozen=True, slots=True)
class NodeCovariances:
    """Marginal covariances of the nodes of a graph, pose 0 being fixed.

    Parameters
    ----------
    own : (N, 3, 3) float64
        Of every node, in its body frame.
    cross : (N - 1, 3, 3) float64
        Of every node (rows) with the next (columns), each in its own body frame.
    steps : (N - 1, 3, 3) float64
        Of the measured step between them alone, in the body frame of the next node.
    """

    own: Floats
    cross: Floats
    steps: Floats


def path_covariances(
    graph: PoseGraph, scans: NDArray[np.int64], poses: Floats, variances: Floats
) -> Floats | None:
    """Interpolate the covariances of the graph's nodes to every scan.

    Model: seen from b, the step of every scan between two nodes a and b adds a share of the
    covariance Q of the step from a to b, by its own variance, independently. Given both nodes, a
    scan at a share s of that variance has the error

        e = (1 - s) A e_a + s B e_b + w,   cov(w) = s (1 - s) B Q B^T

    with A and B the adjoints from a and b to the scan: a Brownian bridge. For this model it is
    exact to first order; between nodes that loops have tied more closely than the step, scans are
    less certain than the nodes, by Q / 4 at most. Scans after the last node go on with the last
    step's share.

    Parameters
    ----------
    graph : PoseGraph
        At its optimum.
    scans : (N,) int64
        Scan of every node, ascending.
    poses : (S, 3) float64
        `map_from_robot` at every scan.
    variances : (S,) float64
        Of the step to every scan [m^2].

    Returns
    -------
    (S, 3, 3) float64 or None
        Body frame [m^2, m rad, rad^2]; None for a graph of one node, or with a gap.
    """
    nodes = node_covariances(graph)
    if nodes is None:
        return None
    before, after, share = bracketing_anchors(scans, variances)
    from_a, from_b = (between(poses, poses[scans[node]]) for node in (before, after))
    s = np.minimum(share, 1.0)[:, None, None]
    cross = transform_covariances(from_a, nodes.cross[before], from_b)
    step = transform_covariances(from_b, nodes.steps[before])
    total = (
        (1.0 - s) ** 2 * transform_covariances(from_a, nodes.own[before])
        + s**2 * transform_covariances(from_b, nodes.own[after])
        + s * (1.0 - s) * (cross + cross.swapaxes(1, 2) + step)
        + np.maximum(share - 1.0, 0.0)[:, None, None] * step
    )
    return symmetric(total)


def node_covariances(graph: PoseGraph) -> NodeCovariances | None:
    """Marginal covariances of each node, and of each with the next.

    None for a graph of one node, with two nodes in a row that no measured step joins, or with
    information that is singular in double precision.
    """
    steps = _steps(graph)
    every = np.arange(len(graph.poses))
    pairs = np.concatenate([every, every[:-1]]), np.concatenate([every, every[1:]])
    joint = None if steps is None else joint_covariances(graph, *pairs)
    if steps is None or joint is None:
        return None
    return NodeCovariances(symmetric(joint[every]), joint[len(every) :], steps)


def joint_covariances(
    graph: PoseGraph, rows: NDArray[np.int64], columns: NDArray[np.int64]
) -> Floats | None:
    """Marginal covariances of pairs of nodes that a constraint joins, or of one with itself.

    Parameters
    ----------
    graph : PoseGraph
        Pose 0 is fixed.
    rows, columns : (K,) int64
        Nodes.

    Returns
    -------
    (K, 3, 3) float64 or None
        Each node in its own body frame; None for a graph of one node, or with information that is
        singular in double precision.
    """
    count = len(graph.poses) - 1
    if count < 1:
        return None
    i, j = np.array([(c.i - 1, c.j - 1) for c in graph.constraints]).T
    free = (i >= 0) & (j >= 0)
    order = _axes(elimination_order(count, i[free], j[free])).ravel()
    inverse = selected_inverse(csc_array(_information(graph).tocsc()), order)
    if inverse is None:
        return None
    pairs = np.zeros((len(rows), 3, 3))
    free = (rows > 0) & (columns > 0)
    down, across = _axes(rows[free] - 1)[:, :, None], _axes(columns[free] - 1)[:, None, :]
    pairs[free] = inverse.at(*np.broadcast_arrays(down, across))
    return pairs


def _axes(nodes: NDArray[np.int64]) -> NDArray[np.int64]:
    """Rows (K, 3) of nodes (K,) in a matrix of three per node."""
    return 3 * nodes[:, None] + np.arange(3)


def _steps(graph: PoseGraph) -> Floats | None:
    """Covariances (N - 1, 3, 3) of the steps, all measurements of one fused."""
    information = np.zeros((len(graph.poses) - 1, 3, 3))
    for c in graph.constraints:
        if c.j == c.i + 1 and c.kind is not ConstraintKind.LOOP_CLOSURE:
            information[c.i] += np.linalg.inv(c.covariance)
    if not (information[:, 2, 2] > 0.0).all():
        return None
    return np.asarray(np.linalg.inv(information), dtype=np.float64)


def _information(graph: PoseGraph) -> bsr_matrix:
    """Information of all poses but the first; the residual is e_j - Ad(j_from_i) e_i."""
    i, j = np.array([(c.i, c.j) for c in graph.constraints]).T
    weight = np.linalg.inv(np.array([c.covariance for c in graph.constraints]))
    back = -adjoints(between(graph.poses[j], graph.poses[i]))
    ii, ij = back.swapaxes(1, 2) @ weight @ back, back.swapaxes(1, 2) @ weight
    blocks = np.concatenate([ii, ij, ij.swapaxes(1, 2), weight])
    rows, columns = np.concatenate([i, i, j, j]) - 1, np.concatenate([i, j, i, j]) - 1
    free = (rows >= 0) & (columns >= 0)
    return _blocks(blocks[free], rows[free], columns[free], len(graph.poses) - 1)


def _blocks(
    blocks: Floats, rows: NDArray[np.int64], columns: NDArray[np.int64], count: int
) -> bsr_matrix:
    """Put blocks (K, 3, 3) into a sparse matrix; those at one place add up."""
    order = np.argsort(rows, kind="stable")
    starts = np.searchsorted(rows[order], np.arange(count + 1))
    return bsr_matrix((blocks[order], columns[order], starts), shape=(3 * count, 3 * count))


def sample_covariances(paths: Floats, best: Floats, weights: Floats, floor: Floats) -> Floats:
    """Weighted second moment of the particles' paths about the best one, in its body frame.

    Before their common ancestor all particles agree, however wrong: far back this is no more than
    the floor, and always a lower bound.

    Parameters
    ----------
    paths : (U, P, 3) float64
        `map_from_robot` of all particles at every update.
    best : (U, 3) float64
    weights : (P,) float64
        Summing to 1.
    floor : (3, 3) float64
        Added to every one.

    Returns
    -------
    (U, 3, 3) float64
    """
    deviations = between(best[:, None, :], paths)
    return np.asarray(np.einsum("upi,p,upj->uij", deviations, weights, deviations) + floor)


def interpolate_covariances(
    known: Floats, scans: NDArray[np.int64], poses: Floats, variances: Floats
) -> Floats:
    """Interpolate covariances of some scans to all.

    Parameters
    ----------
    known : (U, 3, 3) float64
        At the scans `scans`, in their body frames.
    scans, poses, variances : (U,) int64, (S, 3) float64, (S,) float64
        As of `path_covariances`.

    Returns
    -------
    (S, 3, 3) float64
        The path between is taken as rigid; equal to `known` at its scans.
    """
    before, after, share = bracketing_anchors(scans, variances)
    s = np.minimum(share, 1.0)[:, None, None]
    one, other = (
        transform_covariances(between(poses, poses[scans[node]]), known[node])
        for node in (before, after)
    )
    return symmetric((1.0 - s) * one + s * other)
