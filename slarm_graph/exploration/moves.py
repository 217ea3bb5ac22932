# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The 8-connected graph of cells for path searches, and clearance by the distance transform.

The graph is `moves`, a (rows, cols) uint8 layer whose bit d says that the step in direction d is
open. Directions count eighths of a turn, counter-clockwise from +x. A diagonal is open only where
both ways around its corner are, so that no path cuts a corner.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slarm_graph.grid import Mask
from slarm_graph.kernels import kernel
from slarm_graph.raster.distance import clearance

Moves = NDArray[np.uint8]

EAST, NORTH, WEST, SOUTH = 0, 2, 4, 6
"""Directions in eighths of a turn, counter-clockwise from +x; only the straight ones have a
name."""
DELTA_ROW = (0, 1, 1, 1, 0, -1, -1, -1)
"""Row offsets of the eight directions, from east counter-clockwise."""
DELTA_COL = (1, 1, 0, -1, -1, -1, 0, 1)
"""Column offsets of the eight directions, from east counter-clockwise."""


def clearance_m(blocked: Mask, resolution_m: float) -> NDArray[np.float32]:
    """Distance (rows, cols) from every cell's centre to the nearest blocked cell's centre [m].

    Everything outside the grid counts as blocked.
    """
    return np.asarray(clearance(~blocked) * np.float32(resolution_m), dtype=np.float32)


def moves_within(passable: Mask) -> Moves:
    """Open steps between neighbouring passable cells."""
    east = passable[:, :-1] & passable[:, 1:]
    north = passable[:-1] & passable[1:]
    return moves_across(east, north)


def moves_across(east: Mask, north: Mask) -> Moves:
    """Open steps, diagonal ones included, from the straight ones.

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


@kernel
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
