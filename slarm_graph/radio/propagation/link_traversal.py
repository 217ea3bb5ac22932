# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Traversal of grid cells along links, from one obstacle to the next.

A segment passes the cells of each row in one run, and those of each column. It is traversed along
the axis of the longer runs; a table of the number of free cells that begin at each lets a run
without an obstacle, as nearly all are, take one look-up.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slarm_graph.geometry import Floats
from slarm_graph.grid import Mask
from slarm_graph.kernels import kernel, kernel_with
from slarm_graph.raster.lines import first_crossing

Counts = NDArray[np.int16]
Ints = NDArray[np.int64]
Heights = NDArray[np.float32]
FreeCells = NDArray[np.uint8]

_GAP_CELLS = 2.0 + 1e-6
"""Along a slanted face a segment leaves and enters cells of the same obstacle; without it 7 % of
the links of the world `cluttered` count an obstacle twice, with 4 thin passages vanish. The small
addition exceeds rounding: two whole cells along an axis are no gap."""

_MOST_FREE = 255
"""What a byte holds; longer runs take another look-up."""


class Grids(NamedTuple):
    """Maps that links cross, in K variants: the map shifted, or the access point higher.

    Parameters
    ----------
    heights : (rows, cols) float32
        Top of the obstacle that fills the cell [m].
    tallest : (rows, cols) float32
        Greatest height on a cell over all shifts, with a margin as wide as the largest [m].
    shifts : (K, 2) int64
        Rows and columns by which the map is shifted.
    inside : (rows, cols) int16
        Label, from 1, of the block whose inside the cell is; 0 elsewhere.
    """

    heights: Heights
    tallest: Heights
    shifts: Ints
    inside: NDArray[np.int16]


class LinkEnds(NamedTuple):
    """Where links begin and end.

    Parameters
    ----------
    eyes : (E, 2) float64
        Access points in plan, x and y [cells].
    eye_heights : (K,) float64
        Of each of them, one for each variant [m].
    points : (N, 2) float64
        Antennas, x and y [cells].
    height : float
        Of the antennas [m].
    mount_cells : float
        Obstacles that a link has left this near to the access point are its mount.
    """

    eyes: Floats
    eye_heights: Floats
    points: Floats
    height: float
    mount_cells: float


class CrossingCounts(NamedTuple):
    """Obstacles crossed by links.

    Parameters
    ----------
    counts : (E, K, N) int16
        Number of walls and obstacles.
    through : (N, B) bool
        Whether the inside of each block is passed, on the map as it is.
    """

    counts: Counts
    through: Mask


def free_run_lengths(blocked: Mask) -> tuple[FreeCells, FreeCells]:
    """Count how many free cells begin at each, along its row and along its column.

    Parameters
    ----------
    blocked : (rows, cols) bool

    Returns
    -------
    in_row : (rows, cols) uint8
        At most 255.
    in_column : (cols, rows) uint8
    """
    return _free_in_row(blocked), _free_in_row(np.ascontiguousarray(blocked.T))


@kernel
def _free_in_row(blocked: Mask) -> FreeCells:
    free = np.zeros(blocked.shape, dtype=np.uint8)
    for row in range(blocked.shape[0]):
        count = 0
        for col in range(blocked.shape[1] - 1, -1, -1):
            count = 0 if blocked[row, col] else min(count + 1, _MOST_FREE)
            free[row, col] = count
    return free


@kernel
def count_crossings(
    grids: Grids, free: tuple[FreeCells, FreeCells], ends: LinkEnds, passed: CrossingCounts
) -> None:
    """Traverse the link from every access point to every antenna, and count crossings.

    Parameters
    ----------
    grids : Grids
    free : tuple
        By `free_run_lengths`, of the cells whose tallest can block a link.
    ends : LinkEnds
    passed : CrossingCounts
        Zeros; filled.
    """
    margin = (len(grids.tallest) - len(grids.heights)) // 2
    cells = np.empty((sum(free[0].shape), 2), dtype=np.int64)
    spans = np.empty((len(cells), 2))
    for e in range(len(ends.eyes)):
        x, y = ends.eyes[e]
        for i in range(len(ends.points)):
            across, up = ends.points[i, 0] - x, ends.points[i, 1] - y
            length = max(math.hypot(across, up), 1e-12)
            in_rows = abs(across) >= abs(up)
            link = (x, across, y, up) if in_rows else (y, up, x, across)
            lines, carried = free[0] if in_rows else free[1], ends.mount_cells / length
            count = _blocked_cells(lines, margin, in_rows, link, carried, cells, spans)
            if count:
                _count_link(grids, ends, e, i, _GAP_CELLS / length, cells[:count], spans, passed)


@kernel
def _blocked_cells(
    free: FreeCells,
    margin: int,
    in_rows: bool,
    link: tuple[float, float, float, float],
    carried: float,
    cells: Ints,
    spans: Floats,
) -> int:
    """Find the potentially blocking cells of a link, in its order.

    Parameters
    ----------
    free : (lines, size) uint8
    margin : int
        Of the lines around the map.
    in_rows : bool
        Whether lines are rows.
    link : tuple
        Where it begins along lines and how far it goes there, and the same across them [cells].
    carried : float
        Share of it that does not count.
    cells : (M, 2) int64
        Filled with row and column.
    spans : (M, 2) float64
        Filled with where the link enters and leaves, as shares of it.
    """
    at, along, line_at, over = link
    first, step, crosses, every = first_crossing(at, along)
    line, line_step, line_next, line_every = first_crossing(line_at, over)
    # Through a corner of cells the column changes first, whichever way lines go.
    upward = (along >= 0.0) == in_rows
    begin, entered, count = _cell(at, upward), 0.0, 0
    while entered < 1.0:
        until = min(line_next, 1.0)
        stop = _cell(at + along * until, upward)
        known = 0 <= line + margin < len(free)
        if known and not _is_free(free, line + margin, begin + margin, stop + margin):
            for cell in range(begin, stop + step, step):
                left = min(until, crosses + (cell - first) * step * every)
                at_all = entered < 1.0 and left > carried
                if at_all and not _is_free(free, line + margin, cell + margin, cell + margin):
                    cells[count, 0], cells[count, 1] = (line, cell) if in_rows else (cell, line)
                    spans[count, 0], spans[count, 1] = entered, left
                    count += 1
                entered = left
        begin, entered = stop, until
        line, line_next = line + line_step, line_next + line_every
    return count


@kernel_with(inline=True)
def _cell(at: float, upward: bool) -> int:
    """Cell of a coordinate on a line; at a border the one above, or the one below."""
    return math.floor(at) if upward else math.ceil(at) - 1


@kernel
def _is_free(free: FreeCells, line: int, begin: int, stop: int) -> bool:
    """Whether all cells of a line from one to another, either way, are free."""
    cell, last = max(min(begin, stop), 0), min(max(begin, stop), free.shape[1] - 1)
    while cell <= last and free[line, cell] > 0:
        cell += int(free[line, cell])
    return bool(cell > last)


@kernel
def _count_link(
    grids: Grids,
    ends: LinkEnds,
    e: int,
    i: int,
    gap: float,
    cells: Ints,
    spans: Floats,
    passed: CrossingCounts,
) -> None:
    """Count the obstacles of one link from its cells (C, 2) and where it enters and leaves them."""
    heights, shifts, insides = grids.heights, grids.shifts, grids.inside
    rows, cols = heights.shape
    for k in range(len(shifts)):
        rise, left_at = ends.height - ends.eye_heights[k], -1.0
        for f in range(len(cells)):
            row, col = cells[f, 0] - shifts[k, 0], cells[f, 1] - shifts[k, 1]
            entered, left = spans[f, 0], spans[f, 1]
            lowest = ends.eye_heights[k] + rise * (left if rise < 0.0 else entered)
            if 0 <= row < rows and 0 <= col < cols and heights[row, col] > lowest:
                if left_at < 0.0 or entered - left_at > gap:
                    passed.counts[e, k, i] += 1
                left_at = left
                if k == 0 and passed.through.shape[1] > 0 and insides[row, col] > 0:
                    passed.through[i, insides[row, col] - 1] = True
