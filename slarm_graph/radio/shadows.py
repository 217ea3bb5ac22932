# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Kernels of the line of sight: boxes of cells, rasterised shadows of prisms, single rays."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from slarm_graph.geometry import Floats, wrap_angles
from slarm_graph.grid import Mask
from slarm_graph.kernels import kernel
from slarm_graph.raster.bands import by_windows
from slarm_graph.raster.fill import cover_strictly
from slarm_graph.tiles import TILE_CELLS, Where, Window

GRAZE_CELLS = 1e-9
"""A link that grazes a surface is clear; above the rounding of coordinates of 10^5 cells."""

_SECTORS: Final = 1 << 13
"""Angular sectors of occlusion culling; a cell fills one up to 1300 cells away. Of 243,000 boxes in
a clinic 32,000, 8000 and 4800 are left with half of it, it and double."""
_EDGE_SECTORS: Final = 1e-3
"""0.8 microradians: above rounding, and far beyond the slack of grazing links."""
_BOXES: Final = 1 << 15
"""Boxes processed together, of a few tens of sectors each: megabytes."""


@kernel
def boxes_of_cells(
    heights: NDArray[np.generic], above: float, known: Mask
) -> tuple[NDArray[np.int64], Floats]:
    """Cover cells higher than `above` by rectangles of one height, col0, row0, col1, row1.

    None are in tiles that are not `known` (R, C).
    """
    rows, cols = heights.shape
    boxes = np.empty((1024, 4), dtype=np.int64)
    tops = np.empty(1024)
    count = 0
    begun_at = np.full(cols, -1, dtype=np.int64)
    for row in range(rows):
        col = 0
        while col < cols:
            if col % TILE_CELLS == 0 and not known[row // TILE_CELLS, col // TILE_CELLS]:
                col += TILE_CELLS
                continue
            top = heights[row, col]
            first = col
            col += 1
            if not top > above:
                continue
            while col < cols and heights[row, col] == top:
                col += 1
            last = begun_at[first]
            if last >= 0 and boxes[last, 3] == row and boxes[last, 2] == col and tops[last] == top:
                boxes[last, 3] = row + 1
                continue
            if count == len(tops):
                boxes = np.concatenate((boxes, np.empty_like(boxes)))
                tops = np.concatenate((tops, np.empty_like(tops)))
            boxes[count, 0] = first
            boxes[count, 1] = row
            boxes[count, 2] = col
            boxes[count, 3] = row + 1
            tops[count] = top
            begun_at[first] = count
            count += 1
    return boxes[:count], tops[:count]


def unoccluded(eye: Floats, boxes: NDArray[np.int64]) -> Mask:
    """Occlusion culling: which boxes (N, 4) of infinite height are not surely hidden from the eye.

    Every direction in which one of the others is seen from the eye (2,) is filled by a nearer box;
    lengths in cells.
    """
    parts = np.array_split(boxes, len(boxes) // _BOXES + 1)
    ends = np.full(_SECTORS, np.inf)
    for part in parts:
        first, last, _, farthest = _extents(eye, part)
        filled, of = _sectors_of(np.ceil(first + _EDGE_SECTORS), np.floor(last - _EDGE_SECTORS))
        np.minimum.at(ends, filled, farthest[of])
    front = []
    for part in parts:
        first, last, nearest, _ = _extents(eye, part)
        touched, of = _sectors_of(np.floor(first - _EDGE_SECTORS), np.ceil(last + _EDGE_SECTORS))
        seen = ends[touched] >= nearest[of]
        front.append(np.bincount(of, weights=seen, minlength=len(part)) > 0.0)
    return np.concatenate(front)


def _extents(eye: Floats, boxes: NDArray[np.int64]) -> tuple[Floats, Floats, Floats, Floats]:
    """First and last direction [sectors], least and greatest distance of boxes; 0, inf inside."""
    low, high = boxes[:, :2] - eye, boxes[:, 2:] - eye
    nearest = np.hypot(*np.maximum(np.maximum(low, -high), 0.0).T)
    farthest = np.where(nearest > 0.0, np.hypot(*np.maximum(high, -low).T), np.inf)
    y, x = np.stack([low, low, high, high])[..., 1], np.stack([low, high, low, high])[..., 0]
    angles = np.arctan2(y, x)
    off = wrap_angles(angles - angles[0])
    first, last = angles[0] + off.min(axis=0), angles[0] + off.max(axis=0)
    sector = 2.0 * np.pi / _SECTORS
    return first / sector, last / sector, nearest, farthest


def _sectors_of(first: Floats, past: Floats) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Sectors of all ranges in one array, and the index of the range of each."""
    count = np.maximum(past - first, 0.0).astype(np.int64)
    of = np.repeat(np.arange(len(count)), count)
    rank = np.arange(len(of)) - (np.cumsum(count) - count)[of]
    return (first.astype(np.int64)[of] + rank) % _SECTORS, of


def shadowed_cells(
    where: Where,
    eye: Floats,
    corners: Floats,
    starts: NDArray[np.int64],
    scales: Floats,
    slack: float,
) -> Mask:
    """Union of all shadows as a mask, of all cells or in known tiles; lengths in cells."""
    hulls, hull_starts = outlines_of_shadows(eye, corners, starts, scales)

    def part(window: Window) -> Mask:
        """Those of a window."""
        rows, cols = ((at.start, at.stop) for at in window)
        return _filled(rows, cols, hulls, hull_starts, slack)

    return by_windows(where, 0, part)


@kernel
def outlines_of_shadows(
    eye: Floats, corners: Floats, starts: NDArray[np.int64], scales: Floats
) -> tuple[Floats, NDArray[np.int64]]:
    """Outlines of the shadows, end to end, and where each starts."""
    most, total = 0, 0
    for i in range(len(scales)):
        if not math.isnan(scales[i, 0]):
            most = max(most, starts[i + 1] - starts[i])
            total += 2 * (starts[i + 1] - starts[i])
    points = np.empty((2 * most, 2))
    hull = np.empty((2 * most + 2, 2))
    hulls, hull_starts = np.empty((total, 2)), np.zeros(len(scales) + 1, dtype=np.int64)
    count = 0
    for i in range(len(scales)):
        if not math.isnan(scales[i, 0]):
            size = starts[i + 1] - starts[i]
            for k in range(size):
                for axis in range(2):
                    off = corners[starts[i] + k, axis] - eye[axis]
                    points[k, axis] = eye[axis] + scales[i, 0] * off
                    points[size + k, axis] = eye[axis] + scales[i, 1] * off
            edges = _hull(points[: 2 * size], hull)
            if edges >= 3:
                for k in range(edges):
                    for axis in range(2):
                        hulls[count + k, axis] = hull[k, axis]
                count += edges
        hull_starts[i + 1] = count
    return hulls[:count].copy(), hull_starts


@kernel
def _filled(
    row_span: tuple[int, int],
    col_span: tuple[int, int],
    hulls: Floats,
    hull_starts: NDArray[np.int64],
    slack: float,
) -> Mask:
    """Cells of a window that lie in any outline."""
    first_row, first_col = row_span[0], col_span[0]
    rows, cols = row_span[1] - first_row, col_span[1] - first_col
    steps = np.zeros((rows, cols + 1), dtype=np.int32)
    left, right = np.empty(rows), np.empty(rows)
    for i in range(len(hull_starts) - 1):
        if hull_starts[i] < hull_starts[i + 1]:
            hull = hulls[hull_starts[i] : hull_starts[i + 1]]
            cover_strictly(steps, first_row, first_col, left, right, hull, slack * GRAZE_CELLS)
    mask = np.empty((rows, cols), dtype=np.bool_)
    for row in range(rows):
        covers = 0
        for col in range(cols):
            covers += steps[row, col]
            mask[row, col] = covers > 0
    return mask


@kernel
def next_containing(first: int, points: Floats, corners: Floats, starts: NDArray[np.int64]) -> int:
    """Index of the next polygon, from the first on, with any of points (N, 2); else their number.

    Even-odd rule, as `polygons.contains`.
    """
    for i in range(first, len(starts) - 1):
        ring = corners[starts[i] : starts[i + 1]]
        x_min, x_max = ring[:, 0].min(), ring[:, 0].max()
        y_min, y_max = ring[:, 1].min(), ring[:, 1].max()
        for n in range(len(points)):
            x, y = points[n, 0], points[n, 1]
            if x < x_min or x > x_max or y < y_min or y > y_max:
                continue
            odd = False
            for k in range(len(ring)):
                xi, yi, xj, yj = ring[k, 0], ring[k, 1], ring[k - 1, 0], ring[k - 1, 1]
                if (yi > y) != (yj > y) and x < (xj - xi) * (y - yi) / (yj - yi) + xi:
                    odd = not odd
            if odd:
                return i
    return len(starts) - 1


@kernel
def hidden_points(
    eye: Floats, points: Floats, corners: Floats, starts: NDArray[np.int64], scales: Floats
) -> Mask:
    """Whether any prism hides each point (N, 2) from the eye (2,); lengths in metres."""
    hidden = np.zeros(len(points), dtype=np.bool_)
    for n in range(len(points)):
        for i in range(len(scales)):
            near, far = scales[i, 0], scales[i, 1]
            if not math.isnan(near) and _crosses(
                eye, points[n], corners[starts[i] : starts[i + 1]], 1.0 / far, 1.0 / near
            ):
                hidden[n] = True
                break
    return hidden


@kernel
def _crosses(eye: Floats, point: Floats, corners: Floats, begin: float, end: float) -> bool:
    """Whether eye + u (point - eye) enters a convex polygon (K, 2) for begin < u < end."""
    enters, leaves = begin, end
    for k in range(len(corners)):
        x, y = corners[k - 1, 0], corners[k - 1, 1]
        along_x, along_y = corners[k, 0] - x, corners[k, 1] - y
        ahead = along_x * (point[1] - eye[1]) - along_y * (point[0] - eye[0])
        inside = along_x * (eye[1] - y) - along_y * (eye[0] - x)
        if ahead == 0.0:
            if inside <= 0.0:
                return False
        elif ahead > 0.0:
            enters = max(enters, -inside / ahead)
        else:
            leaves = min(leaves, -inside / ahead)
    return leaves - enters > 1e-9


@kernel
def _hull(points: Floats, hull: Floats) -> int:
    """Convex hull of points (N, 2), counter-clockwise into `hull`; returns its size."""
    size = len(points)
    for i in range(1, size):
        x, y = points[i, 0], points[i, 1]
        k = i - 1
        while k >= 0 and (points[k, 0] > x or (points[k, 0] == x and points[k, 1] > y)):
            points[k + 1, 0] = points[k, 0]
            points[k + 1, 1] = points[k, 1]
            k -= 1
        points[k + 1, 0] = x
        points[k + 1, 1] = y
    count = 0
    for sweep in range(2):
        base = count
        for j in range(size):
            i = j if sweep == 0 else size - 1 - j
            while count >= base + 2 and not _turns_left(
                hull[count - 2], hull[count - 1], points[i]
            ):
                count -= 1
            hull[count, 0] = points[i, 0]
            hull[count, 1] = points[i, 1]
            count += 1
        count -= 1
    return count


@kernel
def _turns_left(a: Floats, b: Floats, c: Floats) -> bool:
    return bool((b[0] - a[0]) * (c[1] - b[1]) - (b[1] - a[1]) * (c[0] - b[0]) > 0.0)
