# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Lanes side by side along the walls: level lines of the distance to what is in the way.

Level lines follow walls of any heading without a turn, pass through gaps, and close around
obstacles. Where the innermost ones leave a strip between them, its middle line is a lane as well.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from slarm_graph.exploration.thin_lines import thinned, traced
from slarm_graph.geometry import Floats
from slarm_graph.grid import Mask

_REACH: Final = 0.75
"""A lane is for what lies nearer than this share of the disc's radius; the rest is a sliver."""


@dataclass(frozen=True, slots=True, eq=False)
class Lane:
    """A short stretch of a lane.

    Parameters
    ----------
    points : (K, 2) float64
        Where the robot's centre passes, in either sense; x, y [cells].
    area_cells : float
        Wanted cells that lie nearer to it than to any other lane.
    """

    points: Floats
    area_cells: float


def contour_lanes(wanted: Mask, passable: Mask, radius: float, longest: float) -> list[Lane]:
    """Cover the wanted cells by lanes a disc's width apart.

    Parameters
    ----------
    wanted : (rows, cols) bool
        What the disc has still to pass over.
    passable : (rows, cols) bool
        Where the centre may be.
    radius : float
        Of the disc [cells].
    longest : float
        Lanes are cut into pieces up to this length [cells].
    """
    lines = lane_lines(wanted, passable, radius)
    nearest, near = _nearest_line_cell(lines, wanted)
    area = np.bincount(nearest[near <= radius + 1.0], minlength=lines.size)
    lanes = []
    for chain in traced(lines):
        rows, cols = np.divmod(chain, lines.shape[1])
        points = _smooth(np.stack([cols + 0.5, rows + 0.5], axis=-1), radius)
        count = max(1, math.ceil((len(chain) - 1) / longest))
        cuts = np.linspace(0, len(chain) - 1, count + 1).round().astype(int)
        for first, last in zip(cuts[:-1], cuts[1:], strict=True):
            mine = float(area[chain[first : last + 1]].sum())
            lanes.append(Lane(points[first : last + 1], mine))
    return lanes


def lane_lines(wanted: Mask, passable: Mask, radius: float) -> Mask:
    """Cells (rows, cols) of thin lines that the centre must follow to pass over the wanted."""
    # Where there is hardly room for one lane there shall not be two.
    roomy = cv2.morphologyEx(passable.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    depth = cv2.distanceTransform(np.pad(roomy, 1), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    band = np.floor((depth - 1.0) / (2.0 * radius)).astype(np.int32)
    shallow = cv2.erode(band.astype(np.float32), cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3)))
    rings = (band > shallow)[1:-1, 1:-1]
    rings &= _distance_to(wanted) <= _REACH * radius
    left = wanted & passable & (_distance_to(rings) > radius)
    left = cv2.morphologyEx(left.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)) > 0
    return thinned(rings | thinned(left))


def _distance_to(mask: Mask) -> NDArray[np.float32]:
    """Distance (rows, cols) to the nearest cell of a mask [cells]; far where it is empty."""
    if not mask.any():
        return np.full(mask.shape, np.inf, dtype=np.float32)
    away = cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.asarray(away, dtype=np.float32)


def _nearest_line_cell(lines: Mask, wanted: Mask) -> tuple[NDArray[np.int64], Floats]:
    """Flat line cell nearest to every wanted cell, and its distance [cells]."""
    if not lines.any():
        return np.empty(0, dtype=np.int64), np.empty(0)
    away, labels = cv2.distanceTransformWithLabels(
        (~lines).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    cell_of = np.zeros(int(labels.max()) + 1, dtype=np.int64)
    cell_of[labels[lines]] = np.flatnonzero(lines)
    return cell_of[labels[wanted]], away[wanted]


def _smooth(points: Floats, radius: float) -> Floats:
    """Average a chain of cells over half a disc's radius to either side; the ends stay."""
    return _averaged(points, max(1, round(0.5 * radius)))


@njit(cache=True, nogil=True)
def _averaged(points: Floats, half: int) -> Floats:
    count = len(points)
    out = np.empty_like(points)
    for i in range(count):
        reach = min(half, i, count - 1 - i)
        for k in range(2):
            out[i, k] = points[i - reach : i + reach + 1, k].mean()
    return out
