# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Correlative scan matching: the best pose in a whole window, exactly.

The window is a lattice of angles and whole-cell offsets (Olson 2009). Branch and bound over blocks
of both (Hess et al. 2016, there over offsets only) finds the very pose that trying all would find:
a block of 2^h angles x 2^h x 2^h offsets is bounded by the grid's maximum over everything its
points can reach.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import cast

import numpy as np

from slarm_graph.frontends.scans.search_pyramid import FULL, Bytes, Integers, SearchPyramid
from slarm_graph.frontends.scans.search_window import Window, window_of
from slarm_graph.geometry import Floats, Pose2
from slarm_graph.kernels import kernel

_STACK = 256
"""Depth first, each level leaves seven of eight children waiting: enough for 36 levels."""

_ZERO = cast(int, np.int64(0))
"""To count from, as a value: for a literal numba compiles a kernel anew."""


@dataclass(frozen=True, slots=True)
class SearchHit:
    """The best lattice pose of a window.

    Parameters
    ----------
    grid_from_robot : Pose2
    score : float
        Mean likelihood of the points there, 0 to 1.
    visited : int
        Blocks and poses scored on the way.
    """

    grid_from_robot: Pose2
    score: float
    visited: int


def search(
    pyramid: SearchPyramid,
    points: Floats,
    center: Pose2,
    *,
    reach_m: float,
    reach_rad: float = math.pi,
    min_score: float = 0.0,
) -> SearchHit | None:
    """Find the best pose in a window, exactly.

    Parameters
    ----------
    pyramid : SearchPyramid
    points : (K, 2) float64
        Returns in the robot's frame [m].
    center : Pose2
        `grid_from_robot` in the middle of the window.
    reach_m, reach_rad : float
        Half the window's sides [m] and half its angle [rad]; pi searches the whole circle.
    min_score : float
        Poses with a lower mean likelihood are not worth finding; the higher, the faster.

    Returns
    -------
    SearchHit or None
        None when nothing in the window is better than `min_score`.
    """
    near = points[np.hypot(points[:, 0], points[:, 1]) <= pyramid.max_radius_m]
    if not len(near):
        return None
    window = window_of(pyramid, near, center, pyramid.step_rad, reach_m, reach_rad)
    floor = math.floor(min_score * FULL * len(near))
    best, visited = _branch_and_bound(pyramid, window, floor)
    k, i, j, total = best.tolist()
    if total <= floor:
        return None
    pose = Pose2(
        center.x + i * pyramid.resolution_m,
        center.y + j * pyramid.resolution_m,
        center.theta + k * pyramid.step_rad,
    )
    return SearchHit(pose, total / (FULL * len(near)), visited)


@kernel
def _score_offsets(
    cells: Bytes,
    layout: Integers,
    level: int,
    window: Window,
    k0: int,
    i0: int,
    j0: int,
    sums: Integers,
) -> None:
    """Bound (or, at level 0, score) 2 x 2 blocks from angle step k0 and offset (i0, j0) on."""
    start, rows, cols = layout[level, 0], layout[level, 1], layout[level, 2]
    stride, padding = layout[level, 3], layout[level, 4]
    shift = 0
    while (1 << shift) < stride:
        shift += 1
    block = 1 << level
    back = block >> 1
    points = window.points
    angle = window.heading + (k0 + 0.5 * (block - 1)) * window.step
    c, s = math.cos(angle), math.sin(angle)
    base_x = window.center[0] + 0.5
    base_y = window.center[1] + 0.5
    sums[:] = 0
    for p in range(len(points)):
        x = math.floor(base_x + c * points[p, 0] - s * points[p, 1]) + i0 - back + padding
        y = math.floor(base_y + s * points[p, 0] + c * points[p, 1]) + j0 - back + padding
        col0, col1 = x >> shift, (x + block) >> shift
        row0, row1 = y >> shift, (y + block) >> shift
        if row0 >= 0 and row0 < rows:
            if col0 >= 0 and col0 < cols:
                sums[0] += cells[start + row0 * cols + col0]
            if col1 >= 0 and col1 < cols:
                sums[1] += cells[start + row0 * cols + col1]
        if row1 >= 0 and row1 < rows:
            if col0 >= 0 and col0 < cols:
                sums[2] += cells[start + row1 * cols + col0]
            if col1 >= 0 and col1 < cols:
                sums[3] += cells[start + row1 * cols + col1]


def _branch_and_bound(pyramid: SearchPyramid, window: Window, floor: int) -> tuple[Integers, int]:
    """Return the best (4,), angle and offset steps and sum, and how many blocks were scored.

    The sum is `floor` where none is better. Of several best it is the one that is found depth
    first, best bound first.
    """
    cells, layout = pyramid.cells, pyramid.layout
    level = _top_level(layout, window)
    roots, visited = _roots(cells, layout, window, level, floor)
    best = np.array([0, 0, 0, floor], dtype=np.int64)
    ties, scored = _best_first(cells, layout, window, roots, level, best)
    visited += scored
    if ties > 1:
        best[3] -= 1
        roots = roots[np.argsort(-roots[:, 3], kind="stable")]
        visited += _descend_all(cells, layout, window, roots, level, best)
    return best, visited


@kernel
def _best_first(
    cells: Bytes, layout: Integers, window: Window, roots: Integers, top: int, best: Integers
) -> tuple[int, int]:
    """Improve on the `best` (4,) within blocks, best first (by bound).

    Depth first scores five times as many before it reaches the best.

    Returns
    -------
    Number of poses that are best (ties), and number of blocks scored.
    """
    first = np.full(FULL * len(window.points) + 1, -1, dtype=np.int64)
    queue = np.empty((max(1024, 2 * len(roots)), 6), dtype=np.int64)
    children = np.empty((8, 4), dtype=np.int64)
    sums = np.zeros(4, dtype=np.int64)
    count, bound, ties, scored = _ZERO, _ZERO, _ZERO, _ZERO
    for r in range(len(roots)):
        count = _enqueue(queue, first, count, roots[r], top)
        bound = max(bound, roots[r, 3])
    reached = best[3] + 1
    while bound >= reached:
        at = first[bound]
        if at < 0:
            bound -= 1
            continue
        k, i, j, level = queue[at, 0], queue[at, 1], queue[at, 2], queue[at, 4]
        first[bound] = queue[at, 5]
        if level == 0:
            reached = bound
            ties += 1
            for field in range(4):
                best[field] = queue[at, field]
            continue
        found, half = _ZERO, 1 << (level - 1)
        for k_child in range(k, min(k + half, window.turns) + 1, half):
            _score_offsets(cells, layout, level - 1, window, k_child, i, j, sums)
            scored += 4
            found = _admit(children, found, sums, reached - 1, k_child, i, j, half, window.reach)
        if count + found > len(queue):
            longer = np.empty((2 * len(queue), 6), dtype=np.int64)
            for block in range(count):
                for field in range(6):
                    longer[block, field] = queue[block, field]
            queue = longer
        for child in range(found):
            count = _enqueue(queue, first, count, children[child], level - 1)
            bound = max(bound, children[child, 3])
            if level == 1:
                reached = max(reached, children[child, 3])
    return ties, scored


@kernel
def _enqueue(queue: Integers, first: Integers, count: int, block: Integers, level: int) -> int:
    """Queue a block before others of the same bound; returns the new length of the queue."""
    for field in range(4):
        queue[count, field] = block[field]
    queue[count, 4] = level
    queue[count, 5] = first[block[3]]
    first[block[3]] = count
    return count + 1


@kernel
def _descend_all(
    cells: Bytes, layout: Integers, window: Window, roots: Integers, top: int, best: Integers
) -> int:
    """Improve on the `best` (4,) within blocks, depth first; returns the number of blocks scored.

    Sorting lies outside: numba's own sort takes longer to compile than all of the search.
    """
    visited = 0
    for r in range(len(roots)):
        if roots[r, 3] <= best[3]:
            break
        visited += _descend(cells, layout, window, roots[r], top, best)
    return visited


@kernel
def _top_level(layout: Integers, window: Window) -> int:
    """Return the first level whose blocks are as wide as the window, or the last."""
    widest = 2 * min(window.turns, window.reach) + 1
    top = 0
    while top + 1 < len(layout) and (1 << top) < widest:
        top += 1
    return top


@kernel
def _roots(
    cells: Bytes, layout: Integers, window: Window, level: int, floor: int
) -> tuple[Integers, int]:
    """Blocks (M, 4) of a level that cover the window and may beat the floor; and all scored."""
    reach, turns, size = window.reach, window.turns, 1 << level
    per_angle = (2 * reach) // (2 * size) + 1
    angles = (2 * turns) // size + 1
    scored = 4 * angles * per_angle * per_angle
    roots = np.empty((scored, 4), dtype=np.int64)
    sums = np.zeros(4, dtype=np.int64)
    count = _ZERO
    for a in range(angles):
        k = -turns + a * size
        for q in range(per_angle):
            for p in range(per_angle):
                i, j = -reach + 2 * p * size, -reach + 2 * q * size
                _score_offsets(cells, layout, level, window, k, i, j, sums)
                count = _admit(roots, count, sums, floor, k, i, j, size, reach)
    return roots[:count], scored


@kernel
def _descend(
    cells: Bytes, layout: Integers, window: Window, root: Integers, top: int, best: Integers
) -> int:
    """Improve on the `best` (4,) within one block; returns the number of blocks scored."""
    stack = np.empty((_STACK, 5), dtype=np.int64)
    children = np.empty((8, 4), dtype=np.int64)
    sums = np.zeros(4, dtype=np.int64)
    for field in range(4):
        stack[0, field] = root[field]
    stack[0, 4] = top
    depth, visited = 1, 0
    while depth > 0:
        depth -= 1
        k, i, j, bound, level = stack[depth]
        if bound <= best[3]:
            continue
        if level == 0:
            for field in range(4):
                best[field] = stack[depth, field]
            continue
        half = 1 << (level - 1)
        found = _ZERO
        for side in range(2):
            k_child = k + side * half
            if k_child > window.turns:
                continue
            _score_offsets(cells, layout, level - 1, window, k_child, i, j, sums)
            visited += 4
            found = _admit(children, found, sums, best[3], k_child, i, j, half, window.reach)
        depth = _push(stack, depth, children, found, level - 1)
    return visited


@kernel
def _push(stack: Integers, depth: int, children: Integers, found: int, level: int) -> int:
    """Put children on the stack, the one with the highest bound on top; returns the new depth.

    Of equal ones the later is above: the order of a stable sort, here by insertion.
    """
    for child in range(found):
        at = depth + child
        while at > depth and stack[at - 1, 3] > children[child, 3]:
            for field in range(5):
                stack[at, field] = stack[at - 1, field]
            at -= 1
        for field in range(4):
            stack[at, field] = children[child, field]
        stack[at, 4] = level
    return depth + found


@kernel
def _admit(
    nodes: Integers,
    count: int,
    sums: Integers,
    lowest: int,
    k: int,
    i: int,
    j: int,
    size: int,
    reach: int,
) -> int:
    """Append those of four neighbouring blocks that can still win."""
    for b in range(4):
        i_block, j_block = i + (b & 1) * size, j + (b >> 1) * size
        if sums[b] > lowest and i_block <= reach and j_block <= reach:
            nodes[count, 0] = k
            nodes[count, 1] = i_block
            nodes[count, 2] = j_block
            nodes[count, 3] = sums[b]
            count += 1
    return count
