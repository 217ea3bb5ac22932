# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Cells of the plane. GridGeometry is the only place that knows the axes."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slarm_graph.geometry import Floats
from slarm_graph.tiles import KnownTiles, Where, Window

Cells = NDArray[np.int64]
Mask = NDArray[np.bool_]
Scalar = TypeVar("Scalar", bound=np.generic)


@dataclass(frozen=True, slots=True)
class GridGeometry:
    """A lattice of square cells: row = y, column = x, row 0 lowest.

    Parameters
    ----------
    origin_x_m, origin_y_m : float
        Lower-left *corner* of cell (0, 0) [m].
    resolution_m : float
        Side of a cell [m].
    rows, cols : int
    """

    origin_x_m: float
    origin_y_m: float
    resolution_m: float
    rows: int
    cols: int

    def __post_init__(self) -> None:
        if not self.resolution_m > 0.0:
            raise ValueError(f"resolution must be positive, not {self.resolution_m}")

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, cols), the shape of every layer on this lattice."""
        return self.rows, self.cols

    @property
    def extent_m(self) -> tuple[float, float, float, float]:
        """x_min, x_max, y_min, y_max [m]."""
        width, height = self.cols * self.resolution_m, self.rows * self.resolution_m
        return (
            self.origin_x_m,
            self.origin_x_m + width,
            self.origin_y_m,
            self.origin_y_m + height,
        )

    def part(self, rows: slice, cols: slice) -> GridGeometry:
        """Return the lattice of some of the rows and columns."""
        first_row, past_row, _ = rows.indices(self.rows)
        first_col, past_col, _ = cols.indices(self.cols)
        return GridGeometry(
            self.origin_x_m + first_col * self.resolution_m,
            self.origin_y_m + first_row * self.resolution_m,
            self.resolution_m,
            past_row - first_row,
            past_col - first_col,
        )

    @staticmethod
    def covering(
        x_min_m: float, x_max_m: float, y_min_m: float, y_max_m: float, resolution_m: float
    ) -> GridGeometry:
        """Start at the lower-left corner and cover the box; the last cells may stick out."""
        cols = max(1, math.ceil(round((x_max_m - x_min_m) / resolution_m, 9)))
        rows = max(1, math.ceil(round((y_max_m - y_min_m) / resolution_m, 9)))
        return GridGeometry(x_min_m, y_min_m, resolution_m, rows, cols)

    def divided(self, parts: int) -> GridGeometry:
        """Return the lattice whose cells are so many parts of ours across and up."""
        side_m = self.resolution_m / parts
        return replace(self, resolution_m=side_m, rows=self.rows * parts, cols=self.cols * parts)

    def cell_of(self, points: ArrayLike) -> Cells:
        """Return (row, col) of points (..., 2) [m]; may lie outside the grid."""
        p = np.asarray(points, dtype=np.float64)
        cols = np.floor((p[..., 0] - self.origin_x_m) / self.resolution_m)
        rows = np.floor((p[..., 1] - self.origin_y_m) / self.resolution_m)
        return np.stack([rows, cols], axis=-1).astype(np.int64)

    def center_of(self, cells: ArrayLike) -> Floats:
        """Return the centres (..., 2) [m] of cells (..., 2) given as (row, col)."""
        c = np.asarray(cells, dtype=np.float64)
        x = self.origin_x_m + (c[..., 1] + 0.5) * self.resolution_m
        y = self.origin_y_m + (c[..., 0] + 0.5) * self.resolution_m
        return np.stack([x, y], axis=-1)

    def centers(self) -> Floats:
        """Return all centres (rows, cols, 2) [m]."""
        return self.center_of(np.moveaxis(np.indices(self.shape), 0, -1))

    def contains(self, cells: ArrayLike) -> Mask:
        """Which of the cells (..., 2) lie on the grid."""
        c = np.asarray(cells)
        rows, cols = c[..., 0], c[..., 1]
        return np.asarray((rows >= 0) & (rows < self.rows) & (cols >= 0) & (cols < self.cols))

    def share_within(self, x_min: float, x_max: float, y_min: float, y_max: float) -> Floats:
        """Return the share of every cell's area (rows, cols) that lies in a box [m]."""
        return np.outer(
            _overlap(self.origin_y_m, self.resolution_m, self.rows, y_min, y_max),
            _overlap(self.origin_x_m, self.resolution_m, self.cols, x_min, x_max),
        )

    def sample(self, layer: NDArray[Scalar], points: ArrayLike, outside: float) -> NDArray[Scalar]:
        """Look a layer (rows, cols) up at points (..., 2) [m]; `outside` where there is no cell."""
        cells = self.cell_of(points)
        rows, cols = cells[..., 0], cells[..., 1]
        inside = self.contains(cells)
        values = np.full(rows.shape, outside, dtype=layer.dtype)
        values[inside] = layer[rows[inside], cols[inside]]
        return values

    def resample(
        self, layer: NDArray[Scalar], target: GridGeometry, outside: float
    ) -> NDArray[Scalar]:
        """Look a layer (rows, cols) up at the centres of another grid's cells, as `sample` does.

        For the same grid that is the layer itself, not a copy.
        """
        if target == self:
            return layer
        corner = np.array([target.origin_x_m, target.origin_y_m])
        count = np.arange(max(target.shape))[:, None]
        cells = self.cell_of(corner + (count + 0.5) * target.resolution_m)
        rows, cols = cells[: target.rows, 0], cells[: target.cols, 1]
        row_in, col_in = (rows >= 0) & (rows < self.rows), (cols >= 0) & (cols < self.cols)
        values = np.full(target.shape, outside, dtype=layer.dtype)
        values[np.ix_(row_in, col_in)] = layer[np.ix_(rows[row_in], cols[col_in])]
        return values


def _overlap(origin: float, side: float, count: int, low: float, high: float) -> Floats:
    """Share (N,) of every interval of a row of equal ones that lies between two limits."""
    start = origin + side * np.arange(count)
    share = (np.minimum(start + side, high) - np.maximum(start, low)) / side
    # Rounding must not turn a whole cell into 0.9999999999999.
    return np.asarray(np.clip(np.round(share, 9), 0.0, 1.0))


def window_of(layer: NDArray[np.generic]) -> tuple[slice, slice]:
    """Return the rows and columns in which a layer is not zero; empty where it is nowhere."""
    rows, cols = (np.flatnonzero(layer.any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return slice(0, 0), slice(0, 0)
    return slice(int(rows[0]), int(rows[-1]) + 1), slice(int(cols[0]), int(cols[-1]) + 1)


@dataclass(frozen=True, slots=True)
class OccupancyGrid:
    """How likely every cell is occupied.

    Parameters
    ----------
    geometry : GridGeometry
    probability : (rows, cols) float32
        Of being occupied, 0 to 1; nan where the cell was never seen.
    occupied_at, free_at : float
        A cell is occupied from `occupied_at` on, free up to `free_at` and unknown in between.
    tiles : KnownTiles, optional
        Of a large grid, where any cell was seen, and those beside.
    """

    geometry: GridGeometry
    probability: NDArray[np.float32]
    occupied_at: float = 0.65
    free_at: float = 0.196
    tiles: KnownTiles | None = None

    def __post_init__(self) -> None:
        if self.probability.shape != self.geometry.shape:
            raise ValueError(f"{self.probability.shape} cells for a {self.geometry.shape} grid")

    def on(self, target: GridGeometry) -> OccupancyGrid:
        """Return the grid looked up at the centres of another grid's cells."""
        if target == self.geometry:
            return self
        probability = self.geometry.resample(self.probability, target, np.nan)
        return replace(self, geometry=target, probability=probability, tiles=None)

    @property
    def where(self) -> Where:
        """Where it has to be looked at: everywhere, unless it has tiles."""
        return self.tiles or self.geometry.shape

    def in_window(self, window: Window) -> OccupancyGrid:
        """Return some of the rows and columns, without a copy."""
        part, cells = self.geometry.part(*window), self.probability[window]
        return replace(self, geometry=part, probability=cells, tiles=None)

    @property
    def occupied(self) -> Mask:
        """Cells held to be occupied."""
        return np.asarray(self.probability >= self.occupied_at)

    @property
    def free(self) -> Mask:
        """Cells held to be free."""
        return np.asarray(self.probability <= self.free_at) & ~self.occupied

    @property
    def unknown(self) -> Mask:
        """Cells never seen, or undecided."""
        return ~(self.occupied | self.free)
