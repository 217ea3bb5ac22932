# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Finds of old places that tell the same story, and those that contradict what is believed.

Pairwise consistency: Mangelson, Dominic, Eustice and Vasudevan, "Pairwise Consistent Measurement
Set Maximization for Robust Multi-robot Map Merging", ICRA 2018.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import networkx as nx
import numpy as np
from numpy.typing import NDArray

from slarm_graph.backends.submap_graph import FAR_OFF, SubmapGraph
from slarm_graph.frontends.scans.closures import Closure
from slarm_graph.frontends.scans.significance import CHI2_1_PERCENT
from slarm_graph.frontends.scans.small_pose import log_det_2pi, squared_mahalanobis
from slarm_graph.geometry import Floats, adjoints, between, compose, invert

_LEAST_SET = 3
"""Finds that must agree: two may by chance where a corridor repeats itself."""
_SPAN_M = 2.0
"""Way that a set must span; from one place all finds may err alike."""
_LEAST_FOLLOWED, _SPAN_FOLLOWED_M = 4, 6.0
"""Finds that must agree, and the way that they must span, where most only follow from others: one
more and three times as far, as they begin where they are expected."""
_CLOSURE = np.diag([0.05, 0.05, 0.02]) ** 2
"""What one find may be off by [m, m, rad]: a cell, and what a cell is at 2.5 m."""
_NEIGHBOURS_M = 40.0
"""Way between two finds up to which drift leaves the comparison of them sharp."""
GRAPH_SPEAKS_NAT = 5.0
"""Evidence from which the graph itself counts as one of them: the odds of 150 to 1 that a find
needs. Without that one of six draws of edmonton is 0.99 m in place of 0.76, one ward 0.027 in place
of 0.020, one hall 0.066 in place of 0.077; a dozen others stay."""
SIDEWAYS_M = 10.0
"""Distance from which two submaps may still show the same."""

Pairs = NDArray[np.int64]
"""Indices (P, 2) of two finds each."""


def consistent_sets(found: Sequence[Closure], graph: SubmapGraph) -> list[Closure]:
    """Return the finds that tell the same story as others.

    Parameters
    ----------
    found : sequence of Closure
    graph : SubmapGraph

    Returns
    -------
    list of Closure
        Members of sets of at least three that agree pair by pair over the ways between them.
    """
    near, links = nx.Graph(), nx.Graph()
    pairs = _neighbours(found, graph)
    near.add_edges_from(pairs.tolist())
    # The library weighs in whole numbers.
    links.add_nodes_from((k, {"permille": round(1000 * c.score)}) for k, c in enumerate(found))
    links.add_edges_from(pairs[agreeing(found, pairs, graph)].tolist())
    believed: set[int] = set()
    parts = [set(part) for part in nx.connected_components(links)]
    while parts:
        part = parts.pop()
        # A copy: a view looks through all finds at every look-up.
        story = _largest_set(links.subgraph(part).copy(), found, graph)
        if story:
            believed |= story
            # Others tell of other ways; what mostly disagrees with this story goes with it.
            others = {k for k in part - story if not _disagrees(k, story, near, links)}
            parts += [set(p) for p in nx.connected_components(links.subgraph(others))]
    return [found[k] for k in sorted(believed)]


def stories(found: Sequence[Closure], graph: SubmapGraph) -> list[list[Closure]]:
    """Part finds into those that hang together by agreeing, pair by pair."""
    links, pairs = nx.Graph(), _neighbours(found, graph)
    links.add_nodes_from(range(len(found)))
    links.add_edges_from(pairs[agreeing(found, pairs, graph)].tolist())
    return [[found[k] for k in sorted(part)] for part in nx.connected_components(links)]


def disputed(graph: SubmapGraph) -> list[Closure]:
    """Return the believed closures that some find disagrees with which was turned down."""
    met = [c for c in graph.closures if not c.reason or c.reason == FAR_OFF]
    is_held = np.array([not c.reason for c in met], dtype=np.bool_)
    pairs = _neighbours(met, graph)
    contests = pairs[is_held[pairs[:, 0]] != is_held[pairs[:, 1]]]
    against = contests[~agreeing(met, contests, graph)]
    return [met[k] for k in np.unique(against).tolist() if is_held[k]]


def _disagrees(k: int, story: set[int], near: nx.Graph, links: nx.Graph) -> bool:
    """Whether a find agrees with fewer than half of those finds of a story that lie near it."""
    return 2 * len(story.intersection(links[k])) < len(story.intersection(near[k]))


def _neighbours(found: Sequence[Closure], graph: SubmapGraph) -> Pairs:
    """Return the pairs (P, 2) of finds near each other along both ways, the later one first."""
    ways = np.array([(graph.way_of_submap(c.submap), graph.way_of(c.keyframe)) for c in found])
    near = [
        np.flatnonzero((np.abs(ways[:a] - ways[a]) <= _NEIGHBOURS_M).all(axis=1))
        for a in range(len(found))
    ]
    later = np.repeat(np.arange(len(found)), [len(earlier) for earlier in near])
    return np.column_stack([later, np.concatenate([*near, np.zeros(0, dtype=np.int64)])])


def _largest_set(links: nx.Graph, found: Sequence[Closure], graph: SubmapGraph) -> set[int]:
    """Return all that agree with the best core that agrees in itself and spans a way."""
    core = nx.max_weight_clique(links, "permille")[0] if len(links) <= 60 else _greedy(links)
    ways = [graph.way_of(found[k].keyframe) for k in core]
    # Where the graph is sure, it tells the same story as one find more.
    told = any(speaks_for_nat(graph, found[k], SIDEWAYS_M) > GRAPH_SPEAKS_NAT for k in core)
    independent = told + sum(found[k].searched for k in core) >= _LEAST_SET
    least, span_m = (_LEAST_SET, _SPAN_M) if independent else (_LEAST_FOLLOWED, _SPAN_FOLLOWED_M)
    if told + len(core) < least or max(ways) - min(ways) < span_m:
        return set()
    return {k for k in links if sum(links.has_edge(k, c) for c in core) >= 0.5 * len(core)} | set(
        core
    )


def _greedy(links: nx.Graph) -> list[int]:
    """Grow a set from the find that agrees with most others: for many finds."""
    core: list[int] = []
    for k in sorted(links, key=lambda n: -links.degree(n)):
        if all(links.has_edge(k, c) for c in core):
            core.append(k)
    return core


def speaks_for_nat(graph: SubmapGraph, closure: Closure, within_m: float) -> float:
    """Log-likelihood ratio that a closure is where the graph has it, over anywhere near.

    Parameters
    ----------
    graph : SubmapGraph
    closure : Closure
    within_m : float
        Radius of the disc in which a false one would lie, turned by anything.
    """
    miss, covariance = graph.miss(closure)
    anywhere = math.log(2.0 * math.pi**2 * within_m**2)
    return anywhere - 0.5 * (squared_mahalanobis(miss, covariance) + log_det_2pi(covariance))


def agreeing(found: Sequence[Closure], pairs: Pairs, graph: SubmapGraph) -> NDArray[np.bool_]:
    """Whether two finds close a small loop: along the old way, across, back along the new way.

    Parameters
    ----------
    found : sequence of Closure
    pairs : (P, 2) int64
        Indices of two finds each.
    graph : SubmapGraph

    Returns
    -------
    (P,) bool
        Two of one keyframe do not: a scan cannot confirm itself.
    """
    keyframes, submaps = graph.keyframes, graph.submaps
    at = np.array([c.keyframe for c in found], dtype=np.int64)[pairs.T]
    old, new, across = (
        np.array(poses).reshape(-1, 3)[pairs.T]
        for poses in (
            [keyframes[submaps[c.submap].anchor].local_from_robot.as_array() for c in found],
            [keyframes[c.keyframe].local_from_robot.as_array() for c in found],
            [c.submap_from_keyframe for c in found],
        )
    )
    one, other = compose(across[0], between(*new)), compose(between(*old), across[1])
    spread = _CLOSURE + _carried(_CLOSURE, between(new[1], new[0]))
    nodes = np.array([graph.node_of(c.keyframe) for c in found], dtype=np.int64)[pairs.T]
    spread = spread + graph.drifts(*nodes)
    targets = np.array([c.submap for c in found], dtype=np.int64)[pairs.T]
    spread = spread + _carried(graph.drifts(*targets), invert(across[1]))
    miss = between(one, other)
    squared = np.einsum("pi,pi->p", miss, np.linalg.solve(spread, miss[..., None])[..., 0])
    return np.asarray((squared < CHI2_1_PERCENT) & (at[0] != at[1]))


def _carried(covariances: Floats, poses: Floats) -> Floats:
    """Covariances (P, 3, 3), or one, in the frames that poses (P, 3) lead from."""
    carry = adjoints(poses)
    return np.asarray(carry @ covariances @ carry.transpose(0, 2, 1))
