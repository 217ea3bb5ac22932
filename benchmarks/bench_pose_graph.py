# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Cost per scan of graph SLAM over a log driven again and again, and the error it ends with.

    python benchmarks/bench_pose_graph.py RECORDING [--times 8] [--relations FILE]

The recording is appended to itself, so the robot is carried back to the start each time. The last
line compares the last repetition with the first: a method whose cost grows with the log shows it
there.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np

from slarm_graph.backends.pose_graph import PoseGraphBackend
from slarm_graph.config import FrontendConfig, PoseGraphConfig, SourceConfig
from slarm_graph.eval.relations import read_relations, relation_errors
from slarm_graph.frontends.recordings.sources import open_source
from slarm_graph.readings import Reading
from slarm_graph.trajectory import Trajectory

WARM_UP_SCANS = 500
"""Scans that are followed before the clock runs, for what is compiled on first use; what they leave
uncompiled shows in the time of the first repetition alone."""
PAUSE_NS = 200_000_000
"""From the last scan of a repetition to the first of the next: the period of a laser of 5 Hz."""


def make() -> PoseGraphBackend:
    return PoseGraphBackend(PoseGraphConfig(), FrontendConfig(), np.random.default_rng(0))


def warm_up(readings: list[Reading]) -> None:
    """Have everything compiled before the clock runs."""
    backend = make()
    for reading in readings[:WARM_UP_SCANS]:
        backend.update(reading)
    backend.result()


def repeat(backend: PoseGraphBackend, readings: list[Reading], times: int) -> list[float]:
    """Feed the recording `times` times; return the CPU seconds of each."""
    span_ns = readings[-1].stamp_ns - readings[0].stamp_ns + PAUSE_NS
    seconds = []
    for number in range(times):
        shift_ns = number * span_ns
        begin = time.process_time()
        for r in readings:
            backend.update(Reading(r.stamp_ns + shift_ns, r.scan, r.odom_from_robot))
        seconds.append(time.process_time() - begin)
        print(f"| {number + 1} | {seconds[-1]:.2f} | {1e3 * seconds[-1] / len(readings):.3f} |")
    return seconds


def print_error(trajectory: Trajectory, readings: list[Reading], relations: Path) -> None:
    """Print the error of the first repetition at the laser."""
    count = len(readings)
    first = Trajectory(trajectory.stamps_ns[:count], trajectory.poses[:count])
    mount = readings[0].scan.robot_from_laser
    errors = relation_errors(read_relations(relations), first, mount)
    translation_m = errors.translation_m.mean()
    rotation_deg = np.degrees(errors.rotation_rad).mean()
    print(f"error of the first repetition: {translation_m:.4f} m, {rotation_deg:.3f} deg")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("recording", type=Path)
    parser.add_argument("--times", type=int, default=8)
    parser.add_argument("--relations", type=Path)
    args = parser.parse_args()
    readings = list(open_source(args.recording, SourceConfig()))
    warm_up(readings)
    backend = make()
    print("| repetition | CPU s | CPU ms per scan |\n|---|---|---|")
    seconds = repeat(backend, readings, args.times)
    begin = time.process_time()
    trajectory = backend.result().trajectory
    print(f"result: {time.process_time() - begin:.2f} CPU s")
    print(f"last / first repetition: {seconds[-1] / seconds[0]:.2f}")
    if args.relations is not None:
        print_error(trajectory, readings, args.relations)


if __name__ == "__main__":
    main()
