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
    stories,
)
from slarm_graph.backends.submap_graph import OUTVOTED, SubmapGraph
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
    """Leave out closures while that removes contradictions between the places of a graph.

    Parameters
    ----------
    graph : SubmapGraph
        Not changed itself.
    matcher : SubmapMatcher
    heartbeat : Heartbeat
    """
    graph.settle(heartbeat)
    against = contradictions(graph, matcher)
    while against[:, 2].sum() > GRAPH_SPEAKS_NAT:
        heartbeat("weighing closures by what the places beside them saw")
        tried = []
        for closures in _without_stories(graph, against):
            other = graph.with_closures(closures)
            other.settle(heartbeat)
            tried.append((contradictions(other, matcher), other))
        best = min(tried, key=lambda t: float(t[0][:, 2].sum()), default=(against, graph))
        if against[:, 2].sum() - best[0][:, 2].sum() <= GRAPH_SPEAKS_NAT:
            break
        against, graph = best
    return graph


def contradictions(graph: SubmapGraph, matcher: SubmapMatcher) -> Floats:
    """Return which submaps, where the graph has them beside each other, contradict each other.

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
        for i in nearest[away_m[nearest] < SIDEWAYS_M].tolist():
            nat = matcher.evidence_against(j, i, between(nodes[i], nodes[j]))
            if nat > 0.0:
                found.append((i, j, nat))
    return np.array(found, dtype=np.float64).reshape(-1, 3)


def _without_stories(graph: SubmapGraph, against: Floats) -> Iterator[list[Closure]]:
    """Leave out one story of closures after the other, that with most contradictions first."""
    _, weights = graph.settle()
    held = [c for c, w in zip(graph.closures, weights.tolist(), strict=True) if w >= OUTVOTED]
    told = sorted(stories(held, graph), key=lambda s: -_beside(s, graph, against))
    for story in told[:_TRIED]:
        out = {id(c) for c in story}
        yield [replace(c, reason=MISFITS) if id(c) in out else c for c in graph.closures]


def _beside(story: Sequence[Closure], graph: SubmapGraph, against: Floats) -> float:
    """Sum up what speaks against the places that a story's closures lay upon each other [nat]."""
    ways = graph.ways_m()[against[:, :2].astype(np.int64)]
    is_beside = np.zeros(len(against), dtype=np.bool_)
    for c in story:
        at = graph.way_of_submap(c.submap), graph.way_of(c.keyframe)
        is_beside |= (np.abs(ways - at) < _BESIDE_M).all(axis=1)
    return float(against[is_beside, 2].sum())
