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

_log = logging.getLogger(__name__)

MOST_IMAGE_CELLS = 16_384
"""Side of the largest texture of common graphics chips, in which map viewers hold an image."""


def save_map(
    folder: RunFolder,
    name: str,
    geometry: GridGeometry,
    masks: Masks,
    large: LargeImage = "whole",
) -> None:
    """Write `<name>.pgm` and `<name>.yaml`, map_server's trinary form.

    Parameters
    ----------
    folder : RunFolder
    name : str
    geometry : GridGeometry
    masks : function of rows
        Returns the cells of some rows that are occupied, and those that are free.
    large : str
        What to do where a side is longer than many programs read: write it `whole` and tell;
        `split` it, into `<name>_ROW_COLUMN.pgm` that each have their place in the map; or write
        it `coarse`, in cells that are occupied where any of theirs is, and free where all are.
    """
    if max(geometry.shape) <= MOST_IMAGE_CELLS:
        _save(folder, name, geometry, masks)
        return
    step = math.ceil(max(geometry.shape) / MOST_IMAGE_CELLS)
    size = f"{name}.pgm has {geometry.cols} x {geometry.rows} cells"
    if large == "split":
        _log.warning(f"{size}, and is split: {name}_0_0.pgm ...")
        for tile, rows, cols in _tiles(geometry):
            _save(folder, f"{name}_{tile}", geometry.part(rows, cols), _window(masks, rows, cols))
    elif large == "coarse":
        _log.warning(f"{size}; it is written in cells of {geometry.resolution_m * step:g} m")
        _save(folder, name, *_coarser(geometry, masks, step))
    else:
        _log.warning(
            f"{size}, and many programs read at most {MOST_IMAGE_CELLS} a side; --set"
            " mapping.large_image=split or =coarse, or mapping.resolution_m="
            f"{geometry.resolution_m * step:g} make them fewer"
        )
        _save(folder, name, geometry, masks)


def of_layers(occupied: Mask, free: Mask) -> Masks:
    """Return what is occupied and free of some rows of two layers (rows, cols)."""
    return lambda rows: (occupied[rows], free[rows])


def _save(folder: RunFolder, name: str, geometry: GridGeometry, masks: Masks) -> None:
    with folder.replacing(f"{name}.pgm") as temporary:
        write_trinary(temporary, geometry.shape, masks)
    folder.write_text(f"{name}.yaml", map_yaml(f"{name}.pgm", geometry))


def _tiles(geometry: GridGeometry) -> Iterator[tuple[str, slice, slice]]:
    """Yield parts that are small enough: row and column among them, and their cells."""
    side = MOST_IMAGE_CELLS
    for row in range(math.ceil(geometry.rows / side)):
        for col in range(math.ceil(geometry.cols / side)):
            rows = slice(row * side, min((row + 1) * side, geometry.rows))
            cols = slice(col * side, min((col + 1) * side, geometry.cols))
            yield f"{row}_{col}", rows, cols


def _window(masks: Masks, rows: slice, cols: slice) -> Masks:
    """Cut a part out of a map."""

    def part(some: slice) -> tuple[Mask, Mask]:
        """Look up some of its rows."""
        occupied, free = masks(slice(rows.start + some.start, rows.start + some.stop))
        return occupied[:, cols], free[:, cols]

    return part


def _coarser(geometry: GridGeometry, masks: Masks, step: int) -> tuple[GridGeometry, Masks]:
    """Take so many cells a side together."""
    rows, cols = (math.ceil(n / step) for n in geometry.shape)
    coarse = GridGeometry(
        geometry.origin_x_m, geometry.origin_y_m, geometry.resolution_m * step, rows, cols
    )

    def part(some: slice) -> tuple[Mask, Mask]:
        """Take the cells of some of its rows together."""
        occupied, free = masks(slice(some.start * step, min(some.stop * step, geometry.rows)))
        return ~_all(~occupied, step), _all(free, step)

    return coarse, part


def _all(mask: Mask, step: int) -> Mask:
    """Whether all cells (rows, cols) of every block are in a mask, as far as the grid goes."""
    for axis in range(2):
        starts = np.arange(0, mask.shape[axis], step)
        mask = np.logical_and.reduceat(mask, starts, axis=axis)
    return mask
