# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Alignment of two occupancy grids: search over all rotations and shifts, then refinement."""

from __future__ import annotations

import math

import numpy as np
import scipy

from slarm_graph.errors import BadInput
from slarm_graph.eval.map_accuracy import distance_to_m
from slarm_graph.geometry import Floats, Pose2, transform_points
from slarm_graph.grid import GridGeometry, OccupancyGrid

_COARSE_CELL_M = 0.2
"""Cell of the correlation that finds the start: less than half of the 0.5 m within which a wall
attracts in the refinement."""
_COARSE_STEP_RAD = math.radians(3.0)
"""Ends of a map of 30 m lie 0.8 m off at half this step, which the correlation's blur tolerates."""
_FAR_M = 0.5
"""Distances are truncated here, so that walls of only one map do not attract, as in robust ICP."""
_MAX_POINTS = 4000
"""Most wall points that are aligned: three unknowns, and the fit's error falls with the root of
their number, 1 mm at cells of 0.05 m."""


def align_maps(reference: OccupancyGrid, estimate: OccupancyGrid) -> Pose2:
    """Return `reference_from_estimate` [m, m, rad], the motion that aligns the walls.

    Raises
    ------
    BadInput
        When one of the maps has no wall.
    """
    target, source = _walls_m(reference), _walls_m(estimate)
    if not len(target) or not len(source):
        raise BadInput("maps without occupied cells cannot be aligned")
    return _refine(reference, _thin(source), _search(target, source))


def _walls_m(grid: OccupancyGrid) -> Floats:
    return grid.geometry.center_of(np.argwhere(grid.occupied))


def _thin(points_m: Floats) -> Floats:
    return points_m[:: max(1, len(points_m) // _MAX_POINTS)]


def _search(target: Floats, source: Floats) -> Pose2:
    """Try every rotation; the best shift of each is the peak of a cross-correlation."""
    middle = source.mean(axis=0)
    reach = float(np.linalg.norm(source - middle, axis=1).max()) + _COARSE_CELL_M
    window = GridGeometry.covering(-reach, reach, -reach, reach, _COARSE_CELL_M)
    low, high = target.min(axis=0), target.max(axis=0)
    frame = GridGeometry.covering(low[0], high[0] + 1e-6, low[1], high[1] + 1e-6, _COARSE_CELL_M)
    image = _raster(target, frame)
    best, found = -np.inf, Pose2()
    for theta in np.arange(0.0, 2.0 * math.pi, _COARSE_STEP_RAD):
        turned = transform_points(np.array([0.0, 0.0, theta]), source - middle)
        match = scipy.signal.fftconvolve(image, _raster(turned, window)[::-1, ::-1], mode="full")
        row, col = np.unravel_index(int(match.argmax()), match.shape)
        if match[row, col] > best:
            best = float(match[row, col])
            # In full mode, index (window.rows - 1, window.cols - 1) is the shift by no cell.
            shift = np.array([col - window.cols + 1, row - window.rows + 1]) * _COARSE_CELL_M
            shift += np.array(
                [frame.origin_x_m - window.origin_x_m, frame.origin_y_m - window.origin_y_m]
            )
            found = Pose2(float(shift[0]), float(shift[1]), float(theta)) @ Pose2(
                -middle[0], -middle[1], 0.0
            )
    return found


def _raster(points_m: Floats, geometry: GridGeometry) -> Floats:
    image = np.zeros(geometry.shape)
    cells = geometry.cell_of(points_m)
    cells = cells[geometry.contains(cells)]
    image[cells[:, 0], cells[:, 1]] = 1.0
    return image


def _refine(reference: OccupancyGrid, source: Floats, start: Pose2) -> Pose2:
    """Minimise the distances of the source's wall points to the reference's walls."""
    geometry = reference.geometry
    field = np.minimum(distance_to_m(reference.occupied, geometry.resolution_m), _FAR_M)

    def distances(pose: Floats) -> Floats:
        """Distance (N,) of every source wall point from the reference's walls [m]."""
        return _bilinear(field, geometry, transform_points(pose, source))

    fit = scipy.optimize.least_squares(
        distances, start.as_array(), loss="soft_l1", f_scale=0.1, diff_step=1e-4
    )
    return Pose2.from_array(fit.x)


def _bilinear(field: Floats, geometry: GridGeometry, points_m: Floats) -> Floats:
    """Interpolate bilinearly between cell centres; outside, the truncation distance."""
    origin_m = np.array([geometry.origin_x_m, geometry.origin_y_m])
    cols_rows = (points_m - origin_m) / geometry.resolution_m - 0.5
    return np.asarray(scipy.ndimage.map_coordinates(field, cols_rows.T[::-1], order=1, cval=_FAR_M))
