# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Pairwise check of visits that saw the same cells: evidence that one of the two is misplaced."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from slarm_graph.consistency.evidence import CELL_M, count_agreement, wrong_place_evidence
from slarm_graph.consistency.visits import Visits
from slarm_graph.geometry import Floats, compose
from slarm_graph.kernels import kernel

MIN_CELLS = 30
"""Wall cells that two visits must share to be compared: 3 m of wall."""

MAX_PAIRS = 200_000
"""Pairs compared at most; more are subsampled evenly. Reached after hours in one building."""


@dataclass(frozen=True, slots=True)
class VisitPairs:
    """P pairs of visits that share walls.

    Parameters
    ----------
    visits : (P, 2) int64
        Earlier and later visit.
    confirmed, contradicted : (P,) int64
        Wall cells of either visit that the other one confirms, and that it saw as free.
    """

    visits: NDArray[np.int64]
    confirmed: NDArray[np.int64]
    contradicted: NDArray[np.int64]

    def evidence(self) -> Floats:
        """Log-likelihood ratio (P,) [nat] of a wrong relative pose over a right one."""
        return wrong_place_evidence(self.confirmed, self.contradicted)

    def conflict_share(self) -> float:
        """Share of the compared wall cells in conflict; nan without any."""
        compared = int(self.confirmed.sum() + self.contradicted.sum())
        return float(self.contradicted.sum() / compared) if compared else math.nan

    def only(self, which: NDArray[np.bool_]) -> VisitPairs:
        """Return some of the pairs."""
        return VisitPairs(self.visits[which], self.confirmed[which], self.contradicted[which])


def cross_check(
    visits: Visits, poses: Floats | None = None, least_cells: int = MIN_CELLS
) -> VisitPairs:
    """Compare all visits that saw the same cells.

    Parameters
    ----------
    visits : Visits
    poses : (K, 3) float64, optional
        `map_from_visit` to check instead of the visits' own, as of a graph with other closures.
    least_cells : int
        Wall cells that a pair has to share.
    """
    poses = visits.poses if poses is None else np.ascontiguousarray(poses, dtype=np.float64)
    if not len(visits):
        return VisitPairs(np.zeros((0, 2), np.int64), np.zeros(0, np.int64), np.zeros(0, np.int64))
    candidates = _subsampled(_overlapping(poses, visits.lows, visits.shapes))
    counts = _compare(
        candidates,
        poses,
        visits.walls,
        visits.wall_start,
        visits.states,
        visits.state_start,
        visits.lows,
        visits.shapes,
    )
    enough = counts.sum(axis=1) >= least_cells
    return VisitPairs(candidates[enough], counts[enough, 0], counts[enough, 1])


def _subsampled(candidates: NDArray[np.int64]) -> NDArray[np.int64]:
    """Select at most `MAX_PAIRS` candidates, evenly."""
    if len(candidates) <= MAX_PAIRS:
        return candidates
    return candidates[np.linspace(0, len(candidates) - 1, MAX_PAIRS).astype(np.int64)]


def _overlapping(poses: Floats, lows: Floats, shapes: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the pairs (P, 2) of visits whose cells' bounding circles intersect."""
    half = 0.5 * CELL_M * shapes[:, ::-1]
    middle = lows + half
    centre = compose(poses, np.column_stack([middle, np.zeros(len(middle))]))[:, :2]
    radius = np.hypot(*half.T)
    pairs = cKDTree(centre).query_pairs(2.0 * radius.max(), output_type="ndarray")
    apart = np.hypot(*(centre[pairs[:, 0]] - centre[pairs[:, 1]]).T)
    pairs = pairs[apart < radius[pairs].sum(axis=1)].astype(np.int64)
    return np.asarray(pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))])


@kernel
def _b_from_a(map_from_b: Floats, map_from_a: Floats) -> Floats:
    c, s = math.cos(map_from_b[2]), math.sin(map_from_b[2])
    dx, dy = map_from_a[0] - map_from_b[0], map_from_a[1] - map_from_b[1]
    return np.array([c * dx + s * dy, -s * dx + c * dy, map_from_a[2] - map_from_b[2]])


@kernel
def _compare(
    pairs: NDArray[np.int64],
    poses: Floats,
    walls: Floats,
    wall_start: NDArray[np.int64],
    states: NDArray[np.uint8],
    state_start: NDArray[np.int64],
    lows: Floats,
    shapes: NDArray[np.int64],
) -> NDArray[np.int64]:
    """Count (P, 2): wall cells confirmed and contradicted, both directions together."""
    counts = np.zeros((len(pairs), 2), dtype=np.int64)
    for k in range(len(pairs)):
        for side in range(2):
            a, b = pairs[k, side], pairs[k, 1 - side]
            other_states = states[state_start[b] : state_start[b + 1]].reshape(
                shapes[b, 0], shapes[b, 1]
            )
            own_walls = walls[wall_start[a] : wall_start[a + 1]]
            confirmed, contradicted = count_agreement(
                own_walls, _b_from_a(poses[b], poses[a]), other_states, lows[b]
            )
            counts[k, 0] += confirmed
            counts[k, 1] += contradicted
    return counts
