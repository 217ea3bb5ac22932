# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Backend comparison: every source with every backend and seed, each in a process of its own.

A run that fails, even one that takes its process down, leaves the others alone. The same trials
run on a cluster when a dask scheduler is given; the folder must be visible from all its workers.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from itertools import product
from pathlib import Path

from slarm_graph.errors import BadInput
from slarm_graph.eval.comparison import Outcome
from slarm_graph.frontends.sources import existing_paths
from slarm_graph.progress import Progress, Quiet
from slarm_graph.run_folder import RECORD
from slarm_graph.world_files import shipped_worlds

_BEAT_S = 1.0
_RECORDED = ("wall_s", "cpu_s", "peak_memory_mb", "scans_per_s")


@dataclass(frozen=True, slots=True)
class Source:
    """A recording, or a world to be explored.

    Parameters
    ----------
    place : str
        Path; of a world also the name of one that comes along.
    is_world : bool
    """

    place: str
    is_world: bool


@dataclass(frozen=True, slots=True)
class Trial:
    """One run of a comparison.

    Parameters
    ----------
    source : Source
    backend : str
    seed : int
    folder : Path
        Its run folder, below the comparison's.
    options : tuple of str
        Further words of the command line.
    """

    source: Source
    backend: str
    seed: int
    folder: Path
    options: tuple[str, ...] = ()

    def command(self) -> list[str]:
        """Return the command line of the run."""
        place = self.source.place
        what = ("explore", "--world", place) if self.source.is_world else ("run", place)
        return [
            *(sys.executable, "-m", "slarm_graph", *what),
            *("--backend", self.backend, "--seed", str(self.seed)),
            *("--out", str(self.folder.parent), "--name", self.folder.name),
            *self.options,
        ]


def find_sources(given: Sequence[str]) -> tuple[Source, ...]:
    """Tell recordings and worlds apart.

    Raises
    ------
    BadInput
        When one is missing.
    """
    return tuple(_find(source) for source in given)


def _find(given: str) -> Source:
    shipped, path = given in shipped_worlds(), Path(given)
    if shipped or (path.suffix in (".yaml", ".yml") and path.name != "metadata.yaml"):
        return Source(given if shipped else str(path.resolve()), True)
    return Source(str(existing_paths(given)[0].resolve()), False)


def trials(
    sources: Sequence[Source],
    backends: Sequence[str],
    seeds: int,
    folder: Path,
    *,
    options: Sequence[str] = (),
    for_recordings: Sequence[str] = (),
) -> tuple[Trial, ...]:
    """Plan every source with every backend and the seeds 0 ... `seeds` - 1.

    A file beside a recording that has its name and ends in `.relations` or `.tum` is taken for
    what is known to be true of it.

    Parameters
    ----------
    sources : sequence of Source
    backends : sequence of str
    seeds : int
    folder : Path
        The comparison's.
    options, for_recordings : sequence of str
        Further words of the command line, for every run and for recordings only.
    """
    names = _unique_names([Path(source.place) for source in sources])
    planned = []
    for source, name in zip(sources, names, strict=True):
        references = () if source.is_world else (*for_recordings, *_references(Path(source.place)))
        for backend, seed in product(backends, range(seeds)):
            place = folder.resolve() / f"{name}_{backend}_{seed}"
            planned.append(Trial(source, backend, seed, place, (*options, *references)))
    return tuple(planned)


def _unique_names(paths: Sequence[Path]) -> list[str]:
    stems = [path.name.split(".")[0] for path in paths]
    return [
        stem if stems.count(stem) == 1 else f"{number}_{path.name.replace('.', '_')}"
        for number, (stem, path) in enumerate(zip(stems, paths, strict=True), start=1)
    ]


def _references(source: Path) -> Iterator[str]:
    for option, suffix in (("--relations", ".relations"), ("--ground-truth", ".tum")):
        beside = source.with_name(source.name.split(".")[0] + suffix)
        if beside.is_file():
            yield from (option, str(beside.resolve()))


def carry_out(trial: Trial) -> Outcome:
    """Run a trial in a process of its own and read what it left."""
    environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
    done = subprocess.run(
        trial.command(), capture_output=True, text=True, env=environment, check=False
    )
    said = done.stderr.strip().splitlines()
    problem = said[-1].removeprefix("slarm: ") if said and done.returncode else ""
    return read_outcome(trial, problem or f"exit code {done.returncode}")


def read_outcome(trial: Trial, problem: str = "") -> Outcome:
    """Read a finished trial's record and metrics.

    Parameters
    ----------
    trial : Trial
    problem : str
        What its process said last, for when it left no record.
    """
    try:
        record = json.loads((trial.folder / RECORD).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        record = {"status": "failed", "problem": problem}
    status = record["status"] if record["status"] != "running" else "failed"
    figures = {name: float(record[name]) for name in _RECORDED if name in record}
    return Outcome(
        Path(trial.source.place).name,
        trial.backend,
        trial.seed,
        status,
        "" if status == "ok" else record.get("problem") or problem,
        trial.folder.name,
        figures | _metrics(trial.folder / "metrics.json"),
    )


def _metrics(path: Path) -> dict[str, float]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return {name: m["value"] for name, m in content.items() if m["value"] is not None}


def compare(
    planned: Sequence[Trial],
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    tell: Callable[[Outcome], None] = lambda _outcome: None,
    progress: Progress | None = None,
) -> tuple[Outcome, ...]:
    """Carry out all trials and return their outcomes in the order of the plan.

    Parameters
    ----------
    planned : sequence of Trial
    workers : int, optional
        Processes at a time; the number of cores when left out.
    scheduler : str, optional
        Address of a dask scheduler, such as `tcp://host:8786`; local processes when left out.
    tell : callable
        Told every outcome as it comes in.
    progress : Progress, optional
    """
    workers = workers or os.cpu_count() or 1
    run = _on_cluster(scheduler) if scheduler else _locally(workers, progress or Quiet())
    outcomes: dict[Trial, Outcome] = {}
    for trial, outcome in run(planned):
        outcomes[trial] = outcome
        tell(outcome)
    return tuple(outcomes[trial] for trial in planned)


Runner = Callable[[Sequence[Trial]], Iterator[tuple[Trial, Outcome]]]


def _as_they_end(
    futures: dict[Future[Outcome], Trial], progress: Progress
) -> Iterator[tuple[Trial, Outcome]]:
    """Yield outcomes as trials end, with a sign of life in between."""
    progress.start("runs", len(futures))
    waiting = set(futures)
    while waiting:
        ended, waiting = wait(waiting, _BEAT_S, FIRST_COMPLETED)
        progress.say("")
        for future in ended:
            progress.advance()
            yield futures[future], future.result()


def _locally(workers: int, progress: Progress) -> Runner:
    def run(planned: Sequence[Trial]) -> Iterator[tuple[Trial, Outcome]]:
        with ThreadPoolExecutor(workers) as pool:
            futures = {pool.submit(carry_out, trial): trial for trial in planned}
            try:
                yield from _as_they_end(futures, progress)
            except KeyboardInterrupt:
                pool.shutdown(wait=False, cancel_futures=True)
                raise

    return run


def _on_cluster(address: str) -> Runner:
    def run(planned: Sequence[Trial]) -> Iterator[tuple[Trial, Outcome]]:
        from distributed import Client
        from distributed import as_completed as as_completed_on_cluster

        try:
            client = Client(address, timeout="10s")  # type: ignore[no-untyped-call]
        except OSError as error:
            raise BadInput(f"--scheduler {address}: no dask scheduler answers ({error})") from None
        with client:
            futures = {client.submit(carry_out, t, pure=False): t for t in planned}
            for future in as_completed_on_cluster(futures):  # type: ignore[no-untyped-call]
                trial = futures[future]
                failure = future.exception()
                yield trial, (read_outcome(trial, str(failure)) if failure else future.result())

    return run
