# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""A smooth likelihood grid: 1 on what the scans saw, falling off as a Gaussian beside it.

Neighbouring returns are joined by short segments, so a wall is a ridge and not a row of dots: the
distance that matters is the one to the line, as in point-to-line ICP.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slarm_graph.frontends.scans.bicubic import bicubic
from slarm_graph.geometry import Floats
from slarm_graph.kernels import kernel, kernel_with

Grid = NDArray[np.float32]

_REACH_SIGMAS = 3.0
"""Beyond, the likelihood is below exp(-4.5), about 1 %, and taken as none."""
_TABLE_SIZE = 2048
"""Of the fall-off by squared distance: steps of 0.2 % of the likelihood at most."""
_FALL_OFF = np.exp(-0.5 * np.linspace(0.0, _REACH_SIGMAS**2, _TABLE_SIZE)).astype(np.float32)
"""Likelihood by squared distance, from none to that of the reach."""

_WIDE_CELLS = 2.0
"""Fall-off, in cells, from which a grid is built from a distance field: at 2.3 cells that takes two
thirds as long, at 0.8 cells longer."""


class Lattice(NamedTuple):
    """A likelihood grid as compiled code takes it: the fields of `LikelihoodGrid`, lengths in m."""

    values: Grid
    origin_x: float
    origin_y: float
    resolution: float
    sigma: float


@dataclass(frozen=True, slots=True)
class LikelihoodGrid:
    """Likelihood of a return at cell centres.

    Parameters
    ----------
    origin_x_m, origin_y_m : float
        Centre of cell (0, 0) [m].
    resolution_m, sigma_m : float
        Cell side and standard deviation of the fall-off [m].
    values : (rows = y, cols = x) float32
        exp(-d^2 / 2 sigma^2) of the distance d to the nearest segment.
    """

    origin_x_m: float
    origin_y_m: float
    resolution_m: float
    sigma_m: float
    values: Grid

    @property
    def lattice(self) -> Lattice:
        """The grid for compiled code."""
        return Lattice(
            self.values, self.origin_x_m, self.origin_y_m, self.resolution_m, self.sigma_m
        )


def build_likelihood_grid(
    segments: Floats, *, resolution_m: float, sigma_m: float, margin_m: float = 0.0
) -> LikelihoodGrid:
    """Splat segments (S, 4) (x, y, x, y) [m] into a grid that holds them and a margin around."""
    margin = margin_m + _REACH_SIGMAS * sigma_m + 4 * resolution_m
    low, high = _bounds(segments)
    low = np.floor((low - margin) / resolution_m) * resolution_m
    size = np.ceil((high + margin - low) / resolution_m).astype(int) + 1
    values = np.zeros((int(size[1]), int(size[0])), dtype=np.float32)
    grid = LikelihoodGrid(float(low[0]), float(low[1]), resolution_m, sigma_m, values)
    if sigma_m >= _WIDE_CELLS * resolution_m:
        _splat_wide(grid.lattice, _REACH_SIGMAS * sigma_m, segments)
    else:
        add_segments(grid, segments)
    return grid


def add_segments(grid: LikelihoodGrid, segments: Floats) -> bool:
    """Splat further segments (S, 4) [m] in place; False, and nothing done, if they do not fit."""
    reach = _REACH_SIGMAS * grid.sigma_m
    rows, cols = grid.values.shape
    low, high = _bounds(segments)
    if low[0] - reach < grid.origin_x_m or low[1] - reach < grid.origin_y_m:
        return False
    if high[0] + reach > grid.origin_x_m + cols * grid.resolution_m:
        return False
    if high[1] + reach > grid.origin_y_m + rows * grid.resolution_m:
        return False
    _splat(grid.lattice, reach, segments)
    return True


@kernel
def scan_segments(points: Floats, pose: Floats, max_gap: float) -> Floats:
    """Join neighbouring points (K, 2) nearer than `max_gap` [m]; lone points stay as dots.

    Returns
    -------
    (S, 4) float64
        Segments (x, y, x, y) [m] in the frame of `pose`'s parent.
    """
    c, s = math.cos(pose[2]), math.sin(pose[2])
    out = np.empty((len(points), 4))
    count = 0
    joined = False
    for i in range(len(points)):
        x = pose[0] + c * points[i, 0] - s * points[i, 1]
        y = pose[1] + s * points[i, 0] + c * points[i, 1]
        next_joined = False
        if i + 1 < len(points):
            dx, dy = points[i + 1, 0] - points[i, 0], points[i + 1, 1] - points[i, 1]
            next_joined = dx * dx + dy * dy < max_gap * max_gap
        if next_joined or not joined:
            out[count, 0] = x
            out[count, 1] = y
            out[count, 2] = x
            out[count, 3] = y
            if next_joined:
                out[count, 2] += c * dx - s * dy
                out[count, 3] += s * dx + c * dy
            count += 1
        joined = next_joined
    return out[:count].copy()


@kernel
def _bounds(segments: Floats) -> tuple[Floats, Floats]:
    """Lowest and highest x and y of segments (S, 4)."""
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    for k in range(len(segments)):
        for axis in range(2):
            low[axis] = min(low[axis], segments[k, axis], segments[k, axis + 2])
            high[axis] = max(high[axis], segments[k, axis], segments[k, axis + 2])
    return low, high


@kernel
def _splat(lattice: Lattice, reach: float, segments: Floats) -> None:
    """Raise every cell near a segment to the likelihood of its distance."""
    values, origin_x, origin_y, resolution, _ = lattice
    scale = (_TABLE_SIZE - 1) / (reach * reach)
    for k in range(len(segments)):
        x0, y0, x1, y1 = segments[k, 0], segments[k, 1], segments[k, 2], segments[k, 3]
        dx, dy = x1 - x0, y1 - y0
        length2 = dx * dx + dy * dy
        per_length2 = 1.0 / length2 if length2 > 0.0 else 0.0
        col_low = math.floor((min(x0, x1) - reach - origin_x) / resolution)
        col_high = math.ceil((max(x0, x1) + reach - origin_x) / resolution)
        row_low = math.floor((min(y0, y1) - reach - origin_y) / resolution)
        row_high = math.ceil((max(y0, y1) + reach - origin_y) / resolution)
        first, last = max(col_low, 0), min(col_high + 1, values.shape[1])
        if first >= last:
            continue
        left = origin_x + first * resolution - x0
        for row in range(max(row_low, 0), min(row_high + 1, values.shape[0])):
            py = origin_y + row * resolution - y0
            # A slice tells the compiler that no index is negative.
            line = values[row, first:last]
            for i in range(len(line)):
                px = left + i * resolution
                along = min(max((px * dx + py * dy) * per_length2, 0.0), 1.0)
                ex, ey = px - along * dx, py - along * dy
                d2 = ex * ex + ey * ey
                if d2 < reach * reach:
                    line[i] = max(line[i], _FALL_OFF[int(d2 * scale + 0.5)])


@kernel
def _splat_wide(lattice: Lattice, reach: float, segments: Floats) -> None:
    """As `_splat` on an empty grid, where most of what is near a segment is nearer to others."""
    values = lattice.values
    scale = (_TABLE_SIZE - 1) / (reach * reach)
    squares: Floats = np.full(values.shape, reach * reach)
    offsets = np.empty((2, values.shape[1]))
    for k in range(len(segments)):
        _lower(squares, offsets, lattice, reach, segments[k])
    for row in range(len(squares)):
        for col in range(values.shape[1]):
            if squares[row, col] < reach * reach:
                values[row, col] = _FALL_OFF[int(squares[row, col] * scale + 0.5)]


@kernel
def _lower(
    squares: Floats, offsets: Floats, lattice: Lattice, reach: float, segment: Floats
) -> None:
    """Lower every cell of squared distances [m^2] near a segment (4,) to that of the segment.

    Cells of a row are worked on several at once, for which `offsets` (2, cols) has room.
    """
    _, origin_x, origin_y, resolution, _ = lattice
    x0, y0 = segment[0], segment[1]
    dx, dy = segment[2] - x0, segment[3] - y0
    length2 = dx * dx + dy * dy
    per_length2 = 1.0 / length2 if length2 > 0.0 else 0.0
    rows, cols = squares.shape
    col_low = max(math.floor((min(x0, segment[2]) - reach - origin_x) / resolution), 0)
    row_low = max(math.floor((min(y0, segment[3]) - reach - origin_y) / resolution), 0)
    row_high = math.ceil((max(y0, segment[3]) + reach - origin_y) / resolution)
    col_high = math.ceil((max(x0, segment[2]) + reach - origin_x) / resolution)
    left = origin_x + col_low * resolution - x0
    width = min(col_high + 1, cols) - col_low
    for i in range(width):
        offsets[0, i] = left + i * resolution
        offsets[1, i] = offsets[0, i] * dx
    for row in range(row_low, min(row_high + 1, rows)):
        py = origin_y + row * resolution - y0
        # Only as much of a row as is within reach, and a cell more.
        off = max(py - max(dy, 0.0), min(dy, 0.0) - py, 0.0)
        half = math.sqrt(max(reach * reach - off * off, 0.0))
        first = max(int((min(dx, 0.0) - half - left) / resolution), 0)
        last = min(int((max(dx, 0.0) + half - left) / resolution) + 2, width)
        if first >= last:
            continue
        # A slice tells the compiler that no index is negative.
        line = squares[row, col_low + first : col_low + last]
        xs, projected = offsets[0, first:last], offsets[1, first:last]
        for i in range(len(line)):
            px = xs[i]
            along = (projected[i] + py * dy) * per_length2
            along = along if along > 0.0 else 0.0
            along = along if along < 1.0 else 1.0
            ex, ey = px - along * dx, py - along * dy
            square = ex * ex + ey * ey
            line[i] = square if square < line[i] else line[i]


def mean_likelihood(grid: LikelihoodGrid, points: Floats, pose: Floats) -> float:
    """Mean likelihood, 0 to 1, of points (K, 2) [m] in the frame of a pose (3,) on the grid."""
    return float(likelihoods(grid.lattice, points, pose).sum()) / max(len(points), 1)


@kernel
def likelihoods(lattice: Lattice, points: Floats, pose: Floats) -> Floats:
    """Likelihood (K,), 0 to 1, of every point (K, 2) [m] in the frame of a pose (3,)."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    values_at = np.empty(len(points))
    for i in range(len(points)):
        x = pose[0] + c * points[i, 0] - s * points[i, 1]
        y = pose[1] + s * points[i, 0] + c * points[i, 1]
        values_at[i] = interpolate(lattice, x, y)[0]
    return values_at


@kernel_with(inline=True)
def interpolate(lattice: Lattice, x: float, y: float) -> tuple[float, float, float]:
    """Bicubic (Catmull-Rom) value and gradient [1/m] at a point; zero outside the grid."""
    values, origin_x, origin_y, resolution, _ = lattice
    u, v = (x - origin_x) / resolution, (y - origin_y) / resolution
    col, row = math.floor(u), math.floor(v)
    if col < 1 or row < 1 or col + 2 >= values.shape[1] or row + 2 >= values.shape[0]:
        return 0.0, 0.0, 0.0
    value, by_col, by_row = bicubic(values, row, col, u - col, v - row)
    return value, by_col / resolution, by_row / resolution
