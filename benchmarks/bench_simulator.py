# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Scans per second of the simulator in every shipped world, beside the same rays in numpy.

    python benchmarks/bench_simulator.py
    pytest benchmarks/bench_simulator.py --benchmark-only -m ''

The baseline intersects all 360 rays of a scan
with all segments of the world at once in numpy, in the same process and the same minute. Times are
of the processor, the best of several rounds.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from slarm_graph.config import SimulationConfig
from slarm_graph.files.worlds import load_world, shipped_worlds
from slarm_graph.frontends.simulation.simulator import SimulatedWorld, visible_segments
from slarm_graph.geometry import Floats
from slarm_graph.world import DriveCommand, WorldMap

ROUNDS = 5
"""The best of so many counts: what else runs on a machine only ever adds time."""


def best_rate(work: Callable[[], object], repeats: int) -> float:
    """Calls per second of processor time, the best of several rounds."""
    work()
    rates = []
    for _ in range(ROUNDS):
        start = time.process_time()
        for _ in range(repeats):
            work()
        rates.append(repeats / (time.process_time() - start))
    return max(rates)


def numpy_scan(segments: Floats, x: float, y: float, directions: Floats) -> Floats:
    """Intersect every ray with every segment in one broadcast."""
    px, py = segments[:, 0] - x, segments[:, 1] - y
    ex, ey = segments[:, 2], segments[:, 3]
    dx, dy = directions[:, :1], directions[:, 1:]
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1.0 / (dx * ey - dy * ex)
        t, along = (px * ey - py * ex) * inverse, (px * dy - py * dx) * inverse
    hit = (t >= 0.0) & (along >= 0.0) & (along <= 1.0)
    return np.asarray(np.where(hit, t, np.inf).min(axis=1))


def measure(world: WorldMap) -> tuple[int, float, float, float]:
    """Segments, scans/s, scans/s while driving, scans/s of numpy."""
    robot = SimulatedWorld(world, SimulationConfig(), np.random.default_rng(0))
    segments = visible_segments(world, 0.2).segments
    angles = np.linspace(-np.pi, np.pi, 360, endpoint=False)
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    x, y = world.start.x, world.start.y
    creep = DriveCommand(0.0, 0.5)

    def drive_and_read() -> None:
        robot.drive(creep)
        robot.read()

    return (
        len(segments),
        best_rate(robot.read, 1000),
        best_rate(drive_and_read, 1000),
        best_rate(lambda: numpy_scan(segments, x, y, directions), 20),
    )


@pytest.mark.parametrize("name", shipped_worlds())
def test_scans(benchmark: BenchmarkFixture, name: str) -> None:
    robot = SimulatedWorld(load_world(name), SimulationConfig(), np.random.default_rng(0))
    benchmark(robot.read)
    _, scans, _, baseline = measure(load_world(name))
    benchmark.extra_info["ratio_to_numpy"] = round(scans / baseline, 1)


def main() -> None:
    """Print one line per world."""
    print("360 beams, 8 m range, one core")
    print(
        f"{'world':12} {'segments':>8} {'read /s':>9} {'drive+read /s':>13} {'numpy /s':>9} ratio"
    )
    for name in shipped_worlds():
        segments, scans, driving, baseline = measure(load_world(name))
        ratio = scans / baseline
        print(f"{name:12} {segments:8} {scans:9.0f} {driving:13.0f} {baseline:9.0f} {ratio:5.0f}")


if __name__ == "__main__":
    main()
