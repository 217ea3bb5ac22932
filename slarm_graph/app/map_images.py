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
from slarm_graph.files.maps import map_yaml, pgm_bytes, trinary_image
from slarm_graph.grid import GridGeometry, Mask

_log = logging.getLogger(__name__)

MOST_IMAGE_CELLS = 16_384
"""Side of the largest texture of common graphics chips, in which map viewers hold an image."""


def save_map(
    folder: RunFolder,
    name: str,
    geometry: GridGeometry,
    occupied: Mask,
    free: Mask,
    large: LargeImage = "whole",
) -> None:
    """Write `<name>.pgm` and `<name>.yaml`, map_server's trinary form.

    Parameters
    ----------
    folder : RunFolder
    name : str
    geometry : GridGeometry
    occupied, free : (rows, cols) bool
    large : str
        What to do where a side is longer than many programs read: write it `whole` and tell;
        `split` it, into `<name>_ROW_COLUMN.pgm` that each have their place in the map; or write
        it `coarse`, in cells that are occupied where any of theirs is, and free where all are.
    """
    if max(geometry.shape) <= MOST_IMAGE_CELLS:
        _save(folder, name, geometry, occupied, free)
        return
    step = math.ceil(max(geometry.shape) / MOST_IMAGE_CELLS)
    size = f"{name}.pgm has {geometry.cols} x {geometry.rows} cells"
    if large == "split":
        _log.warning(f"{size}, and is split: {name}_0_0.pgm ...")
        for tile, rows, cols in _tiles(geometry):
            here = (rows, cols)
            part = geometry.part(rows, cols)
            _save(folder, f"{name}_{tile}", part, occupied[here], free[here])
    elif large == "coarse":
        _log.warning(f"{size}; it is written in cells of {geometry.resolution_m * step:g} m")
        _save(folder, name, *_coarser(geometry, occupied, free, step))
    else:
        _log.warning(
            f"{size}, and many programs read at most {MOST_IMAGE_CELLS} a side; --set"
            " mapping.large_image=split or =coarse, or mapping.resolution_m="
            f"{geometry.resolution_m * step:g} make them fewer"
        )
        _save(folder, name, geometry, occupied, free)


def _save(folder: RunFolder, name: str, geometry: GridGeometry, occupied: Mask, free: Mask) -> None:
    folder.write_bytes(f"{name}.pgm", pgm_bytes(trinary_image(occupied, free)))
    folder.write_text(f"{name}.yaml", map_yaml(f"{name}.pgm", geometry))


def _tiles(geometry: GridGeometry) -> Iterator[tuple[str, slice, slice]]:
    """Yield parts that are small enough: row and column among them, and their cells."""
    side = MOST_IMAGE_CELLS
    for row in range(math.ceil(geometry.rows / side)):
        for col in range(math.ceil(geometry.cols / side)):
            rows = slice(row * side, min((row + 1) * side, geometry.rows))
            cols = slice(col * side, min((col + 1) * side, geometry.cols))
            yield f"{row}_{col}", rows, cols


def _coarser(
    geometry: GridGeometry, occupied: Mask, free: Mask, step: int
) -> tuple[GridGeometry, Mask, Mask]:
    """Take so many cells a side together."""
    rows, cols = (math.ceil(n / step) for n in geometry.shape)
    coarse = GridGeometry(
        geometry.origin_x_m, geometry.origin_y_m, geometry.resolution_m * step, rows, cols
    )
    return coarse, ~_all(~occupied, step), _all(free, step)


def _all(mask: Mask, step: int) -> Mask:
    """Whether all cells (rows, cols) of every block are in a mask, as far as the grid goes."""
    for axis in range(2):
        starts = np.arange(0, mask.shape[axis], step)
        mask = np.logical_and.reduceat(mask, starts, axis=axis)
    return mask
