# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Planning time of `ggmr` and `ggmr+` over the number of free cells, and the fitted exponent.

    python benchmarks/bench_planning.py [--largest CELLS]

Floors are square halls with thirty random boxes that grow with the hall, so that finer cells and
larger halls are the same to the planner. `ggmr+` plans for a body of 0.18 m on 0.05 m cells.
Processor time of the planning, best of three.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable

import numpy as np

from slarm_graph.config import DrivingConfig, ExploreConfig
from slarm_graph.exploration.algorithm_1 import ggmr_path
from slarm_graph.exploration.coverage_grid import (
    CoverageGrid,
    coverage_grid,
    driving_grid,
    known_coverage,
)
from slarm_graph.exploration.explorer import Leg
from slarm_graph.exploration.ggmr_plus import GgmrPlus
from slarm_graph.exploration.live_map import mark_swept
from slarm_graph.exploration.moves import clearance_m
from slarm_graph.geometry import Pose2
from slarm_graph.grid import GridGeometry, Mask

SIZES = (10_000, 30_000, 100_000, 300_000, 1_000_000, 4_000_000)
"""Cells of halls from 25 to 10,000 square metres, half a decade apart for the exponent's fit."""
CELL_M = ExploreConfig().resolution_m
BODY_M = DrivingConfig().robot_radius_m


def main() -> None:
    """Print a table of planning times and the exponents fitted to it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--largest", type=int, default=SIZES[-1], metavar="CELLS")
    largest = parser.parse_args().largest
    sizes = [n for n in SIZES if n <= largest]
    print(f"{'planner':8s} {'free cells':>11s} {'planning':>10s} {'per cell':>10s}")
    for name, plan in (("ggmr", plan_ggmr), ("ggmr+", plan_ggmr_plus)):
        plan(known(hall(2_500), name))
        cells, seconds = [], []
        for size in sizes:
            free = hall(size)
            cells.append(int(free.sum()))
            seconds.append(min(cpu_s(plan, known(free, name)) for _ in range(3)))
            per_cell_ns = 1e9 * seconds[-1] / cells[-1]
            print(f"{name:8s} {cells[-1]:11,d} {seconds[-1]:8.3f} s {per_cell_ns:7.0f} ns")
        exponent = np.polyfit(np.log(cells), np.log(seconds), 1)[0]
        print(f"{name}: time grows with cells to the power of {exponent:.2f}\n")


def hall(cells: int, boxes: int = 30) -> Mask:
    """Return the free cells of a square hall with boxes; about `cells` of them."""
    side = round(math.sqrt(1.2 * cells))
    rng = np.random.default_rng(1)
    free = np.ones((side, side), dtype=np.bool_)
    for _ in range(boxes):
        row, col = (rng.uniform(0.05, 0.9, 2) * side).astype(int)
        height, width = (rng.uniform(0.02, 0.12, 2) * side).astype(int)
        free[row : row + height, col : col + width] = False
    free[:8, :8] = True
    return free


def plan_ggmr(coverage: CoverageGrid) -> None:
    """Plan a way that visits every free cell."""
    assert ggmr_path(coverage, (0, 0)).complete


def plan_ggmr_plus(coverage: CoverageGrid) -> None:
    """Plan all legs that pass over every free cell in reach of the body, taking them as driven."""
    explorer = GgmrPlus(ExploreConfig(resolution_m=CELL_M))
    pose = Pose2(0.3, 0.3, 0.0)
    while isinstance(leg := explorer.next_goal(coverage, pose), Leg):
        mark_swept(coverage.driving.swept, leg.points_m / CELL_M, BODY_M / CELL_M)
        pose = Pose2(leg.points_m[-1, 0], leg.points_m[-1, 1], 0.0)


def known(free: Mask, name: str) -> CoverageGrid:
    """Coverage of a hall that is known and not yet passed over; `ggmr` drives a point."""
    if name == "ggmr":
        return known_coverage(free)
    geometry, nothing = GridGeometry(0.0, 0.0, CELL_M, *free.shape), np.zeros_like(free)
    passable = clearance_m(~free, CELL_M) >= BODY_M + 0.5 * CELL_M
    driving = driving_grid(geometry, passable, ~free, free, nothing)
    return coverage_grid(geometry, driving, nothing)


def cpu_s(plan: Callable[[CoverageGrid], None], coverage: CoverageGrid) -> float:
    """Processor time of one run [s]."""
    before = time.process_time()
    plan(coverage)
    return time.process_time() - before


if __name__ == "__main__":
    main()
