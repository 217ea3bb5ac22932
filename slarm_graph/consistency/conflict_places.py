# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Places where a map contradicts itself: clusters of contradictory pairs of visits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from slarm_graph.consistency.evidence import FREE, state_at
from slarm_graph.consistency.pairs import VisitPairs
from slarm_graph.consistency.visits import Visits
from slarm_graph.geometry import Floats, between, transform_points

ADJACENT_VISITS = 2
"""Pairs whose earlier and later visits differ by at most so many are of one place."""


@dataclass(frozen=True, slots=True)
class ConflictPlace:
    """A place where the scans of two parts of the trajectory contradict each other.

    Parameters
    ----------
    earlier_ns, later_ns : (int, int)
        Stamps of the first and the last scan of either part [ns].
    position_m : (float, float)
        Median of the walls in conflict, in the map [m].
    extent_m : float
        Radius about it of nine in ten of them [m].
    evidence_nat : float
        Log-likelihood ratio of a wrong pose, of the strongest pair of visits [nat].
    confirmed, contradicted : int
        Wall cells of that pair.
    pairs : int
        Contradictory pairs of visits.
    """

    earlier_ns: tuple[int, int]
    later_ns: tuple[int, int]
    position_m: tuple[float, float]
    extent_m: float
    evidence_nat: float
    confirmed: int
    contradicted: int
    pairs: int


def conflict_places(
    visits: Visits, pairs: VisitPairs, stamps_ns: NDArray[np.int64], least_nat: float
) -> tuple[tuple[ConflictPlace, ...], Floats]:
    """Cluster the pairs with evidence of a wrong pose by place, the strongest first.

    Parameters
    ----------
    visits : Visits
    pairs : VisitPairs
        Of these visits.
    stamps_ns : (N,) int64
        Of every scan [ns].
    least_nat : float
        Evidence from which a pair is contradictory [nat].

    Returns
    -------
    places : tuple of ConflictPlace
    points_m : (M, 2) float64
        Walls in conflict, in the map [m], of the strongest pair of every place.
    """
    wrong = pairs.only(pairs.evidence() >= least_nat)
    if not len(wrong.visits):
        return (), np.zeros((0, 2))
    groups = _groups(wrong.visits)
    clusters = [_place(visits, wrong.only(groups == g), stamps_ns) for g in range(groups.max() + 1)]
    clusters.sort(key=lambda item: -item[0].evidence_nat)
    return tuple(place for place, _ in clusters), np.concatenate([points for _, points in clusters])


def _groups(visits: NDArray[np.int64]) -> NDArray[np.int64]:
    """Label the connected components (P,) of pairs of adjacent visits."""
    edges = cKDTree(visits).query_pairs(ADJACENT_VISITS + 0.5, p=np.inf, output_type="ndarray")
    size = len(visits)
    graph = coo_matrix((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(size, size))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)


def _place(
    visits: Visits, pairs: VisitPairs, stamps_ns: NDArray[np.int64]
) -> tuple[ConflictPlace, Floats]:
    evidence = pairs.evidence()
    best = int(np.argmax(evidence))
    points = conflict_points_m(visits, *pairs.visits[best])
    middle = np.median(points, axis=0)
    stamps = stamps_ns[visits.scans[pairs.visits]]
    first, last = stamps[..., 0].min(axis=0), stamps[..., 1].max(axis=0)
    place = ConflictPlace(
        earlier_ns=(int(first[0]), int(last[0])),
        later_ns=(int(first[1]), int(last[1])),
        position_m=(float(middle[0]), float(middle[1])),
        extent_m=float(np.quantile(np.hypot(*(points - middle).T), 0.9)),
        evidence_nat=float(evidence[best]),
        confirmed=int(pairs.confirmed[best]),
        contradicted=int(pairs.contradicted[best]),
        pairs=len(evidence),
    )
    return place, points


def conflict_points_m(visits: Visits, first: int, second: int) -> Floats:
    """Return the walls (M, 2) [m] in the map of either visit that the other saw as free."""
    parts = []
    for a, b in ((first, second), (second, first)):
        walls = visits.walls[visits.wall_start[a] : visits.wall_start[a + 1]]
        seen = transform_points(between(visits.poses[b], visits.poses[a]), walls)
        states = visits.states[visits.state_start[b] : visits.state_start[b + 1]]
        states = states.reshape(visits.shapes[b])
        free = [state_at(states, visits.lows[b], x, y) == FREE for x, y in seen]
        parts.append(transform_points(visits.poses[a], walls[np.array(free, dtype=bool)]))
    return np.concatenate(parts)
