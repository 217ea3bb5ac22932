# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Pairwise-consistent sets of loop closures, and accepted closures that rejected ones contest.

Pairwise consistency: Mangelson, Dominic, Eustice and Vasudevan, "Pairwise Consistent Measurement
Set Maximization for Robust Multi-robot Map Merging", ICRA 2018.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import networkx as nx
import numpy as np
from numpy.typing import NDArray

from slarm_graph.backends.submap_graph import GATED, SubmapGraph
from slarm_graph.frontends.scans.closures import Closure
from slarm_graph.frontends.scans.significance import CHI2_1_PERCENT, DECISIVE_NAT
from slarm_graph.frontends.scans.small_pose import log_det_2pi, squared_mahalanobis
from slarm_graph.geometry import between, compose, invert, transform_covariances

_MIN_SET = 3
"""Closures that must agree: two may by chance where a corridor repeats itself."""
_MIN_SPAN_M = 2.0
"""Path length that a set must span; from one place all closures may err alike."""
_MIN_PROPAGATED_SET, _MIN_PROPAGATED_SPAN_M = 4, 6.0
"""Size and span of a set most of which was propagated from other closures (see
`final_closures.propagated`): one more and three times as far, as they start where expected."""
_CLOSURE_COVARIANCE = np.diag([0.05, 0.05, 0.02]) ** 2
"""Of one closure [m, m, rad]: a cell, and what a cell subtends at 2.5 m."""
_NEIGHBOURS_M = 40.0
"""Path length between two closures up to which drift leaves the test of them sharp."""
_EXACT_CLIQUE = 60
"""Closures up to which the best clique is found exactly: a tenth of a second where 90 % of the
pairs agree, ten with twice as many."""
MAX_COVISIBLE_M = 10.0
"""Distance up to which two submaps may show the same walls."""
REVISIT_M = 15.0
"""Path length from which a return is a revisit, and within which a closure decides what overlaps:
the local map has dropped what lies farther behind."""

Pairs = NDArray[np.int64]
"""Indices (P, 2) of two closures each."""


def consistent_sets(closures: Sequence[Closure], graph: SubmapGraph) -> list[Closure]:
    """Return the closures that belong to a pairwise-consistent set.

    Parameters
    ----------
    closures : sequence of Closure
    graph : SubmapGraph

    Returns
    -------
    list of Closure
        Members of sets of at least three, consistent pair by pair given the odometry between them.
    """
    near, agree = nx.Graph(), nx.Graph()
    pairs = _neighbour_pairs(closures, graph)
    near.add_edges_from(pairs.tolist())
    # networkx takes integer weights only.
    agree.add_nodes_from((k, {"permille": round(1000 * c.score)}) for k, c in enumerate(closures))
    agree.add_edges_from(pairs[pairwise_consistent(closures, pairs, graph)].tolist())
    accepted: set[int] = set()
    components = [set(part) for part in nx.connected_components(agree)]
    while components:
        component = components.pop()
        # A copy: a view looks through all closures at every look-up.
        inliers = _largest_set(agree.subgraph(component).copy(), closures, graph)
        if inliers:
            accepted |= inliers
            # The rest may hold further sets, less what mostly contradicts this one.
            rest = {k for k in component - inliers if not _disagrees(k, inliers, near, agree)}
            components += [set(p) for p in nx.connected_components(agree.subgraph(rest))]
    return [closures[k] for k in sorted(accepted)]


def agreeing_groups(closures: Sequence[Closure], graph: SubmapGraph) -> list[list[Closure]]:
    """Partition closures into the connected components of their pairwise consistency."""
    agree, pairs = nx.Graph(), _neighbour_pairs(closures, graph)
    agree.add_nodes_from(range(len(closures)))
    agree.add_edges_from(pairs[pairwise_consistent(closures, pairs, graph)].tolist())
    return [[closures[k] for k in sorted(part)] for part in nx.connected_components(agree)]


def contested_closures(graph: SubmapGraph) -> list[Closure]:
    """Return the accepted closures that are inconsistent with one the chi-square gate rejected."""
    candidates = [c for c in graph.closures if not c.reason or c.reason == GATED]
    is_accepted = np.array([not c.reason for c in candidates], dtype=np.bool_)
    pairs = _neighbour_pairs(candidates, graph)
    mixed = pairs[is_accepted[pairs[:, 0]] != is_accepted[pairs[:, 1]]]
    inconsistent = mixed[~pairwise_consistent(candidates, mixed, graph)]
    return [candidates[k] for k in np.unique(inconsistent).tolist() if is_accepted[k]]


def _disagrees(k: int, inliers: set[int], near: nx.Graph, agree: nx.Graph) -> bool:
    """Whether a closure is consistent with fewer than half of the members of a set near it."""
    return 2 * len(inliers.intersection(agree[k])) < len(inliers.intersection(near[k]))


def _neighbour_pairs(closures: Sequence[Closure], graph: SubmapGraph) -> Pairs:
    """Return the pairs (P, 2) of closures near each other along the path at both ends.

    The later one comes first.
    """
    lengths_m = np.array(
        [
            (graph.path_length_at_submap(c.submap), graph.path_length_at(c.keyframe))
            for c in closures
        ]
    )
    near = [
        np.flatnonzero((np.abs(lengths_m[:a] - lengths_m[a]) <= _NEIGHBOURS_M).all(axis=1))
        for a in range(len(closures))
    ]
    later = np.repeat(np.arange(len(closures)), [len(earlier) for earlier in near])
    return np.column_stack([later, np.concatenate([*near, np.zeros(0, dtype=np.int64)])])


def _largest_set(agree: nx.Graph, closures: Sequence[Closure], graph: SubmapGraph) -> set[int]:
    """Return the best clique and all that agree with half of it; empty when it is too small."""
    is_small = len(agree) <= _EXACT_CLIQUE
    core = nx.max_weight_clique(agree, "permille")[0] if is_small else _greedy_clique(agree)
    lengths_m = [graph.path_length_at(closures[k].keyframe) for k in core]
    # Where the graph itself is certain, it counts as one more member.
    graph_agrees = any(
        log_odds_nat(graph, closures[k], MAX_COVISIBLE_M) > DECISIVE_NAT for k in core
    )
    is_independent = graph_agrees + sum(closures[k].searched for k in core) >= _MIN_SET
    least, span_m = (
        (_MIN_SET, _MIN_SPAN_M) if is_independent else (_MIN_PROPAGATED_SET, _MIN_PROPAGATED_SPAN_M)
    )
    if graph_agrees + len(core) < least or max(lengths_m) - min(lengths_m) < span_m:
        return set()
    return {k for k in agree if sum(agree.has_edge(k, c) for c in core) >= 0.5 * len(core)} | set(
        core
    )


def _greedy_clique(agree: nx.Graph) -> list[int]:
    """Grow a clique in the order of node degree: for many closures."""
    core: list[int] = []
    for k in sorted(agree, key=lambda n: -agree.degree(n)):
        if all(agree.has_edge(k, c) for c in core):
            core.append(k)
    return core


def log_odds_nat(graph: SubmapGraph, closure: Closure, within_m: float) -> float:
    """Log-likelihood ratio [nat] of a closure under the graph's estimate over a uniform pose.

    Parameters
    ----------
    graph : SubmapGraph
    closure : Closure
    within_m : float
        Radius of the disc over which a false one would be uniform, its heading over the circle.
    """
    residual, covariance = graph.residual(closure)
    log_area = math.log(2.0 * math.pi**2 * within_m**2)
    return log_area - 0.5 * (squared_mahalanobis(residual, covariance) + log_det_2pi(covariance))


def pairwise_consistent(
    closures: Sequence[Closure], pairs: Pairs, graph: SubmapGraph
) -> NDArray[np.bool_]:
    """Chi-square test of the loop that two closures and the odometry between them make.

    Parameters
    ----------
    closures : sequence of Closure
    pairs : (P, 2) int64
        Indices of two closures each.
    graph : SubmapGraph

    Returns
    -------
    (P,) bool
        False for two of one keyframe: a scan cannot confirm itself.
    """
    keyframes, submaps = graph.keyframes, graph.submaps
    keyframe = np.array([c.keyframe for c in closures], dtype=np.int64)[pairs.T]
    old, new, measured = (
        np.array(poses).reshape(-1, 3)[pairs.T]
        for poses in (
            [keyframes[submaps[c.submap].anchor].local_from_robot.as_array() for c in closures],
            [keyframes[c.keyframe].local_from_robot.as_array() for c in closures],
            [c.submap_from_keyframe for c in closures],
        )
    )
    one, other = compose(measured[0], between(*new)), compose(between(*old), measured[1])
    nodes = np.array([graph.node_of(c.keyframe) for c in closures], dtype=np.int64)[pairs.T]
    targets = np.array([c.submap for c in closures], dtype=np.int64)[pairs.T]
    covariance = (
        _CLOSURE_COVARIANCE
        + transform_covariances(between(new[1], new[0]), _CLOSURE_COVARIANCE)
        + graph.dead_reckoning_covariances(*nodes)
        + transform_covariances(invert(measured[1]), graph.dead_reckoning_covariances(*targets))
    )
    residual = between(one, other)
    squared = np.einsum(
        "pi,pi->p", residual, np.linalg.solve(covariance, residual[..., None])[..., 0]
    )
    return np.asarray((squared < CHI2_1_PERCENT) & (keyframe[0] != keyframe[1]))
