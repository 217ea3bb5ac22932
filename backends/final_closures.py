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

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import networkx as nx
import numpy as np
from numpy.typing import NDArray

from slarm_graph.backend import Heartbeat
from slarm_graph.backends.submap_graph import FAR_OFF, SubmapGraph
from slarm_graph.frontends.scans.closures import SIGMAS, Closure
from slarm_graph.frontends.scans.place_recognition import Appearance, PlaceIndex, appearance_of
from slarm_graph.frontends.scans.small_pose import squared_sigmas
from slarm_graph.frontends.scans.submap_matching import SubmapMatcher
from slarm_graph.geometry import Floats, adjoints, between, compose, invert, transform_points

_ROUNDS = 3
"""Most passes over the recording: each needs the corrections of the one before."""
_ALIKE, _ALIGNED = 10, 5
"""Submaps whose pictures are compared with a node's, and ways to lie on one that are then aligned:
of revisits two in three are among the ten most alike; twice as many find no more."""
_FOLLOWED = 4
"""Nodes that a find is followed by to either side, 10 m, and submaps beside its own that these may
lie on."""
_LEAST_FOLLOWED, _SPAN_FOLLOWED_M = 4, 6.0
"""Finds that must agree, and the way that they must span, where most only follow from others: one
more and three times as far, as they begin where they are expected."""
_APART_M = 15.0
"""Way from which a return is a revisit: the local map has forgotten what lies behind."""
_SURE_M, _SURE_RAD = 0.5, 0.15
"""Uncertainty up to which matching from the expected pose finds the place without a search."""
_SEEN_TOGETHER_M = 3.0
"""Distance of submaps that show the same."""
_SIDEWAYS_M = 10.0
"""Distance from which two submaps may still show the same."""
_CONSISTENT = 11.34
"""Chi-square quantile of 99 % for 3 degrees of freedom."""
_CLOSURE = np.diag([0.05, 0.05, 0.02]) ** 2
"""What one find may be off by [m, m, rad]: a cell, and what a cell is at 2.5 m."""
_NEIGHBOURS_M = 40.0
"""Way between two finds up to which drift leaves the comparison of them sharp."""
_LEAST_SET = 3
"""Finds that must agree: two may by chance where a corridor repeats itself."""
_GRAPH_SPEAKS_NAT = 5.0
"""Evidence from which the graph itself counts as one of them: the odds of 150 to 1 that a find
needs. Without that one of six draws of edmonton is 0.99 m in place of 0.76, one ward 0.027 in place
of 0.020, one hall 0.066 in place of 0.077; a dozen others stay."""
_SPAN_M = 2.0
"""Way that a set must span; from one place all finds may err alike."""

_Question = tuple[int, int, Floats]
"""Whether one submap lies in another at a pose (3,) [m, m, rad]."""


def close_finally(graph: SubmapGraph, matcher: SubmapMatcher, heartbeat: Heartbeat) -> int:
    """Find what was missed while driving, until nothing new is found.

    Returns
    -------
    rivals : int
        Finds that agree with each other and not with the graph: what it turned down.
    """
    if len(graph.submaps) < 3:
        return 0
    index = PlaceIndex([_appearance(matcher, submap) for submap in range(len(graph.submaps))])
    tried: set[tuple[int, int]] = set()
    far_off: list[Closure] = []
    for round_number in range(_ROUNDS):
        graph.settle(heartbeat)
        heartbeat(f"looking for old places, round {round_number + 1}")
        asked = [*_near(graph, tried), *_alike(graph, index, tried)]
        found = _aligned(matcher, asked)
        judged = graph.judged([*found, *followed(found, graph, matcher)])
        believed = consistent_sets([c for c in judged if not c.reason], graph)
        far_off += [c for c in judged if c.reason]
        if not believed:
            break
        graph.close(believed, heartbeat)
    graph.close(far_off, heartbeat)
    open_again = disputed(graph)
    if open_again:
        heartbeat(f"weighing {len(open_again)} closures against what they had turned down")
        graph.reopen(open_again, heartbeat)
    return len(consistent_sets([c for c in graph.closures if c.reason == FAR_OFF], graph))


def disputed(graph: SubmapGraph) -> list[Closure]:
    """Return the believed closures that some find disagrees with which was turned down."""
    met = [c for c in graph.closures if not c.reason or c.reason == FAR_OFF]
    against: set[int] = set()
    for pair in _neighbours(met, graph):
        held, other = sorted(pair, key=lambda k: met[k].reason)
        is_contest = met[other].reason and not met[held].reason
        if is_contest and not agree(met[held], met[other], graph):
            against.add(held)
    return [met[k] for k in sorted(against)]


def _appearance(matcher: SubmapMatcher, submap: int) -> Appearance:
    """Describe a submap with its neighbours, around the middle of its own returns."""
    middle = np.median(matcher.points_of(matcher.region(submap, 0)), axis=0)
    return appearance_of(matcher.points_of(matcher.region(submap)), middle)


def _aligned(matcher: SubmapMatcher, asked: Sequence[_Question]) -> list[Closure]:
    """Return what aligns, in the order asked; each target's questions follow on each other.

    So a target is prepared once, however few are kept.
    """
    by_target = sorted(range(len(asked)), key=lambda k: asked[k][1])
    found = {k: matcher.align(*asked[k]) for k in by_target}
    return [found[k] for k in range(len(asked)) if not found[k].reason]


def _near(graph: SubmapGraph, tried: set[tuple[int, int]]) -> Iterator[_Question]:
    """Ask for nodes in old submaps that the graph is sure they are near."""
    nodes = graph.poses()
    centers = np.array(
        [transform_points(nodes[i], s.center_m) for i, s in enumerate(graph.submaps)]
    )
    for j, old in _unlinked(graph):
        away = np.hypot(*(centers[old] - centers[j]).T)
        i = int(old[np.argmin(away)])
        if away.min() > _SEEN_TOGETHER_M or (i, j) in tried:
            continue
        sigma_m, sigma_rad = graph.sigmas_between(i, j)
        if sigma_m > _SURE_M or sigma_rad > _SURE_RAD:
            continue
        tried.add((i, j))
        yield j, i, between(nodes[i], nodes[j])


def _alike(
    graph: SubmapGraph, index: PlaceIndex, tried: set[tuple[int, int]]
) -> Iterator[_Question]:
    """Ask for nodes in the submaps that look most like their own, as they then lie."""
    nodes = graph.poses()
    for j, old in _unlinked(graph):
        sigmas_m, _ = graph.sigmas_from(j)
        reach_m = SIGMAS * sigmas_m[old] + _SEEN_TOGETHER_M
        possible = old[np.hypot(*(nodes[old] - nodes[j])[:, :2].T) < reach_m + _SIDEWAYS_M]
        fresh = np.array([i for i in possible.tolist() if (i, j) not in tried], dtype=np.int64)
        if not len(fresh):
            continue
        for alike in index.alike(j, fresh, _ALIKE)[:_ALIGNED]:
            i = alike.place
            tried.add((i, j))
            shift = between(between(nodes[i], nodes[j]), alike.place_from_query)
            if math.hypot(shift[0], shift[1]) > SIGMAS * sigmas_m[i] + _SEEN_TOGETHER_M:
                continue
            yield j, i, alike.place_from_query


def followed(
    found: Sequence[Closure], graph: SubmapGraph, matcher: SubmapMatcher
) -> Iterator[Closure]:
    """Go on from every find along both ways, as far as the places beside it match as well.

    What is the same place stays so a few steps further; what only looks like it does not.
    """
    met = {(c.submap, graph.node_of(c.keyframe)) for c in found}
    linked = graph.linked()
    for c in found:
        for direction in (-1, 1):
            yield from _beside(c, direction, graph, matcher, met, linked)


def _beside(
    find: Closure,
    direction: int,
    graph: SubmapGraph,
    matcher: SubmapMatcher,
    met: set[tuple[int, int]],
    linked: set[int],
) -> Iterator[Closure]:
    """Align the unlinked nodes beside a find's with the submaps where it puts them, once each."""
    nodes, ways, here = graph.poses()[: len(graph.submaps)], graph.ways_m(), find
    for _ in range(_FOLLOWED):
        j = graph.node_of(here.keyframe)
        then = j + direction
        if not 0 <= then < len(nodes) or then in linked:
            return
        there = compose(here.submap_from_keyframe, between(nodes[j], nodes[then]))
        near = np.arange(max(here.submap - _FOLLOWED, 0), min(here.submap + _FOLLOWED + 1, then))
        near = near[ways[near] < ways[then] - _APART_M]
        if not len(near):
            return
        old = between(nodes[here.submap], nodes[near])
        k = int(np.argmin(np.hypot(*(old - there)[:, :2].T)))
        i = int(near[k])
        if (i, then) in met:
            return
        here = matcher.align(then, i, between(old[k], there))
        if here.reason:
            return
        met.add((i, then))
        yield replace(here, searched=False)


def _unlinked(graph: SubmapGraph) -> Iterator[tuple[int, NDArray[np.int64]]]:
    """Yield nodes that no closure ties to an older one, with the submaps left far behind."""
    ways, linked = graph.ways_m(), graph.linked()
    for j in range(len(graph.submaps)):
        old = np.flatnonzero(ways[: len(graph.submaps)] < ways[j] - _APART_M)
        if len(old) and j not in linked:
            yield j, old


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
    near.add_edges_from(_neighbours(found, graph))
    # The library weighs in whole numbers.
    links.add_nodes_from((k, {"permille": round(1000 * c.score)}) for k, c in enumerate(found))
    links.add_edges_from((a, b) for a, b in near.edges if agree(found[a], found[b], graph))
    believed: set[int] = set()
    parts = [set(part) for part in nx.connected_components(links)]
    while parts:
        part = parts.pop()
        story = _largest_set(links.subgraph(part), found, graph)
        if story:
            believed |= story
            # Others tell of other ways; what mostly disagrees with this story goes with it.
            others = {k for k in part - story if not _disagrees(k, story, near, links)}
            parts += [set(p) for p in nx.connected_components(links.subgraph(others))]
    return [found[k] for k in sorted(believed)]


def _disagrees(k: int, story: set[int], near: nx.Graph, links: nx.Graph) -> bool:
    """Whether a find agrees with fewer than half of those finds of a story that lie near it."""
    return 2 * len(story.intersection(links[k])) < len(story.intersection(near[k]))


def _neighbours(found: Sequence[Closure], graph: SubmapGraph) -> Iterator[tuple[int, int]]:
    """Yield the pairs of finds that lie near each other along both ways."""
    ways = np.array([(graph.way_of_submap(c.submap), graph.way_of(c.keyframe)) for c in found])
    for a in range(len(found)):
        near = (np.abs(ways[:a] - ways[a]) <= _NEIGHBOURS_M).all(axis=1)
        for b in np.flatnonzero(near).tolist():
            yield a, b


def _largest_set(links: nx.Graph, found: Sequence[Closure], graph: SubmapGraph) -> set[int]:
    """Return all that agree with the best core that agrees in itself and spans a way."""
    core = nx.max_weight_clique(links, "permille")[0] if len(links) <= 60 else _greedy(links)
    ways = [graph.way_of(found[k].keyframe) for k in core]
    # Where the graph is sure, it tells the same story as one find more.
    told = any(graph.speaks_for_nat(found[k], _SIDEWAYS_M) > _GRAPH_SPEAKS_NAT for k in core)
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


def agree(a: Closure, b: Closure, graph: SubmapGraph) -> bool:
    """Whether two finds close a small loop: along the old way, across, back along the new way."""
    if a.keyframe == b.keyframe:
        return False
    keyframes, submaps = graph.keyframes, graph.submaps
    old_a, old_b = (keyframes[submaps[c.submap].anchor].local_from_robot.as_array() for c in (a, b))
    new_a, new_b = (keyframes[c.keyframe].local_from_robot.as_array() for c in (a, b))
    one = compose(a.submap_from_keyframe, between(new_a, new_b))
    other = compose(between(old_a, old_b), b.submap_from_keyframe)
    miss = between(one, other)
    carry_a, carry_old = (
        adjoints(pose[None])[0] for pose in (between(new_b, new_a), invert(b.submap_from_keyframe))
    )
    spread = _CLOSURE + carry_a @ _CLOSURE @ carry_a.T
    spread += graph.drift(graph.node_of(a.keyframe), graph.node_of(b.keyframe))
    spread += carry_old @ graph.drift(a.submap, b.submap) @ carry_old.T
    return squared_sigmas(miss, spread) < _CONSISTENT
