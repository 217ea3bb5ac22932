# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Backend comparison: every source with every backend and seed, each in a process of its own.

A run that fails, even one that takes its process down, leaves the others alone. The same trials
run on a cluster when a dask scheduler is given; the folder must be visible from all its workers.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import closing
from pathlib import Path
from threading import Event, Lock

from slarm_graph.app.progress import Progress, Quiet
from slarm_graph.app.run_folder import RECORD
from slarm_graph.app.trials import Trial
from slarm_graph.errors import BadInput
from slarm_graph.eval.comparison import Outcome

_BEAT_S = 1.0
"""Progress is shown about once a second while trials run; nothing waits for it."""
_RECORDED = ("wall_s", "cpu_s", "peak_memory_mb", "scans_per_s")


def carry_out(trial: Trial) -> Outcome:
    """Run a trial in a process of its own and read what it left."""
    return _waited_for(trial, _started(trial))


def _started(trial: Trial) -> subprocess.Popen[str]:
    """Start a trial's process, in a session of its own: Ctrl-C does not reach it by itself."""
    return subprocess.Popen(
        trial.command(),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
        start_new_session=True,
    )


def _waited_for(trial: Trial, process: subprocess.Popen[str]) -> Outcome:
    _, errors = process.communicate()
    said = errors.strip().splitlines()
    problem = said[-1].removeprefix("slarm: ") if said and process.returncode else ""
    return read_outcome(trial, problem or f"exit code {process.returncode}")


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
    with closing(run(planned)) as coming:
        for trial, outcome in coming:
            outcomes[trial] = outcome
            tell(outcome)
    return tuple(outcomes[trial] for trial in planned)


Outcomes = Generator[tuple[Trial, Outcome]]
Runner = Callable[[Sequence[Trial]], Outcomes]


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
    """Run trials on this machine; Ctrl-C stops those that run after their present scan."""
    running: set[subprocess.Popen[str]] = set()
    lock, stopping = Lock(), Event()

    def carry_out_here(trial: Trial) -> Outcome:
        """Run a trial and be there to be stopped."""
        process = _started(trial)
        with lock:
            running.add(process)
            if stopping.is_set():
                process.send_signal(signal.SIGINT)
        try:
            return _waited_for(trial, process)
        finally:
            with lock:
                running.discard(process)

    def stop() -> None:
        """Stop every process once; those that are just being started stop themselves."""
        with lock:
            stopping.set()
            for process in running:
                process.send_signal(signal.SIGINT)

    def run(planned: Sequence[Trial]) -> Outcomes:
        """Yield outcomes as trials end."""
        with ThreadPoolExecutor(workers) as pool:
            futures = {pool.submit(carry_out_here, trial): trial for trial in planned}
            try:
                yield from _as_they_end(futures, progress)
            except BaseException:  # Ctrl-C may strike in whoever takes the outcomes, too
                pool.shutdown(wait=False, cancel_futures=True)
                stop()
                raise

    return run


def _on_cluster(address: str) -> Runner:
    """Run trials on a dask cluster."""

    def run(planned: Sequence[Trial]) -> Outcomes:
        """Yield outcomes as trials end."""
        from distributed import Client
        from distributed import as_completed as as_completed_on_cluster

        try:
            client = Client(address, timeout="10s")  # type: ignore[no-untyped-call]
        except (OSError, ValueError) as error:
            raise BadInput(f"--scheduler {address}: no dask scheduler answers ({error})") from None
        with client:
            futures = {client.submit(carry_out, t, pure=False): t for t in planned}
            for future in as_completed_on_cluster(futures):  # type: ignore[no-untyped-call]
                trial = futures[future]
                failure = future.exception()
                yield trial, (read_outcome(trial, str(failure)) if failure else future.result())

    return run
