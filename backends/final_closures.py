# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Loop closures over a whole recording: found by how places look, believed as consistent sets.

While driving, old places are looked for where the robot is believed to be. Once the recording has
ended, every node is compared with those that look like it, wherever they are; what is found is
believed where several finds tell the same story (pairwise consistency: Mangelson, Dominic, Eustice
and Vasudevan, "Pairwise Consistent Measurement Set Maximization for Robust Multi-robot Map
Merging", ICRA 2018), and again with the corrected poses until nothing new is found.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import networkx as nx
import numpy as np

from slarm_graph.backend import Heartbeat
from slarm_graph.backends.submap_graph import SubmapGraph
from slarm_graph.frontends.scans.closures import Closure
from slarm_graph.frontends.scans.loop_closure import LoopCloser
from slarm_graph.frontends.scans.place_recognition import describe
from slarm_graph.geometry import Floats, between, compose, transform_points, wrap_angles

_ROUNDS = 3
"""Most passes over the recording: each needs the corrections of the one before."""
_ALIKE = 3
"""Submaps looked at per node: of revisits, half are among the three most alike."""
_APART_M = 15.0
"""Way from which a return is a revisit: the local map has forgotten what lies behind."""
_SURE_M, _SURE_RAD = 0.5, 0.15
"""Uncertainty up to which matching from the expected pose finds the place without a search."""
_HEADING_VARIANCE_PER_M, _POSITION_VARIANCE_PER_M = 2e-5, 1e-4
"""Drift of lidar odometry, as in `graph_reach`."""
_CONSISTENT = 11.34
"""Chi-square quantile of 99 % for 3 degrees of freedom."""
_CLOSURE_M, _CLOSURE_RAD = 0.05, 0.02
"""What one find may be off by: a cell, and what a cell is at 2.5 m."""
_NEIGHBOURS_M = 40.0
"""Way between two finds up to which drift leaves the comparison of them sharp."""
_LEAST_SET = 3
"""Finds that must agree: two may by chance where a corridor repeats itself."""
_SPAN_M = 2.0
"""Way that a set must span; from one place all finds may err alike."""


def close_finally(graph: SubmapGraph, closer: LoopCloser, heartbeat: Heartbeat) -> None:
    """Find what was missed while driving, until nothing new is found."""
    if len(graph.submaps) < 3:
        return
    looks = descriptors(graph)
    tried: set[tuple[int, int]] = set()
    for round_number in range(_ROUNDS):
        graph.settle(heartbeat)
        heartbeat(f"looking for old places, round {round_number + 1}")
        found = [*_near(graph, closer, tried), *_alike(graph, closer, looks, tried)]
        believed = consistent_sets(found, graph)
        if not believed:
            break
        graph.close(believed, heartbeat)


def descriptors(graph: SubmapGraph) -> Floats:
    """Return how every submap looks, (S, D)."""
    rows = []
    for submap in graph.submaps:
        anchor = graph.keyframes[submap.anchor].local_from_robot.as_array()
        parts = [
            transform_points(between(anchor, m.local_from_robot.as_array()), m.points_m)
            for m in graph.keyframes[submap.first : submap.last]
        ]
        points = np.concatenate(parts)
        near = np.hypot(*(points - submap.center_m).T) < 14.0
        rows.append(describe(points[near] if near.any() else points))
    return np.array(rows)


def _near(graph: SubmapGraph, closer: LoopCloser, tried: set[tuple[int, int]]) -> Iterator[Closure]:
    """Compare nodes with old submaps that the graph is sure they are near."""
    nodes, ways = graph.poses(), graph.ways_m()
    centers = np.array(
        [transform_points(nodes[i], s.center_m) for i, s in enumerate(graph.submaps)]
    )
    linked = graph.linked()
    for j in range(len(graph.submaps)):
        old = np.flatnonzero(ways[: len(centers)] < ways[j] - _APART_M)
        if not len(old) or j in linked:
            continue
        away = np.hypot(*(centers[old] - centers[j]).T)
        i = int(old[np.argmin(away)])
        if away.min() > 3.0 or (i, j) in tried:
            continue
        sigma_m, sigma_rad = graph.sigmas_between(i, j)
        if sigma_m > _SURE_M or sigma_rad > _SURE_RAD:
            continue
        tried.add((i, j))
        k = graph.first_of(j)
        found = closer.compare(k, i, between(nodes[i], nodes[j]), graph.keyframes, graph.submaps)
        if not found.reason:
            yield found


def _alike(
    graph: SubmapGraph, closer: LoopCloser, looks: Floats, tried: set[tuple[int, int]]
) -> Iterator[Closure]:
    """Search nodes in the submaps that look most like their own."""
    ways, linked, nodes = graph.ways_m(), graph.linked(), graph.poses()
    for j in range(len(graph.submaps)):
        old = np.flatnonzero(ways[: len(looks)] < ways[j] - _APART_M)
        if not len(old) or j in linked:
            continue
        likeness = looks[old] @ looks[j]
        for i in old[np.argsort(-likeness)][:_ALIKE].tolist():
            if (i, j) in tried or not _possible(graph, nodes, i, j):
                continue
            tried.add((i, j))
            found = closer.look(graph.last_of(j), i, graph.keyframes, graph.submaps)
            if found is not None and not found.reason:
                yield found


def _possible(graph: SubmapGraph, nodes: Floats, i: int, j: int) -> bool:
    """Whether two nodes may be near each other for all that is known of their poses."""
    sigma_m, _ = graph.sigmas_between(i, j)
    return float(np.hypot(*(nodes[i] - nodes[j])[:2])) < 10.0 + 4.0 * sigma_m


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
    links = nx.Graph()
    links.add_nodes_from(range(len(found)))
    for a in range(len(found)):
        for b in range(a):
            if agree(found[a], found[b], graph):
                links.add_edge(a, b)
    believed: set[int] = set()
    for part in list(nx.connected_components(links)):
        if len(part) >= _LEAST_SET:
            believed |= _largest_set(links.subgraph(part), found, graph)
    return [found[k] for k in sorted(believed)]


def _largest_set(links: nx.Graph, found: Sequence[Closure], graph: SubmapGraph) -> set[int]:
    """Return all that agree with a core that agrees in itself and spans a way."""
    core = max(nx.find_cliques(links), key=len) if len(links) <= 60 else _greedy(links)
    ways = [graph.way_of(found[k].keyframe) for k in core]
    if len(core) < _LEAST_SET or max(ways) - min(ways) < _SPAN_M:
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


def agree(a: Closure, b: Closure, graph: SubmapGraph) -> bool:
    """Whether two finds close a small loop: along the old way, across, back along the new way."""
    old_m = abs(graph.way_of_submap(a.submap) - graph.way_of_submap(b.submap))
    new_m = abs(graph.way_of(a.keyframe) - graph.way_of(b.keyframe))
    if max(old_m, new_m) > _NEIGHBOURS_M or a.keyframe == b.keyframe:
        return False
    keyframes, submaps = graph.keyframes, graph.submaps
    old_a, old_b = (keyframes[submaps[c.submap].anchor].local_from_robot.as_array() for c in (a, b))
    new_a, new_b = (keyframes[c.keyframe].local_from_robot.as_array() for c in (a, b))
    one = compose(a.submap_from_keyframe, between(new_a, new_b))
    other = compose(between(old_a, old_b), b.submap_from_keyframe)
    miss = between(one, other)
    way_m = old_m + new_m
    turn2 = 2.0 * _CLOSURE_RAD**2 + _HEADING_VARIANCE_PER_M * way_m
    place2 = 2.0 * _CLOSURE_M**2 + _POSITION_VARIANCE_PER_M * way_m + turn2 * (0.5 * way_m) ** 2
    turn = float(wrap_angles(miss[2]))
    away2 = float(miss[0] ** 2 + miss[1] ** 2)
    return away2 / place2 + turn**2 / turn2 < _CONSISTENT
