# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Between cells and polygons: the outlines of a mask, and the mask of outlines."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from slarm_graph.convex import convex_pieces
from slarm_graph.geometry import Floats
from slarm_graph.grid import GridGeometry, Mask
from slarm_graph.world import Solid


def outlines_m(geometry: GridGeometry, mask: Mask) -> list[Floats]:
    """Trace the sides of cells that part a mask from the rest.

    Parameters
    ----------
    geometry : GridGeometry
    mask : (rows, cols) bool

    Returns
    -------
    list of (K, 2) float64
        Closed polygons with the mask on their left: outer outlines counter-clockwise, those of
        holes clockwise [m]. Cells that touch only at a corner are apart.
    """
    corners, starts = _trace_cracks(np.pad(mask, 1))
    origin = np.array([geometry.origin_x_m, geometry.origin_y_m])
    points = (corners - 1) * geometry.resolution_m + origin
    return [points[a:b] for a, b in pairwise(starts)]


def simplified_m(outline_m: Floats, tolerance_m: float) -> Floats:
    """Drop corners (Douglas-Peucker) that lie within a tolerance of the outline without them."""
    kept = cv2.approxPolyDP(outline_m.astype(np.float32).reshape(-1, 1, 2), tolerance_m, True)
    if len(kept) < 3:
        return outline_m
    # The image library works in single precision: take the exact corner that is meant.
    exact = dict(zip(map(tuple, outline_m.astype(np.float32)), outline_m, strict=True))
    return np.array([exact[tuple(corner)] for corner in kept[:, 0]])


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
def _trace_cracks(mask: Mask) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Corner points (x, y) where cracks turn, and where each outline starts."""
    rows, cols = mask.shape
    # Whether a crack leaves a lattice corner to the right, up, left, down.
    leaves = np.zeros((rows + 1, cols + 1, 4), dtype=np.bool_)
    count = 0
    for r in range(1, rows - 1):
        for c in range(1, cols - 1):
            if mask[r, c]:
                leaves[r, c, 0] |= not mask[r - 1, c]
                leaves[r, c + 1, 1] |= not mask[r, c + 1]
                leaves[r + 1, c + 1, 2] |= not mask[r + 1, c]
                leaves[r + 1, c, 3] |= not mask[r, c - 1]
    count = leaves.sum()
    corners = np.empty((count, 2), dtype=np.int64)
    starts = [0]
    size = 0
    for r in range(rows + 1):
        for c in range(cols + 1):
            # The lowest, then leftmost corner of an outline is left to the right, or downward
            # from a hole; an outline always turns where it begins.
            if not leaves[r, c, 0]:
                continue
            x, y, heading, before = c, r, 0, -1
            while leaves[y, x, heading]:
                leaves[y, x, heading] = False
                if heading != before:
                    corners[size, 0] = x
                    corners[size, 1] = y
                    size += 1
                before = heading
                x += (1, 0, -1, 0)[heading]
                y += (0, 1, 0, -1)[heading]
                for turn in (1, 0, 3):
                    ahead = (heading + turn) % 4
                    if leaves[y, x, ahead]:
                        heading = ahead
                        break
            starts.append(size)
    return corners[:size], np.array(starts)
