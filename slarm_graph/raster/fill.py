# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Cells whose centre lies inside polygons.

Areas are half open: of two polygons that share an edge, a centre on it lies in exactly one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slarm_graph.convex import convex_plans
from slarm_graph.geometry import Floats
from slarm_graph.grid import GridGeometry, Mask
from slarm_graph.kernels import kernel
from slarm_graph.tiles import TILE_CELLS, KnownTiles, Window
from slarm_graph.world import Solid

EVERYWHERE: Window = (slice(None), slice(None))


@dataclass(frozen=True, slots=True)
class Polygons:
    """Polygons laid onto a grid, to be filled in it or in a window of it.

    Parameters
    ----------
    shape : (rows, cols)
    corners : (N, 2) float64
        Of all polygons, x, y; centres of cells at whole numbers [cells].
    starts : (P + 1,) int64
        Where each polygon starts among the corners.
    """

    shape: tuple[int, int]
    corners: Floats
    starts: NDArray[np.int64]

    @staticmethod
    def on(geometry: GridGeometry, polygons_m: Sequence[Floats] | Floats) -> Polygons:
        """Lay polygons (K, 2) [m] onto a grid."""
        starts = np.cumsum([0, *(len(polygon) for polygon in polygons_m)])
        if not starts[-1]:
            return Polygons(geometry.shape, np.zeros((0, 2)), starts)
        origin = np.array([geometry.origin_x_m, geometry.origin_y_m])
        corners = (np.concatenate(polygons_m) - origin) / geometry.resolution_m - 0.5
        return Polygons(geometry.shape, corners, starts)

    @staticmethod
    def of_solids(geometry: GridGeometry, solids: Sequence[Solid]) -> Polygons:
        """Lay the plans of solids onto a grid, cut into convex polygons."""
        cut = convex_plans([solid.corners_m for solid in solids])
        return Polygons.on(geometry, [piece for pieces in cut for piece in pieces])

    def odd(self, window: Window = EVERYWHERE) -> Mask:
        """Mark cells, of a window, whose centre lies inside an odd number of the polygons."""
        low, (high, wide) = self._box(window)
        flips = np.zeros((high, wide + 1), dtype=np.bool_)
        _flip(flips, self.corners, self.starts, *low)
        return np.asarray(np.logical_xor.accumulate(flips[:, :-1], axis=1))

    def any(self, window: Window = EVERYWHERE) -> Mask:
        """Mark cells, of a window, whose centre lies inside at least one; convex polygons only."""
        low, size = self._box(window)
        mask = np.zeros(size, dtype=np.bool_)
        _cover(mask, self.corners, self.starts, *low)
        return mask

    def tiles_of(self, tiles: KnownTiles) -> KnownTiles:
        """Add the tiles in which convex polygons lie to those of the grid."""
        size = tiles.known.shape
        inside = Polygons(size, (self.corners + 0.5) / TILE_CELLS - 0.5, self.starts).any()
        # What no centre of a tile tells is narrow: all of it is near a side.
        after = np.arange(1, len(self.corners) + 1)
        after[self.starts[1:] - 1] = self.starts[:-1]
        step = self.corners[after] - self.corners
        count = np.ceil(np.abs(step).max(axis=1, initial=0.0) / TILE_CELLS).astype(np.int64) + 1
        side = np.repeat(np.arange(len(count)), count)
        rank = np.arange(len(side)) - np.repeat(np.cumsum(count) - count, count)
        at = self.corners[side] + (rank / count[side])[:, None] * step[side]
        cells = np.floor(np.clip(at[:, ::-1], -TILE_CELLS, np.array(self.shape) + TILE_CELLS))
        found = KnownTiles(self.shape, tiles.known | inside)
        return found.with_boxes(cells.astype(np.int64), cells.astype(np.int64))

    def _box(self, window: Window) -> tuple[tuple[int, int], tuple[int, int]]:
        """First row and column of a window, and its size."""
        spans = [at.indices(most)[:2] for at, most in zip(window, self.shape, strict=True)]
        (top, past), (left, end) = spans
        return (top, left), (past - top, end - left)


def inside_solids(geometry: GridGeometry, solids: Sequence[Solid]) -> Mask:
    """Mark cells whose centre lies inside the plan of at least one solid."""
    return Polygons.of_solids(geometry, solids).any()


@kernel
def _cover(
    mask: Mask, corners: Floats, starts: NDArray[np.int64], first_row: int, first_col: int
) -> None:
    """Mark the cells of every row between the two crossings of convex polygons."""
    rows, cols = mask.shape
    past = first_col + cols
    for p in range(len(starts) - 1):
        polygon = corners[starts[p] : starts[p + 1]]
        low, high = polygon[:, 1].min(), polygon[:, 1].max()
        begin = max(first_row, math.ceil(max(low, -1.0)))
        end = min(first_row + rows, math.ceil(min(high, float(first_row + rows))))
        for row in range(begin, end):
            left, right = math.inf, -math.inf
            for k in range(len(polygon)):
                x0, y0 = polygon[k - 1, 0], polygon[k - 1, 1]
                x1, y1 = polygon[k, 0], polygon[k, 1]
                if (y0 <= row) != (y1 <= row):
                    x = x0 + (row - y0) * (x1 - x0) / (y1 - y0)
                    left, right = min(left, x), max(right, x)
            if left < right:
                first = max(first_col, math.ceil(min(max(left, -1.0), float(past))))
                last = min(past, math.ceil(min(max(right, 0.0), float(past))))
                for col in range(first, last):
                    mask[row - first_row, col - first_col] = True


@kernel
def _flip(
    flips: Mask, corners: Floats, starts: NDArray[np.int64], first_row: int, first_col: int
) -> None:
    """Flip the first cell right of every crossing of a row of centres; centres are whole."""
    rows, last = flips.shape[0], flips.shape[1] - 1
    past = float(first_col + last)
    for p in range(len(starts) - 1):
        polygon = corners[starts[p] : starts[p + 1]]
        for k in range(len(polygon)):
            x0, y0 = polygon[k - 1, 0], polygon[k - 1, 1]
            x1, y1 = polygon[k, 0], polygon[k, 1]
            low, high = min(y0, y1), max(y0, y1)
            if low == high:
                continue
            begin = max(first_row, math.ceil(max(low, -1.0)))
            end = math.ceil(min(high, float(first_row + rows)))
            for row in range(begin, min(end, first_row + rows)):
                x = x0 + (row - y0) * (x1 - x0) / (y1 - y0)
                col = min(max(math.ceil(min(max(x, -1.0), past)) - first_col, 0), last)
                flips[row - first_row, col] = not flips[row - first_row, col]


@kernel
def cover_strictly(
    steps: NDArray[np.int32],
    first_row: int,
    first_col: int,
    left: Floats,
    right: Floats,
    polygon: Floats,
    slack: float,
) -> None:
    """Add one to every cell, of a window, whose centre lies inside a convex polygon.

    `steps` (rows, cols + 1) holds differences along each row of the window, which begins at
    `first_row` and `first_col`; the rest is as in `row_spans`.
    """
    spans = np.empty((len(left), 2), dtype=np.int64)
    past_col = first_col + steps.shape[1] - 1
    first, past = row_spans(spans, first_row, past_col, left, right, polygon, slack)
    for row in range(first, past):
        begin = max(spans[row, 0], first_col)
        if begin < spans[row, 1]:
            steps[row, begin - first_col] += 1
            steps[row, spans[row, 1] - first_col] -= 1


@kernel
def row_spans(
    spans: NDArray[np.int64],
    first_row: int,
    cols: int,
    left: Floats,
    right: Floats,
    polygon: Floats,
    slack: float,
) -> tuple[int, int]:
    """Find first and past column, of some rows, of the cells with their centre in a polygon.

    The polygon is convex and counter-clockwise, the corner of cell (0, 0) its origin. `spans`
    (rows, 2) is filled from the returned first to the past row, counted from `first_row`; `left`
    and `right` (rows,) are scratch.
    """
    rows = first_row + len(spans)
    low, high = polygon[:, 1].min() - 0.5, polygon[:, 1].max() - 0.5
    first = max(first_row, math.floor(min(max(low + slack, -1.0), float(rows))) + 1)
    last = math.ceil(min(max(high - slack, -1.0), float(rows))) - 1
    if first > last:
        return 0, 0
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
            side[row - first_row] = anchor_x + (row - anchor_y) * slope
    for row in range(first - first_row, last + 1 - first_row):
        begin = max(0, math.floor(min(max(left[row] - 0.5 + slack, -1.0), float(cols))) + 1)
        end = min(cols, math.ceil(min(max(right[row] - 0.5 - slack, -1.0), float(cols))))
        spans[row, 0] = begin
        spans[row, 1] = end
    return first - first_row, last + 1 - first_row
