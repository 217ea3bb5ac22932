# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Initialisation of pose-graph optimisation: spanning tree, and linear rotations-first solutions.

In the plane the headings alone are almost a linear problem. With them fixed, the positions are
exactly one (Carlone, Tron, Daniilidis, Dellaert, "Initialization techniques for 3D SLAM", ICRA
2015, section III, specialised to SE(2)).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import breadth_first_order
from scipy.sparse.linalg import splu

from slarm_graph.constraint import PoseGraph
from slarm_graph.geometry import Floats, compose, invert, wrap_angles


@dataclass(frozen=True, slots=True)
class _Edges:
    """The constraints of a graph as arrays.

    Parameters
    ----------
    i, j : (M,) int64
    measured : (M, 3) float64
        `i_from_j` [m, m, rad].
    rotation_weight, position_weight : (M,) float64
        Inverse variances [1/rad^2, 1/m^2].
    """

    i: NDArray[np.int64]
    j: NDArray[np.int64]
    measured: Floats
    rotation_weight: Floats
    position_weight: Floats


def starting_poses(graph: PoseGraph) -> Iterator[tuple[str, Floats]]:
    """Yield names and initial poses (N, 3), pose 0 unchanged."""
    yield "the given poses", graph.poses
    if len(graph.constraints) < len(graph.poses):
        return
    edges = _edges(graph)
    tree = spanning_tree_poses(graph)
    yield "a spanning tree", tree
    chordal = chordal_headings(graph.poses[0, 2], len(graph.poses), edges)
    yield "averaged rotations", _with_positions(graph.poses[0], chordal, edges)
    refined = unwrapped_headings(tree[:, 2], edges)
    yield "unwrapped headings", _with_positions(graph.poses[0], refined, edges)


def spanning_tree_poses(graph: PoseGraph) -> Floats:
    """Chain measurements (N, 3) outward from pose 0 along the fewest constraints."""
    edges, count = _edges(graph), len(graph.poses)
    pairs = np.concatenate([np.stack([edges.i, edges.j]), np.stack([edges.j, edges.i])], axis=1)
    both = np.concatenate([edges.measured, invert(edges.measured)])
    # The last of parallel constraints wins; entry k + 1 keeps 0 for "no constraint".
    label = {(int(a), int(b)): k for k, (a, b) in enumerate(pairs.T)}
    links = sparse.csr_matrix((np.ones(pairs.shape[1]), (pairs[0], pairs[1])), (count, count))
    order, parents = breadth_first_order(links, 0, directed=False)
    poses = graph.poses.copy()
    for key in order[1:]:
        parent = int(parents[key])
        poses[key] = compose(poses[parent], both[label[parent, int(key)]])
    return poses


def chordal_headings(first_rad: float, count: int, edges: _Edges) -> Floats:
    """Headings (N,) [rad] by chordal relaxation: unit complex numbers, unit length dropped.

    Minimises the sum of `w |z_j - z_i exp(i theta_ij)|^2` with `z_0` given, one sparse solve.
    """
    w, turn = edges.rotation_weight, np.exp(1j * edges.measured[:, 2])
    rows = np.concatenate([edges.i, edges.j, edges.j, edges.i])
    cols = np.concatenate([edges.i, edges.j, edges.i, edges.j])
    data = np.concatenate([w, w, -w * turn, -w * np.conj(turn)])
    normal = sparse.csc_matrix((data, (rows, cols)), (count, count))
    fixed = np.exp(1j * first_rad)
    z = splu(normal[1:, 1:].tocsc()).solve(-normal[1:, :1].toarray().ravel() * fixed)
    return np.concatenate([[first_rad], np.angle(z)])


def unwrapped_headings(guess_rad: Floats, edges: _Edges) -> Floats:
    """Headings (N,) [rad] by iterated linear least squares, unwrapped by a guess."""
    headings = guess_rad.copy()
    for _ in range(10):
        residual = wrap_angles(edges.measured[:, 2] - (headings[edges.j] - headings[edges.i]))
        step = _laplacian_solve(len(headings), edges, edges.rotation_weight, residual)
        headings = headings + step
        if np.abs(step).max() < 1e-9:
            break
    return np.asarray(wrap_angles(headings))


def _with_positions(first: Floats, headings: Floats, edges: _Edges) -> Floats:
    """Poses (N, 3) with the least-squares positions for given headings."""
    c, s = np.cos(headings[edges.i]), np.sin(headings[edges.i])
    dx, dy = edges.measured[:, 0], edges.measured[:, 1]
    count, w = len(headings), edges.position_weight
    x = _laplacian_solve(count, edges, w, c * dx - s * dy)
    y = _laplacian_solve(count, edges, w, s * dx + c * dy)
    poses = np.stack([x + first[0], y + first[1], wrap_angles(headings)], axis=1)
    poses[0] = first
    return poses


def _laplacian_solve(count: int, edges: _Edges, weights: Floats, step: Floats) -> Floats:
    """Minimise the sum of `w (v_j - v_i - step)^2` with `v_0 = 0`; returns (N,)."""
    i, j = edges.i, edges.j
    rows, cols = np.concatenate([i, j, i, j]), np.concatenate([i, j, j, i])
    data = np.concatenate([weights, weights, -weights, -weights])
    normal = sparse.csc_matrix((data, (rows, cols)), (count, count))
    right = np.zeros(count)
    np.add.at(right, j, weights * step)
    np.add.at(right, i, -weights * step)
    return np.concatenate([[0.0], splu(normal[1:, 1:].tocsc()).solve(right[1:])])


def _edges(graph: PoseGraph) -> _Edges:
    constraints = graph.constraints
    covariances = np.array([c.covariance for c in constraints])
    return _Edges(
        np.array([c.i for c in constraints], dtype=np.int64),
        np.array([c.j for c in constraints], dtype=np.int64),
        np.array([(c.i_from_j.x, c.i_from_j.y, c.i_from_j.theta) for c in constraints]),
        1.0 / covariances[:, 2, 2],
        2.0 / (covariances[:, 0, 0] + covariances[:, 1, 1]),
    )
