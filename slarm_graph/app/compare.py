# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The runs of a comparison, here or on a dask cluster.

A run that fails, even one that takes its process down, leaves the others alone. One that is
already finished is read and not computed again, one that was interrupted goes on.
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

from slarm_graph.app.outcomes import BEAT_S, Process, read_outcome, started, waited_for
from slarm_graph.app.progress import Progress, Quiet
from slarm_graph.app.template import Template
from slarm_graph.app.trials import Trial
from slarm_graph.cores import usable_cores
from slarm_graph.errors import BadInput
from slarm_graph.eval.comparison import Outcome

_RETRIES = 3
"""How often a run is given to another worker when one dies over it."""


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
        Processes at a time on this machine; as many as it has processors when left out.
    scheduler : str, optional
        Address of a dask scheduler, such as `tcp://host:8786`; local processes when left out.
    upload : bool
        Send sources to the cluster's workers and take the run folders back, where they share no
        files with this machine.
    budget_s : float, optional
        After that long no further trial is started [s]; those left are outcomes, too.
    tell : callable
        Told every outcome as it comes in.
    progress : Progress, optional
    """
    done = {trial: read_outcome(trial) for trial in planned if trial.is_done()}
    for outcome in done.values():
        tell(outcome)
    left = [trial for trial in planned if trial not in done]
    runner = _on_cluster(scheduler, upload) if scheduler else _locally(workers or usable_cores())
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


def _as_they_end(
    planned: Sequence[Trial],
    submit: Submit,
    at_once: int,
    progress: Progress,
    budget_s: float | None,
) -> Iterator[tuple[Trial, Outcome]]:
    """Yield outcomes as trials end, with a sign of life in between."""
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
        ended, _ = wait(running, BEAT_S, FIRST_COMPLETED)
        progress.say("")
        for future in ended:
            progress.advance()
            trial = running.pop(future)
            failure = future.exception()
            yield trial, (read_outcome(trial, str(failure)) if failure else future.result())


def _locally(workers: int) -> Runner:
    """Run trials on this machine; Ctrl-C stops those that run after their present scan."""
    running: set[Process] = set()
    lock, stopping, template = Lock(), Event(), Template()

    def carry_out_here(trial: Trial) -> Outcome:
        """Run a trial and be there to be stopped."""
        process = started(trial, template)
        with lock:
            running.add(process)
            if stopping.is_set():
                process.send_signal(signal.SIGINT)
        try:
            return waited_for(trial, process)
        finally:
            with lock:
                running.discard(process)

    def stop() -> None:
        """Stop every process once; those that are just being started stop themselves."""
        with lock:
            stopping.set()
            for process in running:
                process.send_signal(signal.SIGINT)

    def run(planned: Sequence[Trial], progress: Progress, budget_s: float | None) -> Outcomes:
        """Yield outcomes as trials end."""
        with closing(template), ThreadPoolExecutor(workers) as pool:

            def submit(trial: Trial) -> Future[Outcome]:
                """Hand a trial to a thread."""
                return pool.submit(carry_out_here, trial)

            try:
                yield from _as_they_end(planned, submit, workers, progress, budget_s)
            except BaseException:  # Ctrl-C may strike in whoever takes the outcomes, too
                stop()
                pool.shutdown(wait=True, cancel_futures=True)
                raise

    return run


def _on_cluster(address: str, upload: bool) -> Runner:
    """Run trials on a dask cluster; Ctrl-C stops those that run there, too."""

    def run(planned: Sequence[Trial], progress: Progress, budget_s: float | None) -> Outcomes:
        """Yield outcomes as trials end."""
        import distributed

        from slarm_graph.app.elsewhere import Elsewhere, carry_out_on_worker

        try:
            client = distributed.Client(address, timeout="10s")
        except (OSError, ValueError) as error:
            raise BadInput(f"--scheduler {address}: no dask scheduler answers ({error})") from None
        with client:
            stop = distributed.Event(f"slarm-stop-{uuid.uuid4().hex}", client=client)
            pool = client.get_executor(pure=False, retries=_RETRIES)
            elsewhere = Elsewhere(client) if upload else None

            def submit(trial: Trial) -> Future[Outcome]:
                """Hand a trial to the scheduler."""
                if elsewhere is not None:
                    return elsewhere.submit(pool, trial, stop.name)
                future: Future[Outcome] = pool.submit(carry_out_on_worker, trial, stop.name)
                return future

            at_once = max(1, sum(client.nthreads().values()))
            try:
                yield from _as_they_end(planned, submit, at_once, progress, budget_s)
            except BaseException:
                stop.set()
                raise

    return run
