# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Occupancy mapping: Bresenham hit and visit counts (paper Remark 1) in a grid that grows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numba import njit
from numpy.typing import NDArray

from slarm_graph.config import MappingConfig
from slarm_graph.errors import BadInput
from slarm_graph.geometry import Floats, wrap_angles
from slarm_graph.grid import GridGeometry, OccupancyGrid
from slarm_graph.readings import LaserScan
from slarm_graph.trajectory import Trajectory

_MARGIN_CELLS = 64
_MAX_SCAN_GAP_S = 1.0


class GridMapper:
    """Counts hits and visits of beams in cells; grows with what it is shown.

    Parameters
    ----------
    config : MappingConfig
    """

    def __init__(self, config: MappingConfig) -> None:
        self._config = config
        self._geometry = GridGeometry(0.0, 0.0, config.resolution_m, 0, 0)
        self._hits: NDArray[np.int32] = np.zeros((0, 0), dtype=np.int32)
        self._visits: NDArray[np.int32] = np.zeros((0, 0), dtype=np.int32)

    def add(self, scan: LaserScan, pose: Floats, pose_rate: Floats | None = None) -> None:
        """Integrate one scan.

        Parameters
        ----------
        scan : LaserScan
        pose : (3,) float64
            `map_from_robot` at the first beam [m, m, rad].
        pose_rate : (3,) float64, optional
            Its rate of change in the map's frame [m/s, m/s, rad/s], to undo the motion that takes
            place within the scan.
        """
        beams = _beams(scan, pose, pose_rate, self._config.max_range_m)
        if not len(beams):
            return
        self._cover(beams)
        g = self._geometry
        _walk(self._hits, self._visits, g.origin_x_m, g.origin_y_m, g.resolution_m, beams)

    def grid(self) -> OccupancyGrid:
        """Return the occupancy of everything seen so far, cropped to it.

        The probability of a cell is the share of its visits that were hits.
        """
        seen_rows = np.flatnonzero(self._visits.any(axis=1))
        seen_cols = np.flatnonzero(self._visits.any(axis=0))
        if not len(seen_rows):
            empty = GridGeometry(0.0, 0.0, self._config.resolution_m, 1, 1)
            return OccupancyGrid(empty, np.full((1, 1), np.nan, dtype=np.float32))
        rows = slice(int(seen_rows[0]), int(seen_rows[-1]) + 1)
        cols = slice(int(seen_cols[0]), int(seen_cols[-1]) + 1)
        g = self._geometry
        cropped = GridGeometry(
            g.origin_x_m + cols.start * g.resolution_m,
            g.origin_y_m + rows.start * g.resolution_m,
            g.resolution_m,
            rows.stop - rows.start,
            cols.stop - cols.start,
        )
        hits, visits = self._hits[rows, cols], self._visits[rows, cols]
        with np.errstate(invalid="ignore", divide="ignore"):
            share = (hits / visits).astype(np.float32)
        at = self._config.occupied_at
        return OccupancyGrid(cropped, share, occupied_at=at, free_at=at)

    def _cover(self, beams: Floats) -> None:
        """Grow the counts so that every beam lies inside."""
        box = _box(beams)
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
            self._grow(*(int(n) + spare if n > 0 else 0 for n in missing))

    def _grow(self, below: int, above: int, left: int, right: int) -> None:
        g = self._geometry
        rows, cols = g.rows + below + above, g.cols + left + right
        if rows * cols > self._config.max_cells:
            raise BadInput(
                f"map would be {cols} x {rows} cells; raise mapping.resolution_m"
                " or mapping.max_cells"
            )
        pad = ((below, above), (left, right))
        self._hits = np.pad(self._hits, pad)
        self._visits = np.pad(self._visits, pad)
        self._geometry = GridGeometry(
            g.origin_x_m - left * g.resolution_m,
            g.origin_y_m - below * g.resolution_m,
            g.resolution_m,
            rows,
            cols,
        )


def render(
    scans: Sequence[LaserScan], trajectory: Trajectory, config: MappingConfig
) -> OccupancyGrid:
    """Render scans at known poses into an occupancy grid.

    Parameters
    ----------
    scans : sequence of N LaserScan
    trajectory : Trajectory of N poses
        `map_from_robot` at each scan's first beam.
    config : MappingConfig
    """
    mapper = GridMapper(config)
    for scan, pose, rate in zip(scans, trajectory.poses, pose_rates(trajectory), strict=True):
        mapper.add(scan, pose, rate)
    return mapper.grid()


def end_points_m(
    scans: Sequence[LaserScan], trajectory: Trajectory, config: MappingConfig
) -> Floats:
    """Return the end points (N, 2) [m] in the map of all returns, motion within scans undone."""
    ends = [
        beams[beams[:, 4] > 0.0, 2:4]
        for beams in (
            _beams(scan, pose, rate, config.max_range_m)
            for scan, pose, rate in zip(
                scans, trajectory.poses, pose_rates(trajectory), strict=True
            )
        )
    ]
    return np.concatenate(ends) if ends else np.zeros((0, 2))


def thinned(points: Floats, at_most: int) -> Floats:
    """Leave points out evenly so that at most so many (N, 2) are left."""
    return points[:: max(1, math.ceil(len(points) / at_most))]


def pose_rates(trajectory: Trajectory) -> Floats:
    """Rate of change (N, 3) [m/s, m/s, rad/s] from each pose to the next, 0 across gaps."""
    rates = np.zeros((len(trajectory), 3))
    if len(trajectory) < 2:
        return rates
    span_s = np.diff(trajectory.stamps_ns) * 1e-9
    step = np.diff(trajectory.poses, axis=0)
    step[:, 2] = wrap_angles(step[:, 2])
    rates[:-1] = np.where((span_s < _MAX_SCAN_GAP_S)[:, None], step / span_s[:, None], 0.0)
    rates[-1] = rates[-2]
    return rates


def _beams(scan: LaserScan, pose: Floats, pose_rate: Floats | None, max_range_m: float) -> Floats:
    """Return usable beams (K, 5): start x, y, end x, y in the map [m], 1 where it is a hit."""
    per_beam = np.zeros(3) if pose_rate is None else pose_rate * scan.time_increment_s
    return np.asarray(
        _trace(
            scan.ranges_m.astype(np.float64),
            scan.angle_min_rad,
            scan.angle_increment_rad,
            scan.range_min_m,
            scan.range_max_m,
            min(max_range_m, scan.range_max_m),
            scan.robot_from_laser.as_array(),
            np.asarray(pose, dtype=np.float64),
            per_beam,
        )
    )


@njit(cache=True, nogil=True)
def _trace(
    ranges: Floats,
    angle_min: float,
    angle_increment: float,
    range_min: float,
    range_max: float,
    usable_range: float,
    robot_from_laser: Floats,
    pose: Floats,
    pose_per_beam: Floats,
) -> Floats:
    """Turn ranges into segments in the map, the robot moving on between the beams."""
    beams = np.empty((len(ranges), 5))
    count = 0
    for i in range(len(ranges)):
        r = ranges[i]
        if math.isnan(r) or r < range_min or (r > range_max and r != math.inf):
            continue
        theta = pose[2] + i * pose_per_beam[2]
        c, s = math.cos(theta), math.sin(theta)
        x = pose[0] + i * pose_per_beam[0] + c * robot_from_laser[0] - s * robot_from_laser[1]
        y = pose[1] + i * pose_per_beam[1] + s * robot_from_laser[0] + c * robot_from_laser[1]
        direction = theta + robot_from_laser[2] + angle_min + i * angle_increment
        length = min(r, usable_range)
        beams[count, 0] = x
        beams[count, 1] = y
        beams[count, 2] = x + length * math.cos(direction)
        beams[count, 3] = y + length * math.sin(direction)
        beams[count, 4] = 1.0 if r <= usable_range else 0.0
        count += 1
    return beams[:count]


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True, inline="always")
def next_on_line(col: int, row: int, error: int, across: int, up: int) -> tuple[int, int, int]:
    """Step to the next cell of Bresenham's line, and its error.

    `across` and `up` are the cells from the line's start to its end; the first error is the sum of
    |across| and -|up|.
    """
    twice = 2 * error
    d_col, d_row = abs(across), -abs(up)
    if twice >= d_row:
        error += d_row
        col += 1 if across > 0 else -1
    if twice <= d_col:
        error += d_col
        row += 1 if up > 0 else -1
    return col, row, error


@njit(cache=True, nogil=True)
def _walk(
    hits: NDArray[np.int32],
    visits: NDArray[np.int32],
    origin_x: float,
    origin_y: float,
    resolution: float,
    beams: Floats,
) -> None:
    """Walk every beam with Bresenham's line; its last cell is a hit where something returned."""
    for b in range(len(beams)):
        col = math.floor((beams[b, 0] - origin_x) / resolution)
        row = math.floor((beams[b, 1] - origin_y) / resolution)
        end_col = math.floor((beams[b, 2] - origin_x) / resolution)
        end_row = math.floor((beams[b, 3] - origin_y) / resolution)
        error = abs(end_col - col) - abs(end_row - row)
        start_col, start_row = col, row
        while True:
            visits[row, col] += 1
            if row == end_row and col == end_col:
                break
            col, row, error = next_on_line(
                col, row, error, end_col - start_col, end_row - start_row
            )
        if beams[b, 4] > 0.0:
            hits[row, col] += 1
