# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Walks over the cells along a line, for kernels: Bresenham's, and that of every cell touched."""

from __future__ import annotations

import math

from slarm_graph.kernels import kernel_with


@kernel_with(inline=True)
def next_on_line(col: int, row: int, error: int, across: int, up: int) -> tuple[int, int, int]:
    """Step to the next cell of Bresenham's line, and its error.

    `across` and `up` are the cells from the line's start to its end; the first error is the sum of
    |across| and -|up|.
    """
    twice = 2 * error
    d_col, d_row = abs(across), -abs(up)
    if twice >= d_row:
        error += d_row
        col += 1 if across > 0 else -1
    if twice <= d_col:
        error += d_col
        row += 1 if up > 0 else -1
    return col, row, error


@kernel_with(inline=True)
def first_crossing(at: float, speed: float) -> tuple[int, int, float, float]:
    """Begin the walk over every cell that a ray touches, along one axis (Amanatides and Woo 1987).

    Parameters
    ----------
    at, speed : float
        Where the ray begins [cells], and how fast it moves [cells per unit of its parameter].

    Returns
    -------
    cell, step : int
        The first cell, and whether the walk goes up or down from there.
    crosses, every : float
        The ray's parameter where it first leaves a cell along this axis, and how much it grows
        from there to the next; infinite where it does not move.
    """
    cell = math.floor(at)
    if speed == 0.0:
        return cell, -1, math.inf, math.inf
    every = 1.0 / abs(speed)
    if speed > 0.0:
        return cell, 1, (cell + 1 - at) * every, every
    return cell, -1, (at - cell) * every, every
