# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Outlines of a mask, along the sides of its cells."""

from __future__ import annotations

from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from slarm_graph.geometry import Floats
from slarm_graph.grid import GridGeometry, Mask
from slarm_graph.kernels import kernel
from slarm_graph.tiles import TILE_CELLS, KnownTiles, known_tiles


def outlines_m(geometry: GridGeometry, mask: Mask, tiles: KnownTiles | None = None) -> list[Floats]:
    """Trace the sides of cells that part a mask from the rest.

    Parameters
    ----------
    geometry : GridGeometry
    mask : (rows, cols) bool
        False outside of tiles and in those at their border.
    tiles : KnownTiles, optional

    Returns
    -------
    list of (K, 2) float64
        Closed polygons with the mask on their left: outer outlines counter-clockwise, those of
        holes clockwise [m]. Cells that touch only at a corner are apart.
    """
    known = known_tiles(tiles or mask.shape)
    corners, starts = _trace_cracks(np.ascontiguousarray(mask), known)
    origin = np.array([geometry.origin_x_m, geometry.origin_y_m])
    points = corners * geometry.resolution_m + origin
    return [points[a:b] for a, b in pairwise(starts)]


def simplified_m(outline_m: Floats, tolerance_m: float) -> Floats:
    """Drop corners (Douglas-Peucker) that lie within a tolerance of the outline without them."""
    single = outline_m.astype(np.float32)
    kept = cv2.approxPolyDP(single[:, None], tolerance_m, True)
    if len(kept) < 3:
        return outline_m
    # The image library works in single precision: take the exact corner that is meant.
    number = {tuple(corner): n for n, corner in enumerate(single.tolist())}
    return outline_m[[number[tuple(corner)] for corner in kept[:, 0].tolist()]]


@kernel
def _cracks(mask: Mask, known: Mask, leaves: NDArray[np.uint8]) -> int:
    """Mark whether a crack leaves a lattice corner to the right (1), up (2), left (4), down (8)."""
    rows, cols = mask.shape
    count = 0
    for r in range(rows):
        for tile in range(known.shape[1]):
            if not known[r // TILE_CELLS, tile]:
                continue
            for c in range(tile * TILE_CELLS, min(cols, (tile + 1) * TILE_CELLS)):
                if not mask[r, c]:
                    continue
                if r == 0 or not mask[r - 1, c]:
                    leaves[r, c] |= 1
                    count += 1
                if c + 1 == cols or not mask[r, c + 1]:
                    leaves[r, c + 1] |= 2
                    count += 1
                if r + 1 == rows or not mask[r + 1, c]:
                    leaves[r + 1, c + 1] |= 4
                    count += 1
                if c == 0 or not mask[r, c - 1]:
                    leaves[r + 1, c] |= 8
                    count += 1
    return count


@kernel
def _trace_cracks(mask: Mask, known: Mask) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Corner points (x, y) where cracks turn, and where each outline starts; of known tiles."""
    rows, cols = mask.shape
    leaves = np.zeros((rows + 1, cols + 1), dtype=np.uint8)
    corners = np.empty((_cracks(mask, known, leaves), 2), dtype=np.int64)
    starts = [0]
    size = 0
    for r in range(rows + 1):
        for tile in range(known.shape[1]):
            if not known[r // TILE_CELLS, tile]:
                continue
            for c in range(tile * TILE_CELLS, min(cols + 1, (tile + 1) * TILE_CELLS)):
                # The lowest, then leftmost corner of an outline is left to the right, or downward
                # from a hole; an outline always turns where it begins.
                if leaves[r, c] & 1:
                    size = _follow(leaves, corners, size, r, c)
                    starts.append(size)
    return corners[:size], np.array(starts)


@kernel
def _follow(
    leaves: NDArray[np.uint8], corners: NDArray[np.int64], size: int, row: int, col: int
) -> int:
    """Add the corners of the outline that begins at a corner, and use its cracks up."""
    x, y, heading, before = col, row, 0, -1
    while leaves[y, x] >> heading & 1:
        leaves[y, x] ^= 1 << heading
        if heading != before:
            corners[size, 0] = x
            corners[size, 1] = y
            size += 1
        before = heading
        x += (1, 0, -1, 0)[heading]
        y += (0, 1, 0, -1)[heading]
        for turn in (1, 0, 3):
            ahead = (heading + turn) % 4
            if leaves[y, x] >> ahead & 1:
                heading = ahead
                break
    return size
