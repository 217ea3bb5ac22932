# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Line of sight and gain of one access point over 1000 x 1000 cells, and recovery of large grids.

    python benchmarks/bench_radio.py [--cells 1000]

Times are CPU time on one core, best of five, kernels warm. The baseline walks the segment to every
cell with a digital differential analyser in numba, which is what a careful user would write; both
must give the same answer, up to segments that graze a cell's edge.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from slarm_graph.access_points import AccessPoint
from slarm_graph.config import MappingConfig, RadioConfig, RecoveryConfig
from slarm_graph.geographic import CellState, Coverage, GeographicMap
from slarm_graph.geometry import Floats
from slarm_graph.grid import GridGeometry, Mask, OccupancyGrid
from slarm_graph.kernels import kernel
from slarm_graph.radio.line_of_sight import line_of_sight_over_cells
from slarm_graph.radio.propagation.crossings import link_crossings
from slarm_graph.radio.radio_map import radio_map
from slarm_graph.recovery.recover import recover
from slarm_graph.trajectory import Trajectory

T = TypeVar("T")

RESOLUTION_M = MappingConfig().resolution_m
ANTENNA_M, WALL_M = RadioConfig().antenna_height_m, 1.8
"""Walls higher than the antenna and lower than the access point at 2.5 m, which are passed far from
it and not near it: no shortcut serves all cells."""


def main() -> None:
    """Time everything and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=1000)
    cells = parser.parse_args().cells
    header = (
        f"{'scene':<22}{'walking':>10}{'shadows':>10}{'ratio':>8}{'with gain':>11}{'differ':>9}"
    )
    print(f"{cells} x {cells} cells, one access point\n{header}")
    for name, occupied in scenes(cells).items():
        print(radio_row(name, occupied))
    print(f"\n{'walls counted':<22}{'the map':>10}{'and moved':>10}{'apart':>10}{'differ':>9}")
    for name, occupied in scenes(cells).items():
        print(walls_row(name, occupied))
    print(f"\nrecovery of {cells} x {cells} cells")
    for name, occupied in scenes(cells).items():
        print(f"{name:<22}{recovery_s(occupied):>9.3f}s")


def scenes(cells: int) -> dict[str, Mask]:
    """Obstacle masks: rooms with doors, a hall with pillars, sparse and dense clutter."""
    rng = np.random.default_rng(0)
    rooms = np.zeros((cells, cells), dtype=np.bool_)
    rooms[:: cells // 10] = rooms[:, :: cells // 10] = True
    for door in rng.integers(0, cells - 20, 60):
        rooms[:, door : door + 20] = False
        rooms[door : door + 20] = False
    pillars = np.zeros_like(rooms)
    for row, col in rng.integers(0, cells - 10, (300, 2)):
        pillars[row : row + 8, col : col + 8] = True
    return {
        "rooms": rooms,
        "pillars": pillars,
        "clutter 0.5 %": rng.random(rooms.shape) < 0.005,
        "clutter 10 %": rng.random(rooms.shape) < 0.1,
    }


def radio_row(name: str, occupied: Mask) -> str:
    """Time walking, shadows, and the whole radio map of one scene."""
    cells = len(occupied)
    geometry = GridGeometry(0.0, 0.0, RESOLUTION_M, cells, cells)
    eye = np.array([0.4137 * cells, 0.5219 * cells])
    ap = AccessPoint("ap", eye[0] * RESOLUTION_M, eye[1] * RESOLUTION_M, 2.5)
    heights = np.where(occupied, WALL_M, 0.0)
    walk_s, walked = best(lambda: walked_sight(heights, eye, ap.z_m, ANTENNA_M), 3)
    shade_s, shaded = best(
        lambda: line_of_sight_over_cells(geometry, heights, ap.position_m(), ANTENNA_M)
    )
    states = np.where(occupied, CellState.OBSTACLE, CellState.ACCESSIBLE).astype(np.uint8)
    layers = Coverage(~occupied, ~occupied, ~occupied)
    known = GeographicMap(geometry, states, heights.astype(np.float32), "default", layers)
    all_s, _ = best(lambda: radio_map(known, [ap], RadioConfig()))
    differ = int(np.sum(walked != shaded))
    return (
        f"{name:<22}{walk_s:>9.3f}s{shade_s:>9.3f}s{walk_s / shade_s:>7.1f}x"
        f"{all_s:>10.3f}s{differ:>9}"
    )


def walls_row(name: str, occupied: Mask) -> str:
    """Time counting walls to all free cells: on the map, with the map moved, and moved apart."""
    geometry = GridGeometry(0.0, 0.0, RESOLUTION_M, *occupied.shape)
    heights_m = np.where(occupied, WALL_M, 0.0)
    eye_m = np.array([0.4137, 0.5219]) * len(occupied) * RESOLUTION_M
    points_m = geometry.center_of(np.argwhere(~occupied))

    def count(shift_cells: int, shift_m: Floats) -> NDArray[np.int16]:
        """Counts with both ends of the links shifted."""
        there = np.array([*(eye_m + shift_m), 2.5])
        return link_crossings(
            geometry, heights_m, there, points_m + shift_m, ANTENNA_M, shift_cells=shift_cells
        ).counts

    shifts = RESOLUTION_M * np.array([(0, 0), (-1, 0), (1, 0), (0, -1), (0, 1)])
    one_s, _ = best(lambda: count(0, shifts[0]), 2)
    moved_s, moved = best(lambda: count(1, shifts[0]), 2)
    apart_s, apart = best(lambda: np.concatenate([count(0, s) for s in shifts]), 1)
    differ = int((moved != apart).sum())
    return f"{name:<22}{one_s:>9.2f}s{moved_s:>9.2f}s{apart_s:>9.2f}s{differ:>9}"


def recovery_s(occupied: Mask) -> float:
    """Time recovery of a fully seen scene."""
    cells = len(occupied)
    grid = OccupancyGrid(
        GridGeometry(0.0, 0.0, RESOLUTION_M, cells, cells), occupied.astype(np.float32)
    )
    free = np.argwhere(~occupied)[:: max(1, occupied.size // 50)]
    poses = np.column_stack([grid.geometry.center_of(free[:1]), [0.0]])
    trajectory = Trajectory(np.arange(len(poses)), poses)
    return best(lambda: recover(grid, trajectory, RecoveryConfig()), 2)[0]


def best(work: Callable[[], T], times: int = 5) -> tuple[float, T]:
    """Shortest CPU time of several runs after one to warm up, and the result [s]."""
    result = work()
    spent = []
    for _ in range(times):
        began = time.process_time()
        result = work()
        spent.append(time.process_time() - began)
    return min(spent), result


@kernel
def walked_sight(heights: Floats, eye: Floats, eye_m: float, antenna_m: float) -> Mask:
    """Walk from every cell's centre to the access point; lengths in plan in cells."""
    rows, cols = heights.shape
    clear = np.ones((rows, cols), dtype=np.bool_)
    for row in range(rows):
        for col in range(cols):
            clear[row, col] = _is_clear(heights, eye, eye_m, antenna_m, row, col)
    return clear


@kernel
def _is_clear(
    heights: Floats, eye: Floats, eye_m: float, antenna_m: float, row: int, col: int
) -> bool:
    dx, dy = eye[0] - (col + 0.5), eye[1] - (row + 0.5)
    step_x, step_y = (1 if dx > 0 else -1), (1 if dy > 0 else -1)
    per_x = abs(1.0 / dx) if dx != 0.0 else math.inf
    per_y = abs(1.0 / dy) if dy != 0.0 else math.inf
    next_x, next_y = 0.5 * per_x, 0.5 * per_y
    entered = 0.0
    while entered < 1.0:
        lowest = antenna_m + min(entered, 1.0) * (eye_m - antenna_m)
        if not (0 <= row < heights.shape[0] and 0 <= col < heights.shape[1]):
            return True
        if heights[row, col] > lowest:
            return False
        if next_x < next_y:
            entered = next_x
            next_x += per_x
            col += step_x
        else:
            entered = next_y
            next_y += per_y
            row += step_y
    return True


if __name__ == "__main__":
    main()
