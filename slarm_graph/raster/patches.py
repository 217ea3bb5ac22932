# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Patches: cells of a mask that hang together over sides, or over sides and corners."""

from __future__ import annotations

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from slarm_graph.grid import Mask
from slarm_graph.raster.bands import by_bands

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


def larger_than(mask: Mask, cells: int) -> Mask:
    """Drop the patches (over sides and corners) of a mask that have at most so many cells."""

    def part(rows: slice) -> Mask:
        """Patches that are small in a band reach no further than its halo, large ones are large."""
        labels, sizes = patches(mask[rows], over_corners=True)
        return np.asarray((sizes > cells)[labels] & mask[rows])

    return by_bands(mask.shape, cells + 1, part)


def joined(mask: Mask, seeds: Mask) -> Mask:
    """Cells of a mask joined over sides to seeds in it; where there are none, its largest patch."""
    begun = np.flatnonzero(seeds & mask)
    if len(begun):
        reached = np.zeros(mask.shape, dtype=np.bool_)
        reached.flat[begun] = True
        _flood(np.ascontiguousarray(mask), reached, begun)
        return reached
    labels, sizes = patches(mask, over_corners=False)
    return np.asarray((labels == sizes.argmax()) & mask)


@njit(cache=True, nogil=True)
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
