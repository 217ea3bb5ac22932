# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Corridors of 3 km spread over a square kilometre, and the same ones folded into 200 x 200 m.

    python benchmarks/large_site.py -- --backend odometry --ap 0 0 2.5

Both are driven once, in simulation, with few scans, so that SLAM is not the whole cost; whole runs
are compared stage by stage in processor time and memory. What goes with the bounding box instead of
with what is mapped shows as the ratio of the two. Odometry is exact: the backend of that name maps
each site as it is, and what the rest costs shows.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from slarm_graph.config import SimulationConfig
from slarm_graph.frontends.recordings.formats import format_written_as
from slarm_graph.frontends.simulation.world_recording import SourceFromWorld, waypoints
from slarm_graph.geometry import Floats, Pose2
from slarm_graph.world import Solid, WorldMap

WIDTH_M = 2.4
"""Of a corridor, as in offices."""
WALL_M, HEIGHT_M = 0.2, 3.0
"""Of a corridor's walls. No scan shows either of the two: walls are seen from one side, and rise
above the laser."""
STEP_M = 5.0
"""Between two waypoints of a corridor, which lie on one line: any other makes the same way."""
NICHE_EVERY_M = 3.0
"""A cupboard stands at a wall about so often: corridors of nothing but walls are of one place."""
SPEED_M_S = 1.0
"""Of a robot in corridors, at a walk."""
APART_M, BEAMS = 0.5, 181
"""Between two scans, and of a scan: a fifth of what 5 Hz and 361 beams give, and enough for the way
to be followed."""


@dataclass(frozen=True, slots=True)
class Cost:
    """Of a whole run."""

    wall_s: float
    cpu_s: float
    peak_mb: float
    stages: dict[str, tuple[float, float]]
    """Processor time [s] of every stage, and the largest memory until its end [MB]."""


def spread_m(length_m: float) -> Floats:
    """Middle line (K, 2) of corridors along three sides of a square [m]."""
    side = length_m / 3.0
    return np.array([[0.0, 0.0], [side, 0.0], [side, side], [0.0, side]])


def folded_m(length_m: float, side_m: float) -> Floats:
    """Middle line (K, 2) of corridors in as many lanes as fit a square [m]."""
    lanes = round(length_m / side_m)
    apart = side_m / max(lanes - 1, 1)
    along = (length_m - side_m) / lanes
    corners = []
    for lane in range(lanes):
        ends = (0.0, along) if lane % 2 == 0 else (along, 0.0)
        corners += [(x, lane * apart) for x in ends]
    return np.array(corners)


def world_along(line_m: Floats, name: str) -> WorldMap:
    """Walls on both sides of a line, and cupboards at them."""
    rng = np.random.default_rng(0)
    solids, half = [], 0.5 * (WIDTH_M + WALL_M)
    for left in (half, -half):
        sides = _offset(line_m, left)
        solids += [_bar(a, b, WALL_M) for a, b in pairwise(sides)]
    for end, inner in ((line_m[0], line_m[1]), (line_m[-1], line_m[-2])):
        along = (end - inner) / np.linalg.norm(end - inner)
        across = np.array([-along[1], along[0]]) * half
        middle = end + along * half
        solids.append(_bar(middle - across, middle + across, WALL_M))
    for a, b in pairwise(line_m):
        length, along = float(np.linalg.norm(b - a)), (b - a) / np.linalg.norm(b - a)
        at = 3.0
        while at < length - 3.0:
            side = rng.choice([-1.0, 1.0]) * (0.5 * WIDTH_M - 0.2)
            middle = a + along * at + side * np.array([-along[1], along[0]])
            reach = 0.5 * along * rng.uniform(0.3, 2.5)
            solids.append(_bar(middle - reach, middle + reach, rng.uniform(0.1, 0.8)))
            at += NICHE_EVERY_M * rng.uniform(0.5, 1.5)
    low, high = line_m.min(axis=0) - 5.0, line_m.max(axis=0) + 5.0
    boundary = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
    heading = float(np.arctan2(*(line_m[1] - line_m[0])[::-1]))
    start = Pose2(float(line_m[0, 0]), float(line_m[0, 1]), heading)
    return WorldMap(name, tuple(solids), boundary, HEIGHT_M, (), start)


def _offset(line_m: Floats, left_m: float) -> Floats:
    """A line with right-angled corners moved to its left, and as far beyond its ends."""
    step = np.diff(line_m, axis=0)
    along = step / np.linalg.norm(step, axis=1, keepdims=True)
    normals = np.stack([-along[:, 1], along[:, 0]], axis=1)
    reach = abs(left_m)
    points = [line_m[0] + left_m * normals[0] - reach * along[0]]
    for corner, before, after in zip(line_m[1:-1], normals[:-1], normals[1:], strict=True):
        points.append(corner + left_m * (before + after))
    points.append(line_m[-1] + left_m * normals[-1] + reach * along[-1])
    return np.array(points)


def _bar(a: Floats, b: Floats, thick_m: float) -> Solid:
    along = (b - a) / np.linalg.norm(b - a)
    across = 0.5 * thick_m * np.array([-along[1], along[0]])
    ring = np.array([a - across, b - across, b + across, a + across])
    return Solid("wall", ring, HEIGHT_M)


def _ways(line_m: Floats) -> Iterator[Floats]:
    for a, b in pairwise(line_m):
        count = max(round(float(np.linalg.norm(b - a)) / STEP_M), 1)
        yield from (a + (b - a) * (k / count) for k in range(1, count + 1))


def record(line_m: Floats, name: str, path: Path) -> int:
    """Drive along a line once and write the recording; returns its number of scans."""
    script = waypoints(np.array(list(_ways(line_m))), speed_m_s=SPEED_M_S)
    config = SimulationConfig.model_validate(
        {
            "lidar": {
                "rate_hz": SPEED_M_S / APART_M,
                "beams": BEAMS,
                "field_of_view_rad": np.pi,
                "range_max_m": 30.0,
            },
            "wheels": {
                "wheel_base_error": 0.0,
                "left_slip": 0.0,
                "right_slip": 0.0,
                "random_slip_m_per_sqrt_m": 0.0,
            },
        }
    )
    source = SourceFromWorld(world_along(line_m, name), config, script=script)
    return format_written_as(path).write(path, source)


def cost_of(path: Path, out: Path, words: list[str]) -> Cost:
    """Run it whole in a process of its own."""
    begun_s, name = time.monotonic(), f"run_of_{path.stem}"
    command = [sys.executable, "-m", "slarm_graph", "run", str(path), "--out", str(out)]
    process = subprocess.Popen([*command, "--name", name, *words], stdout=subprocess.DEVNULL)
    _, status, used = os.wait4(process.pid, 0)
    if status:
        raise SystemExit(f"{path.name}: the run failed")
    record = json.loads((out / name / "run.json").read_text(encoding="utf-8"))
    peaks_mb, cpu_s = record["stage_peak_mb"], record["stage_cpu_s"]
    stages = {stage: (cpu_s[stage], peaks_mb[stage]) for stage in cpu_s}
    spent_s = used.ru_utime + used.ru_stime
    return Cost(time.monotonic() - begun_s, spent_s, used.ru_maxrss / 1024.0, stages)


def show(name: str, cost: Cost) -> None:
    """Print a table of one run, a row for each of its stages."""
    print(f"\n| {name} | CPU [s] | peak until its end [MB] |\n|---|---|---|")
    for stage, (cpu_s, peak_mb) in cost.stages.items():
        print(f"| {stage} | {cpu_s:.1f} | {peak_mb:.0f} |")
    print(f"| all, {cost.wall_s:.0f} s | {cost.cpu_s:.1f} | {cost.peak_mb:.0f} |", flush=True)


def recorded(line_m: Floats, name: str, folder: Path) -> Path:
    """Return the recording of a site in a folder, driven now unless it is there."""
    path = folder / f"{name}.bag"
    if not path.is_file():
        record(line_m, name, path)
    return path


def main() -> None:
    """Record, run and compare."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--length", type=float, default=3000.0, help="Of the corridors [m].")
    parser.add_argument("--folded", type=float, default=200.0, help="Side of the small site [m].")
    parser.add_argument("--keep", type=Path, help="Folder for recordings and runs.")
    parser.add_argument("words", nargs="*", help="Further options of `slarm run`, after --.")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = given.keep or Path(temporary)
        lines = {
            "folded": folded_m(given.length, given.folded),
            "spread": spread_m(given.length),
        }
        for name, line_m in lines.items():
            width, height = np.ptp(line_m, axis=0)
            cost = cost_of(recorded(line_m, name, folder), folder, given.words)
            show(f"{name}, {width:.0f} x {height:.0f} m", cost)


if __name__ == "__main__":
    main()
