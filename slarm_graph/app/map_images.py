# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Maps as map_server's images, also such as are larger than many programs read."""

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
"""Side of the largest texture of common graphics chips, in which map viewers hold an image."""


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
        Returns the cells of a window that are occupied, and those that are free.
    large : str
        What to do where a side is longer than many programs read: write it `whole` and tell;
        `split` it, into `<name>_ROW_COLUMN.pgm` that each have their place in the map; or write
        it `coarse`, in cells that are occupied where any of theirs is, and free where all are.
    tiles : KnownTiles, optional
        Outside of which cells are unknown.
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
    """Return what is occupied and free of windows of two layers (rows, cols)."""
    return lambda window: (occupied[window], free[window])


def _save(folder: RunFolder, name: str, geometry: GridGeometry, masks: Masks, where: Where) -> None:
    with folder.replacing(f"{name}.pgm") as temporary:
        write_trinary(temporary, where, masks)
    folder.write_text(f"{name}.yaml", map_yaml(f"{name}.pgm", geometry))


def _tiles(geometry: GridGeometry) -> Iterator[tuple[str, slice, slice]]:
    """Yield parts that are small enough: row and column among them, and their cells."""
    side = MOST_IMAGE_CELLS
    for row in range(math.ceil(geometry.rows / side)):
        for col in range(math.ceil(geometry.cols / side)):
            rows = slice(row * side, min((row + 1) * side, geometry.rows))
            cols = slice(col * side, min((col + 1) * side, geometry.cols))
            yield f"{row}_{col}", rows, cols


def _everywhere(masks: Masks, where: Where) -> Masks:
    """Look only into tiles, and answer for any window."""

    def part(window: Window) -> tuple[Mask, Mask]:
        """Look up a window."""
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
    """Cut a part out of a map."""

    def part(some: Window) -> tuple[Mask, Mask]:
        """Look up a window of it."""
        high, wide = some
        return masks(
            (
                slice(rows.start + high.start, rows.start + high.stop),
                slice(cols.start + wide.start, cols.start + wide.stop),
            )
        )

    return part


def _coarser(geometry: GridGeometry, masks: Masks, step: int) -> tuple[GridGeometry, Masks]:
    """Take so many cells a side together."""
    rows, cols = (math.ceil(n / step) for n in geometry.shape)
    coarse = GridGeometry(
        geometry.origin_x_m, geometry.origin_y_m, geometry.resolution_m * step, rows, cols
    )

    def part(some: Window) -> tuple[Mask, Mask]:
        """Take the cells of a window of it together."""
        high, wide = (
            slice(at.start * step, min(at.stop * step, most))
            for at, most in zip(some, geometry.shape, strict=True)
        )
        occupied, free = masks((high, wide))
        return ~_all(~occupied, step), _all(free, step)

    return coarse, part


def _all(mask: Mask, step: int) -> Mask:
    """Whether all cells (rows, cols) of every block are in a mask, as far as the grid goes."""
    for axis in range(2):
        starts = np.arange(0, mask.shape[axis], step)
        mask = np.logical_and.reduceat(mask, starts, axis=axis)
    return mask
