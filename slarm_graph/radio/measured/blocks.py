# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Blocks: obstacles deeper than any wall, whose inside the laser did not see, solid or hollow."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from slarm_graph.geographic import GeographicMap
from slarm_graph.raster.distance import distance_to

_THICKEST_WALL_M = 0.6
"""Walls are not thicker: outer ones of insulated masonry come to half a metre. The shipped worlds
have 142 blocks deeper than that, 154 deeper than 0.4 m and 100 deeper than 0.8 m."""

_MOST_BLOCKS = 32
"""The largest are kept: each is a column of the design. Five of the seven shipped worlds have at
most 20."""


@dataclass(frozen=True, slots=True)
class Blocks:
    """Labels of the insides of blocks.

    Parameters
    ----------
    insides : (rows, cols) int16
        Label, from 1, of the block whose inside the cell is; 0 elsewhere.
    count : int
    """

    insides: NDArray[np.int16]
    count: int


def find_blocks(geographic: GeographicMap) -> Blocks:
    """Find the obstacles of a map that are deeper than any wall."""
    depth_cells = distance_to(geographic.heights_m <= 0.0) - 0.5
    deep = (depth_cells * geographic.geometry.resolution_m > 0.5 * _THICKEST_WALL_M) & (
        geographic.heights_m > 0.0
    )
    numbers, count = ndimage.label(deep)
    by_size = np.argsort(-np.bincount(numbers.ravel(), minlength=count + 1)[1:], kind="stable")
    kept = by_size[:_MOST_BLOCKS]
    renamed = np.zeros(count + 1, dtype=np.int16)
    renamed[kept + 1] = np.arange(1, len(kept) + 1)
    return Blocks(renamed[numbers], len(kept))
