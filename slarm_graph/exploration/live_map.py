# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The map for driving: occupancy, clearance of the robot's body, and coverage so far."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from slarm_graph.config import ExploreConfig, MappingConfig
from slarm_graph.exploration.coverage_grid import CoverageGrid, coverage_grid, driving_grid
from slarm_graph.exploration.moves import clearance_m
from slarm_graph.geometry import Floats, Pose2
from slarm_graph.grid import GridGeometry, Mask
from slarm_graph.mapping import GridMapper, Rendering
from slarm_graph.polygons import contains
from slarm_graph.raster.discs import mark_discs
from slarm_graph.readings import LaserScan
from slarm_graph.trajectory import Trajectory

_EXPLAINED_CELLS: Final = 2
"""Scan points within two cells of a mapped obstacle belong to it, given the noise of laser and
pose."""
_HEARD_EVERY_M: Final = 0.12
"""Spacing of signal readings expected on the path ahead: at 0.6 m/s and 5 readings a second, a
usual rate of Wi-Fi and Bluetooth."""
_MAX_DRIVING_CELLS: Final = 1_500_000
"""Above so many, driving cells are 0.05 m: planning processes all of them after every scan, and
finer cells than the map's own would add nothing for a large place."""


class LiveMap:
    """Occupancy and coverage on driving cells inside the rough boundary.

    Parameters
    ----------
    extent_m : (x_min, x_max, y_min, y_max)
        The rough boundary [m].
    config : ExploreConfig
    mapping : MappingConfig
        All but the resolution applies.
    """

    def __init__(
        self,
        extent_m: tuple[float, float, float, float],
        config: ExploreConfig,
        mapping: MappingConfig | None = None,
    ) -> None:
        self.config = config
        self.geometry = GridGeometry.covering(*extent_m, config.resolution_m)
        self.driving_geometry = _divided(self.geometry, config.driving.grid_m)
        self._extent_m = extent_m
        self._rmse_m = config.slam_rmse_m or 0.0
        self._forbidden = _forbidden(self.driving_geometry, extent_m, config, self._rmse_m)
        self._scan_points = np.empty((0, 2))
        self.heard_m: Floats = np.empty((0, 2))
        self._rendering = Rendering(GridMapper(mapping or MappingConfig(), self.driving_geometry))
        self._forget_covered()

    @property
    def occupied(self) -> Mask:
        """Driving cells held to be occupied."""
        return self._rendering.mapper.occupied()

    @property
    def free(self) -> Mask:
        """Driving cells held to be free."""
        return self._rendering.mapper.free()

    def add(self, scan: LaserScan, pose: Pose2, pose_rate: Floats | None = None) -> None:
        """Integrate one scan from a pose `map_from_robot` that changes at a rate (3,)."""
        rate = np.zeros(3) if pose_rate is None else pose_rate
        self._rendering.add(scan, pose.as_array(), rate)

    def follow(self, scans: Sequence[LaserScan], trajectory: Trajectory, every: int = 1) -> None:
        """Update map and coverage to a corrected trajectory, as `Rendering.follow`."""
        self._rendering.follow(scans, trajectory, every)
        self._forget_covered()
        self.pass_over(trajectory.poses[:, :2])

    def _forget_covered(self) -> None:
        self.swept = np.zeros(self.driving_geometry.shape, dtype=np.bool_)
        self.visited = np.zeros(self.geometry.shape, dtype=np.bool_)

    def stand_by(self, scan: LaserScan, pose: Pose2) -> None:
        """Treat the points of the present scan as obstacles, whatever the map says."""
        self._scan_points = pose.transform(scan.points_m())

    def pass_over(self, points_m: Floats) -> None:
        """Mark what the robot's centre and its disc cover along points (N, 2) [m]."""
        self._mark(points_m, self.visited, self.swept)

    def coverage(self, ahead_m: Floats | None = None, *, tight: bool = False) -> CoverageGrid:
        """Return the paper's grid for the map so far.

        Parameters
        ----------
        ahead_m : (K, 2) float64, optional
            A path that is about to be driven and counts as driven [m].
        tight : bool
            Whether to drop the safety margin, for a gap that the body just fits through.
        """
        g = self.driving_geometry
        visited, swept = self.visited.copy(), self.swept.copy()
        if ahead_m is not None:
            self._mark(ahead_m, visited, swept)
        everywhere = (slice(0, g.rows), slice(0, g.cols))
        needed_m = self._least_m() if tight else self._needed_m()
        passable = self._clearance_m(everywhere) >= needed_m
        grid = driving_grid(g, passable, self.occupied, self.free, swept)
        heard_m = self.heard_m
        if ahead_m is not None and len(heard_m):
            heard_m = np.concatenate([heard_m, _densified(ahead_m, _HEARD_EVERY_M)])
        return replace(coverage_grid(self.geometry, grid, visited), heard_m=heard_m)

    def is_clear(self, path_m: Floats) -> bool:
        """Whether the body still fits along a path (K, 2) [m] near the robot.

        This needs less clearance than planning does, so that a wall that comes nearer by a cell
        does not invalidate a path along it.
        """
        g = self.driving_geometry
        spots = g.cell_of(_densified(path_m, g.resolution_m))
        spots = spots[g.contains(spots)]
        if not len(spots):
            return True
        reach = math.ceil(self._least_m() / g.resolution_m) + _EXPLAINED_CELLS + 1
        low = np.maximum(spots.min(axis=0) - reach, 0)
        high = spots.max(axis=0) + reach + 1
        window = (slice(int(low[0]), int(high[0])), slice(int(low[1]), int(high[1])))
        clearance = self._clearance_m(window)[spots[:, 0] - low[0], spots[:, 1] - low[1]]
        return bool(clearance.min() >= self._least_m())

    def shrink_by(self, rmse_m: float) -> None:
        """Shrink the rough boundary by the position error, half of it on each side [m]."""
        if rmse_m != self._rmse_m:
            self._rmse_m = rmse_m
            self._forbidden = _forbidden(self.driving_geometry, self._extent_m, self.config, rmse_m)

    def _least_m(self) -> float:
        """Least clearance between the robot's centre and the centre of an occupied cell [m]."""
        return self.config.driving.robot_radius_m + 0.5 * self.driving_geometry.resolution_m

    def _needed_m(self) -> float:
        """Least clearance plus the safety margin of planning [m]."""
        return self._least_m() + self.config.driving.margin_m

    def _clearance_m(self, window: tuple[slice, slice]) -> NDArray[np.float32]:
        in_the_way = self._rendering.mapper.occupied(window) | self._forbidden[window]
        # Points beside a mapped obstacle are noise of it; others are new obstacles.
        around = np.ones((2 * _EXPLAINED_CELLS + 1,) * 2, dtype=np.uint8)
        explained = cv2.dilate(in_the_way.astype(np.uint8), around) > 0
        near = self.driving_geometry.cell_of(self._scan_points)
        near = near - np.array([window[0].start, window[1].start])
        rows, cols = in_the_way.shape
        inside = (near >= 0).all(axis=1) & (near[:, 0] < rows) & (near[:, 1] < cols)
        near = near[inside]
        near = near[~explained[near[:, 0], near[:, 1]]]
        in_the_way[near[:, 0], near[:, 1]] = True
        return clearance_m(in_the_way, self.driving_geometry.resolution_m)

    def _mark(self, points_m: Floats, visited: Mask, swept: Mask) -> None:
        g = self.driving_geometry
        path = _densified(points_m, 0.5 * g.resolution_m)
        cells = self.geometry.cell_of(path)
        inside = self.geometry.contains(cells)
        visited[cells[inside, 0], cells[inside, 1]] = True
        corner = np.array([g.origin_x_m, g.origin_y_m])
        radius = self.config.driving.robot_radius_m / g.resolution_m
        mark_swept(swept, (points_m - corner) / g.resolution_m, radius)

    def observed(self) -> Mask:
        """Coverage cells (rows, cols) whose centre has been seen free."""
        centers = self.geometry.centers()
        return self.driving_geometry.sample(self.free, centers, False)

    def footprint(self) -> Mask:
        """Coverage cells (rows, cols) over whose centre the robot's disc has passed."""
        centers = self.geometry.centers()
        return np.asarray(self.driving_geometry.sample(self.swept, centers, 0.0))


def mark_swept(swept: Mask, path: Floats, radius: float) -> None:
    """Mark the cells (rows, cols) over whose centre a disc passes along points (N, 2) [cells]."""
    mark_discs(swept, _densified(path, 0.5), radius)


def _divided(geometry: GridGeometry, limit_m: float) -> GridGeometry:
    """Divide cells until they are at most `limit_m` wide, or 0.05 m where that would be many."""
    fine = max(1, math.ceil(round(geometry.resolution_m / limit_m, 6)))
    coarse = max(1, math.ceil(round(geometry.resolution_m / 0.05, 6)))
    if geometry.rows * geometry.cols * fine * fine > _MAX_DRIVING_CELLS:
        fine = coarse
    return geometry.divided(fine)


def _forbidden(
    geometry: GridGeometry,
    extent_m: tuple[float, float, float, float],
    config: ExploreConfig,
    rmse_m: float,
) -> Mask:
    """Driving cells (rows, cols) that the user or the shrunk rough boundary rules out."""
    centers = geometry.centers()
    x, y = centers[..., 0], centers[..., 1]
    shrink_m = 0.5 * rmse_m
    limits = [(extent_m, shrink_m)] + ([(config.area, 0.0)] if config.area else [])
    out = np.zeros(geometry.shape, dtype=np.bool_)
    for (x_min, x_max, y_min, y_max), inset in limits:
        out |= (x < x_min + inset) | (x > x_max - inset) | (y < y_min + inset) | (y > y_max - inset)
    for corners in config.keep_out:
        out |= contains(np.array(corners, dtype=np.float64), centers)
    return out


def _densified(points: Floats, step_m: float) -> Floats:
    """Resample a polyline (N, 2) to points (M, 2) at most `step_m` apart."""
    if len(points) < 2:
        return points
    pieces = np.maximum(1, np.ceil(np.hypot(*np.diff(points, axis=0).T) / step_m)).astype(np.int64)
    knots = np.concatenate([[0], np.cumsum(pieces)])
    at = np.arange(knots[-1] + 1)
    return np.stack([np.interp(at, knots, points[:, k]) for k in (0, 1)], axis=-1)
