# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Loop closures over a whole recording: found by how places look, believed as consistent sets.

While driving, old places are looked for where the robot is believed to be. Once the recording has
ended, every node is compared with those that look like it, wherever they are; what is found is
believed where several finds tell the same story, and again with the corrected poses until nothing
new is found.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from slarm_graph.backend import Heartbeat, silent
from slarm_graph.backends.closure_sets import SIDEWAYS_M, consistent_sets, disputed
from slarm_graph.backends.misfits import reconciled
from slarm_graph.backends.step_chains import is_contradicted_twice
from slarm_graph.backends.submap_graph import SubmapGraph
from slarm_graph.counts import count_of
from slarm_graph.frontends.scans.closures import GATE_SIGMAS, Closure
from slarm_graph.frontends.scans.place_recognition import (
    PlaceDescriptor,
    PlaceIndex,
    describe_place,
)
from slarm_graph.frontends.scans.submap_matching import SubmapMatcher
from slarm_graph.geometry import Floats, between, compose, transform_points

_ROUNDS = 3
"""Most passes over the recording: each needs the corrections of the one before."""
_ALIKE, _ALIGNED = 10, 5
"""Submaps whose pictures are compared with a node's, and ways to lie on one that are then aligned:
of revisits two in three are among the ten most alike; twice as many find no more."""
_FOLLOWED = 4
"""Nodes that a find is followed by to either side, 10 m, and submaps beside its own that these may
lie on."""
_APART_M = 15.0
"""Way from which a return is a revisit: the local map has forgotten what lies behind."""
_SURE_M, _SURE_RAD = 0.5, 0.15
"""Uncertainty up to which matching from the expected pose finds the place without a search."""
_SEEN_TOGETHER_M = 3.0
"""Distance of submaps that show the same."""

_Question = tuple[int, int, Floats]
"""Whether one submap lies in another at a pose (3,) [m, m, rad]."""


def close_finally(
    graph: SubmapGraph, matcher: SubmapMatcher, heartbeat: Heartbeat
) -> tuple[SubmapGraph, int]:
    """Find what was missed while driving, until nothing new is found.

    Returns
    -------
    graph : SubmapGraph
        To go on with.
    rivals : int
        Finds that agree with each other and not with the graph, which turned them down, and that
        matches or odometry alone would allow.
    """
    if len(graph.submaps) < 3:
        return graph, 0
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
        heartbeat(
            f"weighing {count_of(len(open_again), 'closure')} against what they had turned down"
        )
        graph = reopened(graph, open_again, heartbeat)
    graph = reconciled(graph, matcher, heartbeat)
    steps = graph.pose_graph().constraints
    agreeing = consistent_sets(graph.far_off(), graph)
    return graph, sum(not is_contradicted_twice(graph.edge(c), steps) for c in agreeing)


def reopened(
    graph: SubmapGraph, contested: Sequence[Closure], heartbeat: Heartbeat = silent
) -> SubmapGraph:
    """Return a graph that judges closures anew with all that the given one has turned down.

    All are held against a graph of what is undisputed: what came first has no right of its own.

    Parameters
    ----------
    graph : SubmapGraph
    contested : sequence of Closure
        Believed so far.
    heartbeat : Heartbeat
    """
    open_again = {id(c) for c in (*contested, *graph.far_off())}
    other = graph.with_closures([c for c in graph.closures if id(c) not in open_again])
    other.settle(heartbeat)
    anew = [replace(c, reason="") for c in graph.closures if id(c) in open_again]
    other.close(other.judged(anew), heartbeat)
    return other


def _appearance(matcher: SubmapMatcher, submap: int) -> PlaceDescriptor:
    """Describe a submap with its neighbours, around the middle of its own returns."""
    middle = np.median(matcher.points_of(matcher.region(submap, 0)), axis=0)
    return describe_place(matcher.points_of(matcher.region(submap)), middle)


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
        reach_m = GATE_SIGMAS * sigmas_m[old] + _SEEN_TOGETHER_M
        possible = old[np.hypot(*(nodes[old] - nodes[j])[:, :2].T) < reach_m + SIDEWAYS_M]
        fresh = np.array([i for i in possible.tolist() if (i, j) not in tried], dtype=np.int64)
        if not len(fresh):
            continue
        for alike in index.most_similar(j, fresh, _ALIKE)[:_ALIGNED]:
            i = alike.place
            tried.add((i, j))
            shift = between(between(nodes[i], nodes[j]), alike.place_from_query)
            if math.hypot(shift[0], shift[1]) > GATE_SIGMAS * sigmas_m[i] + _SEEN_TOGETHER_M:
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
