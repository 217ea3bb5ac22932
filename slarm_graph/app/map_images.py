# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Writing of maps as images for map_server, also of very large ones."""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator

import numpy as np

from slarm_graph.app.run_folder import RunFolder
from slarm_graph.config.maps import LargeImage
from slarm_graph.files.maps import Masks, map_yaml, write_trinary
from slarm_graph.grid import GridGeometry, Mask
from slarm_graph.tiles import KnownTiles, Where, Window, columns_of

_log = logging.getLogger(__name__)

MOST_IMAGE_CELLS = 16_384
"""Side of the largest texture of common graphics chips, the limit of many map viewers."""


def save_map(
    folder: RunFolder,
    name: str,
    geometry: GridGeometry,
    masks: Masks,
    large: LargeImage = "whole",
    tiles: KnownTiles | None = None,
) -> None:
    """Write `<name>.pgm` and `<name>.yaml`, map_server's trinary form.

    Parameters
    ----------
    folder : RunFolder
    name : str
    geometry : GridGeometry
    masks : function of a window
        Returns the occupied and the free cells of a window.
    large : str
        How to write an image with a longer side than many programs read: `whole`, with a warning;
        `split` into `<name>_ROW_COLUMN.pgm`, each with its origin; or `coarse`, in larger cells
        that are occupied where any of their cells is, and free where all are.
    tiles : KnownTiles, optional
        Tiles outside of which all cells are unknown.
    """
    where = tiles or geometry.shape
    if max(geometry.shape) <= MOST_IMAGE_CELLS:
        _save(folder, name, geometry, masks, where)
        return
    step = math.ceil(max(geometry.shape) / MOST_IMAGE_CELLS)
    size = f"{name}.pgm has {geometry.cols} x {geometry.rows} cells"
    if large == "split":
        _log.warning(f"{size}, and is split: {name}_0_0.pgm ...")
        whole = _everywhere(masks, where)
        for tile, rows, cols in _tiles(geometry):
            part = geometry.part(rows, cols)
            _save(folder, f"{name}_{tile}", part, _window(whole, rows, cols), part.shape)
    elif large == "coarse":
        _log.warning(f"{size}; it is written in cells of {geometry.resolution_m * step:g} m")
        coarse, cells = _coarser(geometry, _everywhere(masks, where), step)
        _save(folder, name, coarse, cells, coarse.shape)
    else:
        _log.warning(
            f"{size}, and many programs read at most {MOST_IMAGE_CELLS} a side; --set"
            " mapping.large_image=split or =coarse, or mapping.resolution_m="
            f"{geometry.resolution_m * step:g} make them fewer"
        )
        _save(folder, name, geometry, masks, where)


def of_layers(occupied: Mask, free: Mask) -> Masks:
    """Return the function that cuts windows from two layers (rows, cols)."""
    return lambda window: (occupied[window], free[window])


def _save(folder: RunFolder, name: str, geometry: GridGeometry, masks: Masks, where: Where) -> None:
    with folder.replacing(f"{name}.pgm") as temporary:
        write_trinary(temporary, where, masks)
    folder.write_text(f"{name}.yaml", map_yaml(f"{name}.pgm", geometry))


def _tiles(geometry: GridGeometry) -> Iterator[tuple[str, slice, slice]]:
    """Yield parts that are small enough: name by row and column, and their rows and columns."""
    side = MOST_IMAGE_CELLS
    for row in range(math.ceil(geometry.rows / side)):
        for col in range(math.ceil(geometry.cols / side)):
            rows = slice(row * side, min((row + 1) * side, geometry.rows))
            cols = slice(col * side, min((col + 1) * side, geometry.cols))
            yield f"{row}_{col}", rows, cols


def _everywhere(masks: Masks, where: Where) -> Masks:
    """Extend masks that are defined in tiles to any window."""

    def part(window: Window) -> tuple[Mask, Mask]:
        """Return the cells of a window."""
        rows, cols = window
        size = rows.stop - rows.start, cols.stop - cols.start
        found = np.zeros(size, dtype=np.bool_), np.zeros(size, dtype=np.bool_)
        for known in columns_of(where, rows):
            some = slice(max(known.start, cols.start), min(known.stop, cols.stop))
            if some.start < some.stop:
                here = slice(some.start - cols.start, some.stop - cols.start)
                found[0][:, here], found[1][:, here] = masks((rows, some))
        return found

    return part


def _window(masks: Masks, rows: slice, cols: slice) -> Masks:
    """Return the masks of a part of a map."""

    def part(some: Window) -> tuple[Mask, Mask]:
        """Return the cells of a window of the part."""
        high, wide = some
        return masks(
            (
                slice(rows.start + high.start, rows.start + high.stop),
                slice(cols.start + wide.start, cols.start + wide.stop),
            )
        )

    return part


def _coarser(geometry: GridGeometry, masks: Masks, step: int) -> tuple[GridGeometry, Masks]:
    """Merge blocks of `step` x `step` cells into one."""
    rows, cols = (math.ceil(n / step) for n in geometry.shape)
    coarse = GridGeometry(
        geometry.origin_x_m, geometry.origin_y_m, geometry.resolution_m * step, rows, cols
    )

    def part(some: Window) -> tuple[Mask, Mask]:
        """Return the merged cells of a window."""
        high, wide = (
            slice(at.start * step, min(at.stop * step, most))
            for at, most in zip(some, geometry.shape, strict=True)
        )
        occupied, free = masks((high, wide))
        return ~_all(~occupied, step), _all(free, step)

    return coarse, part


def _all(mask: Mask, step: int) -> Mask:
    """Return which blocks of a mask (rows, cols) have all their cells within the grid set."""
    for axis in range(2):
        starts = np.arange(0, mask.shape[axis], step)
        mask = np.logical_and.reduceat(mask, starts, axis=axis)
    return mask
