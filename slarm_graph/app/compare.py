# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Execution of a comparison's runs, locally or on a dask cluster.

A run that fails, even by a crash of its process, does not affect the others. A finished run is
read and not repeated; an interrupted one is resumed.
"""

from __future__ import annotations

import signal
import time
import uuid
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import closing
from pathlib import Path
from threading import Event, Lock

from slarm_graph.app.fork_server import ForkServer
from slarm_graph.app.outcomes import POLL_S, Process, read_outcome, start_trial, wait_for
from slarm_graph.app.progress import Progress, Quiet
from slarm_graph.app.trials import Trial
from slarm_graph.cores import usable_cores
from slarm_graph.errors import BadInput
from slarm_graph.eval.comparison import Outcome

_RETRIES = 3
"""How often a run is given to another worker when its worker dies."""


def compare(
    planned: Sequence[Trial],
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    upload: bool = False,
    budget_s: float | None = None,
    tell: Callable[[Outcome], None] = lambda _: None,
    progress: Progress | None = None,
) -> tuple[Outcome, ...]:
    """Carry all trials out and return their outcomes, in the order of the plan.

    Parameters
    ----------
    planned : sequence of Trial
    workers : int, optional
        Parallel processes on this machine; default: as many as it has processors.
    scheduler : str, optional
        Address of a dask scheduler, such as `tcp://host:8786`; default: local processes.
    upload : bool
        Copy sources to the workers and run folders back, for a cluster without a shared file
        system.
    budget_s : float, optional
        Time after which no further trial is started [s]; the rest has the status `missing`.
    tell : callable
        Called with every outcome as it comes in.
    progress : Progress, optional
    """
    done = {trial: read_outcome(trial) for trial in planned if trial.is_done()}
    for outcome in done.values():
        tell(outcome)
    left = [trial for trial in planned if trial not in done]
    runner = (
        _cluster_runner(scheduler, upload)
        if scheduler
        else _local_runner(workers or usable_cores())
    )
    outcomes = dict(done)
    if left:
        with closing(runner(left, progress or Quiet(), budget_s)) as coming:
            for trial, outcome in coming:
                outcomes[trial] = outcome
                tell(outcome)
    return tuple(outcomes.get(trial) or _not_started(trial) for trial in planned)


def _not_started(trial: Trial) -> Outcome:
    place, why = Path(trial.source.place).name, "not started within the budget"
    return Outcome(place, trial.backend, trial.seed, "missing", why, setting=trial.setting)


Outcomes = Generator[tuple[Trial, Outcome]]
Runner = Callable[[Sequence[Trial], Progress, float | None], Outcomes]
Submit = Callable[[Trial], "Future[Outcome]"]


def _run_all(
    planned: Sequence[Trial],
    submit: Submit,
    at_once: int,
    progress: Progress,
    budget_s: float | None,
) -> Iterator[tuple[Trial, Outcome]]:
    """Run trials in parallel and yield their outcomes as they end, with a heartbeat."""
    progress.start("runs", len(planned))
    ends_s = None if budget_s is None else time.monotonic() + budget_s
    left = list(reversed(planned))
    running: dict[Future[Outcome], Trial] = {}
    while left or running:
        in_time = ends_s is None or time.monotonic() < ends_s
        while left and in_time and len(running) < at_once:
            trial = left.pop()
            running[submit(trial)] = trial
        if not running:
            return
        ended, _ = wait(running, POLL_S, FIRST_COMPLETED)
        progress.say("")
        for future in ended:
            progress.advance()
            trial = running.pop(future)
            failure = future.exception()
            yield trial, (read_outcome(trial, str(failure)) if failure else future.result())


def _local_runner(workers: int) -> Runner:
    """Return a runner on this machine; Ctrl-C stops its trials after their present scan."""
    running: set[Process] = set()
    lock, stopping, server = Lock(), Event(), ForkServer()

    def carry_out_here(trial: Trial) -> Outcome:
        """Run a trial in a process that `stop` reaches."""
        process = start_trial(trial, server)
        with lock:
            running.add(process)
            if stopping.is_set():
                process.send_signal(signal.SIGINT)
        try:
            return wait_for(trial, process)
        finally:
            with lock:
                running.discard(process)

    def stop() -> None:
        """Interrupt every process once, also those that are just being started."""
        with lock:
            stopping.set()
            for process in running:
                process.send_signal(signal.SIGINT)

    def run(planned: Sequence[Trial], progress: Progress, budget_s: float | None) -> Outcomes:
        """Yield outcomes as trials end."""
        with closing(server), ThreadPoolExecutor(workers) as pool:

            def submit(trial: Trial) -> Future[Outcome]:
                """Hand a trial to a thread."""
                return pool.submit(carry_out_here, trial)

            try:
                yield from _run_all(planned, submit, workers, progress, budget_s)
            except BaseException:  # Ctrl-C may strike in whoever takes the outcomes, too
                stop()
                pool.shutdown(wait=True, cancel_futures=True)
                raise

    return run


def _cluster_runner(address: str, upload: bool) -> Runner:
    """Return a runner on a dask cluster; Ctrl-C stops its trials, too."""

    def run(planned: Sequence[Trial], progress: Progress, budget_s: float | None) -> Outcomes:
        """Yield outcomes as trials end."""
        import distributed

        from slarm_graph.app.cluster import UploadingClient, carry_out_on_worker

        try:
            client = distributed.Client(address, timeout="10s")
        except (OSError, ValueError) as error:
            raise BadInput(f"--scheduler {address}: no dask scheduler answers ({error})") from None
        with client:
            stop = distributed.Event(f"slarm-stop-{uuid.uuid4().hex}", client=client)
            pool = client.get_executor(pure=False, retries=_RETRIES)
            elsewhere = UploadingClient(client) if upload else None

            def submit(trial: Trial) -> Future[Outcome]:
                """Hand a trial to the scheduler."""
                if elsewhere is not None:
                    return elsewhere.submit(pool, trial, stop.name)
                future: Future[Outcome] = pool.submit(carry_out_on_worker, trial, stop.name)
                return future

            at_once = max(1, sum(client.nthreads().values()))
            try:
                yield from _run_all(planned, submit, at_once, progress, budget_s)
            except BaseException:
                stop.set()
                raise

    return run
