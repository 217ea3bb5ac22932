# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Line segments in a uniform grid: exact ray casting and clearance of a disc."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from slarm_graph.geometry import Floats
from slarm_graph.kernels import kernel
from slarm_graph.raster.lines import first_crossing
from slarm_graph.raster.segments import cells_passed

# A ray through the common end of two segments must not slip between them.
_TOLERANCE: Final = 1e-9
_PAD_M: Final = 1e-6
"""A micrometre: far above rounding and far below what a laser resolves, so that no hit falls
between cells."""
_MAX_CELLS: Final = 4_000_000
"""32 MB of starts; half or double of it changes the time of a scan, never a range."""


class SegmentGrid(NamedTuple):
    """Segments sorted into the cells they pass; compiled code takes it as it is.

    Parameters
    ----------
    segments : (S, 4) float64
        Start x, y and the vector to the end x, y [m].
    frame : (3,) float64
        Lower-left corner x, y and side of a cell [m].
    shape : (2,) int64
        Rows (y) and columns (x).
    starts : (rows * cols + 1,) int64
        Where each cell's entries begin in `members`.
    members : (M,) int32
        Indices of segments, cell by cell.
    """

    segments: Floats
    frame: Floats
    shape: NDArray[np.int64]
    starts: NDArray[np.int64]
    members: NDArray[np.int32]


def build_segment_grid(ends_m: Floats) -> SegmentGrid:
    """Sort segments into a grid of about as many cells as there are segments times eight.

    Parameters
    ----------
    ends_m : (S, 4) float64
        Start x, y and end x, y of every segment [m]; S >= 1.
    """
    ends = np.ascontiguousarray(ends_m, dtype=np.float64).reshape(-1, 4)
    low = ends.reshape(-1, 2).min(axis=0) - 2 * _PAD_M
    high = ends.reshape(-1, 2).max(axis=0) + 2 * _PAD_M
    width, height = (float(v) for v in high - low)
    cells = min(_MAX_CELLS, 8 * len(ends) + 64)
    side = max(math.sqrt(width * height / cells), max(width, height) / cells)
    shape = np.array([math.floor(height / side) + 1, math.floor(width / side) + 1], dtype=np.int64)
    segments = np.concatenate([ends[:, :2], ends[:, 2:] - ends[:, :2]], axis=1)
    frame = np.array([low[0], low[1], side])
    cells = (ends - np.tile(low, 2)) / side
    members, passed = cells_passed(cells, (int(shape[0]), int(shape[1])), _PAD_M / side)
    counts = np.bincount(passed, minlength=int(shape[0] * shape[1]))
    starts = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    members = members[np.argsort(passed, kind="stable")]
    return SegmentGrid(segments, frame, shape, starts, members)


def cast_rays(
    grid: SegmentGrid, world_from_laser: Floats, directions: Floats, max_range_m: float
) -> Floats:
    """Return the exact distance along every ray to the nearest segment, (B,) [m].

    Parameters
    ----------
    grid : SegmentGrid
    world_from_laser : (1, 3) or (B, 3) float64
        One pose for all rays, or a pose for each [m, m, rad].
    directions : (B, 2) float64
        Unit vectors in the laser's frame.
    max_range_m : float
        Rays that meet nothing up to here return +inf.
    """
    return np.asarray(_cast(grid, world_from_laser, directions, max_range_m))


def is_near(grid: SegmentGrid, x_m: float, y_m: float, radius_m: float) -> bool:
    """Whether any segment comes closer than `radius_m` to a point [m]."""
    return bool(_near(grid, x_m, y_m, radius_m))


@kernel
def _cast(grid: SegmentGrid, poses: Floats, directions: Floats, max_range: float) -> Floats:
    """Walk every ray through the grid (Amanatides and Woo 1987), testing what each cell holds."""
    ranges = np.empty(len(directions))
    x, y = poses[0, 0], poses[0, 1]
    c, s = math.cos(poses[0, 2]), math.sin(poses[0, 2])
    for i in range(len(directions)):
        if len(poses) > 1:
            x, y = poses[i, 0], poses[i, 1]
            c, s = math.cos(poses[i, 2]), math.sin(poses[i, 2])
        dx = c * directions[i, 0] - s * directions[i, 1]
        dy = s * directions[i, 0] + c * directions[i, 1]
        ranges[i] = _cast_one(grid, x, y, dx, dy, max_range)
    return ranges


@kernel
def _cast_one(
    grid: SegmentGrid, x: float, y: float, dx: float, dy: float, max_range: float
) -> float:
    """Distance along one ray, +inf when nothing is met within `max_range`."""
    segments, frame, shape, starts, members = grid
    side = frame[2]
    rows, cols = shape[0], shape[1]
    col, step_col, next_x, delta_x = first_crossing((x - frame[0]) / side, dx / side)
    row, step_row, next_y, delta_y = first_crossing((y - frame[1]) / side, dy / side)
    best = math.inf
    while 0 <= col < cols and 0 <= row < rows:
        cell = row * cols + col
        for k in range(starts[cell], starts[cell + 1]):
            m = members[k]
            px, py = segments[m, 0] - x, segments[m, 1] - y
            ex, ey = segments[m, 2], segments[m, 3]
            cross = dx * ey - dy * ex
            if cross == 0.0:
                continue
            inverse = 1.0 / cross
            t = (px * ey - py * ex) * inverse
            if t < 0.0 or t >= best:
                continue
            along = (px * dy - py * dx) * inverse
            if -_TOLERANCE <= along <= 1.0 + _TOLERANCE:
                best = t
        leave = min(next_x, next_y)
        if best <= leave or leave > max_range:
            break
        if next_x < next_y:
            next_x += delta_x
            col += step_col
        else:
            next_y += delta_y
            row += step_row
    return best if best <= max_range else math.inf


@kernel
def _near(grid: SegmentGrid, x: float, y: float, radius: float) -> bool:
    """Whether any segment comes closer than `radius` to (x, y)."""
    segments, frame, shape, starts, members = grid
    side = frame[2]
    first_col = max(0, math.floor((x - radius - frame[0]) / side))
    last_col = min(shape[1] - 1, math.floor((x + radius - frame[0]) / side))
    first_row = max(0, math.floor((y - radius - frame[1]) / side))
    last_row = min(shape[0] - 1, math.floor((y + radius - frame[1]) / side))
    for row in range(first_row, last_row + 1):
        for col in range(first_col, last_col + 1):
            cell = row * shape[1] + col
            for k in range(starts[cell], starts[cell + 1]):
                m = members[k]
                ex, ey = segments[m, 2], segments[m, 3]
                px, py = x - segments[m, 0], y - segments[m, 1]
                length2 = ex * ex + ey * ey
                share = 0.0
                if length2 > 0.0:
                    share = min(1.0, max(0.0, (px * ex + py * ey) / length2))
                qx, qy = px - share * ex, py - share * ey
                if qx * qx + qy * qy < radius * radius:
                    return True
    return False
