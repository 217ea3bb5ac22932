# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""How sure a path is of every pose: covariances in the robot's own frame [m, m, rad].

Errors are tangents in the body frame of the pose they belong to, as in GTSAM: the true pose is
`pose @ exp(error)`. What is known at frame a is carried to a frame b fixed to it by the adjoint of
`b_from_a`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import bsr_matrix
from scipy.sparse.linalg import splu

from slarm_graph.backends.path_filling import neighbours
from slarm_graph.constraint import ConstraintKind, PoseGraph
from slarm_graph.geometry import Floats, adjoints, between

_MOST_NODES = 1000
"""The time grows with the square of the nodes: 400 take 0.3 s, 3000 half a minute. Larger graphs
are left without covariances."""
_AT_ONCE = 20
"""Nodes solved for in one go: what stays in a core's cache. A hundred take half as long again, and
how many there are moves the last digit."""


@dataclass(frozen=True, slots=True)
class NodeCovariances:
    """What a graph says of its nodes, pose 0 being certain.

    Parameters
    ----------
    own : (N, 3, 3) float64
        Of every node, in its body frame.
    cross : (N - 1, 3, 3) float64
        Of every node (rows) with the one after (columns), each in its own body frame.
    steps : (N - 1, 3, 3) float64
        Of the measured step between them by itself, in the body frame of the node after.
    """

    own: Floats
    cross: Floats
    steps: Floats


def path_covariances(
    graph: PoseGraph, scans: NDArray[np.int64], poses: Floats, variances: Floats
) -> Floats | None:
    """Return the covariance of every scan's pose out of that of the graph's nodes.

    Model: seen from the node after, the step of every scan between two nodes a and b adds a share
    of the covariance Q of the step from a to b, by its own variance, independently. Given both
    nodes, a scan that is a share s of the way has the error

        e = (1 - s) A e_a + s B e_b + w,   cov(w) = s (1 - s) B Q B^T

    with A and B the adjoints that carry errors of a and b to the scan: a bridge pinned at both
    ends. For this model it is exact to first order; nodes that loops have tied more
    closely than the step between them have the scans in between less certain than themselves, by
    Q / 4 at most. Scans after the last node go on with the last step's share.

    Parameters
    ----------
    graph : PoseGraph
        At its optimum.
    scans : (N,) int64
        The scan that every node stands at, ascending.
    poses : (S, 3) float64
        `map_from_robot` at every scan.
    variances : (S,) float64
        Of the step to every scan [m^2].

    Returns
    -------
    (S, 3, 3) float64 or None
        Body frame [m^2, m rad, rad^2]; None for a graph of one node, of too many, or with a gap.
    """
    nodes = node_covariances(graph)
    if nodes is None:
        return None
    before, after, share = neighbours(scans, variances)
    from_a = adjoints(between(poses, poses[scans[before]]))
    from_b = adjoints(between(poses, poses[scans[after]]))
    s = np.minimum(share, 1.0)[:, None, None]
    mixed = carried(nodes.cross[before], from_a, from_b)
    step = carried(nodes.steps[before], from_b)
    total = (
        (1.0 - s) ** 2 * carried(nodes.own[before], from_a)
        + s**2 * carried(nodes.own[after], from_b)
        + s * (1.0 - s) * (mixed + mixed.swapaxes(1, 2) + step)
        + np.maximum(share - 1.0, 0.0)[:, None, None] * step
    )
    return _symmetric(total)


def covariance_notices(graph: PoseGraph, found: Floats | None) -> tuple[str, ...]:
    """Say why there are no covariances, where the graph is too large for them."""
    if found is not None or len(graph.poses) <= _MOST_NODES:
        return ()
    return (
        f"no covariances of the poses: the graph has {len(graph.poses)} nodes, and more than"
        f" {_MOST_NODES} take too long",
    )


def node_covariances(graph: PoseGraph) -> NodeCovariances | None:
    """Return what a graph says of each node, and of each with the next.

    None for a graph of one node, of more than `_MOST_NODES`, with two nodes in a row that no
    measured step joins, or with information that is singular in double precision.
    """
    steps = _steps(graph)
    every = np.arange(len(graph.poses))
    pairs = np.concatenate([every, every[:-1]]), np.concatenate([every, every[1:]])
    found = None if steps is None else joint_covariances(graph, *pairs)
    if steps is None or found is None:
        return None
    return NodeCovariances(_symmetric(found[every]), found[len(every) :], steps)


def joint_covariances(
    graph: PoseGraph, rows: NDArray[np.int64], columns: NDArray[np.int64]
) -> Floats | None:
    """Covariances of pairs of nodes: the graph's information is factorised once.

    Parameters
    ----------
    graph : PoseGraph
        Pose 0 is certain.
    rows, columns : (K,) int64
        Nodes.

    Returns
    -------
    (K, 3, 3) float64 or None
        Each node in its own body frame; None for a graph of one node, of more than `_MOST_NODES`,
        or with information that is singular in double precision.
    """
    count = len(graph.poses)
    if not 2 <= count <= _MOST_NODES:
        return None
    try:
        solver = splu(_information(graph).tocsc())
    except RuntimeError:
        return None
    pairs = np.zeros((len(rows), 3, 3))
    size = 3 * (count - 1)
    for first in range(1, count, _AT_ONCE):
        nodes = np.arange(first, min(first + _AT_ONCE, count))
        unit = np.zeros((size, 3 * len(nodes)))
        places = np.arange(3 * len(nodes))
        unit[3 * (first - 1) + places, places] = 1.0
        found = solver.solve(unit).reshape(count - 1, 3, len(nodes), 3)
        if not (np.isfinite(found).all() and (_own(found, nodes) >= 0.0).all()):
            return None
        here = np.flatnonzero((columns >= first) & (columns <= nodes[-1]) & (rows > 0))
        pairs[here] = found[rows[here] - 1, :, columns[here] - first]
    return pairs


def _own(found: Floats, nodes: NDArray[np.int64]) -> Floats:
    """Variances (3, N) of nodes in the columns that were solved for them."""
    return np.diagonal(found[nodes - 1, :, nodes - nodes[0]], axis1=1, axis2=2)


def _steps(graph: PoseGraph) -> Floats | None:
    """Covariances (N - 1, 3, 3) of the steps, all that measures one taken together."""
    information = np.zeros((len(graph.poses) - 1, 3, 3))
    for c in graph.constraints:
        if c.j == c.i + 1 and c.kind is not ConstraintKind.LOOP_CLOSURE:
            information[c.i] += np.linalg.inv(c.covariance)
    if not (information[:, 2, 2] > 0.0).all():
        return None
    return np.asarray(np.linalg.inv(information), dtype=np.float64)


def _information(graph: PoseGraph) -> bsr_matrix:
    """Information of all poses but the first: e_j - Ad(j_from_i) e_i is what was measured."""
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


def spread_covariances(paths: Floats, best: Floats, weights: Floats, floor: Floats) -> Floats:
    """Weighted spread of particles' paths about the best of them, in its body frame.

    Particles of one ancestor agree on what was before, however wrong it may be: far back, this is
    no more than the floor, and a lower bound at all times.

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
    away = between(best[:, None, :], paths)
    return np.asarray(np.einsum("upi,p,upj->uij", away, weights, away) + floor)


def fill_covariances(
    known: Floats, scans: NDArray[np.int64], poses: Floats, variances: Floats
) -> Floats:
    """Give every scan a covariance, blended from the known ones before and after.

    Parameters
    ----------
    known : (U, 3, 3) float64
        At the scans `scans`, in their body frames.
    scans : (U,) int64
        Ascending.
    poses : (S, 3) float64
        `map_from_robot` at every scan.
    variances : (S,) float64
        Of the step to every scan [m^2].

    Returns
    -------
    (S, 3, 3) float64
        Both neighbours' errors taken as those of one rigid way; equal to `known` at its scans.
    """
    before, after, share = neighbours(scans, variances)
    s = np.minimum(share, 1.0)[:, None, None]
    from_before = carried(known[before], adjoints(between(poses, poses[scans[before]])))
    from_after = carried(known[after], adjoints(between(poses, poses[scans[after]])))
    return _symmetric((1.0 - s) * from_before + s * from_after)


def carried(covariances: Floats, left: Floats, right: Floats | None = None) -> Floats:
    """Carry covariances (N, 3, 3) by adjoints (N, 3, 3), rows by the left, columns by the right."""
    return np.asarray(left @ covariances @ (left if right is None else right).swapaxes(1, 2))


def _symmetric(covariances: Floats) -> Floats:
    return np.asarray(0.5 * (covariances + covariances.swapaxes(1, 2)))
