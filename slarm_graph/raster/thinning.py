# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Lines one cell thin: their making (Zhang and Suen 1984) and their tracing."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slarm_graph.grid import Mask
from slarm_graph.kernels import kernel

Indices = NDArray[np.int64]


def thinned(mask: Mask) -> Mask:
    """Peel a mask (rows, cols) until lines of one cell remain, joined as the mask was."""
    framed = np.pad(mask, 1).astype(np.uint8)
    _thin(framed.ravel(), np.flatnonzero(framed), framed.shape[1])
    return framed[1:-1, 1:-1] > 0


def pruned(lines: Mask, times: int) -> Mask:
    """Take the last cell off every end of thin lines, so many times; one cell stays of each."""
    framed = np.pad(lines, 1).astype(np.uint8)
    _prune(framed.ravel(), np.flatnonzero(framed), framed.shape[1], times)
    return framed[1:-1, 1:-1] > 0


def traced(lines: Mask) -> list[Indices]:
    """Follow thin lines (rows, cols): chains of flat cells, each cell in one of them.

    A chain starts at an end where there is one, goes on as straight as it can at a fork, and comes
    back to its first cell where it is closed.
    """
    framed = np.pad(lines, 1).astype(np.uint8)
    cells, starts = _trace(framed.ravel(), np.flatnonzero(framed), framed.shape[1])
    rows, cols = np.divmod(cells, framed.shape[1])
    flat = (rows - 1) * lines.shape[1] + cols - 1
    return np.split(flat, starts[1:]) if len(starts) else []


@kernel
def _around(cols: int) -> Indices:
    """Offsets of the eight neighbours, counter-clockwise from east."""
    return np.array([1, cols + 1, cols, cols - 1, -1, -cols - 1, -cols, -cols + 1])


@kernel
def _thin(flat: NDArray[np.uint8], cells: Indices, cols: int) -> None:
    around = _around(cols)
    alive = cells.copy()
    peeled = np.empty(len(cells), dtype=np.int64)
    count = 1
    while count > 0:
        count = 0
        for half in range(2):
            found = 0
            for cell in alive:
                if flat[cell] and _can_go(flat, cell, around, half):
                    peeled[found] = cell
                    found += 1
            for cell in peeled[:found]:
                # Asked again, or lines two cells wide might vanish from both sides at once.
                if _can_go(flat, cell, around, half):
                    flat[cell] = 0
                    count += 1
        alive = alive[flat[alive] > 0]


@kernel
def _neighbours(flat: NDArray[np.uint8], cell: int, around: Indices) -> tuple[int, int]:
    """Count the neighbours of a cell, and the rows of them that touch each other."""
    count, rises = 0, 0
    for k in range(8):
        here, after = flat[cell + around[k]], flat[cell + around[(k + 1) % 8]]
        count += here
        rises += here == 0 and after == 1
    return count, rises


@kernel
def _can_go(flat: NDArray[np.uint8], cell: int, around: Indices, half: int) -> bool:
    count, rises = _neighbours(flat, cell, around)
    if rises != 1 or count < 2 or count > 6:
        return False
    east, north, west, south = (
        flat[cell + around[0]],
        flat[cell + around[2]],
        flat[cell + around[4]],
        flat[cell + around[6]],
    )
    if half == 0:
        return bool(east * north * south == 0 and east * south * west == 0)
    return bool(east * north * west == 0 and north * south * west == 0)


@kernel
def _prune(flat: NDArray[np.uint8], cells: Indices, cols: int, times: int) -> None:
    around = _around(cols)
    alive = cells.copy()
    for _ in range(times):
        ends = alive[np.array([_is_end(flat, cell, around) for cell in alive])]
        for cell in ends:
            if _is_end(flat, cell, around):
                flat[cell] = 0
        alive = alive[flat[alive] > 0]


@kernel
def _is_end(flat: NDArray[np.uint8], cell: int, around: Indices) -> bool:
    """Whether all neighbours of a cell, at least one, touch each other."""
    count, rises = _neighbours(flat, cell, around)
    return rises == 1 and 1 <= count <= 2


@kernel
def _trace(flat: NDArray[np.uint8], cells: Indices, cols: int) -> tuple[Indices, Indices]:
    around = _around(cols)
    chain = [cells[:1].sum()][:0]
    starts = [0][:0]
    for only_ends in (True, False):
        for first in cells:
            if not flat[first]:
                continue
            if only_ends:
                degree = 0
                for offset in around:
                    degree += flat[first + offset]
                if degree > 1:
                    continue
            starts.append(len(chain))
            here, heading, length = first, -1, 0
            while here >= 0:
                chain.append(here)
                flat[here] = 0
                length += 1
                here, heading = _next(flat, here, heading, around)
            last = chain[-1]
            for offset in around:
                if length > 3 and last + offset == first:
                    chain.append(first)
                    break
    return np.array(chain), np.array(starts)


@kernel
def _next(flat: NDArray[np.uint8], here: int, heading: int, around: Indices) -> tuple[int, int]:
    """Neighbour to go on to, -1 if there is none, and the direction to it.

    Neighbours over a side come before those over a corner, so that no cell of a stair is left out.
    """
    best, best_bend = -1, 99
    for k in range(8):
        if flat[here + around[k]]:
            bend = 0 if heading < 0 else abs((k - heading + 4) % 8 - 4)
            bend = 2 * bend + 3 * (k % 2)
            if bend < best_bend:
                best, best_bend = k, bend
    if best < 0:
        return -1, -1
    return here + around[best], best
