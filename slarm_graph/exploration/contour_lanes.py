# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Coverage lanes parallel to the walls: contour lines of the distance transform.

Contours follow walls of any heading without a turn, pass through gaps, and close around obstacles.
Where the innermost ones leave a strip between them, its skeleton is a lane as well.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import cv2
import numpy as np

from slarm_graph.geometry import Floats
from slarm_graph.grid import Mask
from slarm_graph.raster.distance import clearance, distance_to, nearest_of
from slarm_graph.raster.thinning import pruned, thinned, traced

_REACH: Final = 0.75
"""A lane serves cells nearer than this share of the disc's radius; the rest is a sliver."""


@dataclass(frozen=True, slots=True, eq=False)
class Lane:
    """A short stretch of a lane.

    Parameters
    ----------
    points : (K, 2) float64
        Path of the robot's centre, in either direction; x, y [cells].
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
        Cells that the disc has still to pass over.
    passable : (rows, cols) bool
        Cells in which the centre may be.
    radius : float
        Of the disc [cells].
    longest : float
        Lanes are cut into pieces up to this length [cells].
    """
    rings = contour_lines(wanted, passable, radius)
    left = wanted & (distance_to(rings) > radius)
    lines = thinned(rings | middle_lines(left & passable, radius))
    area = _nearest_counts(rings & lines, wanted & ~left) + _nearest_counts(lines, left)
    lanes = []
    for chain in traced(lines):
        rows, cols = np.divmod(chain, lines.shape[1])
        points = np.stack([cols + 0.5, rows + 0.5], axis=-1)
        count = max(1, math.ceil((len(chain) - 1) / longest))
        cuts = np.linspace(0, len(chain) - 1, count + 1).round().astype(int)
        for first, last in pairwise(cuts):
            mine = float(area[chain[first : last + 1]].sum())
            lanes.append(Lane(points[first : last + 1], mine))
    return lanes


def contour_lines(wanted: Mask, passable: Mask, radius: float) -> Mask:
    """Contours (rows, cols) of the distance to the walls, within reach of wanted cells."""
    # Where there is hardly room for one lane there must not be two.
    roomy = cv2.morphologyEx(passable.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    depth = clearance(np.pad(roomy, 1) > 0)
    band = np.floor((depth - 1.0) / (2.0 * radius)).astype(np.float32)
    shallow = cv2.erode(band, cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3)))
    return np.asarray((band > shallow)[1:-1, 1:-1] & (distance_to(wanted) <= _REACH * radius))


def middle_lines(left: Mask, radius: float) -> Mask:
    """Skeleton (rows, cols) of narrow strips, pruned by the disc's reach at its ends."""
    left = cv2.morphologyEx(left.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)) > 0
    return pruned(thinned(left), round(_REACH * radius))


def _nearest_counts(lines: Mask, wanted: Mask) -> Floats:
    """Number (rows * cols,) of wanted cells whose nearest line cell is each."""
    if not lines.any():
        return np.zeros(lines.size)
    return np.bincount(nearest_of(lines)[wanted], minlength=lines.size).astype(np.float64)
