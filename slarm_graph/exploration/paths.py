# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Shortest paths around known obstacles, shortcut by visibility (string pulling)."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from slarm_graph.exploration.coverage_grid import (
    CoverageGrid,
    DrivingGrid,
    driving_cell,
    in_blocks,
)
from slarm_graph.exploration.explorer import Leg
from slarm_graph.exploration.searches import path_to_nearest, shortest_path
from slarm_graph.exploration.visibility import sees, shortcut
from slarm_graph.geometry import Floats, Pose2
from slarm_graph.grid import Cells, Mask


def anchors_m(coverage: CoverageGrid, cells: Cells) -> Floats:
    """Points (M, 2) [m] where the robot enters cells (M, 2): the passable spot nearest the centre.

    Cells with no passable spot keep their centre.
    """
    fine = coverage.fineness
    if fine == 1:
        return coverage.geometry.center_of(cells)
    blocks = in_blocks(coverage.driving.passable, fine)[cells[:, 0], cells[:, 1]]
    offset = np.arange(fine) - 0.5 * (fine - 1)
    from_center = np.hypot(offset[:, None], offset[None, :])
    best = np.where(blocks, from_center, np.inf).reshape(len(cells), -1).argmin(axis=1)
    spot = np.stack(np.divmod(best, fine), axis=-1)
    return coverage.driving.geometry.center_of(cells * fine + spot)


def leg_along(coverage: CoverageGrid, pose: Pose2, cells: Cells, *, more: bool) -> Leg:
    """Turn coverage cells into a drivable path, around obstacles between their anchors."""
    points = np.concatenate([[[pose.x, pose.y]], anchors_m(coverage, cells)])
    pieces = [points[:1]]
    for begin, end in pairwise(points):
        piece = path_between(coverage.driving, begin, end)
        if piece is None:
            more = True
            break
        pieces.append(piece[1:])
    return Leg(without_collinear_points(np.concatenate(pieces)), more)


def path_between(driving: DrivingGrid, begin_m: Floats, end_m: Floats) -> Floats | None:
    """Shortest path (K, 2) [m] between two points, shortcut; None where there is none.

    From a start within the expansion of an obstacle it leads out by the shortest path.
    """
    g = driving.geometry
    ends = (np.stack([begin_m, end_m]) - (g.origin_x_m, g.origin_y_m)) / g.resolution_m
    if sees(driving.passable, ends[0], ends[1]):
        return np.stack([begin_m, end_m])
    start = driving_cell(driving, begin_m[0], begin_m[1])
    goal = driving_cell(driving, end_m[0], end_m[1])
    if start is None or goal is None:
        return None
    cells = shortest_path(driving.moves, start, goal)
    return None if cells is None else drivable(driving, begin_m, cells)


def path_to_wanted(driving: DrivingGrid, begin_m: Floats, wanted: Mask) -> Floats | None:
    """Shortest path (K, 2) [m] to any wanted driving cell; None where there is none."""
    start = driving_cell(driving, begin_m[0], begin_m[1])
    if start is None:
        return None
    cells = path_to_nearest(driving.moves, wanted, start)
    return None if cells is None else drivable(driving, begin_m, cells)


def drivable(driving: DrivingGrid, begin_m: Floats, cells: Cells) -> Floats:
    """Shortcut a path over driving cells, beginning at the robot.

    The centre of the robot's own cell, which may lie behind it, is skipped.
    """
    g = driving.geometry
    corner_m = np.array([g.origin_x_m, g.origin_y_m])
    points = cells[:, ::-1].astype(np.float64) + 0.5
    begin = (begin_m - corner_m) / g.resolution_m
    is_inside = len(cells) > 1 and bool((np.floor(begin) == cells[0, ::-1]).all())
    path = np.concatenate([begin[None], points[1:] if is_inside else points])
    return np.asarray(shortcut(driving.passable, path) * g.resolution_m + corner_m)


def without_collinear_points(points_m: Floats, tolerance_m: float = 1e-6) -> Floats:
    """Drop repeated points and those that lie on the straight line between their neighbours."""
    keep = np.ones(len(points_m), dtype=np.bool_)
    keep[1:] = np.hypot(*np.diff(points_m, axis=0).T) > tolerance_m
    points = points_m[keep]
    if len(points) < 3:
        return points
    before, after = np.diff(points[:-1], axis=0), np.diff(points[1:], axis=0)
    cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    length = np.hypot(*before.T) * np.hypot(*after.T)
    ahead = (before * after).sum(axis=1) > 0
    straight = ahead & (np.abs(cross) <= tolerance_m * np.maximum(length, tolerance_m))
    return np.asarray(points[np.concatenate([[True], ~straight, [True]])])
