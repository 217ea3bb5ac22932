# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Patches: cells of a mask that hang together over sides, or over sides and corners."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from slarm_graph.grid import Mask
from slarm_graph.kernels import kernel
from slarm_graph.raster.bands import by_windows, cells_of
from slarm_graph.tiles import TILE_CELLS, KnownTiles, Where, Window

Labels = NDArray[np.int32]
Sizes = NDArray[np.int64]


def patches(mask: Mask, *, over_corners: bool) -> tuple[Labels, Sizes]:
    """Number the patches of a mask (rows, cols) from 1.

    Returns
    -------
    labels : (rows, cols) int32
        0 where the mask is not.
    sizes : (count + 1,) int64
        Cells of every patch; 0 for what is not in the mask.
    """
    _, labels, stats, _ = cv2.connectedComponentsWithStats(
        mask.astype(np.uint8), connectivity=8 if over_corners else 4
    )
    sizes = stats[:, cv2.CC_STAT_AREA].astype(np.int64)
    sizes[0] = 0
    return np.asarray(labels), sizes


def larger_than(mask: Mask, cells: int, where: Where | None = None) -> Mask:
    """Drop the patches (over sides and corners) of a mask that have at most so many cells.

    Parameters
    ----------
    mask : (rows, cols) bool
        False outside of tiles.
    cells : int
    where : (rows, cols) or KnownTiles, optional
    """

    def part(window: Window) -> Mask:
        """Patches small in a window reach no further than its halo, large ones are large."""
        here = np.ascontiguousarray(mask[window])
        return here & ~small_patches(here, np.zeros_like(here), cells)

    return by_windows(where or mask.shape, cells + 1, part)


@kernel
def small_patches(mask: Mask, barred: Mask, most: int) -> Mask:
    """Find the patches, over sides and corners, of at most so many cells, none of them barred.

    Parameters
    ----------
    mask, barred : (rows, cols) bool
    most : int
        What is larger is not followed to its end.
    """
    rows, cols = mask.shape
    is_large, looked_at = np.zeros_like(mask), ~mask
    patch = np.empty((max(most, 1), 2), dtype=np.int64)
    for row in range(rows):
        for col in range(cols):
            if looked_at[row, col]:
                continue
            if col > 0 and is_large[row, col - 1]:
                is_large[row, col] = looked_at[row, col] = True
                continue
            size, small = _follow_patch(patch, row, col, looked_at, is_large, barred, most)
            for k in range(size):
                is_large[patch[k, 0], patch[k, 1]] = not small
    return mask & ~is_large


@kernel
def _follow_patch(
    patch: Sizes, row: int, col: int, looked_at: Mask, is_large: Mask, barred: Mask, most: int
) -> tuple[int, bool]:
    """Gather a patch from a cell on, until it is told to be large or barred; its size so far."""
    patch[0, 0], patch[0, 1] = row, col
    looked_at[row, col] = True
    size, at, small = 1, 0, most > 0
    while small and at < size:
        row, col = patch[at, 0], patch[at, 1]
        at += 1
        small = not barred[row, col]
        for r in range(max(0, row - 1), min(len(barred), row + 2)):
            for c in range(max(0, col - 1), min(barred.shape[1], col + 2)):
                small = small and not is_large[r, c] and (looked_at[r, c] or size < most)
                if small and not looked_at[r, c]:
                    patch[size, 0], patch[size, 1] = r, c
                    looked_at[r, c] = True
                    size += 1
    return size, small


def joined(mask: Mask, seeds: Mask, where: Where | None = None, *, through: bool = False) -> Mask:
    """Cells of a mask joined over sides to seeds in it; where there are none, its largest patch.

    Parameters
    ----------
    mask, seeds : (rows, cols) bool
        False outside of tiles.
    where : (rows, cols) or KnownTiles, optional
    through : bool
        Whether what lies outside of tiles joins cells as well; it is not in the result.
    """
    both = by_windows(where or mask.shape, 0, lambda window: mask[window] & seeds[window])
    begun = np.ravel_multi_index(tuple(cells_of(both, where or mask.shape).T), mask.shape)
    if len(begun):
        reached = both
        mask = np.ascontiguousarray(mask)
        _flood(mask, reached, begun)
        if through and isinstance(where, KnownTiles):
            _flood_around(mask, reached, where)
        return reached
    labels, sizes = patches(mask, over_corners=False)
    return np.asarray((labels == sizes.argmax()) & mask)


def _flood_around(mask: Mask, reached: Mask, tiles: KnownTiles) -> None:
    """Go on with what steps through the tiles outside, all of whose cells count as the mask's."""
    rows, cols, outside = rim_of(tiles)
    while True:
        entered = np.unique(outside[reached[rows, cols]])
        fresh = np.isin(outside, entered) & mask[rows, cols] & ~reached[rows, cols]
        if not fresh.any():
            return
        begun = np.unique(rows[fresh] * mask.shape[1] + cols[fresh])
        reached.flat[begun] = True
        _flood(mask, reached, begun)


def rim_of(tiles: KnownTiles) -> tuple[Sizes, Sizes, Labels]:
    """Cells (N,) of known tiles at the side of one outside: row, column, and its patch of tiles."""
    labels, _ = patches(~tiles.known, over_corners=False)
    along = np.arange(TILE_CELLS)
    found = []
    for up, right in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        beside = np.zeros_like(labels)
        to = [slice(max(0, -n), min(0, -n) or None) for n in (up, right)]
        of = [slice(max(0, n), min(0, n) or None) for n in (up, right)]
        beside[to[0], to[1]] = labels[of[0], of[1]]
        at = np.argwhere(tiles.known & (beside > 0))
        edge = (TILE_CELLS - 1) * (up + right > 0)
        rows, cols = (
            at[:, axis, None] * TILE_CELLS + (edge if step else along)
            for axis, step in enumerate((up, right))
        )
        patch = np.repeat(beside[at[:, 0], at[:, 1]], TILE_CELLS)
        found.append((*np.broadcast_arrays(rows, cols), patch.reshape(-1, TILE_CELLS)))
    rows, cols, outside = (np.concatenate([f[k].ravel() for f in found]) for k in range(3))
    inside = (rows < tiles.shape[0]) & (cols < tiles.shape[1])
    return rows[inside], cols[inside], outside[inside]


@kernel
def _flood(mask: Mask, reached: Mask, waiting: Sizes) -> None:
    """Mark what steps over sides from the waiting cells reach."""
    rows, cols = mask.shape
    count = len(waiting)
    while count > 0:
        count -= 1
        row, col = waiting[count] // cols, waiting[count] % cols
        if count + 4 > len(waiting):
            waiting = np.concatenate((waiting, np.empty(len(waiting) + 4, dtype=np.int64)))
        for turn in range(4):
            to_row, to_col = row + (1, 0, -1, 0)[turn], col + (0, 1, 0, -1)[turn]
            if not (0 <= to_row < rows and 0 <= to_col < cols):
                continue
            if mask[to_row, to_col] and not reached[to_row, to_col]:
                reached[to_row, to_col] = True
                waiting[count] = to_row * cols + to_col
                count += 1
