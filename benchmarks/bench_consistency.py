# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""How often the verdict on a trajectory is right: errors planted into good ones, and real runs.

    python benchmarks/bench_consistency.py planted intel.bag=good.tum ... [--each 20] [--seed 0]
    python benchmarks/bench_consistency.py buildings 0 1 2 ... [--each 20] [--seed 0]
    python benchmarks/bench_consistency.py runs fr079.bag=run/trajectory.tum=fr079.relations ...

A trajectory is lost when more than 1 % of true relations are off by more than 0.5 m; planted ones
are judged by relations made of the good one, that of a building is its true path.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from buildings import building
from buildings import recording as drive_through
from planting import FAR_M, KINDS, LOST_SHARE, is_lost, plant

from slarm_graph.config import SimulationConfig, SourceConfig
from slarm_graph.consistency import contradictions
from slarm_graph.eval.relations import read_relations, relation_errors
from slarm_graph.files.trajectories import read_trajectory
from slarm_graph.frontends.recordings.sources import open_source
from slarm_graph.geometry import Floats
from slarm_graph.reading_log import ReadingLog
from slarm_graph.trajectory import Trajectory

VERDICTS = ("consistent", "doubtful", "inconsistent")


@dataclass(frozen=True, slots=True)
class Case:
    """One trajectory that was judged: of what, whether it is lost, and the verdict."""

    recording: str
    kind: str
    lost: bool
    verdict: str


def planted(name: str, log: ReadingLog, poses: Floats, each: int, seed: int) -> Iterator[Case]:
    """Judge a good trajectory and so many of every kind of error in it."""
    yield _judged(name, "none", log, poses, False)
    rng = np.random.default_rng(seed)
    for _ in range(each):
        for kind in KINDS:
            bad = plant(poses, kind, rng).poses
            yield _judged(name, kind, log, bad, is_lost(poses, bad))


def in_building(number: int, each: int, seed: int) -> Iterator[Case]:
    """Judge the true path through a simulated building, and errors in it."""
    readings, truth = drive_through(number)
    log = ReadingLog()
    for reading in readings:
        log.append(reading)
    name = building(number)[0].name
    return planted(name, log, truth.poses, each, seed + number)


def run(recording: Path, estimate: Path, relations: Path) -> Case:
    """Judge what a run made of a recording whose true relations are known."""
    log, poses = _scans_and_poses(recording, estimate)
    trajectory = Trajectory(log.stamps_ns, poses)
    errors = relation_errors(read_relations(relations), trajectory, log.robot_from_laser)
    lost = bool((errors.translation_m > FAR_M).mean() > LOST_SHARE)
    return _judged(recording.stem, "run", log, poses, lost)


def _scans_and_poses(recording: Path, trajectory: Path) -> tuple[ReadingLog, Floats]:
    poses = read_trajectory(trajectory)
    log = ReadingLog()
    for reading in open_source([recording], SourceConfig(), SimulationConfig()):
        if poses.stamps_ns[0] <= reading.stamp_ns <= poses.stamps_ns[-1]:
            log.append(reading)
    return log, poses.at(log.stamps_ns)


def _judged(recording: str, kind: str, log: ReadingLog, poses: Floats, lost: bool) -> Case:
    trajectory = Trajectory(log.stamps_ns, poses)
    result = contradictions(log.scans, trajectory, log.odometry_poses())
    case = Case(recording, kind, lost, result.verdict)
    print(
        f"  {recording} {kind}: {'lost' if lost else 'held'}, {result.summary()}"[:220], flush=True
    )
    return case


def table(cases: Iterable[Case]) -> list[str]:
    """Return how often which verdict was given, by recording and kind, as rows of a table."""
    counts = Counter((c.recording, c.kind, c.lost, c.verdict) for c in cases)
    lines = [
        "| recording | error | truly | " + " | ".join(VERDICTS) + " |",
        "|---|---|---|---|---|---|",
    ]
    for recording, kind, lost in dict.fromkeys(key[:3] for key in counts):
        found = " | ".join(str(counts[recording, kind, lost, v]) for v in VERDICTS)
        lines.append(f"| {recording} | {kind} | {'lost' if lost else 'held'} | {found} |")
    return lines


def totals(cases: Iterable[Case]) -> str:
    """Return the two shares that count."""
    lost = [c.verdict for c in cases if c.lost]
    held = [c.verdict for c in cases if not c.lost]
    told = sum(v != "consistent" for v in lost)
    wronged, doubted = (held.count(v) for v in ("inconsistent", "doubtful"))
    return (
        f"{told} of {len(lost)} lost ones are not called consistent;"
        f" of {len(held)} that held {wronged} are called inconsistent, {doubted} doubtful"
    )


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("planted", "buildings", "runs"))
    parser.add_argument("given", nargs="+", metavar="RECORDING=TRAJECTORY[=RELATIONS] | NUMBER")
    parser.add_argument("--each", type=int, default=5, help="planted errors of each kind")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    cases: list[Case] = []
    for text in given.given:
        if given.what == "buildings":
            cases += in_building(int(text), given.each, given.seed)
            continue
        files = [Path(p) for p in text.split("=")]
        if given.what == "planted":
            of_recording = _scans_and_poses(files[0], files[1])
            cases += planted(files[0].stem, *of_recording, given.each, given.seed)
        else:
            cases.append(run(*files))
    print("\n".join(table(cases)))
    print(totals(cases))


if __name__ == "__main__":
    main()
