# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Graph searches on cells: A*, Dijkstra's algorithm as a wavefront, and flood fill."""

from __future__ import annotations

import heapq
import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from slarm_graph.exploration.moves import DELTA_COL, DELTA_ROW, Moves
from slarm_graph.geometry import Floats
from slarm_graph.grid import Cells, Mask
from slarm_graph.kernels import kernel

Indices = NDArray[np.int64]
Labels = NDArray[Any]

_LABEL: Final = np.dtype([("cost", "f8"), ("wave", "i4"), ("came_by", "u1")], align=True)
_ROOT: Final = 8
"""Marks the start, which has no direction of entry."""
_NOTHING: Final = -1
"""Matches no cell, as codes are not negative: the search is exhaustive."""
_SQRT2: Final = math.sqrt(2.0)
"""Length of a step over a corner between two cells."""
_TIE: Final = 1e-9
"""Costs that differ by less are equal: sums of up to 10^6 steps round at about 1e-10."""


def shortest_path(moves: Moves, start: tuple[int, int], goal: tuple[int, int]) -> Cells | None:
    """A* from start to goal with the octile distance as heuristic (admissible and consistent).

    Parameters
    ----------
    moves : (rows, cols) uint8
    start, goal : (row, col)

    Returns
    -------
    (K, 2) int64 cells from start to goal, both included, or None where there is no path.
    """
    cols = moves.shape[1]
    begin, end = start[0] * cols + start[1], goal[0] * cols + goal[1]
    return _unflatten(_astar(moves, begin, end, new_labels(moves.size)), cols)


def path_to_nearest(moves: Moves, wanted: Mask, start: tuple[int, int]) -> Cells | None:
    """Cheapest path from start to any wanted cell; ties go to the lowest row, then column.

    The wavefront stops at the first wanted cell, so that only cells nearer than it are expanded;
    the path is the one that A* to every wanted cell would find.
    """
    cols, labels = moves.shape[1], new_labels(moves.size)
    codes = wanted.astype(np.uint8).ravel()
    found = wavefront(moves, codes, 1, start[0] * cols + start[1], math.inf, labels, 1)
    return _unflatten(walk_back(labels, found, cols), cols)


def distances_from(moves: Moves, start: tuple[int, int], limit: float = math.inf) -> Floats:
    """Length (rows, cols) [cells] of the cheapest path from start; inf beyond the limit."""
    labels = new_labels(moves.size)
    begin = start[0] * moves.shape[1] + start[1]
    wavefront(moves, moves.ravel(), _NOTHING, begin, limit, labels, 1)
    cost = np.where(labels["wave"] == 1, labels["cost"], np.inf)
    return np.where(cost <= limit, cost, np.inf).reshape(moves.shape)


def distances_between(moves: Moves, cells: Cells, limit: float = math.inf) -> Floats:
    """Lengths (N, N) [cells] of the cheapest paths between cells (N, 2); inf beyond the limit."""
    flat = cells[:, 0] * moves.shape[1] + cells[:, 1]
    return np.asarray(_distances_between(moves, flat, limit, new_labels(moves.size)))


def reachable(moves: Moves, start: tuple[int, int]) -> Mask:
    """Connected component (rows, cols) of the start."""
    found = np.zeros(moves.shape, dtype=np.bool_)
    _fill(moves, start[0] * moves.shape[1] + start[1], found)
    return found


def new_labels(size: int) -> Labels:
    """Scratch memory (size,) of `wavefront`: cost and predecessor of every cell."""
    return np.zeros(size, dtype=_LABEL)


def _unflatten(flat: Indices, cols: int) -> Cells | None:
    return np.stack(np.divmod(flat, cols), axis=-1) if len(flat) else None


@kernel
def wavefront(
    moves: Moves,
    codes: NDArray[np.uint8],
    wanted: int,
    start: int,
    limit: float,
    labels: Labels,
    wave: int,
) -> int:
    """Return the flat cell with code `wanted` that is cheapest to reach, or -1.

    Dijkstra with buckets as wide as the cheapest step: all labels within a bucket are final, so
    it needs no heap (Denardo and Fox 1979). A label counts only where it bears the number of this
    wave, so that nothing is cleared between waves. Cells beyond the limit are not gone on from.
    """
    cols = moves.shape[1]
    bits = moves.ravel()
    labels[start].cost = 0.0
    labels[start].came_by = _ROOT
    labels[start].wave = wave
    now = [start]
    soon = [start][:0]
    later = [start][:0]
    level = 0.0
    while len(now) + len(soon) > 0 and level <= limit:
        best = _cheapest(now, codes, wanted, labels)
        if best >= 0:
            return best
        for node in now:
            cost = labels[node].cost
            if cost < level - _TIE:
                continue
            for d in range(8):
                if not (bits[node] >> d) & 1:
                    continue
                there = node + DELTA_ROW[d] * cols + DELTA_COL[d]
                candidate = cost + (_SQRT2 if d % 2 else 1.0)
                if labels[there].wave == wave and candidate >= labels[there].cost - _TIE:
                    continue
                labels[there].wave = wave
                labels[there].cost = candidate
                labels[there].came_by = d
                if candidate < level + 2.0 - _TIE:
                    soon.append(there)
                else:
                    later.append(there)
        now = soon
        soon = later
        later = [start][:0]
        level += 1.0
    return -1


@kernel
def _cheapest(nodes: list[int], codes: NDArray[np.uint8], wanted: int, labels: Labels) -> int:
    """Cheapest node with code `wanted`, the first of equals, or -1."""
    best = -1
    for node in nodes:
        if codes[node] == wanted and (
            best < 0
            or labels[node].cost < labels[best].cost - _TIE
            or (labels[node].cost < labels[best].cost + _TIE and node < best)
        ):
            best = node
    return best


@kernel
def walk_back(labels: Labels, last: int, cols: int) -> Indices:
    """Path to `last` from where its wave began; empty for -1."""
    path = [last][:0]
    node = last
    while node >= 0:
        path.append(node)
        d = labels[node].came_by
        node = -1 if d == _ROOT else node - DELTA_ROW[d] * cols - DELTA_COL[d]
    return np.array(path[::-1], dtype=np.int64)


@kernel
def _distances_between(moves: Moves, flat: Indices, limit: float, labels: Labels) -> Floats:
    count = len(flat)
    out = np.full((count, count), np.inf)
    codes = moves.ravel()
    for i in range(count):
        wavefront(moves, codes, _NOTHING, flat[i], limit, labels, i + 1)
        for k in range(count):
            if labels[flat[k]].wave == i + 1 and labels[flat[k]].cost <= limit:
                out[i, k] = labels[flat[k]].cost
    return out


@kernel
def _octile(a: int, b: int, cols: int) -> float:
    rows_apart = abs(a // cols - b // cols)
    cols_apart = abs(a % cols - b % cols)
    short = min(rows_apart, cols_apart)
    return max(rows_apart, cols_apart) - short + short * _SQRT2


@kernel
def _astar(moves: Moves, start: int, goal: int, labels: Labels) -> Indices:
    cols = moves.shape[1]
    bits = moves.ravel()
    labels[start].cost = 0.0
    labels[start].came_by = _ROOT
    labels[start].wave = 1
    heap = [(_octile(start, goal, cols), start)]
    while len(heap) > 0:
        estimate, node = heapq.heappop(heap)
        if node == goal:
            return walk_back(labels, goal, cols)
        cost = labels[node].cost
        if estimate > cost + _octile(node, goal, cols) + _TIE:
            continue
        for d in range(8):
            if not (bits[node] >> d) & 1:
                continue
            there = node + DELTA_ROW[d] * cols + DELTA_COL[d]
            candidate = cost + (_SQRT2 if d % 2 else 1.0)
            if labels[there].wave == 0 or candidate < labels[there].cost - _TIE:
                labels[there].wave = 1
                labels[there].cost = candidate
                labels[there].came_by = d
                heapq.heappush(heap, (candidate + _octile(there, goal, cols), there))
    return walk_back(labels, -1, cols)


@kernel
def _fill(moves: Moves, start: int, found: Mask) -> None:
    """Flood fill by straight steps: an open diagonal implies straight ones around it."""
    cols = moves.shape[1]
    bits = moves.ravel()
    flags = found.ravel()
    flags[start] = True
    stack = [start]
    while len(stack) > 0:
        node = stack.pop()
        for d in range(0, 8, 2):
            if (bits[node] >> d) & 1:
                there = node + DELTA_ROW[d] * cols + DELTA_COL[d]
                if not flags[there]:
                    flags[there] = True
                    stack.append(there)
