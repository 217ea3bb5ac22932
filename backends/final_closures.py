# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Offline loop closure over a whole recording: place recognition, alignment, consistent sets.

While driving, loop closures are searched for near the estimated pose. Once the recording has ended,
every node is compared with those of similar appearance, wherever they are. Aligned candidates are
accepted in pairwise-consistent sets, and the search repeats with the corrected poses until nothing
new is found.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from slarm_graph.backend import Heartbeat, silent
from slarm_graph.backends.chain_consistency import contradict_both_chains
from slarm_graph.backends.closure_sets import (
    MAX_COVISIBLE_M,
    REVISIT_M,
    consistent_sets,
    contested_closures,
)
from slarm_graph.backends.closure_verification import verify_closures
from slarm_graph.backends.submap_graph import SubmapGraph
from slarm_graph.counts import count_of
from slarm_graph.frontends.scans.closures import COVISIBLE_M, GATE_SIGMAS, Closure
from slarm_graph.frontends.scans.place_recognition import PlaceIndex
from slarm_graph.frontends.scans.submap_matching import SubmapMatcher
from slarm_graph.geometry import Floats, between, compose, transform_points

_ROUNDS = 3
"""Most passes over the recording: each needs the corrections of the one before."""
_RETRIEVED, _ALIGNED = 10, 5
"""Submaps retrieved by appearance for a node, and relative poses of these that are then aligned:
of revisits two in three are among the ten most similar; twice as many find no more."""
_PROPAGATED = 4
"""Nodes that a closure is propagated to on either side, 10 m, and submaps beside its own that these
may match."""
_MAX_SIGMA_M, _MAX_SIGMA_RAD = 0.5, 0.15
"""Uncertainty up to which matching from the predicted pose finds the place without a search."""

_Candidate = tuple[int, int, Floats]
"""Query submap, target submap, and initial guess (3,) of the first in the second [m, m, rad]."""


def close_loops_offline(
    graph: SubmapGraph, matcher: SubmapMatcher, heartbeat: Heartbeat
) -> tuple[SubmapGraph, int]:
    """Find the loop closures missed while driving, and verify all of them.

    Returns
    -------
    graph : SubmapGraph
        The one to use from here on.
    rejected : int
        Pairwise-consistent closures that the gate rejected, and that the chain of matches or of
        odometry alone would allow.
    """
    if len(graph.submaps) < 3:
        return graph, 0
    index = PlaceIndex([matcher.appearance(submap) for submap in range(len(graph.submaps))])
    tried: set[tuple[int, int]] = set()
    gated: list[Closure] = []
    for round_number in range(_ROUNDS):
        graph.optimize_robustly(heartbeat)
        heartbeat(f"looking for old places, round {round_number + 1}")
        candidates = [*_near_candidates(graph, tried), *_similar_candidates(graph, index, tried)]
        aligned = _aligned(matcher, candidates)
        tested = graph.apply_gate([*aligned, *propagated(aligned, graph, matcher)])
        accepted = consistent_sets([c for c in tested if not c.reason], graph)
        gated += [c for c in tested if c.reason]
        if not accepted:
            break
        graph.add_closures(accepted, heartbeat)
    graph.add_closures(gated, heartbeat)
    contested = contested_closures(graph)
    if contested:
        heartbeat(
            f"weighing {count_of(len(contested), 'closure')} against what they had turned down"
        )
        graph = reassess_closures(graph, contested, heartbeat)
    graph = verify_closures(graph, matcher, heartbeat)
    rejected = map(graph.edge, consistent_sets(graph.gated(), graph))
    return graph, contradict_both_chains(rejected, graph.pose_graph().constraints).count(False)


def reassess_closures(
    graph: SubmapGraph, contested: Sequence[Closure], heartbeat: Heartbeat = silent
) -> SubmapGraph:
    """Gate contested and rejected closures anew, against a graph without either.

    So the outcome does not depend on which were accepted first.

    Parameters
    ----------
    graph : SubmapGraph
    contested : sequence of Closure
        Accepted so far.
    heartbeat : Heartbeat
    """
    reassessed = {id(c) for c in (*contested, *graph.gated())}
    other = graph.with_closures([c for c in graph.closures if id(c) not in reassessed])
    other.optimize_robustly(heartbeat)
    readmitted = [replace(c, reason="") for c in graph.closures if id(c) in reassessed]
    other.add_closures(other.apply_gate(readmitted), heartbeat)
    return other


def _aligned(matcher: SubmapMatcher, candidates: Sequence[_Candidate]) -> list[Closure]:
    """Align candidates and return the successful ones, in the order given.

    They are aligned target by target, so that each is prepared once, however small the cache.
    """
    by_target = sorted(range(len(candidates)), key=lambda k: candidates[k][1])
    aligned = {k: matcher.align(*candidates[k]) for k in by_target}
    return [aligned[k] for k in range(len(candidates)) if not aligned[k].reason]


def _near_candidates(graph: SubmapGraph, tried: set[tuple[int, int]]) -> Iterator[_Candidate]:
    """Yield nodes that lie near an old submap with little uncertainty, at the predicted pose."""
    nodes = graph.poses()
    centers = np.array(
        [transform_points(nodes[i], s.center_m) for i, s in enumerate(graph.submaps)]
    )
    for j, old in _without_closure(graph):
        distance_m = np.hypot(*(centers[old] - centers[j]).T)
        i = int(old[np.argmin(distance_m)])
        if distance_m.min() > COVISIBLE_M or (i, j) in tried:
            continue
        sigma_m, sigma_rad = graph.sigmas_between(i, j)
        if sigma_m > _MAX_SIGMA_M or sigma_rad > _MAX_SIGMA_RAD:
            continue
        tried.add((i, j))
        yield j, i, between(nodes[i], nodes[j])


def _similar_candidates(
    graph: SubmapGraph, index: PlaceIndex, tried: set[tuple[int, int]]
) -> Iterator[_Candidate]:
    """Yield nodes and the old submaps of most similar appearance, at the relative pose it gives."""
    nodes = graph.poses()
    for j, old in _without_closure(graph):
        sigmas_m, _ = graph.sigmas_from(j)
        reach_m = GATE_SIGMAS * sigmas_m[old] + COVISIBLE_M
        possible = old[np.hypot(*(nodes[old] - nodes[j])[:, :2].T) < reach_m + MAX_COVISIBLE_M]
        fresh = np.array([i for i in possible.tolist() if (i, j) not in tried], dtype=np.int64)
        if not len(fresh):
            continue
        for match in index.most_similar(j, fresh, _RETRIEVED)[:_ALIGNED]:
            i = match.place
            tried.add((i, j))
            shift = between(between(nodes[i], nodes[j]), match.place_from_query)
            if math.hypot(shift[0], shift[1]) > GATE_SIGMAS * sigmas_m[i] + COVISIBLE_M:
                continue
            yield j, i, match.place_from_query


def propagated(
    closures: Sequence[Closure], graph: SubmapGraph, matcher: SubmapMatcher
) -> Iterator[Closure]:
    """Propagate closures to the nodes before and after, as long as these align as well.

    A true revisit goes on for a few nodes; an aliased place does not.
    """
    met = {(c.submap, graph.node_of(c.keyframe)) for c in closures}
    closed = graph.nodes_with_closure()
    for c in closures:
        for direction in (-1, 1):
            yield from _propagated_one_way(c, direction, graph, matcher, met, closed)


def _propagated_one_way(
    closure: Closure,
    direction: int,
    graph: SubmapGraph,
    matcher: SubmapMatcher,
    met: set[tuple[int, int]],
    closed: set[int],
) -> Iterator[Closure]:
    """Align nodes without a closure next to a closure's, at the pose it predicts, once each."""
    nodes, lengths_m, current = graph.poses()[: len(graph.submaps)], graph.path_lengths_m(), closure
    for _ in range(_PROPAGATED):
        j = graph.node_of(current.keyframe)
        query = j + direction
        if not 0 <= query < len(nodes) or query in closed:
            return
        predicted = compose(current.submap_from_keyframe, between(nodes[j], nodes[query]))
        targets = np.arange(
            max(current.submap - _PROPAGATED, 0), min(current.submap + _PROPAGATED + 1, query)
        )
        targets = targets[lengths_m[targets] < lengths_m[query] - REVISIT_M]
        if not len(targets):
            return
        old = between(nodes[current.submap], nodes[targets])
        k = int(np.argmin(np.hypot(*(old - predicted)[:, :2].T)))
        i = int(targets[k])
        if (i, query) in met:
            return
        current = matcher.align(query, i, between(old[k], predicted))
        if current.reason:
            return
        met.add((i, query))
        yield replace(current, searched=False)


def _without_closure(graph: SubmapGraph) -> Iterator[tuple[int, NDArray[np.int64]]]:
    """Yield nodes that no closure ties to an older one, with the submaps a revisit may match."""
    lengths_m, closed = graph.path_lengths_m(), graph.nodes_with_closure()
    for j in range(len(graph.submaps)):
        old = np.flatnonzero(lengths_m[: len(graph.submaps)] < lengths_m[j] - REVISIT_M)
        if len(old) and j not in closed:
            yield j, old
