# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Paths on cells: clearance from the distance transform, A*, and bounded wavefronts.

All searches share one word: `moves`, a (rows, cols) uint8 layer whose bit d says that the step
in direction d is open. Directions count eighths of a turn, counter-clockwise from +x. A diagonal
is open only where both ways around its corner are, so that no path cuts a corner.
"""

from __future__ import annotations

import heapq
import math

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from slarm_graph.geometry import Floats
from slarm_graph.grid import Cells, Mask

Moves = NDArray[np.uint8]
Indices = NDArray[np.int64]

EAST, NORTH, WEST, SOUTH = 0, 2, 4, 6
DELTA_ROW = (0, 1, 1, 1, 0, -1, -1, -1)
DELTA_COL = (1, 1, 0, -1, -1, -1, 0, 1)

_SQRT2 = math.sqrt(2.0)
_TIE = 1e-9


def clearance_m(blocked: Mask, resolution_m: float) -> NDArray[np.float32]:
    """Distance (rows, cols) from every cell's centre to the nearest blocked cell's centre [m].

    Everything outside the grid counts as blocked.
    """
    framed = np.pad(~blocked, 1).astype(np.uint8)
    distance = cv2.distanceTransform(framed, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.asarray(distance[1:-1, 1:-1] * np.float32(resolution_m), dtype=np.float32)


def moves_within(passable: Mask) -> Moves:
    """Open steps between neighbouring passable cells."""
    east = passable[:, :-1] & passable[:, 1:]
    north = passable[:-1] & passable[1:]
    return moves_across(east, north)


def moves_across(east: Mask, north: Mask) -> Moves:
    """Open steps where the straight ones are given.

    Parameters
    ----------
    east : (rows, cols - 1) bool
        Whether cell (r, c) and cell (r, c + 1) are joined.
    north : (rows - 1, cols) bool
        Whether cell (r, c) and cell (r + 1, c) are joined.
    """
    rows, cols = east.shape[0], north.shape[1]
    moves = np.zeros((rows, cols), dtype=np.uint8)
    _join(moves, np.ascontiguousarray(east), np.ascontiguousarray(north))
    return moves


def straight_moves(moves: Moves) -> Moves:
    """Keep the four straight steps only."""
    return np.asarray(moves & 0b01010101, dtype=np.uint8)


def shortest_path(moves: Moves, start: tuple[int, int], goal: tuple[int, int]) -> Cells | None:
    """A* from start to goal with the octile distance as heuristic (admissible and consistent).

    Parameters
    ----------
    moves : (rows, cols) uint8
    start, goal : (row, col)

    Returns
    -------
    (K, 2) int64 cells from start to goal, both included, or None where there is no way.
    """
    cols = moves.shape[1]
    begin, end = start[0] * cols + start[1], goal[0] * cols + goal[1]
    return _unflatten(_astar(moves, begin, end), cols)


def path_to_nearest(moves: Moves, wanted: Mask, start: tuple[int, int]) -> Cells | None:
    """Cheapest path from start to any wanted cell; ties go to the lowest row, then column.

    The wavefront stops at the first wanted cell, so that it never costs more than the ball around
    the start that this cell lies on; the path is the one that A* to every wanted cell would find.
    """
    size, cols = moves.size, moves.shape[1]
    cost, parent = np.empty(size), np.empty(size, dtype=np.int64)
    stamp = np.zeros(size, dtype=np.int32)
    begin = start[0] * cols + start[1]
    found = nearest_wanted(moves, wanted.astype(np.uint8).ravel(), 1, begin, cost, parent, stamp, 1)
    return _unflatten(walk_back(parent, found), cols)


def distances_from(moves: Moves, start: tuple[int, int], limit: float = math.inf) -> Floats:
    """Length (rows, cols) [cells] of the cheapest path from start; inf beyond the limit."""
    cost = np.full(moves.size, np.inf)
    _flood(moves, start[0] * moves.shape[1] + start[1], limit, cost)
    return cost.reshape(moves.shape)


def reachable(moves: Moves, start: tuple[int, int]) -> Mask:
    """Cells (rows, cols) with a way from start, which counts itself."""
    found = np.zeros(moves.shape, dtype=np.bool_)
    _fill(straight_moves(moves), start[0] * moves.shape[1] + start[1], found)
    return found


def path_length(cells: Cells) -> float:
    """Length of a path (K, 2) [cells]."""
    return float(np.hypot(*np.diff(cells, axis=0).T).sum()) if len(cells) > 1 else 0.0


def nearest_passable(
    passable: Mask, cell: tuple[int, int], limit: int = 40
) -> tuple[int, int] | None:
    """Return the passable cell nearest to a cell, which may lie outside, or None within limit."""
    rows, cols = passable.shape
    row, col = cell
    if 0 <= row < rows and 0 <= col < cols and passable[row, col]:
        return cell
    low_row, low_col = max(0, row - limit), max(0, col - limit)
    window = passable[low_row : max(0, row + limit + 1), low_col : max(0, col + limit + 1)]
    near = np.argwhere(window) + np.array([low_row, low_col])
    if not len(near):
        return None
    best = near[np.argmin(((near - cell) ** 2).sum(axis=1))]
    return int(best[0]), int(best[1])


def sees(passable: Mask, start: Floats, end: Floats) -> bool:
    """Whether the straight segment between two points [cells, x right] stays on passable cells.

    Parameters
    ----------
    passable : (rows, cols) bool
    start, end : (2,) float64
        x, y in units of cells from the grid's lower-left corner.
    """
    return bool(_sees(passable, start[0], start[1], end[0], end[1]))


def shortcut(passable: Mask, points: Floats, reach: int = 200) -> Floats:
    """Pull a path (K, 2) [cells, x right] straight wherever the segment stays on passable cells.

    Parameters
    ----------
    reach : int
        How many points ahead a segment may jump at the most.
    """
    if len(points) < 3:
        return points
    return points[_pull(passable, points, reach)]


def _unflatten(flat: Indices, cols: int) -> Cells | None:
    return np.stack(np.divmod(flat, cols), axis=-1) if len(flat) else None


@njit(cache=True, nogil=True)
def _join(moves: Moves, east: Mask, north: Mask) -> None:
    rows, cols = moves.shape
    for r in range(rows):
        for c in range(cols):
            e = c + 1 < cols and east[r, c]
            w = c > 0 and east[r, c - 1]
            n = r + 1 < rows and north[r, c]
            s = r > 0 and north[r - 1, c]
            bits = 0
            if e:
                bits |= 1
            if n:
                bits |= 4
            if w:
                bits |= 16
            if s:
                bits |= 64
            if e and n and north[r, c + 1] and east[r + 1, c]:
                bits |= 2
            if w and n and north[r, c - 1] and east[r + 1, c - 1]:
                bits |= 8
            if w and s and north[r - 1, c - 1] and east[r - 1, c - 1]:
                bits |= 32
            if e and s and north[r - 1, c + 1] and east[r - 1, c]:
                bits |= 128
            moves[r, c] = bits


@njit(cache=True, nogil=True)
def walk_back(parent: Indices, last: int) -> Indices:
    """Path to `last` from the root, along the parents; empty for -1."""
    count = 0
    node = last
    while node >= 0:
        count += 1
        node = parent[node]
    path = np.empty(count, dtype=np.int64)
    node = last
    for i in range(count - 1, -1, -1):
        path[i] = node
        node = parent[node]
    return path


@njit(cache=True, nogil=True)
def _octile(a: int, b: int, cols: int) -> float:
    rows_apart = abs(a // cols - b // cols)
    cols_apart = abs(a % cols - b % cols)
    short = min(rows_apart, cols_apart)
    return max(rows_apart, cols_apart) - short + short * _SQRT2


@njit(cache=True, nogil=True)
def _astar(moves: Moves, start: int, goal: int) -> Indices:
    cols = moves.shape[1]
    bits = moves.ravel()
    cost = np.full(bits.size, np.inf)
    parent = np.full(bits.size, -1, dtype=np.int64)
    cost[start] = 0.0
    heap = [(_octile(start, goal, cols), start)]
    while len(heap) > 0:
        estimate, node = heapq.heappop(heap)
        if node == goal:
            return walk_back(parent, goal)
        if estimate > cost[node] + _octile(node, goal, cols) + _TIE:
            continue
        for d in range(8):
            if not (bits[node] >> d) & 1:
                continue
            there = node + DELTA_ROW[d] * cols + DELTA_COL[d]
            candidate = cost[node] + (_SQRT2 if d % 2 else 1.0)
            if candidate < cost[there] - _TIE:
                cost[there] = candidate
                parent[there] = node
                heapq.heappush(heap, (candidate + _octile(there, goal, cols), there))
    return np.empty(0, dtype=np.int64)


@njit(cache=True, nogil=True)
def nearest_wanted(
    moves: Moves,
    codes: NDArray[np.uint8],
    wanted: int,
    start: int,
    cost: Floats,
    parent: Indices,
    stamp: NDArray[np.int32],
    version: int,
) -> int:
    """Return the flat cell with code `wanted` that is cheapest to reach, or -1.

    Dijkstra with buckets as wide as the cheapest step: all labels within a bucket are final, so
    it needs no heap (Denardo and Fox 1979). `cost`, `parent` and `stamp` are scratch of one value
    per cell; a cell's label counts only where its stamp is the version, so nothing is cleared.
    """
    cols = moves.shape[1]
    bits = moves.ravel()
    cost[start] = 0.0
    parent[start] = -1
    stamp[start] = version
    now = [start]
    soon = [start][:0]
    later = [start][:0]
    level = 0.0
    while len(now) + len(soon) + len(later) > 0:
        best = -1
        for node in now:
            if codes[node] == wanted and (
                best < 0
                or cost[node] < cost[best] - _TIE
                or (cost[node] < cost[best] + _TIE and node < best)
            ):
                best = node
        if best >= 0:
            return best
        for node in now:
            if cost[node] < level - _TIE:
                continue
            for d in range(8):
                if not (bits[node] >> d) & 1:
                    continue
                there = node + DELTA_ROW[d] * cols + DELTA_COL[d]
                candidate = cost[node] + (_SQRT2 if d % 2 else 1.0)
                if stamp[there] == version and candidate >= cost[there] - _TIE:
                    continue
                stamp[there] = version
                cost[there] = candidate
                parent[there] = node
                if candidate < level + 2.0 - _TIE:
                    soon.append(there)
                else:
                    later.append(there)
        now = soon
        soon = later
        later = [start][:0]
        level += 1.0
    return -1


@njit(cache=True, nogil=True)
def _flood(moves: Moves, start: int, limit: float, cost: Floats) -> None:
    cols = moves.shape[1]
    bits = moves.ravel()
    cost[start] = 0.0
    now = [start]
    soon = [start][:0]
    later = [start][:0]
    level = 0.0
    while len(now) + len(soon) + len(later) > 0 and level <= limit:
        for node in now:
            if cost[node] < level - _TIE:
                continue
            for d in range(8):
                if not (bits[node] >> d) & 1:
                    continue
                there = node + DELTA_ROW[d] * cols + DELTA_COL[d]
                candidate = cost[node] + (_SQRT2 if d % 2 else 1.0)
                if candidate >= cost[there] - _TIE:
                    continue
                cost[there] = candidate
                if candidate < level + 2.0 - _TIE:
                    soon.append(there)
                else:
                    later.append(there)
        now = soon
        soon = later
        later = [start][:0]
        level += 1.0


@njit(cache=True, nogil=True)
def _fill(moves: Moves, start: int, found: Mask) -> None:
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


@njit(cache=True, nogil=True)
def _sees(passable: Mask, x: float, y: float, end_x: float, end_y: float) -> bool:
    """Walk every cell that the segment touches (Amanatides and Woo 1987)."""
    rows, cols = passable.shape
    col, row = math.floor(x), math.floor(y)
    last_col, last_row = math.floor(end_x), math.floor(end_y)
    dx, dy = end_x - x, end_y - y
    step_col = 1 if dx > 0 else -1
    step_row = 1 if dy > 0 else -1
    next_x = ((col + (1 if dx > 0 else 0)) - x) / dx if dx != 0.0 else math.inf
    next_y = ((row + (1 if dy > 0 else 0)) - y) / dy if dy != 0.0 else math.inf
    per_col = abs(1.0 / dx) if dx != 0.0 else math.inf
    per_row = abs(1.0 / dy) if dy != 0.0 else math.inf
    for _ in range(abs(last_col - col) + abs(last_row - row) + 1):
        if not (0 <= row < rows and 0 <= col < cols and passable[row, col]):
            return False
        if row == last_row and col == last_col:
            return True
        if abs(next_x - next_y) < _TIE:
            # Through a corner: both cells beside it are touched.
            if not (0 <= col + step_col < cols and passable[row, col + step_col]):
                return False
            if not (0 <= row + step_row < rows and passable[row + step_row, col]):
                return False
        if next_x < next_y:
            col += step_col
            next_x += per_col
        else:
            row += step_row
            next_y += per_row
    return 0 <= row < rows and 0 <= col < cols and bool(passable[row, col])


@njit(cache=True, nogil=True)
def _pull(passable: Mask, points: Floats, reach: int) -> Indices:
    kept = [0]
    here = 0
    while here < len(points) - 1:
        best = here + 1
        for ahead in range(min(len(points) - 1, here + reach), here + 1, -1):
            if _sees(
                passable, points[here, 0], points[here, 1], points[ahead, 0], points[ahead, 1]
            ):
                best = ahead
                break
        kept.append(best)
        here = best
    return np.array(kept)
