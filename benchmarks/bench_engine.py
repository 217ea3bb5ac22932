# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""What a comparison costs besides its runs: seconds a run and memory, from the first to the last.

    python benchmarks/bench_engine.py paper_room --runs 1000
    python benchmarks/bench_engine.py short.bag --runs 1000 --real

One run is made by odometry; all others are copies of it by a process that does nothing else, so
that what is left is the engine: planning, starting and waiting for processes, reading what they
left, agreement, tables and page; then the same command again, which finds all of it on disk. With
`--real` every run is made, and what it says that it took is taken off the wall time.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import fields
from pathlib import Path

import numpy as np

from slarm_graph.app.compare import compare
from slarm_graph.app.comparison_folder import open_comparison, write_comparison
from slarm_graph.app.comparison_plan import ComparisonPlan, find_sources
from slarm_graph.app.ending import memory_mb
from slarm_graph.app.fork_server import ForkServer
from slarm_graph.app.outcomes import carry_out
from slarm_graph.app.trials import Trial
from slarm_graph.eval.comparison import Outcome

COPIED = "SLARM_BENCH_MODEL"
_PART = 100
"""Runs that are told together; the first are to be compared with the last."""
_FIRST = "first time"


class Copy(Trial):
    """A run that is there as soon as another's folder is copied."""

    __slots__ = ()

    def command(self) -> list[str]:
        """Copy the model's folder, by links, so that the disk is not what is measured."""
        return ["/bin/cp", "-rl", "--no-target-directory", os.environ[COPIED], str(self.folder)]


def copies(trials: Sequence[Trial]) -> list[Trial]:
    """Return the same plan with runs that cost nothing, unless they are to be real."""
    if COPIED not in os.environ:
        return list(trials)
    return [Copy(**{f.name: getattr(trial, f.name) for f in fields(Trial)}) for trial in trials]


class Clock:
    """Notes wall and processor time and memory whenever a run has come in."""

    def __init__(self) -> None:
        self.points = [(time.monotonic(), time.process_time(), memory_mb(), 0.0)]

    def __call__(self, outcome: Outcome) -> None:
        """Take note, and of what a real run says that it took itself."""
        itself_s = 0.0 if COPIED in os.environ else outcome.figures["wall_s"]
        self.points.append((time.monotonic(), time.process_time(), memory_mb(), itself_s))

    def row(self, what: str, begin: int, end: int) -> str:
        """Return seconds a run, and the memory at the end, of a stretch of runs.

        Wall time is the median, which others on the machine move less.
        """
        wall, cpu, memory, itself_s = np.array(self.points[begin : end + 1]).T
        runs = end - begin
        wall_s = float(np.median(np.diff(wall) - itself_s[1:])) * runs
        return _row(f"{what} {begin + 1} to {end}", wall_s, cpu[-1] - cpu[0], runs, memory[-1])


def whole(trials_of: Callable[[Path], Sequence[Trial]], place: Path, jobs: int, what: str) -> None:
    """Plan, carry out and write a comparison as the command does, and print what each took."""
    begun = time.monotonic(), time.process_time()
    folder = open_comparison(place, "c")
    trials = copies(trials_of(folder.path))
    told(f"{what}: planned", *begun, len(trials))
    begun, clock = (time.monotonic(), time.process_time()), Clock()
    outcomes = compare(trials, workers=jobs, tell=clock)
    told(f"{what}: runs", *begun, len(trials))
    assert all(outcome.status == "ok" for outcome in outcomes), outcomes[0]
    for begin in range(0, len(trials), _PART) if what == _FIRST else ():
        print(clock.row("... of them", begin, min(begin + _PART, len(trials))), flush=True)
    begun = time.monotonic(), time.process_time()
    write_comparison(folder, outcomes, "engine")
    told(f"{what}: agreement, tables and page", *begun, len(trials))


def told(part: str, wall_s: float, cpu_s: float, runs: int) -> None:
    """Print what a part took that began at these times."""
    wall_s, cpu_s = time.monotonic() - wall_s, time.process_time() - cpu_s
    print(_row(part, wall_s, cpu_s, runs, memory_mb()), flush=True)


def _row(part: str, wall_s: float, cpu_s: float, runs: int, memory: float) -> str:
    return f"| {part} | {1e3 * wall_s / runs:.1f} | {1e3 * cpu_s / runs:.2f} | {memory:.0f} |"


def main() -> None:
    """Print a table of what each part costs a run."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("source")
    parser.add_argument("--runs", type=int, default=1000)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--real", action="store_true")
    options = parser.parse_args()
    sources = find_sources([options.source])
    with tempfile.TemporaryDirectory() as place:
        if not options.real:
            (model,) = ComparisonPlan(sources, ("odometry",), 1).trials(Path(place) / "model")
            assert carry_out(model, ForkServer()).status == "ok"
            os.environ[COPIED] = str(model.folder)
        print("| part | wall [ms/run] | CPU of the engine [ms/run] | memory [MB] |")
        print("|---|---|---|---|")
        plan = ComparisonPlan(sources, ("odometry",), options.runs)
        for what in (_FIRST, "again"):
            whole(plan.trials, Path(place), options.jobs, what)


if __name__ == "__main__":
    main()
