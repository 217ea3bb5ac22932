# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""GGMR: the paper's Algorithm 1, literally, with what it leaves open decided.

Decided: a new start position is the open cell with the cheapest path from here (ties: lowest row,
then lowest column), the direction of travel is determined anew in every row that the robot comes
to (+x first, then -x), a diagonal step is two moves through a side cell that is not blocked, and
the algorithm ends when no reachable open cell is left.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from slarm_graph.exploration.coverage_grid import (
    BLOCKED,
    OPEN,
    VISITED,
    Codes,
    CoverageGrid,
)
from slarm_graph.exploration.moves import Moves
from slarm_graph.exploration.searches import Labels, new_labels, walk_back, wavefront
from slarm_graph.kernels import kernel

_FIRST_ROOM: Final = 1024
"""Initial capacity of a path [cells]; doubles where needed."""
PathCells = NDArray[np.int32]
Walked = NDArray[np.int32]
"""Flat cell and facing of every step, (M, 2)."""


@dataclass(frozen=True, slots=True)
class GgmrCounts:
    """Operation counts of a run of Algorithm 1.

    Parameters
    ----------
    comparisons : int
        Look-ups of a neighbouring cell's value.
    restarts : int
        New start positions, each reached by A*.
    turns : int
        Changes of the direction of travel.
    revisits : int
        Steps into cells that were visited before.
    """

    comparisons: int = 0
    restarts: int = 0
    turns: int = 0
    revisits: int = 0


@dataclass(frozen=True, slots=True)
class GgmrPath:
    """A run of Algorithm 1.

    Parameters
    ----------
    cells : (M, 2) int32
        Cells in the order of driving, the start included.
    facing : (M,) int8
        Direction of travel along the row at every cell; 0 where it is to be determined.
    counts : GgmrCounts
    complete : bool
        Whether no reachable open cell is left.
    """

    cells: PathCells
    facing: NDArray[np.int8]
    counts: GgmrCounts
    complete: bool


def ggmr_path(
    coverage: CoverageGrid,
    start: tuple[int, int],
    *,
    facing: int = 0,
    max_cells: int | None = None,
) -> GgmrPath:
    """Run Algorithm 1 on the map so far.

    Parameters
    ----------
    coverage : CoverageGrid
    start : (row, col)
    facing : {0, 1, -1}
        Direction of travel along the row to continue with; 0 determines it anew.
    max_cells : int, optional
        Stop after the first step that makes the path this long.
    """
    limit = np.iinfo(np.int64).max if max_cells is None else max_cells
    cols, labels = coverage.geometry.cols, new_labels(coverage.codes.size)
    here = start[0] * cols + start[1]
    walked, tally, complete = _algorithm_1(
        coverage.codes.copy(), coverage.moves, here, facing, limit, labels
    )
    cells = np.stack(np.divmod(walked[:, 0], cols), axis=-1)
    counts = GgmrCounts(int(tally[0]), int(tally[1]), _count_turns(cells), int(tally[2]))
    return GgmrPath(cells, walked[:, 1].astype(np.int8), counts, bool(complete))


@kernel
def _algorithm_1(
    codes: Codes, moves: Moves, start: int, facing: int, max_cells: int, labels: Labels
) -> tuple[Walked, NDArray[np.int64], bool]:
    """Run until `max_cells` are in the path or no reachable open cell is left; marks `codes`.

    Returns flat cells and facings of the path, (comparisons, restarts, revisits), and whether the
    coverage is complete.
    """
    cols = codes.shape[1]
    flat, bits = codes.ravel(), moves.ravel()
    tally = np.zeros(3, dtype=np.int64)
    walked = np.empty((_FIRST_ROOM, 2), dtype=np.int32)
    walked[0, 0], walked[0, 1] = start, facing
    here, count = start, 1
    flat[here] = VISITED
    while count < max_cells:
        walked = _with_room(walked, count + 2 - len(walked))
        if facing == 0:
            facing, looks = _direction(flat, bits, here)
            tally[0] += looks
        ahead_open = (bits[here] >> (0 if facing > 0 else 4)) & 1
        tally[0] += 1
        if ahead_open and flat[here + facing] == OPEN:
            here += facing
            walked[count, 0], walked[count, 1] = here, facing
            flat[here] = VISITED
            count += 1
            continue
        first, second, looks = _step_up(flat, bits, here, facing, cols)
        tally[0] += looks
        facing = 0
        if first >= 0:
            path = np.array([here, first, second])[: 3 if second >= 0 else 2]
        else:
            goal = wavefront(moves, flat, OPEN, here, np.inf, labels, tally[1] + 1)
            path = walk_back(labels, goal, cols)
            if not len(path):
                return walked[:count], tally, True
            tally[1] += 1
        tally[2] += len(path) - 2
        after = count + len(path) - 1
        walked = _with_room(walked, after - len(walked))
        walked[count:after, 0], walked[count:after, 1] = path[1:], 0
        here, count = path[-1], after
        flat[here] = VISITED
    return walked[:count], tally, False


@kernel
def _direction(flat: NDArray[np.uint8], bits: NDArray[np.uint8], here: int) -> tuple[int, int]:
    """Direction of travel along the row, +x first, then -x; and the number of look-ups."""
    if (bits[here] & 1) and flat[here + 1] == OPEN:
        return 1, 1
    behind_open = (bits[here] >> 4) & 1 and flat[here - 1] == OPEN
    return (-1 if behind_open else 1), 2


@kernel
def _with_room(walked: Walked, missing: int) -> Walked:
    """Double the capacity of a path where it is short."""
    if missing <= 0:
        return walked
    more = np.empty((2 * len(walked) + missing, 2), dtype=np.int32)
    more[: len(walked)] = walked
    return more


@kernel
def _count_turns(cells: PathCells) -> int:
    """Count changes of direction along a path."""
    turns = 0
    for i in range(2, len(cells)):
        for axis in range(2):
            if 2 * cells[i - 1, axis] != cells[i, axis] + cells[i - 2, axis]:
                turns += 1
                break
    return turns


@kernel
def _step_up(
    flat: NDArray[np.uint8], bits: NDArray[np.uint8], here: int, facing: int, cols: int
) -> tuple[int, int, int]:
    """Find an open cell up, up-ahead or up-behind.

    Returns the next cell and, for a diagonal, the cell after it (-1: none), and the look-ups.
    """
    up = here + cols
    up_open = (bits[here] >> 2) & 1
    if up_open and flat[up] == OPEN:
        return up, -1, 1
    looks = 1
    for side in (facing, -facing):
        looks += 1
        d = 0 if side > 0 else 4
        via_up = up_open and (bits[up] >> d) & 1
        if via_up and flat[up] != BLOCKED and flat[up + side] == OPEN:
            return up, up + side, looks
        beside = here + side
        via_side = (bits[here] >> d) & 1 and (bits[beside] >> 2) & 1
        if via_side and flat[beside] != BLOCKED and flat[beside + cols] == OPEN:
            return beside, beside + cols, looks
    return -1, -1, looks
