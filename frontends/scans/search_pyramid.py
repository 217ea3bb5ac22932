# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Multi-resolution pyramid of a likelihood grid: maxima over ever larger blocks of cells."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from slarm_graph.frontends.scans.likelihood_grid import LikelihoodGrid

Bytes = NDArray[np.uint8]
Integers = NDArray[np.int64]

FULL = 255
"""A likelihood of one, in eight bits: the largest a byte holds."""


@dataclass(frozen=True, slots=True)
class SearchPyramid:
    """Search pyramid of a likelihood grid; built once per map, shared between threads.

    Parameters
    ----------
    origin_x_m, origin_y_m, resolution_m : float
        As of the grid: centre of cell (0, 0) and cell side [m].
    max_radius_m : float
        Points farther from the robot are left out of a search; sets the angular step.
    cells : (M,) uint8
        All levels one after another, 255 for likelihood 1.
    layout : (levels, 5) int64
        Per level: where it starts in `cells`, rows, cols, stride in cells, cells of padding
        before the grid's first.
    """

    origin_x_m: float
    origin_y_m: float
    resolution_m: float
    max_radius_m: float
    cells: Bytes
    layout: Integers

    @property
    def step_rad(self) -> float:
        """Angle at which the farthest point moves by one cell [rad]."""
        return self.resolution_m / self.max_radius_m


def build_pyramid(
    grid: LikelihoodGrid, *, max_radius_m: float = 15.0, levels: int = 7
) -> SearchPyramid:
    """Build the pyramid of a likelihood grid for `search`.

    Parameters
    ----------
    grid : LikelihoodGrid
    max_radius_m : float
        Points beyond are left out of a search [m].
    levels : int
        The largest block spans 2^(levels - 1) cells and angles.
    """
    base = np.asarray(cv2.convertScaleAbs(grid.values, alpha=FULL), dtype=np.uint8)
    parts, layout, start = [base.ravel()], [(0, *base.shape, 1, 0)], base.size
    for level in range(1, levels):
        stride = max(1, 2 ** (level - 2))
        window = 2 ** (level + 1) + stride - 1
        padding = -(-window // stride) * stride
        coarse = _block_maxima(base, window, stride, padding)
        parts.append(coarse.ravel())
        layout.append((start, *coarse.shape, stride, padding))
        start += coarse.size
    return SearchPyramid(
        grid.origin_x_m,
        grid.origin_y_m,
        grid.resolution_m,
        max_radius_m,
        np.concatenate(parts),
        np.array(layout, dtype=np.int64),
    )


def _block_maxima(base: Bytes, window: int, stride: int, padding: int) -> Bytes:
    """Maximum over `window` x `window` cells from every `stride`-th cell, -padding the first."""
    padded = cv2.copyMakeBorder(base, padding, 0, padding, 0, cv2.BORDER_CONSTANT, value=0)
    ones = np.ones((window, window), dtype=np.uint8)
    maxima = cv2.dilate(padded, ones, anchor=(0, 0))[::stride, ::stride]
    return np.asarray(maxima, dtype=np.uint8)
