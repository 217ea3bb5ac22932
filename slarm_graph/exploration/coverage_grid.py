# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The paper's grid of cells to visit, and the finer grid of the robot's configuration space."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from slarm_graph.exploration.moves import Moves, moves_across, moves_within, nearest_passable
from slarm_graph.geometry import Floats, Pose2
from slarm_graph.grid import GridGeometry, Mask

OPEN: Final = 0
"""Code of a cell to be visited: twice the paper's grid value 0."""
VISITED: Final = 1
"""Code of a visited cell: twice the paper's grid value 0.5."""
BLOCKED: Final = 2
"""Code of a blocked cell: twice the paper's grid value 1."""

Codes = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class DrivingGrid:
    """Configuration space of the robot's centre, on cells of at most 0.05 m.

    Parameters
    ----------
    geometry : GridGeometry
    passable : (rows, cols) bool
        Far enough from all known obstacles; unknown cells count as passable.
    moves : (rows, cols) uint8
        Open steps between passable cells, as in `slarm_graph.exploration.moves`.
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
    heard_m : (N, 2) float64
        Positions at which signal strength was received [m].
    """

    geometry: GridGeometry
    codes: Codes
    moves: Moves
    driving: DrivingGrid
    heard_m: Floats = field(default_factory=lambda: np.empty((0, 2)))

    @property
    def values(self) -> NDArray[np.float32]:
        """The paper's values (rows, cols): 0 to be visited, 0.5 visited, 1 blocked."""
        return np.asarray(0.5 * self.codes, dtype=np.float32)

    @property
    def fineness(self) -> int:
        """Driving cells along the side of a coverage cell."""
        return self.driving.geometry.rows // self.geometry.rows


def driving_grid(
    geometry: GridGeometry, passable: Mask, occupied: Mask, observed: Mask, swept: Mask
) -> DrivingGrid:
    """Make a driving grid, with its open steps."""
    return DrivingGrid(geometry, passable, moves_within(passable), occupied, observed, swept)


def coverage_grid(
    geometry: GridGeometry, driving: DrivingGrid, visited: Mask, allowed: Mask | None = None
) -> CoverageGrid:
    """Aggregate a driving grid into coverage cells.

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
    """Coverage grid of a fully known place where the robot fits into every free cell."""
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


def tiled(driving: DrivingGrid, side: int) -> CoverageGrid:
    """Aggregate driving cells into tiles of `side` times `side`, none of them visited.

    The grid is padded upwards and to the right by impassable cells until tiles divide it.
    """
    g = driving.geometry
    pad = ((0, -g.rows % side), (0, -g.cols % side))
    rows, cols = g.rows + pad[0][1], g.cols + pad[1][1]
    padded = driving_grid(
        replace(g, rows=rows, cols=cols),
        np.pad(driving.passable, pad),
        np.pad(driving.occupied, pad, constant_values=True),
        np.pad(driving.observed, pad),
        np.pad(driving.swept, pad),
    )
    geometry = replace(g, resolution_m=side * g.resolution_m, rows=rows // side, cols=cols // side)
    return coverage_grid(geometry, padded, np.zeros(geometry.shape, dtype=np.bool_))


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
