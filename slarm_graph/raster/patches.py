# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Patches: cells of a mask that hang together over sides, or over sides and corners."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from slarm_graph.grid import Mask

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
    labels, sizes = patches(mask, over_corners=True)
    return np.asarray((sizes > cells)[labels] & mask)


def joined(mask: Mask, seeds: Mask) -> Mask:
    """Cells of a mask joined over sides to seeds in it; where there are none, its largest patch."""
    labels, sizes = patches(mask, over_corners=False)
    wanted = np.zeros(len(sizes), dtype=np.bool_)
    inside = labels[seeds & mask]
    wanted[inside if len(inside) else sizes.argmax()] = True
    wanted[0] = False
    return np.asarray(wanted[labels])
