# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Occupancy mapping: Bresenham hit and visit counts of beams in cells (paper Remark 1)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from slarm_graph.config import MappingConfig
from slarm_graph.errors import BadInput
from slarm_graph.geometry import Floats
from slarm_graph.grid import GridGeometry, Mask, OccupancyGrid
from slarm_graph.kernels import kernel
from slarm_graph.mapping.beams import beams_in_map
from slarm_graph.raster.bands import windows
from slarm_graph.raster.layers import blank_layer, sparse_layer
from slarm_graph.raster.lines import next_on_line
from slarm_graph.readings import LaserScan
from slarm_graph.tiles import TILE_CELLS, KnownTiles, Where, Window

_MARGIN_CELLS: Final = 64
"""Growth beyond what is needed; half of it copies small maps twice as often."""
_LARGE_CELLS: Final = 8_000_000
"""From here on, 200 x 100 m at 0.05 m, a map knows its tiles; smaller ones are a few bands of rows.
With half and double, a clinic of 48 million cells and a building of 1 million stay what they
are."""
_EVERYTHING: Final = (slice(None), slice(None))


class GridMapper:
    """Counts hits and visits of beams in cells.

    Parameters
    ----------
    config : MappingConfig
    geometry : GridGeometry, optional
        Cells to count in; beams are cut where they leave them. When left out, the cells are those
        of `config.resolution_m` and grow with what is shown.
    """

    def __init__(self, config: MappingConfig, geometry: GridGeometry | None = None) -> None:
        self._config = config
        self._grows = geometry is None
        self._geometry = geometry or GridGeometry(0.0, 0.0, config.resolution_m, 0, 0)
        self.clear()

    def clear(self) -> None:
        """Forget everything seen."""
        self._hits: NDArray[np.int32] = np.zeros(self._geometry.shape, dtype=np.int32)
        self._visits: NDArray[np.int32] = np.zeros(self._geometry.shape, dtype=np.int32)
        self._boxes: set[tuple[int, int, int, int]] = set()

    def add(
        self, scan: LaserScan, pose: Floats, pose_rate: Floats | None = None, *, times: int = 1
    ) -> None:
        """Integrate one scan.

        Parameters
        ----------
        scan : LaserScan
        pose : (3,) float64
            `map_from_robot` at the first beam [m, m, rad].
        pose_rate : (3,) float64, optional
            Its rate of change in the map's frame [m/s, m/s, rad/s], to undo the motion that takes
            place within the scan.
        times : int
            -1 takes back what was integrated with the same pose and rate.
        """
        beams = self._beams(scan, pose, pose_rate)
        if not len(beams):
            return
        self._note(_box(beams))
        g = self._geometry
        _walk(self._hits, self._visits, g.origin_x_m, g.origin_y_m, g.resolution_m, beams, times)

    def make_room(self, scan: LaserScan, pose: Floats, pose_rate: Floats | None = None) -> None:
        """Grow to hold a scan that is yet to be added; as long as nothing is, no count is moved."""
        self._beams(scan, pose, pose_rate)

    def _beams(self, scan: LaserScan, pose: Floats, pose_rate: Floats | None) -> Floats:
        """Beams (B, 5) of a scan in the map, for which there is room."""
        beams = beams_in_map(scan, pose, pose_rate, self._config.max_range_m)
        if self._grows and len(beams):
            self._cover(_box(beams))
        return beams

    def occupied(self, window: Window = _EVERYTHING) -> Mask:
        """Cells held to be occupied, of all or of a part of them."""
        return np.asarray(
            _share(self._hits[window], self._visits[window]) >= np.float32(self._config.occupied_at)
        )

    def free(self, window: Window = _EVERYTHING) -> Mask:
        """Cells held to be free, of all or of a part of them."""
        return np.asarray(
            _share(self._hits[window], self._visits[window]) < np.float32(self._config.occupied_at)
        )

    def grid(self) -> OccupancyGrid:
        """Return the occupancy of everything seen so far, cropped to it.

        The probability of a cell is the share of its visits that were hits.
        """
        rows, cols = self._seen()
        if rows.start == rows.stop:
            empty = GridGeometry(0.0, 0.0, self._config.resolution_m, 1, 1)
            return OccupancyGrid(empty, np.full((1, 1), np.nan, dtype=np.float32))
        cropped = self._geometry.part(rows, cols)
        at = self._config.occupied_at
        tiles = self._tiles_of(cropped)
        probability, visits = blank_layer(cropped.shape, tiles), self._visits[rows, cols]
        hits = self._hits[rows, cols]
        for part in windows(tiles or cropped.shape, aside=[probability]):
            probability[part.cells] = _share(hits[part.cells], visits[part.cells])
        return OccupancyGrid(cropped, probability, occupied_at=at, free_at=at, tiles=tiles)

    def _note(self, box: Floats) -> None:
        """Remember where, in tiles from the map's origin on, something was seen (2, 2) [m]."""
        side_m = TILE_CELLS * self._geometry.resolution_m
        (left, bottom), (right, top) = np.floor(box / side_m).astype(np.int64).tolist()
        self._boxes.add((bottom, left, top, right))

    def _tiles_of(self, geometry: GridGeometry) -> KnownTiles | None:
        """Return tiles of a grid with our lattice in which something was seen; None if small."""
        if not self._grows or geometry.rows * geometry.cols < _LARGE_CELLS:
            return None
        boxes = np.array(sorted(self._boxes), dtype=np.int64).reshape(-1, 4) * TILE_CELLS
        origin = np.array([geometry.origin_y_m, geometry.origin_x_m]) / geometry.resolution_m
        first = np.round(origin).astype(np.int64)
        low, high = boxes[:, :2] - first, boxes[:, 2:] + (TILE_CELLS - 1) - first
        return KnownTiles.none(geometry.shape).with_boxes(low, high)

    def _seen(self) -> Window:
        """Rows and columns in which anything was seen; empty where nothing was."""
        seen = [np.zeros(n, dtype=np.bool_) for n in self._geometry.shape]
        for part in windows(self._tiles_of(self._geometry) or self._geometry.shape):
            here = self._visits[part.cells] != 0
            for axis in range(2):
                seen[axis][part.cells[axis]] |= here.any(axis=1 - axis)
        at = [np.flatnonzero(one) for one in seen]
        if not len(at[0]):
            return slice(0, 0), slice(0, 0)
        return slice(int(at[0][0]), int(at[0][-1]) + 1), slice(int(at[1][0]), int(at[1][-1]) + 1)

    def _cover(self, box: Floats) -> None:
        """Grow the counts so that a box (2, 2) [m] lies inside."""
        x_min, x_max, y_min, y_max = self._geometry.extent_m
        # One cell of slack, so that rounding cannot put an end outside after all.
        slack = self._geometry.resolution_m
        if (
            box[0, 0] > x_min + slack
            and box[1, 0] < x_max - slack
            and box[0, 1] > y_min + slack
            and box[1, 1] < y_max - slack
        ):
            return
        low, high = self._geometry.cell_of(box)
        if not self._hits.size:
            self._geometry = replace(
                self._geometry,
                origin_x_m=float(low[1]) * self._geometry.resolution_m,
                origin_y_m=float(low[0]) * self._geometry.resolution_m,
            )
            low, high = np.zeros(2, dtype=np.int64), high - low
        missing = (
            -low[0],
            high[0] + 1 - self._geometry.rows,
            -low[1],
            high[1] + 1 - self._geometry.cols,
        )
        if max(missing) > 0:
            # Growing by a share of the size keeps the number of copies logarithmic.
            spare = _MARGIN_CELLS + max(self._geometry.shape) // 4
            if self._size(missing, spare) > self._config.max_cells:
                spare = 0
            self._grow(*(int(n) + spare if n > 0 else 0 for n in missing))

    def _size(self, missing: Sequence[int], spare: int) -> int:
        """Cells there would be with so many more, and some to spare, on each side."""
        below, above, left, right = (int(n) + spare if n > 0 else 0 for n in missing)
        g = self._geometry
        return (g.rows + below + above) * (g.cols + left + right)

    def _grow(self, below: int, above: int, left: int, right: int) -> None:
        g = self._geometry
        rows, cols = g.rows + below + above, g.cols + left + right
        if rows * cols > self._config.max_cells:
            raise BadInput(
                f"map would be {cols} x {rows} cells; raise mapping.resolution_m"
                " or mapping.max_cells"
            )
        where = (self._tiles_of(g) or g.shape) if self._boxes else KnownTiles.none(g.shape)
        self._hits = _padded(self._hits, (rows, cols), below, left, where)
        self._visits = _padded(self._visits, (rows, cols), below, left, where)
        self._geometry = GridGeometry(
            g.origin_x_m - left * g.resolution_m,
            g.origin_y_m - below * g.resolution_m,
            g.resolution_m,
            rows,
            cols,
        )


def _share(hits: NDArray[np.int32], visits: NDArray[np.int32]) -> NDArray[np.float32]:
    """Share of a cell's visits that were hits, nan without any; single precision throughout."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.divide(hits, visits, dtype=np.float32, casting="unsafe"))


def _padded(
    counts: NDArray[np.int32], shape: tuple[int, int], below: int, left: int, where: Where
) -> NDArray[np.int32]:
    """Counts in a larger grid; only where there are any, as what stays zero takes no memory."""
    larger = sparse_layer(shape, np.int32)
    for part in windows(where):
        here = counts[part.cells]
        cols = np.flatnonzero(here.any(axis=0))
        if len(cols):
            seen = slice(int(cols[0]), int(cols[-1]) + 1)
            rows = slice(below + part.cells[0].start, below + part.cells[0].stop)
            start = left + part.cells[1].start
            larger[rows, start + seen.start : start + seen.stop] = here[:, seen]
    return larger


@kernel
def _box(beams: Floats) -> Floats:
    """Lowest and highest x, y (2, 2) [m] of the beams' ends."""
    box = np.empty((2, 2))
    box[0] = np.inf
    box[1] = -np.inf
    for b in range(len(beams)):
        for k in range(4):
            axis = k % 2
            box[0, axis] = min(box[0, axis], beams[b, k])
            box[1, axis] = max(box[1, axis], beams[b, k])
    return box


@kernel
def _walk(
    hits: NDArray[np.int32],
    visits: NDArray[np.int32],
    origin_x: float,
    origin_y: float,
    resolution: float,
    beams: Floats,
    times: int,
) -> None:
    """Walk every beam with Bresenham's line; its last cell is a hit where something returned."""
    rows, cols = visits.shape
    for b in range(len(beams)):
        col = math.floor((beams[b, 0] - origin_x) / resolution)
        row = math.floor((beams[b, 1] - origin_y) / resolution)
        end_col = math.floor((beams[b, 2] - origin_x) / resolution)
        end_row = math.floor((beams[b, 3] - origin_y) / resolution)
        error = abs(end_col - col) - abs(end_row - row)
        start_col, start_row = col, row
        while 0 <= row < rows and 0 <= col < cols:
            visits[row, col] += times
            if row == end_row and col == end_col:
                if beams[b, 4] > 0.0:
                    hits[row, col] += times
                break
            col, row, error = next_on_line(
                col, row, error, end_col - start_col, end_row - start_row
            )
