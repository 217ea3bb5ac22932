# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Cells whose centre lies inside polygons.

Areas are half open: of two polygons that share an edge, a centre on it lies in exactly one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import NDArray

from slarm_graph.convex import convex_pieces
from slarm_graph.geometry import Floats
from slarm_graph.grid import GridGeometry, Mask
from slarm_graph.world import Solid


def inside_outlines(geometry: GridGeometry, polygons_m: Sequence[Floats]) -> Mask:
    """Mark cells whose centre lies inside an odd number of closed polygons (K, 2) [m]."""
    flips = np.zeros((geometry.rows, geometry.cols + 1), dtype=np.bool_)
    origin = np.array([geometry.origin_x_m, geometry.origin_y_m])
    for polygon in polygons_m:
        _flip(flips, (polygon - origin) / geometry.resolution_m - 0.5)
    return np.asarray(np.logical_xor.accumulate(flips[:, :-1], axis=1))


def inside_any(geometry: GridGeometry, convex_m: Sequence[Floats]) -> Mask:
    """Mark cells whose centre lies inside at least one convex polygon (K, 2) [m]."""
    steps = np.zeros((geometry.rows, geometry.cols + 1), dtype=np.int32)
    origin = np.array([geometry.origin_x_m, geometry.origin_y_m])
    for polygon in convex_m:
        _cover(steps, (polygon - origin) / geometry.resolution_m - 0.5)
    return np.asarray(np.cumsum(steps[:, :-1], axis=1) > 0)


def inside_solids(geometry: GridGeometry, solids: Sequence[Solid]) -> Mask:
    """Mark cells whose centre lies inside the plan of at least one solid."""
    return inside_any(geometry, [p for solid in solids for p in convex_pieces(solid.corners_m)])


@njit(cache=True, nogil=True)
def _cover(steps: NDArray[np.int32], polygon: Floats) -> None:
    """Add one to the cells of every row between the two crossings of a convex polygon."""
    rows, cols = steps.shape[0], steps.shape[1] - 1
    begin = max(0, math.ceil(max(polygon[:, 1].min(), -1.0)))
    end = min(rows, math.ceil(min(polygon[:, 1].max(), float(rows))))
    for row in range(begin, end):
        left, right = math.inf, -math.inf
        for k in range(len(polygon)):
            x0, y0 = polygon[k - 1, 0], polygon[k - 1, 1]
            x1, y1 = polygon[k, 0], polygon[k, 1]
            if (y0 <= row) != (y1 <= row):
                x = x0 + (row - y0) * (x1 - x0) / (y1 - y0)
                left, right = min(left, x), max(right, x)
        if left < right:
            first = max(0, math.ceil(min(max(left, -1.0), float(cols))))
            last = min(cols, math.ceil(min(max(right, 0.0), float(cols))))
            if first < last:
                steps[row, first] += 1
                steps[row, last] -= 1


@njit(cache=True, nogil=True)
def _flip(flips: Mask, polygon: Floats) -> None:
    """Flip the first cell right of every crossing of a row of centres; centres are whole."""
    rows, last = flips.shape[0], flips.shape[1] - 1
    for k in range(len(polygon)):
        x0, y0 = polygon[k - 1, 0], polygon[k - 1, 1]
        x1, y1 = polygon[k, 0], polygon[k, 1]
        low, high = min(y0, y1), max(y0, y1)
        if low == high:
            continue
        begin = max(0, math.ceil(max(low, -1.0)))
        end = math.ceil(min(high, float(rows)))
        for row in range(begin, min(end, rows)):
            x = x0 + (row - y0) * (x1 - x0) / (y1 - y0)
            col = min(max(math.ceil(min(max(x, -1.0), float(last))), 0), last)
            flips[row, col] = not flips[row, col]


@njit(cache=True, nogil=True)
def cover_strictly(
    steps: NDArray[np.int32], left: Floats, right: Floats, polygon: Floats, slack: float
) -> None:
    """Add one to every cell whose centre lies inside a convex counter-clockwise polygon.

    `steps` (rows, cols + 1) holds differences along each row; `left` and `right` are scratch.
    """
    rows, cols = steps.shape[0], steps.shape[1] - 1
    low, high = polygon[:, 1].min() - 0.5, polygon[:, 1].max() - 0.5
    first = math.floor(min(max(low + slack, -1.0), float(rows))) + 1
    last = math.ceil(min(max(high - slack, -1.0), float(rows))) - 1
    for k in range(len(polygon)):
        x0, y0 = polygon[k, 0], polygon[k, 1] - 0.5
        x1, y1 = polygon[(k + 1) % len(polygon), 0], polygon[(k + 1) % len(polygon), 1] - 0.5
        if y0 == y1:
            continue
        slope = (x1 - x0) / (y1 - y0)
        begin = max(first, math.ceil(max(min(y0, y1) - abs(slack), -1.0)))
        end = min(last, math.floor(min(max(y0, y1) + abs(slack), float(rows))))
        side = right if y1 > y0 else left
        # The nearer end as anchor keeps the far, scaled-up corner's rounding out of the picture.
        anchor_x, anchor_y = (x0, y0) if abs(y0) + abs(x0) < abs(y1) + abs(x1) else (x1, y1)
        for row in range(begin, end + 1):
            side[row] = anchor_x + (row - anchor_y) * slope
    for row in range(first, last + 1):
        begin = max(0, math.floor(min(max(left[row] - 0.5 + slack, -1.0), float(cols))) + 1)
        end = min(cols, math.ceil(min(max(right[row] - 0.5 - slack, -1.0), float(cols))))
        if begin < end:
            steps[row, begin] += 1
            steps[row, end] -= 1
