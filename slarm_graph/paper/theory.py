# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""What the paper's figures would be without SLAM error: counted steps, and two hypotheses.

Nothing here is simulated. Algorithm 1 runs on the true room; its path is timed with the robot's
speed and turn rate.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy import ndimage

from slarm_graph.config import DrivingConfig
from slarm_graph.errors import BadInput
from slarm_graph.exploration.algorithm_1 import GgmrPath, PathCells, ggmr_path
from slarm_graph.exploration.coverage_grid import (
    CoverageGrid,
    coverage_grid,
    driving_grid,
    start_cell,
)
from slarm_graph.exploration.moves import clearance_m
from slarm_graph.exploration.searches import reachable
from slarm_graph.geometry import Floats
from slarm_graph.grid import GridGeometry, Mask
from slarm_graph.truth_map import TruthMap, truth_map
from slarm_graph.world import WorldMap

PAPER_BEST: Final = 0.9195
"""Accuracy at 0.05 m (paper, abstract)."""
PAPER_COARSE: Final = 0.7878
"""Accuracy that resolutions below 0.15 m exceed (paper, abstract)."""


@dataclass(frozen=True, slots=True)
class Complexity:
    """Algorithm 1 counted on the true room at one resolution.

    Parameters
    ----------
    resolution_m : float
    cells : int
        Cells of the whole grid; N in the paper's O(N^2) is its side.
    accessible : int
        Cells that the robot's centre can get to.
    comparisons, restarts, turns, revisits : int
        A comparison is a look at the value of one grid cell. The paper's best case, O(N^3), would
        be three nested loops over the side; literal Algorithm 1 looks once ahead in each cell and
        at up to three cells above where that fails, so that comparisons grow with the number of
        cells, N^2, and a new start costs one search over the cells that are left.
    comparisons_per_cell : float
        Of the accessible ones.
    paper_space, paper_best, paper_worst_log10 : float
        N^2, N^3 and the logarithm of N (log2 N)^N for the grid's longer side N, as claimed.
    path_m : float
        Length of the path over cell centres [m].
    drive_s : float
        Driving it at the given speed, turns on the spot included [s].
    planning_s : float
        Processor time of the planning [s].
    """

    resolution_m: float
    cells: int
    accessible: int
    comparisons: int
    restarts: int
    turns: int
    revisits: int
    comparisons_per_cell: float
    paper_space: float
    paper_best: float
    paper_worst_log10: float
    path_m: float
    drive_s: float
    planning_s: float


def complexity(world: WorldMap, resolution_m: float, driving: DrivingConfig) -> Complexity:
    """Count what Algorithm 1 does in the true room."""
    coverage = true_coverage(world, resolution_m, driving.robot_radius_m)
    path, planning_s = _planned(coverage, world)
    at_s = times_s(path.cells, resolution_m, driving)
    steps = np.diff(path.cells, axis=0)
    accessible = int(np.sum(reachable(coverage.moves, start_of(coverage, world))))
    side = float(max(coverage.codes.shape))
    return Complexity(
        resolution_m,
        coverage.codes.size,
        accessible,
        path.counts.comparisons,
        path.counts.restarts,
        path.counts.turns,
        path.counts.revisits,
        path.counts.comparisons / accessible,
        side**2,
        side**3,
        math.log10(side) + side * math.log10(math.log2(side)),
        float(np.hypot(*steps.T).sum()) * resolution_m,
        float(at_s[-1]),
        planning_s,
    )


def one_cell_ring_accuracy(world: WorldMap, resolution_m: float) -> float:
    """Hypothesis R_e = one cell: what is left when every wall costs a ring of one cell.

    Blocked is what a solid touches, in the reference as well, and what lies within one cell of
    it, centre to centre: the four neighbours over a side. In the paper's room this gives 97.1,
    92.7, 85.2, 77.2, 68.6 and 64.3 % at 0.02, 0.05, 0.10, 0.15, 0.20 and 0.25 m. Against a
    reference by centres, and with diagonal neighbours lost too, it would be 96.4, 92.3, 81.5,
    71.0, 60.3 and 61.7 %.
    """
    truth = truth_map(world, resolution_m, "touched")
    return _share(truth, ~_with_ring(truth.blocked))


def mission_accuracy(
    world: WorldMap, resolution_m: float, driving: DrivingConfig, mission_s: float
) -> float:
    """Hypothesis of a fixed mission time: only cells visited by then count, a ring lost as above.

    The body is a point here, as in the paper; literal Algorithm 1 drives.
    """
    coverage = true_coverage(world, resolution_m, 0.0, ring=True)
    path, _ = _planned(coverage, world)
    in_time = path.cells[times_s(path.cells, resolution_m, driving) <= mission_s]
    visited = np.zeros(coverage.codes.shape, dtype=np.bool_)
    visited[in_time[:, 0], in_time[:, 1]] = True
    return _share(truth_map(world, resolution_m, "touched"), visited)


def times_s(cells: PathCells, resolution_m: float, driving: DrivingConfig) -> Floats:
    """Time (M,) at which a robot is at each cell of a path, turning on the spot at bends [s]."""
    steps = np.diff(cells, axis=0)
    heading = np.arctan2(steps[:, 0], steps[:, 1])
    bend = np.abs(np.mod(np.diff(heading, prepend=heading[:1]) + math.pi, 2 * math.pi) - math.pi)
    # A stop and a new start cost speed / acceleration beyond the way itself.
    stop_s = np.where(bend > 1e-6, driving.speed_m_s / driving.acceleration_m_s2, 0.0)
    step_s = np.hypot(*steps.T) * resolution_m / driving.speed_m_s
    return np.concatenate([[0.0], np.cumsum(step_s + bend / driving.turn_rate_rad_s + stop_s)])


def true_coverage(
    world: WorldMap, resolution_m: float, radius_m: float, *, ring: bool = False
) -> CoverageGrid:
    """Coverage grid of the true room for a body of a radius, or with a ring of one cell."""
    geometry = truth_map(world, resolution_m).geometry
    fine = 1 if ring else max(1, math.ceil(round(resolution_m / 0.025, 6)))
    blocked = truth_map(world, resolution_m / fine, "touched").blocked
    blocked = blocked[: geometry.rows * fine, : geometry.cols * fine]
    pad = [(0, n * fine - have) for n, have in zip(geometry.shape, blocked.shape, strict=True)]
    blocked = np.pad(blocked, pad, constant_values=True)
    lattice = GridGeometry(
        geometry.origin_x_m, geometry.origin_y_m, resolution_m / fine, *blocked.shape
    )
    passable = _passable(blocked, lattice.resolution_m, radius_m, ring)
    nothing = np.zeros(blocked.shape, dtype=np.bool_)
    driving = driving_grid(lattice, passable, blocked, ~blocked, nothing)
    return coverage_grid(geometry, driving, np.zeros(geometry.shape, dtype=np.bool_))


def _passable(blocked: Mask, resolution_m: float, radius_m: float, ring: bool) -> Mask:
    if ring:
        return ~_with_ring(blocked)
    if radius_m == 0.0:
        return ~blocked
    return np.asarray(clearance_m(blocked, resolution_m) >= radius_m + 0.5 * resolution_m)


def _with_ring(blocked: Mask) -> Mask:
    """Blocked cells and those beside them; beyond the grid everything is blocked."""
    return np.asarray(ndimage.binary_dilation(blocked, border_value=1))


def _planned(coverage: CoverageGrid, world: WorldMap) -> tuple[GgmrPath, float]:
    start = start_of(coverage, world)
    ggmr_path(coverage, start, max_cells=2)
    before = time.process_time()
    path = ggmr_path(coverage, start)
    return path, time.process_time() - before


def start_of(coverage: CoverageGrid, world: WorldMap) -> tuple[int, int]:
    """Coverage cell in which the robot begins."""
    start = start_cell(coverage, world.start)
    if start is None:
        raise BadInput(f"{world.name}: start: no free cell near it")
    return start


def _share(reference: TruthMap, found: Mask) -> float:
    """Share of the reference's reachable area that was found and hangs together."""
    weight = reference.area_weight * reference.reachable
    return float(np.sum(weight * found[: weight.shape[0], : weight.shape[1]]) / np.sum(weight))
