# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""A grid in bands of rows and windows, so that intermediate layers do not go with its size."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slarm_graph.grid import Mask, Scalar
from slarm_graph.raster.layers import set_aside
from slarm_graph.tiles import TILE_CELLS, Where, Window, columns_of, shape_of

_BAND_CELLS = 2_000_000
"""Cells of a band: some layers of it fit into a processor's cache. Recovery of a site of 50 million
cells takes 12.9, 12.1 and 12.0 s at half of it, it and double, and the same memory within 1 MB."""

_PAGE_BYTES = 4096
"""Of a page of memory: pages of zeros that nobody writes take none."""

_FEW_CELLS = 2048
"""To leave so many out of what is written pays: zlib takes 3 us for as many bytes of zeros, and 4
to break off and begin again."""


class Part(NamedTuple):
    """Rows and columns of a grid.

    Parameters
    ----------
    cells : window
        Of the grid.
    around : window
        The same and some more on every side, as far as the grid goes.
    inner : window
        The cells among those around.
    """

    cells: Window
    around: Window
    inner: Window


def bands(
    shape: tuple[int, int], halo: int = 0, *, aside: Sequence[NDArray[np.generic]] = ()
) -> Iterator[slice]:
    """Cut a grid (rows, cols) into bands of rows, for work that looks so many rows around each.

    Layers of it that lie on disk may leave the memory again after every band (`set_aside`).
    """
    rows, cols = shape
    count = _height(cols, halo)
    for first in range(0, rows, count):
        yield slice(first, min(rows, first + count))
        set_aside(*aside)


def _height(cols: int, halo: int) -> int:
    """Rows of a band."""
    return max(4 * halo, _BAND_CELLS // max(1, cols), 1)


def windows(
    where: Where, halo: int = 0, *, aside: Sequence[NDArray[np.generic]] = ()
) -> Iterator[Part]:
    """Cut a grid, or the tiles of it where anything is known, into parts that see around them.

    Parameters
    ----------
    where : (rows, cols) or KnownTiles
    halo : int
        How many rows and columns beyond a part are looked at.
    aside : sequence of layers
        As in `bands`.
    """
    shape = shape_of(where)
    for rows in _rows_of(where, halo):
        for cols in columns_of(where, rows):
            cells = rows, cols
            low = [max(0, at.start - halo) for at in cells]
            high = [min(most, at.stop + halo) for at, most in zip(cells, shape, strict=True)]
            inner = [slice(at.start - n, at.stop - n) for at, n in zip(cells, low, strict=True)]
            around = slice(low[0], high[0]), slice(low[1], high[1])
            yield Part(cells, around, (inner[0], inner[1]))
        set_aside(*aside)


def _rows_of(where: Where, halo: int) -> Iterator[slice]:
    """Cut a grid into bands of rows; of tiles, into such as end where tiles do."""
    rows, cols = shape_of(where)
    if isinstance(where, tuple):
        yield from bands(where, halo)
        return
    high = _height(cols, halo) // TILE_CELLS * TILE_CELLS or TILE_CELLS
    for first in range(0, rows, high):
        yield slice(first, min(rows, first + high))


def by_windows(
    where: Where,
    halo: int,
    part: Callable[[Window], Mask],
    *,
    aside: Sequence[NDArray[np.generic]] = (),
) -> Mask:
    """Put a mask (rows, cols) together from what a function says of windows.

    Parameters
    ----------
    where : (rows, cols) or KnownTiles
        Outside of tiles the mask is false.
    halo : int
        How many rows and columns beyond a window the function has to see.
    part : function of a window
        Returns its mask for these cells of the grid; only those well inside are used.
    aside : sequence of layers
        What may leave the memory after every band, as in `bands`.
    """
    whole = np.zeros(shape_of(where), dtype=np.bool_)
    for here in windows(where, halo, aside=aside):
        mask = part(here.around)[here.inner]
        if mask.shape == whole.shape:
            return mask
        lay(whole, here.cells, mask)
    return whole


def lay(layer: NDArray[Scalar], window: Window, values: NDArray[Scalar]) -> None:
    """Write values into a window of a layer that is zero there, only into pages that get any."""
    rows, cols = window
    wide = _PAGE_BYTES // layer.itemsize
    for first in range(0, values.shape[1], wide):
        some = values[:, first : first + wide]
        used = some.any(axis=1)
        if used.any():
            start = cols.start + first
            layer[rows, start : start + some.shape[1]][used] = some[used]


def put(layer: NDArray[Scalar], mask: Mask, value: int, where: Where) -> None:
    """Write a value into the cells (rows, cols) of a mask that is false outside of tiles."""
    for part in windows(where):
        layer[part.cells][mask[part.cells]] = value


def copy_of(layer: NDArray[Scalar], where: Where) -> NDArray[Scalar]:
    """Return a copy of a layer (rows, cols) that is zero outside of tiles."""
    copy = np.zeros(layer.shape, dtype=layer.dtype)
    for part in windows(where):
        copy[part.cells] = layer[part.cells]
    return copy


def looked_up(
    layer: NDArray[Scalar], where: Where, window: Window, blank: float
) -> NDArray[Scalar]:
    """Return a window of a layer; outside of tiles, where it is blank, it is not read."""
    if isinstance(where, tuple):
        return layer[window]
    rows, cols = window
    found = np.full((rows.stop - rows.start, cols.stop - cols.start), blank, dtype=layer.dtype)
    for some in _tile_rows(rows):
        for known in columns_of(where, some):
            first, past = max(known.start, cols.start), min(known.stop, cols.stop)
            if first < past:
                high = slice(some.start - rows.start, some.stop - rows.start)
                wide = slice(first - cols.start, past - cols.start)
                found[high, wide] = layer[some, first:past]
    return found


def every_so_many(layer: NDArray[Scalar], where: Where, step: int, blank: float) -> NDArray[Scalar]:
    """Return every so many rows and columns of a layer, which is blank outside of tiles."""
    if isinstance(where, tuple):
        return layer[::step, ::step]
    found = np.full([-(-n // step) for n in layer.shape], blank, dtype=layer.dtype)
    for rows in _tile_rows(slice(0, layer.shape[0])):
        for cols in columns_of(where, rows):
            few = tuple(slice(-(-at.start // step), -(-at.stop // step)) for at in (rows, cols))
            found[few] = layer[tuple(slice(n.start * step, n.stop * step, step) for n in few)]
    return found


def _tile_rows(rows: slice) -> Iterator[slice]:
    """Cut rows where tiles begin."""
    first = rows.start
    while first < rows.stop:
        past = min(first // TILE_CELLS * TILE_CELLS + TILE_CELLS, rows.stop)
        yield slice(first, past)
        first = past


def in_runs(
    layer: NDArray[Scalar], where: Where, blank: float = 0.0
) -> Iterator[NDArray[Scalar] | int]:
    """Yield the values of a layer (rows, cols) in order, and how many are left out as blank."""
    left_out = 0
    for rows in bands(layer.shape):
        stretches = list(_together(columns_of(where, rows)))
        parts = [looked_up(layer, where, (rows, cols), blank) for cols in stretches]
        if [part.shape[1] for part in parts] == [layer.shape[1]]:
            if left_out:
                yield left_out
            left_out = 0
            yield parts[0]
            continue
        for row in range(rows.stop - rows.start):
            at = 0
            for cols, part in zip(stretches, parts, strict=True):
                left_out += cols.start - at
                if left_out:
                    yield left_out
                left_out, at = 0, cols.stop
                yield part[row]
            left_out += layer.shape[1] - at
    if left_out:
        yield left_out


def _together(stretches: Iterable[slice]) -> Iterator[slice]:
    """Yield ascending stretches, those as one that few cells are between."""
    last: slice | None = None
    for stretch in stretches:
        if last is not None and stretch.start - last.stop >= _FEW_CELLS:
            yield last
            last = None
        last = stretch if last is None else slice(last.start, stretch.stop)
    if last is not None:
        yield last


def found_in_band(
    layer: NDArray[Scalar], where: Where, rows: slice, test: Callable[[NDArray[Scalar]], Mask]
) -> NDArray[np.int64]:
    """Return the numbers (N,) of the cells of some rows that pass a test, by rows, then columns."""
    stretches = list(columns_of(where, rows))
    if stretches == [slice(0, layer.shape[1])]:
        numbers = np.flatnonzero(test(layer[rows]))
        numbers += rows.start * layer.shape[1]
        return numbers
    found = [np.zeros(0, dtype=np.int64)]
    for cols in stretches:
        up, right = np.nonzero(test(layer[rows, cols]))
        found.append((up + rows.start) * layer.shape[1] + (right + cols.start))
    return np.sort(np.concatenate(found))


def side_by_side(where: Where, *layers: NDArray[Scalar]) -> tuple[NDArray[Scalar], ...]:
    """Lay layers (rows, cols) of a byte a cell, zero outside of tiles, into memory cell by cell.

    A page of memory is a stretch of one row, of which a corridor across the rows takes a tenth: of
    layers beside each other it takes one page a row, and not one for each of them. Without tiles
    they stay as they are.
    """
    if isinstance(where, tuple):
        return layers
    kinds = [(str(n), layer.dtype) for n, layer in enumerate(layers)]
    together = np.zeros(shape_of(where), dtype=kinds)
    found = tuple(together[name] for name, _ in kinds)
    for part in windows(where):
        for to, layer in zip(found, layers, strict=True):
            to[part.cells] = layer[part.cells]
    return found


def cells_of(mask: Mask, where: Where) -> NDArray[np.int64]:
    """Return row and column (N, 2) of the cells of a mask that is false outside of tiles, in order.

    As `np.argwhere`: by rows, then columns.
    """
    found = [found_in_band(mask, where, rows, lambda part: part) for rows in bands(shape_of(where))]
    numbers = np.concatenate([np.zeros(0, dtype=np.int64), *found])
    return np.stack(np.unravel_index(numbers, mask.shape), axis=1)
