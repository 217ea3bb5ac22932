# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Tiles of a grid: where anything is known of a site that its bounding box is mostly empty of."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

TILE_CELLS = 64
"""Side of a tile: 3 m at 0.05 m, so that a corridor with what lies around it takes four abreast.
Steps that look around seen cells look less far than a tile, or add what they reach (`grown`)."""

Window = tuple[slice, slice]
"""Rows and columns of a part of a grid; both begin and end on it."""


@dataclass(frozen=True, slots=True)
class KnownTiles:
    """Tiles of a grid in which something may be known; in all others cells are as nobody saw them.

    Parameters
    ----------
    shape : (rows, cols)
        Of the grid; tiles are counted from its cell (0, 0).
    known : (R, C) bool
        Which tiles, the last of a row or column cut where the grid ends.
    """

    shape: tuple[int, int]
    known: NDArray[np.bool_]

    @staticmethod
    def none(shape: tuple[int, int]) -> KnownTiles:
        """Return tiles of a grid of which nothing is known."""
        rows, cols = (-(-n // TILE_CELLS) for n in shape)
        return KnownTiles(shape, np.zeros((rows, cols), dtype=np.bool_))

    @property
    def cells(self) -> int:
        """How many cells the known tiles have."""
        high, wide = (
            np.minimum(TILE_CELLS, n - TILE_CELLS * np.arange(len(tiles)))
            for n, tiles in zip(self.shape, (self.known, self.known.T), strict=True)
        )
        return int(high @ self.known @ wide)

    @property
    def share(self) -> float:
        """Share of the grid's cells that lie in known tiles."""
        return self.cells / (self.shape[0] * self.shape[1])

    def with_boxes(self, low: NDArray[np.int64], high: NDArray[np.int64]) -> KnownTiles:
        """Add the tiles of boxes, and those beside them.

        Parameters
        ----------
        low, high : (N, 2) int64
            First and last row and column of every box; may lie beyond the grid.
        """
        known, most = self.known.copy(), np.array(self.known.shape) - 1
        first = np.clip(low // TILE_CELLS - 1, 0, most)
        last = np.clip(high // TILE_CELLS + 1, 0, most)
        both = np.unique(np.concatenate([first, last], axis=1).reshape(-1, 4), axis=0)
        for top, left, bottom, right in both.tolist():
            known[top : bottom + 1, left : right + 1] = True
        return KnownTiles(self.shape, known)

    def grown(self, cells: int) -> KnownTiles:
        """Add the tiles that lie within so many rows and columns of known ones."""
        low = np.argwhere(self.known) * TILE_CELLS
        return self.with_boxes(low - cells, low + (TILE_CELLS - 1 + cells))

    def columns(self, rows: slice) -> Iterator[slice]:
        """Yield stretches of columns that hold all known tiles of some rows."""
        tiles = slice(rows.start // TILE_CELLS, -(-rows.stop // TILE_CELLS))
        edges = np.diff(self.known[tiles].any(axis=0), prepend=False, append=False)
        for first, past in np.flatnonzero(edges).reshape(-1, 2).tolist():
            yield slice(first * TILE_CELLS, min(past * TILE_CELLS, self.shape[1]))


Where = tuple[int, int] | KnownTiles
"""A whole grid (rows, cols), or only those tiles of it where anything is known."""


def shape_of(where: Where) -> tuple[int, int]:
    """Return the grid's (rows, cols)."""
    return where.shape if isinstance(where, KnownTiles) else where


def known_tiles(where: Where) -> NDArray[np.bool_]:
    """Return for kernels which tiles to look at (R, C), with a row and a column more, all false."""
    rows, cols = (n // TILE_CELLS + 2 for n in shape_of(where))
    known = np.zeros((rows, cols), dtype=np.bool_)
    if isinstance(where, KnownTiles):
        known[: len(where.known), : where.known.shape[1]] = where.known
    else:
        known[:-1, :-1] = True
    return known


def columns_of(where: Where, rows: slice) -> Iterator[slice]:
    """Yield stretches of columns in which some rows have to be looked at."""
    if isinstance(where, KnownTiles):
        yield from where.columns(rows)
    else:
        yield slice(0, where[1])
