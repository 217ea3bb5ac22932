# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""What is lost when recordings are made harder, and in buildings never seen.

    python benchmarks/bench_robustness.py variants intel.clf.gz ... [--only "90 deg" ...]
    python benchmarks/bench_robustness.py variants 15 23 ... (of simulated buildings)
    python benchmarks/bench_robustness.py buildings 0 1 2 ... [--backend gmapping]

Beside every recording its `.relations` is expected; those of a building are drawn from its truth.
Lost is what has more than 1 % of the relations off by more than 0.5 m, in a building driven as it
is more than 0.5 m of absolute error.
"""

from __future__ import annotations

import argparse
import zlib
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from buildings import building, recording, relations_of
from harder import VARIANTS, Recorded, odometry_of
from planting import FAR_M, LOST_SHARE

from slarm_graph.app.calls import run_backend
from slarm_graph.app.consistency_check import check_slam
from slarm_graph.config import RunConfig
from slarm_graph.eval.alignment import AlignmentMethod, align
from slarm_graph.eval.association import associate
from slarm_graph.eval.relations import read_relations, relation_errors
from slarm_graph.eval.trajectory_accuracy import absolute_errors
from slarm_graph.frontends.recordings.sources import open_source
from slarm_graph.geometry import Floats
from slarm_graph.reading_log import ReadingLog
from slarm_graph.readings import Reading
from slarm_graph.trajectory import Trajectory


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of one run: errors [m], the share beyond `FAR_M`, and its own verdict."""

    of: str
    case: str
    error_m: float
    odometry_m: float
    far: float
    verdict: str

    def is_lost(self) -> bool:
        """Whether the map is of no use."""
        return self.far > LOST_SHARE

    def row(self) -> str:
        """Return the row of a table."""
        fate = "lost" if self.is_lost() else "held"
        return (
            f"| {self.of} | {self.case} | {self.error_m:.4f} | {self.odometry_m:.3f}"
            f" | {100 * self.far:.1f} | {fate} | {self.verdict} |"
        )


def variant(of: str, name: str, backend: str) -> Outcome:
    """Run a backend on a variant of a recording; the error is the mean over the relations."""
    whole = _recorded(of)
    log = VARIANTS[name](whole, np.random.default_rng(zlib.crc32(name.encode())))
    estimate, verdict = _run(log.readings, backend)
    laser = log.readings[0].scan.robot_from_laser
    odometry = Trajectory(estimate.stamps_ns, odometry_of(log.readings))
    off, of_odometry = (relation_errors(log.relations, t, laser) for t in (estimate, odometry))
    error_m, far = off.translation_m.mean(), (off.translation_m > FAR_M).mean()
    stem = building(int(of))[0].name if of.isdigit() else _stem(Path(of))
    return Outcome(
        stem, name, float(error_m), float(of_odometry.translation_m.mean()), float(far), verdict
    )


def simulated(number: int, backend: str) -> Outcome:
    """Run a backend on a drive through a building; the error is the ATE, SE(2)-aligned."""
    readings, truth = recording(number)
    estimate, verdict = _run(readings, backend)
    odometry = odometry_of(readings)
    off = _errors_m(truth, estimate)
    of_odometry = _errors_m(truth, Trajectory(estimate.stamps_ns, odometry))
    rmse, odometry_rmse = (float(np.sqrt((e**2).mean())) for e in (off, of_odometry))
    world, config, people = building(number)
    lidar = config.lidar
    case = (
        f"{np.degrees(lidar.field_of_view_rad):.0f} deg, {lidar.beams} beams,"
        f" {lidar.range_max_m:g} m, {1000 * lidar.sigma_m:.0f} mm, {people} people"
    )
    return Outcome(world.name, case, rmse, odometry_rmse, float((off > FAR_M).mean()), verdict)


def _recorded(of: str) -> Recorded:
    """Read a recording, or drive through the building of a number."""
    if of.isdigit():
        readings, truth = recording(int(of))
        return Recorded(tuple(readings), relations_of(truth))
    path = Path(of)
    beside = path.with_name(_stem(path) + ".relations")
    return Recorded(tuple(open_source([path])), read_relations(beside))


def _stem(path: Path) -> str:
    return path.name.split(".")[0]


def _run(readings: Sequence[Reading], backend: str) -> tuple[Trajectory, str]:
    log = ReadingLog()
    for reading in readings:
        log.append(reading)
    slam = run_backend(readings, config=RunConfig(backend=backend))
    return slam.trajectory, check_slam(log, slam).verdict


def _errors_m(truth: Trajectory, estimate: Trajectory) -> Floats:
    pairs = associate(truth, estimate)
    return absolute_errors(pairs, align(pairs, AlignmentMethod.SE2))


def totals(outcomes: Sequence[Outcome]) -> str:
    """Return what was lost, what the verdict told of it, and what is worse than odometry."""
    lost = [o.verdict for o in outcomes if o.is_lost()]
    held = [o.verdict for o in outcomes if not o.is_lost()]
    # Twice the noise of a laser is no loss where the odometry is near perfect.
    worse = sum(o.error_m > 1.1 * o.odometry_m + 0.02 for o in outcomes)
    return (
        f"{len(lost)} of {len(outcomes)} lost, {lost.count('consistent')} of them called"
        f" consistent; of {len(held)} that held {held.count('inconsistent')} called inconsistent,"
        f" {held.count('doubtful')} doubtful; {worse} worse than 1.1 times odometry + 2 cm"
    )


def main() -> None:
    """Print the table row by row, and what it comes to."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("variants", "buildings"))
    parser.add_argument("given", nargs="+", help="recordings, or numbers of buildings")
    parser.add_argument("--only", nargs="+", choices=list(VARIANTS), default=list(VARIANTS))
    parser.add_argument("--backend", default="pose_graph")
    parser.add_argument("--jobs", type=int, default=2)
    asked = parser.parse_args()
    print("| of | case | error [m] | odometry [m] | beyond 0.5 m [%] | | verdict |")
    print("|---|---|---|---|---|---|---|")
    with ProcessPoolExecutor(asked.jobs, mp_context=get_context("spawn")) as pool:
        if asked.what == "buildings":
            pending = [pool.submit(simulated, int(n), asked.backend) for n in asked.given]
        else:
            cases = [(of, name) for of in asked.given for name in asked.only]
            pending = [pool.submit(variant, *case, asked.backend) for case in cases]
        outcomes = [_told(one.result()) for one in pending]
    print(totals(outcomes))


def _told(outcome: Outcome) -> Outcome:
    print(outcome.row(), flush=True)
    return outcome


if __name__ == "__main__":
    main()
