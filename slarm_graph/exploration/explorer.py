# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The seam of exploration: coverage so far and a pose in, the next leg to drive out."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from slarm_graph.exploration.planning import (
    Moves,
    moves_across,
    moves_within,
    nearest_passable,
    path_to_nearest,
    reachable,
    sees,
    shortcut,
    shortest_path,
)
from slarm_graph.geometry import Floats, Pose2
from slarm_graph.grid import Cells, GridGeometry, Mask

OPEN: Final = 0
VISITED: Final = 1
BLOCKED: Final = 2
"""Twice the paper's grid values 0, 0.5 and 1."""

Codes = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class DrivingGrid:
    """Where the robot's centre may be; at most 0.05 m fine whatever the coverage cells are.

    Parameters
    ----------
    geometry : GridGeometry
    passable : (rows, cols) bool
        Far enough from everything known to be in the way; unknown cells count as passable.
    moves : (rows, cols) uint8
        Open steps between passable cells, as in `slarm_graph.exploration.planning`.
    occupied : (rows, cols) bool
        Obstacles so far, not inflated.
    observed : (rows, cols) bool
        Seen free by the laser.
    swept : (rows, cols) bool
        The robot's disc has passed over the cell's centre.
    """

    geometry: GridGeometry
    passable: Mask
    moves: Moves
    occupied: Mask
    observed: Mask
    swept: Mask


@dataclass(frozen=True, slots=True)
class CoverageGrid:
    """The paper's grid: which cells are still to be visited.

    Parameters
    ----------
    geometry : GridGeometry
    codes : (rows, cols) uint8
        OPEN, VISITED or BLOCKED. A cell is blocked only when the robot's centre fits nowhere in
        it, so coarse cells never close a passage.
    moves : (rows, cols) uint8
        Open steps between neighbouring cells.
    driving : DrivingGrid
        The same area, an integer number of times finer.
    """

    geometry: GridGeometry
    codes: Codes
    moves: Moves
    driving: DrivingGrid

    @property
    def values(self) -> NDArray[np.float32]:
        """The paper's values (rows, cols): 0 to be visited, 0.5 visited, 1 blocked."""
        return np.asarray(0.5 * self.codes, dtype=np.float32)

    @property
    def fineness(self) -> int:
        """Driving cells along the side of a coverage cell."""
        return self.driving.geometry.rows // self.geometry.rows


@dataclass(frozen=True, slots=True)
class Leg:
    """A way to drive.

    Parameters
    ----------
    points_m : (K, 2) float64
        Corners of the way in the map, beginning at the robot [m].
    more : bool
        Whether the explorer already knows that it will go on from the end.
    review_s : float
        Ask again after this time of driving, for the map will have changed [s].
    """

    points_m: Floats
    more: bool = True
    review_s: float = math.inf


@dataclass(frozen=True, slots=True)
class Finished:
    """Why exploration ended, and what stayed out of reach.

    Parameters
    ----------
    reason : str
    unreachable_cells : int
        Coverage cells that were never ruled out but have no way to them.
    """

    reason: str
    unreachable_cells: int = 0


class Explorer(Protocol):
    """Decides where to drive next."""

    def next_goal(self, coverage: CoverageGrid, pose: Pose2) -> Leg | Finished:
        """Return the next way to drive from the pose, or that nothing is left to do.

        Parameters
        ----------
        coverage : CoverageGrid
            The map so far. It may differ from that of the last call in any way.
        pose : Pose2
            `map_from_robot` where the leg is to begin.
        """
        ...


def driving_grid(
    geometry: GridGeometry, passable: Mask, occupied: Mask, observed: Mask, swept: Mask
) -> DrivingGrid:
    """Complete a driving grid by its open steps."""
    return DrivingGrid(geometry, passable, moves_within(passable), occupied, observed, swept)


def coverage_grid(
    geometry: GridGeometry, driving: DrivingGrid, visited: Mask, allowed: Mask | None = None
) -> CoverageGrid:
    """Gather a driving grid into coverage cells.

    Parameters
    ----------
    geometry : GridGeometry
    driving : DrivingGrid
        On a lattice whose cells divide those of `geometry`.
    visited : (rows, cols) bool
    allowed : (rows, cols) bool, optional
        Cells outside are blocked.
    """
    fine = driving.geometry.rows // geometry.rows
    enterable = np.asarray(in_blocks(driving.passable, fine).any(axis=(2, 3)))
    if allowed is not None:
        enterable &= allowed
    codes = np.where(enterable, np.where(visited, VISITED, OPEN), BLOCKED).astype(np.uint8)
    return CoverageGrid(geometry, codes, _coarse_moves(driving, enterable, fine), driving)


def known_coverage(free: Mask, resolution_m: float = 1.0) -> CoverageGrid:
    """Coverage of a fully known place where the robot fits into every free cell."""
    rows, cols = free.shape
    geometry = GridGeometry(0.0, 0.0, resolution_m, rows, cols)
    nothing = np.zeros(free.shape, dtype=np.bool_)
    driving = driving_grid(geometry, free, ~free, free, nothing)
    return coverage_grid(geometry, driving, nothing)


def in_blocks(layer: NDArray[np.bool_], fine: int) -> Mask:
    """View a fine layer as (rows, cols, fine, fine) blocks."""
    rows, cols = layer.shape[0] // fine, layer.shape[1] // fine
    return layer.reshape(rows, fine, cols, fine).swapaxes(1, 2)


def start_cell(coverage: CoverageGrid, pose: Pose2) -> tuple[int, int] | None:
    """Return the coverage cell that a robot at a pose is in.

    Where its centre is not passable, the nearest passable spot decides: a neighbouring cell may
    lie inside an obstacle, of whose inside nothing is known.
    """
    spot = driving_cell(coverage.driving, pose.x, pose.y)
    if spot is None:
        return None
    cell = spot[0] // coverage.fineness, spot[1] // coverage.fineness
    return nearest_passable(coverage.codes != BLOCKED, cell)


def driving_cell(driving: DrivingGrid, x_m: float, y_m: float) -> tuple[int, int] | None:
    """Return the driving cell of a point, or the nearest passable one."""
    row, col = driving.geometry.cell_of([x_m, y_m])
    return nearest_passable(driving.passable, (int(row), int(col)))


def unreachable_cells(coverage: CoverageGrid, start: tuple[int, int]) -> int:
    """Count open cells that have no way to them from the start."""
    return int(np.sum((coverage.codes == OPEN) & ~reachable(coverage.moves, start)))


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
    """Turn coverage cells into a drivable way, around what lies between their anchors."""
    points = np.concatenate([[[pose.x, pose.y]], anchors_m(coverage, cells)])
    pieces = [points[:1]]
    for begin, end in pairwise(points):
        piece = way_between(coverage.driving, begin, end)
        if piece is None:
            more = True
            break
        pieces.append(piece[1:])
    return Leg(without_straight_points(np.concatenate(pieces)), more)


def way_between(driving: DrivingGrid, begin_m: Floats, end_m: Floats) -> Floats | None:
    """Shortest way (K, 2) [m] between two points, pulled straight; None where there is none.

    A begin that lies in the expansion of an obstacle is left by the shortest way.
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


def way_to_nearest(driving: DrivingGrid, begin_m: Floats, wanted: Mask) -> Floats | None:
    """Shortest way (K, 2) [m] to any wanted driving cell; None where there is none."""
    start = driving_cell(driving, begin_m[0], begin_m[1])
    if start is None:
        return None
    cells = path_to_nearest(driving.moves, wanted, start)
    return None if cells is None else drivable(driving, begin_m, cells)


def drivable(driving: DrivingGrid, begin_m: Floats, cells: Cells) -> Floats:
    """Pull a path over driving cells straight, beginning at the robot."""
    points = cells[:, ::-1].astype(np.float64) + 0.5
    g = driving.geometry
    pulled = shortcut(driving.passable, points) * g.resolution_m + (g.origin_x_m, g.origin_y_m)
    return np.concatenate([begin_m[None], pulled])


def without_straight_points(points_m: Floats, tolerance_m: float = 1e-6) -> Floats:
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


def _coarse_moves(driving: DrivingGrid, enterable: Mask, fine: int) -> Moves:
    if fine == 1:
        return moves_within(enterable)
    p = driving.passable
    east = (p[:, fine - 1 : -1 : fine] & p[:, fine::fine]).reshape(-1, fine, enterable.shape[1] - 1)
    north = (p[fine - 1 : -1 : fine] & p[fine::fine]).reshape(
        enterable.shape[0] - 1, enterable.shape[1], fine
    )
    joined_east = east.any(axis=1) & enterable[:, :-1] & enterable[:, 1:]
    joined_north = north.any(axis=2) & enterable[:-1] & enterable[1:]
    return moves_across(joined_east, joined_north)
