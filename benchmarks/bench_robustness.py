# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Error over the true relations when a recording is made harder: fewer scans, no odometry.

    python benchmarks/bench_robustness.py intel.bag fr079.bag [--backend NAME]

Beside every `<name>.bag` its `<name>.relations` is expected. Every n-th scan is kept, from the
first and from the n/2-th on; relations between scans that were left out are judged between poses
interpolated, which alone costs some rotation.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from itertools import product
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from slarm_graph import backends
from slarm_graph.backend import silent
from slarm_graph.config import RunConfig, SourceConfig
from slarm_graph.eval.relations import read_relations, relation_errors
from slarm_graph.frontends.recordings.sources import open_source

EVERY = (1, 2, 3, 4)
"""Every how many scans one is kept, up to what a laser of 5 Hz leaves at 1.25 Hz."""


def errors(recording: Path, backend: str, odometry: bool, every: int, first: int) -> str:
    """Run a backend on part of a recording; a row of the table."""
    source = open_source([recording], SourceConfig(odom=None if odometry else "none"))
    readings = list(source)[first::every]
    config = RunConfig(backend=backend)
    slam = backends.make(backend, config, np.random.default_rng(config.seed), silent)
    for reading in readings:
        slam.update(reading)
    relations = read_relations(recording.with_suffix(".relations"))
    laser = readings[0].scan.robot_from_laser
    off = relation_errors(relations, slam.result().trajectory, laser)
    kept = "all" if every == 1 else f"1 of {every}, from {first}"
    return (
        f"| {recording.stem} | {'yes' if odometry else 'no'} | {kept}"
        f" | {off.translation_m.mean():.4f} | {np.median(off.translation_m):.4f}"
        f" | {off.translation_m.max():.2f} | {np.degrees(off.rotation_rad).mean():.3f} |"
    )


def settings(recordings: Iterable[Path]) -> list[tuple[Path, bool, int, int]]:
    """List what is run."""
    return [
        (recording, odometry, every, first)
        for recording, odometry, every in product(recordings, (True, False), EVERY)
        for first in sorted({0, every // 2})
    ]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recordings", nargs="+", type=Path)
    parser.add_argument("--backend", default="pose_graph")
    parser.add_argument("--jobs", type=int, default=2)
    given = parser.parse_args()
    print("| recording | odometry | scans | mean [m] | median [m] | worst [m] | rotation [deg] |")
    print("|---|---|---|---|---|---|---|")
    with ProcessPoolExecutor(given.jobs, mp_context=get_context("spawn")) as pool:
        pending = [
            pool.submit(errors, recording, given.backend, *rest)
            for recording, *rest in settings(given.recordings)
        ]
        for row in pending:
            print(row.result(), flush=True)


if __name__ == "__main__":
    main()
