# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Heights of obstacle cells: of the solid that fills the cell, or at whose face it lies."""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from slarm_graph.geographic import CellState
from slarm_graph.geometry import Floats
from slarm_graph.grid import GridGeometry, Mask
from slarm_graph.raster.bands import lay, windows
from slarm_graph.raster.fill import Polygons
from slarm_graph.raster.layers import new_layer
from slarm_graph.tiles import Where, Window
from slarm_graph.world import Solid

Heights = NDArray[np.float32]
Laid = list[tuple[float, Polygons]]

_BESIDE = np.ones((3, 3), dtype=np.uint8)
"""A cell and its eight neighbours: an outline is straightened to within a cell of the grid's."""


def cell_heights(
    target: GridGeometry,
    states: NDArray[np.uint8],
    blocks: Sequence[Solid],
    strips: Sequence[Solid],
    height_m: float | None,
    where: Where,
) -> Heights:
    """Return the top of every obstacle cell (rows, cols) [m]; 0 where there is none.

    Parameters
    ----------
    target : GridGeometry
    states : (rows, cols) uint8
        Values of CellState.
    blocks : sequence of Solid
        Of known size.
    strips : sequence of Solid
        Walls and obstacles of unknown size.
    height_m : float or None
        Of all obstacles of unknown size; None where every strip has its own.
    where : (rows, cols) or KnownTiles
        That hold all obstacles.
    """
    heights_m = new_layer(target.shape, np.float32, where)
    strips_of: dict[float, list[Floats]] = {}
    for strip in strips:
        top_m = strip.height_m if height_m is None else height_m
        strips_of.setdefault(top_m, []).append(strip.corners_m)
    walls: Laid = [(m, Polygons.on(target, plans)) for m, plans in sorted(strips_of.items())]
    known: Laid = [(b.height_m, Polygons.on(target, [b.corners_m])) for b in blocks]
    for part in windows(where, 1, aside=[heights_m]):
        obstacle = states[part.around] == CellState.OBSTACLE
        if obstacle.any():
            tops_m = _tops(obstacle, part.around, walls, known, height_m or math.inf)
            lay(heights_m, part.cells, tops_m[part.inner])
    return heights_m


def _tops(obstacle: Mask, window: Window, walls: Laid, known: Laid, other_m: float) -> Heights:
    """Tops of the obstacle cells of a window.

    A cell at the face of a block that no solid fills is part of the block: by centres, cells and
    the straightened face differ by one.
    """
    tops_m = np.where(obstacle, np.float32(other_m), np.float32(0.0))
    filled, beside_m = ~obstacle, np.zeros_like(tops_m)
    for top_m, plan in walls:
        inside = plan.any(window) & obstacle
        tops_m[inside] = top_m
        filled |= inside
    for top_m, plan in known:
        inside = plan.odd(window) & obstacle
        if inside.any():
            tops_m[inside] = top_m
            filled |= inside
            beside = cv2.dilate(inside.view(np.uint8), _BESIDE).view(np.bool_)
            beside_m[beside] = np.maximum(beside_m[beside], top_m)
    at_face = ~filled & (beside_m > 0.0)
    tops_m[at_face] = beside_m[at_face]
    return tops_m
