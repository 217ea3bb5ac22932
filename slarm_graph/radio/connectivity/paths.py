# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Shortest paths under constraints on radio coverage: no outage, bounded outage, or a penalty."""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slarm_graph.errors import BadInput
from slarm_graph.geometry import Floats
from slarm_graph.grid import Cells, GridGeometry, Mask
from slarm_graph.kernels import kernel, kernel_with

LAYERS = 8
"""Labels per cell, by length of the outage so far: halving it can miss paths that just keep the
limit, doubling it doubles memory and time."""


@dataclass(frozen=True, slots=True)
class ConnectedPath:
    """A path and its radio coverage.

    Parameters
    ----------
    cells : (K, 2) int64
        (row, col) from start to goal.
    length_m : float
    below_m, longest_below_m : float
        Length below the threshold, in total and of the longest outage.
    least_dbm : float
        Weakest level along the path.
    """

    cells: Cells
    length_m: float
    below_m: float
    longest_below_m: float
    least_dbm: float


def connected_path(
    geometry: GridGeometry,
    level_dbm: NDArray[np.float32],
    start_m: tuple[float, float],
    goal_m: tuple[float, float],
    threshold_dbm: float,
    *,
    longest_outage_m: float = 0.0,
    weight_per_db: float = 0.0,
) -> ConnectedPath | None:
    """Find the shortest path that keeps the connection; None when there is none.

    Parameters
    ----------
    geometry : GridGeometry
    level_dbm : (rows, cols)
        Of the best server; nan where the robot cannot be.
    start_m, goal_m : (x, y) [m]
    threshold_dbm : float
    longest_outage_m : float
        Longest stretch below the threshold: 0 none, inf any (the plain shortest path).
    weight_per_db : float
        Every metre costs 1 + this times the dB by which it lies below the threshold.

    Raises
    ------
    BadInput
        When start or goal is not on the floor.
    """
    floor: Mask = np.isfinite(level_dbm)
    start, goal = (_on_floor(geometry, floor, point) for point in (start_m, goal_m))
    with np.errstate(invalid="ignore"):
        covered = floor & (level_dbm >= threshold_dbm)
        deficit_db = np.where(floor & ~covered, threshold_dbm - level_dbm, 0.0)
    if longest_outage_m <= 0.0 and not (covered[start] and covered[goal]):
        return None
    limit = longest_outage_m / geometry.resolution_m
    layers = LAYERS if 0.0 < limit < math.inf else 1
    allowed = floor if limit > 0.0 else covered
    weights = (1.0 + weight_per_db * deficit_db).astype(np.float32)
    cols = floor.shape[1]
    flat = _search(
        allowed,
        covered | np.bool_(layers == 1),
        weights,
        start[0] * cols + start[1],
        goal[0] * cols + goal[1],
        limit,
        layers,
    )
    if not len(flat):
        return None
    cells = np.stack(np.divmod(flat, cols), axis=1).astype(np.int64)
    return _evaluated(geometry, cells, level_dbm, threshold_dbm)


def _on_floor(geometry: GridGeometry, floor: Mask, point: tuple[float, float]) -> tuple[int, int]:
    row, col = (int(v) for v in geometry.cell_of(point))
    if not geometry.contains(np.array([row, col])) or not floor[row, col]:
        raise BadInput(f"({point[0]:g}, {point[1]:g}) m is not on the floor that can be reached")
    return row, col


def _evaluated(
    geometry: GridGeometry, cells: Cells, level_dbm: NDArray[np.float32], threshold_dbm: float
) -> ConnectedPath:
    levels = level_dbm[tuple(cells.T)]
    steps: Floats = np.hypot(*np.diff(cells, axis=0).T) * geometry.resolution_m
    below = levels[1:] < threshold_dbm
    longest = run = 0.0
    for step, outage in zip(steps.tolist(), below.tolist(), strict=True):
        run = run + step if outage else 0.0
        longest = max(longest, run)
    return ConnectedPath(
        cells,
        float(steps.sum()),
        float(steps[below].sum()),
        longest,
        float(levels.min()),
    )


@kernel
def _search(
    allowed: Mask,
    covered: Mask,
    weights: NDArray[np.float32],
    start: int,
    goal: int,
    limit: float,
    layers: int,
) -> NDArray[np.int64]:
    """A* over (cell, outage so far); empty when there is no path.

    A state keeps the exact outage of its cheapest path, so every path found keeps the limit. Paths
    into a cell are expanded in order of cost: a later one is dominated unless its outage is
    shorter than that of all before it.
    """
    cols = allowed.shape[1]
    size = allowed.size * layers
    cost = np.full(size, np.inf, dtype=np.float32)
    outage = np.zeros(size, dtype=np.float32)
    parent = np.full(size, -1, dtype=np.int64)
    least_outage = np.full(allowed.size, np.inf, dtype=np.float32)
    goal_row, goal_col = goal // cols, goal % cols
    cost[start * layers] = 0.0
    heap = [(0.0, start * layers)]
    while heap:
        _, state = heapq.heappop(heap)
        cell = state // layers
        if outage[state] >= least_outage[cell]:
            continue
        least_outage[cell] = outage[state]
        if cell == goal:
            return _cells_back(parent, state, layers)
        row, col = cell // cols, cell % cols
        for dr in range(-1, 2):
            for dc in range(-1, 2):
                if not _may_step(allowed, row, col, dr, dc):
                    continue
                r, c = row + dr, col + dc
                step = 1.4142135623730951 if dr != 0 and dc != 0 else 1.0
                outage_now = 0.0 if covered[r, c] else outage[state] + step
                if outage_now > limit or outage_now >= least_outage[r * cols + c]:
                    continue
                layer = (
                    0 if outage_now == 0.0 else min(int(outage_now / limit * layers), layers - 1)
                )
                other = (r * cols + c) * layers + layer
                total = cost[state] + step * weights[r, c]
                if total < cost[other]:
                    cost[other] = total
                    outage[other] = outage_now
                    parent[other] = state
                    rest = _octile(abs(c - goal_col), abs(r - goal_row))
                    heapq.heappush(heap, (total + rest, other))
    return np.empty(0, dtype=np.int64)


@kernel_with(inline=True)
def _may_step(allowed: Mask, row: int, col: int, dr: int, dc: int) -> bool:
    """Whether a step to a neighbour is allowed: a diagonal must not cut a corner."""
    r, c = row + dr, col + dc
    if (dr == 0 and dc == 0) or r < 0 or c < 0 or r >= allowed.shape[0] or c >= allowed.shape[1]:
        return False
    return bool(allowed[r, c] and allowed[r, col] and allowed[row, c])


@kernel_with(inline=True)
def _octile(across: int, up: int) -> float:
    """Octile distance [cells]: length of the shortest path over free cells."""
    return max(across, up) + 0.41421356237309515 * min(across, up)


@kernel
def _cells_back(parent: NDArray[np.int64], last: int, layers: int) -> NDArray[np.int64]:
    """Path of flat cells from the start to a state."""
    path = [last // layers]
    while parent[last] >= 0:
        last = parent[last]
        path.append(last // layers)
    return np.array(path[::-1], dtype=np.int64)
