# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""A measured radio map of 10^6 cells by 10^5 readings of six access points, and ways over it.

    python benchmarks/bench_large_radio.py [--cells 1000] [--readings 100000] [--locate]

A floor of rooms with doors, driven through in lanes; readings are those of a multi-wall law with
rough shadowing and noise. Positions of access points are told, or located with `--locate`. Times
are wall and CPU seconds, kernels warm; memory is the peak of the process.
"""

from __future__ import annotations

import argparse
import math
import resource
import time

import numpy as np
from scipy.ndimage import gaussian_filter

from slarm_graph.access_points import AccessPoint
from slarm_graph.config import MeasuredConfig, RadioConfig
from slarm_graph.geographic import CellState, Coverage, GeographicMap
from slarm_graph.geometry import Floats
from slarm_graph.grid import GridGeometry, Mask
from slarm_graph.radio.connectivity.paths import connected_path
from slarm_graph.radio.connectivity.signal import SignalMap
from slarm_graph.radio.measured.build_map import build_measured_map
from slarm_graph.radio.measured.measured_map import MeasuredMap
from slarm_graph.radio.measured.readings import RssReadings

CELL_M, ROOM_M, DOOR_M = 0.05, 8.0, 1.2
"""Side of a cell, of a room, and width of a door: those of offices."""
COUNT, NOISE_DB, SHADOWING_DB, RANGE_M, SPEED_M_S = 6, 3.0, 4.0, 2.0, 0.6
"""Access points; noise and shadowing of readings as the simulator has them; of the robot."""


def rooms(cells: int) -> Mask:
    """Walls (cells, cells) of square rooms that have a door to each neighbour."""
    walls = np.zeros((cells, cells), dtype=np.bool_)
    side, door = round(ROOM_M / CELL_M), round(DOOR_M / CELL_M)
    walls[::side] = walls[:, ::side] = walls[-1] = walls[:, -1] = True
    for middle in range(side // 2, cells, side):
        opened = slice(middle - door // 2, middle + door // 2)
        walls[side:-1:side, opened] = False
        walls[opened, side:-1:side] = False
    return walls


def floor_map(walls: Mask) -> GeographicMap:
    """Make the geographic map of walls."""
    states = np.where(walls, CellState.OBSTACLE, CellState.ACCESSIBLE).astype(np.uint8)
    geometry = GridGeometry(0.0, 0.0, CELL_M, *walls.shape)
    heights = np.where(walls, np.inf, 0.0).astype(np.float32)
    return GeographicMap(geometry, states, heights, "infinite", Coverage(~walls, ~walls, ~walls))


def heard(
    walls: Mask, aps: list[AccessPoint], count: int, rng: np.random.Generator
) -> dict[str, RssReadings]:
    """Readings along lanes over all of the floor, as many of each access point."""
    side_m = CELL_M * len(walls)
    each = count // len(aps)
    lane = np.linspace(0.0, 1.0, each)
    lanes = max(1, round(math.sqrt(each / 12.0)))
    turn = (lane * lanes) % 1.0
    x = np.where((lane * lanes).astype(int) % 2, 1.0 - turn, turn)
    points = 0.2 + (side_m - 0.4) * np.column_stack([x, lane])
    points = points[~walls[tuple((points // CELL_M).astype(int).T[::-1])]]
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    made = {}
    for ap in aps:
        white = rng.standard_normal(walls.shape)
        field = gaussian_filter(white, RANGE_M / CELL_M / 2.0)
        field *= SHADOWING_DB / field.std()
        away = np.linalg.norm(
            np.column_stack([points, np.full(len(points), 0.5)]) - ap.position_m(), axis=1
        )
        passed = crossed(walls, ap.position_m()[:2], points)
        level = -40.0 - 20.0 * np.log10(away) - 4.0 * passed
        level += field[tuple((points // CELL_M).astype(int).T[::-1])]
        level += NOISE_DB * rng.standard_normal(len(points))
        made[ap.name] = RssReadings(points, way / SPEED_M_S, level, np.zeros(len(points), np.int64))
    return made


def crossed(walls: Mask, ap_m: Floats, points_m: Floats) -> Floats:
    """Rooms' walls between an access point and points, by the rooms that both are in."""
    return np.asarray(np.abs(points_m // ROOM_M - ap_m // ROOM_M).sum(axis=1))


def made(cells: int, readings: int, locate: bool) -> MeasuredMap:
    """Fuse a floor's readings."""
    walls, rng = rooms(cells), np.random.default_rng(0)
    side_m = CELL_M * cells
    aps = [
        AccessPoint(
            f"ap{n}", *rng.uniform(0.1 * side_m, 0.9 * side_m, 2).tolist(), 2.4, 0.0, 2.44e9
        )
        for n in range(COUNT)
    ]
    parts = heard(walls, aps, readings, rng)
    return build_measured_map(
        floor_map(walls), parts, () if locate else aps, RadioConfig(), MeasuredConfig()
    )


def spent(label: str, began: tuple[float, float]) -> None:
    """Say what it took."""
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    wall, cpu = time.perf_counter() - began[0], time.process_time() - began[1]
    print(f"{label:<34}{wall:>8.2f} s{cpu:>8.2f} s CPU{peak_mb:>8.0f} MB", flush=True)


def main() -> None:
    """Time a fusion and the plans over what came of it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=1000)
    parser.add_argument("--readings", type=int, default=100_000)
    parser.add_argument("--locate", action="store_true")
    given = parser.parse_args()
    made(200, 6000, given.locate)
    began = time.perf_counter(), time.process_time()
    measured = made(given.cells, given.readings, given.locate)
    spent(f"fused, {given.readings} readings", began)
    plan(SignalMap.of_measured(measured))


def plan(signal: SignalMap) -> None:
    """Time ways from corner to corner, through doors."""
    level, geometry = signal.best_level_dbm(), signal.geometry
    side_m = geometry.rows * geometry.resolution_m
    ends = (1.0, 1.0), (0.94 * side_m, 0.94 * side_m)
    connected_path(geometry, level, *ends, -75.0, longest_outage_m=3.0)
    for threshold in (float(np.nanquantile(level, q)) for q in (0.02, 0.2, 0.5)):
        for label, outage_m, weight in (
            ("never below", 0.0, 0.0),
            ("3 m below at most", 3.0, 0.0),
            ("30 m below at most", 30.0, 0.0),
            ("weighed", math.inf, 0.2),
        ):
            began = time.perf_counter(), time.process_time()
            way = connected_path(
                geometry, level, *ends, threshold, longest_outage_m=outage_m, weight_per_db=weight
            )
            found = "no way" if way is None else f"{way.length_m:.0f} m"
            spent(f"{threshold:.0f} dBm, {label}: {found}", began)


if __name__ == "__main__":
    main()
