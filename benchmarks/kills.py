# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Runs are killed (SIGKILL) at random moments and taken up again; the results must be the same.

python benchmarks/kills.py RECORDING --kills 30
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.random import Generator

from slarm_graph.app.ending import BAD_INPUT

COMPARED = ("trajectory.tum", "map.pgm", "radio_map.npz")
EVERY_S = 0.5
"""Time between checkpoints: as short as one takes to write, so that most kills come after one."""
PATIENCE_S = 3600.0
"""Longest wait for a run, after which it counts as hung: no result depends on it."""
_EARLY_ENOUGH = 0.8
"""Share of a run's usual time within which it is killed: on a busy machine that varies, and a run
that has ended cannot be killed."""


@dataclass(frozen=True, slots=True)
class Job:
    """A command line of `slarm` without where to write.

    Parameters
    ----------
    name : str
    words : tuple of str
    same_again : bool
        Whether it goes on when it is given again, instead of by `slarm run --resume`.
    """

    name: str
    words: tuple[str, ...]
    same_again: bool = False


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of a run that was killed.

    Parameters
    ----------
    job : str
    killed_s : tuple of float
        How long each of its processes lived [s].
    anew : int
        How often there was nothing to resume, and it was started anew.
    problem : str
        Empty when it ended with the bytes of an undisturbed run.
    """

    job: str
    killed_s: tuple[float, ...]
    anew: int
    problem: str = ""


def jobs(recording: Path) -> tuple[Job, ...]:
    """Every backend on a recording, and a drive with each kind of them."""
    points = ("--ap", "0", "0", "2.5")
    runs = [
        Job(f"run {backend}", ("run", str(recording), "-b", backend, *points, *few))
        for backend, few in (
            ("odometry", ()),
            ("pose_graph", ()),
            ("gmapping", ("--set", "gmapping.particles=12")),
        )
    ]
    limit = ("--set", "explore.mission_time_s=40", "--resolution", "0.1")
    drives = [
        Job(f"explore {backend}", ("explore", "-b", backend, *limit, *few))
        for backend, few in (
            ("pose_graph", ()),
            ("gmapping", ("--set", "gmapping.particles=12")),
        )
    ]
    both = ("--backends", "pose_graph,gmapping", "--set", "gmapping.particles=12")
    return (*runs, *drives, Job("compare", ("compare", str(recording), *both), same_again=True))


def slarm(*words: str) -> subprocess.Popen[str]:
    """Start `slarm`."""
    command = [sys.executable, "-m", "slarm_graph", *words]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)


def undisturbed(job: Job, out: Path) -> float:
    """Run a job to its end; returns how long it took [s]."""
    started_s = time.monotonic()
    process = slarm(*job.words, "--out", str(out), "--name", "whole", "--overwrite")
    _, said = process.communicate(timeout=PATIENCE_S)
    if process.returncode:
        raise SystemExit(f"{job.name}: {said}")
    return time.monotonic() - started_s


def disturbed(job: Job, out: Path, kills: int, usual_s: float, rng: Generator) -> Outcome:
    """Start a job, kill it so many times at random moments, and let it end."""
    name, lived, anew = f"killed_{time.monotonic_ns()}", [], 0
    given = (*job.words, "--out", str(out), "--name", name)
    given += ("--set", f"checkpoint.every_s={EVERY_S}")
    again = given if job.same_again else ("run", "--resume", str(out / name))
    words = afresh = (*given, "--overwrite")
    for turn in range(kills + 1 + kills):
        process = slarm(*words)
        try:
            # Killed while it works, not while it waits for the machine.
            longest_s = _EARLY_ENOUGH * usual_s
            wait_s = rng.uniform(0.05, longest_s) if len(lived) < kills else PATIENCE_S
            _, said = process.communicate(timeout=wait_s)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
            lived.append(round(wait_s, 2))
            words = again
            continue
        if process.returncode == 0:
            return Outcome(job.name, tuple(lived), anew, differences(out, name))
        if process.returncode == BAD_INPUT and turn and words is not afresh:
            there = "is finished" in said
            if there:
                return Outcome(job.name, tuple(lived), anew, differences(out, name))
            if not ("start it anew" in said or "not a run folder" in said):
                return Outcome(job.name, tuple(lived), anew, said.strip())
            words, anew = afresh, anew + 1
            continue
        return Outcome(job.name, tuple(lived), anew, f"exit {process.returncode}: {said.strip()}")
    return Outcome(job.name, tuple(lived), anew, "did not end")


def differences(out: Path, name: str) -> str:
    """Name the files that differ from those of the undisturbed run."""
    whole = out / "whole"
    files = sorted(path for path in whole.rglob("*") if path.name in COMPARED)
    inside = [path.relative_to(whole) for path in files]
    different = [
        str(file) for file in inside if _content(out / name / file) != _content(whole / file)
    ]
    if not files:
        return "the undisturbed run left nothing to compare"
    return f"different: {', '.join(different)}" if different else ""


def _content(path: Path) -> bytes | None:
    return path.read_bytes() if path.is_file() else None


def main() -> int:
    """Print a line for every run that was killed, and a summary."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recording", type=Path)
    parser.add_argument("--kills", type=int, default=30, help="In all.")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="", help="Jobs whose name has this in it.")
    given = parser.parse_args()
    rng, problems, done, anew = np.random.default_rng(given.seed), 0, 0, 0
    chosen = [job for job in jobs(given.recording) if given.only in job.name]
    with tempfile.TemporaryDirectory() as made:
        usual = {}
        for job in chosen:
            (Path(made) / job.name).mkdir()
            undisturbed(job, Path(made) / job.name)  # compiles what is not compiled yet
            usual[job] = undisturbed(job, Path(made) / job.name)
        while done < given.kills:
            job = chosen[int(rng.integers(len(chosen)))]
            kills = int(rng.integers(1, 4))
            outcome = disturbed(job, Path(made) / job.name, kills, usual[job], rng)
            done += len(outcome.killed_s)
            anew += outcome.anew
            problems += bool(outcome.problem)
            print(f"{job.name}: {outcome.killed_s} {outcome.problem or 'same bytes'}", flush=True)
    print(f"{done} kills, {anew} times started anew, {problems} problems")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
