# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Closures that make places contradict each other are not believed.

Places that look alike agree pair by pair as well as places that are the same. But where alike ones
are laid upon each other, what lies beside them does not fit: walls stand where others looked
through.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from slarm_graph.backend import Heartbeat
from slarm_graph.backends.closure_sets import (
    GRAPH_SPEAKS_NAT,
    SIDEWAYS_M,
    consistent_sets,
    stories,
)
from slarm_graph.backends.submap_graph import FAR_OFF, OUTVOTED, SubmapGraph
from slarm_graph.frontends.scans.closures import Closure
from slarm_graph.frontends.scans.submap_matching import SubmapMatcher
from slarm_graph.geometry import Floats, between, transform_points

MISFITS = "walls and free space of places beside it contradict each other with it"
_TRIED = 3
"""Stories of closures that are tried without at a time, those with most contradictions beside."""
_COMPARED = 20
"""Older submaps that each is compared with, the nearest ones, so that the effort goes with the way,
however often a place is come to. With half or double a hall stays as it is (two draws)."""
_BESIDE_M = 15.0
"""Way from a closure along which it lays places upon each other: a visit's."""


def reconciled(graph: SubmapGraph, matcher: SubmapMatcher, heartbeat: Heartbeat) -> SubmapGraph:
    """Leave out closures, or believe others, while that removes contradictions between places.

    And while more of them confirm each other: parts that nothing holds do not contradict anything.
    Others are those that agree with each other and were turned down as too far from the graph: it
    is not as sure as it says where a step of it is not.

    Parameters
    ----------
    graph : SubmapGraph
        Not changed itself.
    matcher : SubmapMatcher
    heartbeat : Heartbeat
    """
    graph.settle(heartbeat)
    said = beside_each_other(graph, matcher)
    while _against(said) > GRAPH_SPEAKS_NAT:
        heartbeat("weighing closures by what the places beside them saw")
        held = (graph.settle()[1] >= OUTVOTED).tolist()
        tried = []
        for other in (*_without_stories(graph, said), *_with_stories(graph, said, heartbeat)):
            if (other.settle(heartbeat)[1] >= OUTVOTED).tolist() != held:
                tried.append((beside_each_other(other, matcher), other))
        best = min(tried, key=lambda t: float(t[0][:, 2].sum()), default=(said, graph))
        removed = _against(said) - _against(best[0])
        if min(removed, said[:, 2].sum() - best[0][:, 2].sum()) <= GRAPH_SPEAKS_NAT:
            break
        said, graph = best
    return graph


def beside_each_other(graph: SubmapGraph, matcher: SubmapMatcher) -> Floats:
    """Return what the places that a graph has beside each other say of that.

    Returns
    -------
    (P, 3) float64
        Two submaps, the older one first, and what speaks against their lying so [nat].
    """
    submaps, nodes, found = graph.submaps, graph.poses(), []
    centers = np.array([transform_points(nodes[i], s.center_m) for i, s in enumerate(submaps)])
    for j in range(len(submaps)):
        away_m = np.hypot(*(centers[:j] - centers[j]).T)
        nearest = np.argsort(away_m)[:_COMPARED]
        near = nearest[away_m[nearest] < SIDEWAYS_M]
        for i, lies in zip(near.tolist(), between(nodes[near], nodes[j]), strict=True):
            found.append((i, j, matcher.evidence_against(j, i, lies)))
    return np.array(found, dtype=np.float64).reshape(-1, 3)


def _against(said: Floats) -> float:
    """Sum up what speaks against places that lie beside each other [nat]."""
    return float(np.maximum(said[:, 2], 0.0).sum())


def _without_stories(graph: SubmapGraph, said: Floats) -> Iterator[SubmapGraph]:
    """Leave out one story of closures after the other, that with most contradictions first.

    Of a story those stay beside which nothing is wrong: a long one may be false in a part.
    """
    told = sorted(stories(_weighed(graph)[0], graph), key=lambda s: -_beside(s, graph, said))
    for story in told[:_TRIED]:
        out = {id(c) for c in story if _beside([c], graph, said) > GRAPH_SPEAKS_NAT}
        yield _with_reason(graph, out, MISFITS)


def _with_stories(graph: SubmapGraph, said: Floats, heartbeat: Heartbeat) -> Iterator[SubmapGraph]:
    """Believe one story of what was turned down after the other, where contradictions touch it.

    Judged from where the story has the nodes: from where it is false, none is worth a step's while.
    """
    held, down = _weighed(graph)
    told = stories(consistent_sets(down, graph), graph)
    touched = [s for s in told if _beside(s, graph, said, both=False) > GRAPH_SPEAKS_NAT]
    for story in sorted(touched, key=len, reverse=True)[:_TRIED]:
        other = _with_reason(graph, {id(c) for c in story}, "")
        other.leaning_on([*held, *story], heartbeat)
        yield other


def _weighed(graph: SubmapGraph) -> tuple[list[Closure], list[Closure]]:
    """Return the closures that are believed, and those that lie too far off or are outvoted."""
    held, down = [], []
    for closure, weight in zip(graph.closures, graph.settle()[1].tolist(), strict=True):
        if weight >= OUTVOTED:
            held.append(closure)
        elif closure.reason in ("", FAR_OFF):
            down.append(closure)
    return held, down


def _with_reason(graph: SubmapGraph, those: set[int], reason: str) -> SubmapGraph:
    """Turn closures of these identities down for a reason, or believe them for none."""
    told = [replace(c, reason=reason) if id(c) in those else c for c in graph.closures]
    return graph.with_closures(told)


def _beside(
    story: Sequence[Closure], graph: SubmapGraph, said: Floats, *, both: bool = True
) -> float:
    """Sum up what speaks against the places that a story's closures lay upon each other [nat].

    Or, if not of both, against where the graph has either of them.
    """
    ways = graph.ways_m()[said[:, :2].astype(np.int64)]
    is_beside = np.zeros(len(said), dtype=np.bool_)
    for c in story:
        at = graph.way_of_submap(c.submap), graph.way_of(c.keyframe)
        near = np.abs(ways[:, :, None] - at) < _BESIDE_M
        is_beside |= near[:, [0, 1], [0, 1]].all(axis=1) if both else near.any(axis=(1, 2))
    return _against(said[is_beside])
