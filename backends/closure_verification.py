# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Verify groups of loop closures by the walls and free space of the submaps they overlay.

Under perceptual aliasing false closures are as pairwise consistent as true ones. But where they
overlay different places, the neighbouring submaps contradict: walls of one lie in free space of the
other.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from slarm_graph.backend import Heartbeat
from slarm_graph.backends.closure_sets import (
    MAX_COVISIBLE_M,
    REVISIT_M,
    agreeing_groups,
    consistent_sets,
)
from slarm_graph.backends.robust_optimization import INLIER_WEIGHT
from slarm_graph.backends.submap_graph import GATED, SubmapGraph
from slarm_graph.frontends.scans.closures import Closure
from slarm_graph.frontends.scans.significance import DECISIVE_NAT
from slarm_graph.frontends.scans.submap_matching import SubmapMatcher
from slarm_graph.geometry import Floats, between, transform_points

CONTRADICTED = "with it walls would stand in the free space of neighbouring places"
_MAX_TRIALS = 3
"""Groups of closures removed, or added, on trial at a time, those of most contradiction first."""
_COMPARED = 20
"""Older submaps that each is compared with, the nearest ones, so that the cost is linear in path
length, however often a place is revisited. With half or double a hall stays (two draws)."""


def verify_closures(
    graph: SubmapGraph, matcher: SubmapMatcher, heartbeat: Heartbeat
) -> SubmapGraph:
    """Reject or re-admit groups of closures while that lowers the contradiction between submaps.

    The evidence for overlaps has to improve as well: submaps that nothing ties contradict nothing.
    Re-admitted are pairwise-consistent groups that the chi-square gate rejected: the graph's
    covariance is optimistic where one of its steps is wrong.

    Parameters
    ----------
    graph : SubmapGraph
        Not changed itself.
    matcher : SubmapMatcher
    heartbeat : Heartbeat
    """
    graph.optimize_robustly(heartbeat)
    evidence = overlap_evidence(graph, matcher)
    while _contradiction(evidence) > DECISIVE_NAT:
        heartbeat("weighing closures by what the places beside them saw")
        inliers = (graph.optimize_robustly()[1] >= INLIER_WEIGHT).tolist()
        trials = []
        for trial in (
            *_without_groups(graph, evidence),
            *_with_groups(graph, evidence, heartbeat),
        ):
            if (trial.optimize_robustly(heartbeat)[1] >= INLIER_WEIGHT).tolist() != inliers:
                trials.append((overlap_evidence(trial, matcher), trial))
        best = min(trials, key=lambda t: float(t[0][:, 2].sum()), default=(evidence, graph))
        removed = _contradiction(evidence) - _contradiction(best[0])
        if min(removed, evidence[:, 2].sum() - best[0][:, 2].sum()) <= DECISIVE_NAT:
            break
        evidence, graph = best
    return graph


def overlap_evidence(graph: SubmapGraph, matcher: SubmapMatcher) -> Floats:
    """Log-likelihood ratio of a wrong over a right relative pose for every overlapping submap pair.

    Returns
    -------
    (P, 3) float64
        Indices of two submaps, the older one first, and the evidence against their pose [nat].
    """
    submaps, nodes, rows = graph.submaps, graph.poses(), []
    centers = np.array([transform_points(nodes[i], s.center_m) for i, s in enumerate(submaps)])
    for j in range(len(submaps)):
        distance_m = np.hypot(*(centers[:j] - centers[j]).T)
        nearest = np.argsort(distance_m)[:_COMPARED]
        near = nearest[distance_m[nearest] < MAX_COVISIBLE_M]
        for i, i_from_j in zip(near.tolist(), between(nodes[near], nodes[j]), strict=True):
            rows.append((i, j, matcher.evidence_against(j, i, i_from_j)))
    return np.array(rows, dtype=np.float64).reshape(-1, 3)


def _contradiction(evidence: Floats) -> float:
    """Sum the positive evidence against relative poses of submaps [nat]."""
    return float(np.maximum(evidence[:, 2], 0.0).sum())


def _without_groups(graph: SubmapGraph, evidence: Floats) -> Iterator[SubmapGraph]:
    """Remove one group of closures at a time, that of most contradiction first.

    Members without contradiction near them stay: a long group may be false in part.
    """
    groups = sorted(
        agreeing_groups(_accepted_and_rejected(graph)[0], graph),
        key=lambda s: -_contradiction_near(s, graph, evidence),
    )
    for group in groups[:_MAX_TRIALS]:
        removed = {id(c) for c in group if _contradiction_near([c], graph, evidence) > DECISIVE_NAT}
        yield _with_reason(graph, removed, CONTRADICTED)


def _with_groups(
    graph: SubmapGraph, evidence: Floats, heartbeat: Heartbeat
) -> Iterator[SubmapGraph]:
    """Re-admit one rejected group at a time, of those that contradiction touches.

    From the optimum with the group: from poses where it is false, no closure outweighs a step.
    """
    accepted, rejected = _accepted_and_rejected(graph)
    groups = agreeing_groups(consistent_sets(rejected, graph), graph)
    touched = [
        s for s in groups if _contradiction_near(s, graph, evidence, both=False) > DECISIVE_NAT
    ]
    for group in sorted(touched, key=len, reverse=True)[:_MAX_TRIALS]:
        trial = _with_reason(graph, {id(c) for c in group}, "")
        trial.optimize_with([*accepted, *group], heartbeat)
        yield trial


def _accepted_and_rejected(graph: SubmapGraph) -> tuple[list[Closure], list[Closure]]:
    """Split closures into inliers, and those that the gate or robust optimisation rejected."""
    accepted, rejected = [], []
    for closure, weight in zip(graph.closures, graph.optimize_robustly()[1].tolist(), strict=True):
        if weight >= INLIER_WEIGHT:
            accepted.append(closure)
        elif closure.reason in ("", GATED):
            rejected.append(closure)
    return accepted, rejected


def _with_reason(graph: SubmapGraph, identities: set[int], reason: str) -> SubmapGraph:
    """Reject closures of these identities for a reason, or accept them for an empty one."""
    closures = [replace(c, reason=reason) if id(c) in identities else c for c in graph.closures]
    return graph.with_closures(closures)


def _contradiction_near(
    group: Sequence[Closure], graph: SubmapGraph, evidence: Floats, *, both: bool = True
) -> float:
    """Sum the evidence against the submap pairs that a group of closures overlays [nat].

    Unless of both, against pairs of which either submap is near an end of a closure.
    """
    lengths_m = graph.path_lengths_m()[evidence[:, :2].astype(np.int64)]
    is_near = np.zeros(len(evidence), dtype=np.bool_)
    for c in group:
        ends_m = graph.path_length_at_submap(c.submap), graph.path_length_at(c.keyframe)
        near = np.abs(lengths_m[:, :, None] - ends_m) < REVISIT_M
        is_near |= near[:, [0, 1], [0, 1]].all(axis=1) if both else near.any(axis=(1, 2))
    return _contradiction(evidence[is_near])
