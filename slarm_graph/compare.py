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
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from itertools import product
from pathlib import Path

from slarm_graph.errors import BadInput
from slarm_graph.eval.comparison import Outcome
from slarm_graph.run_folder import RECORD

_RECORDED = ("wall_s", "cpu_s", "peak_memory_mb", "scans_per_s")


@dataclass(frozen=True, slots=True)
class Trial:
    """One run of a comparison.

    Parameters
    ----------
    source : Path
    backend : str
    seed : int
    folder : Path
        Its run folder, below the comparison's.
    options : tuple of str
        Further words of the command line.
    """

    source: Path
    backend: str
    seed: int
    folder: Path
    options: tuple[str, ...] = ()

    def command(self) -> list[str]:
        """Return the command line of the run."""
        return [
            *(sys.executable, "-m", "slarm_graph", "run", str(self.source)),
            *("--backend", self.backend, "--seed", str(self.seed)),
            *("--out", str(self.folder.parent), "--name", self.folder.name),
            *self.options,
        ]


def trials(
    sources: Sequence[Path],
    backends: Sequence[str],
    seeds: int,
    folder: Path,
    options: Sequence[str] = (),
) -> tuple[Trial, ...]:
    """Plan every source with every backend and the seeds 0 ... `seeds` - 1.

    A file beside a recording that has its name and ends in `.relations` or `.tum` is taken for
    what is known to be true of it.
    """
    names = _unique_names(sources)
    return tuple(
        Trial(
            source.resolve(),
            backend,
            seed,
            folder.resolve() / f"{names[source]}_{backend}_{seed}",
            (*options, *_references(source)),
        )
        for source, backend, seed in product(sources, backends, range(seeds))
    )


def _unique_names(sources: Sequence[Path]) -> dict[Path, str]:
    stems = [source.name.split(".")[0] for source in sources]
    return {
        source: stem if stems.count(stem) == 1 else source.name.replace(".", "_")
        for source, stem in zip(sources, stems, strict=True)
    }


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
        trial.source.name,
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
    """
    run = _on_cluster(scheduler) if scheduler else _locally(workers or os.cpu_count() or 1)
    outcomes: dict[Trial, Outcome] = {}
    for trial, outcome in run(planned):
        outcomes[trial] = outcome
        tell(outcome)
    return tuple(outcomes[trial] for trial in planned)


Runner = Callable[[Sequence[Trial]], Iterator[tuple[Trial, Outcome]]]


def _locally(workers: int) -> Runner:
    def run(planned: Sequence[Trial]) -> Iterator[tuple[Trial, Outcome]]:
        with ThreadPoolExecutor(workers) as pool:
            futures = {pool.submit(carry_out, trial): trial for trial in planned}
            try:
                for future in as_completed(futures):
                    yield futures[future], future.result()
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
