# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Execution of a trial in a process of its own, and its outcome.

A process exits with the worker that started it, so that two never write into one folder.
"""

from __future__ import annotations

import json
import signal
import subprocess
from collections.abc import Callable
from pathlib import Path

from slarm_graph.app.child_process import start_child
from slarm_graph.app.fork_server import PROGRAM, ForkedProcess, ForkServer
from slarm_graph.app.run_folder import RECORD
from slarm_graph.app.trials import Trial
from slarm_graph.eval.comparison import Outcome

Process = ForkedProcess | subprocess.Popen[str]
POLL_S = 1.0
"""Longest wait until running processes are checked again; one that ends is noticed at once."""
_RECORDED = ("wall_s", "cpu_s", "peak_memory_mb", "scans_per_s")


def carry_out(
    trial: Trial, server: ForkServer, stop: Callable[[], bool] = lambda: False
) -> Outcome:
    """Run a trial in a process of its own, unless it is done, and return its outcome."""
    if trial.is_done():
        return read_outcome(trial)
    return wait_for(trial, start_trial(trial, server), stop)


def start_trial(trial: Trial, server: ForkServer) -> Process:
    """Start a trial in a process that exits with this one."""
    command = trial.command()
    trial.assign_folder()
    ours = tuple(command[: len(PROGRAM)]) == PROGRAM
    return server.start(command[len(PROGRAM) :]) if ours else start_child(command)


def wait_for(trial: Trial, process: Process, stop: Callable[[], bool] = lambda: False) -> Outcome:
    """Wait for a trial's process, interrupt it when `stop` says so, and return the outcome."""
    while True:
        try:
            _, errors = process.communicate(timeout=POLL_S)
        except subprocess.TimeoutExpired:
            if stop():
                process.send_signal(signal.SIGINT)
            continue
        break
    lines = errors.strip().splitlines()
    problem = lines[-1].removeprefix("slarm: ") if lines and process.returncode else ""
    return read_outcome(trial, problem or f"exit code {process.returncode}")


def read_outcome(trial: Trial, problem: str = "") -> Outcome:
    """Read a finished trial's record and metrics.

    Parameters
    ----------
    trial : Trial
    problem : str
        Last message of its process, used when it left no record.
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
        figures | recorded_metrics(trial.folder),
        trial.setting,
        _verdict(trial.folder / "consistency.json"),
    )


def recorded_metrics(folder: Path) -> dict[str, float]:
    """Read the values of a run's metrics; empty without a readable file."""
    try:
        content = json.loads((folder / "metrics.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return {n: m["value"] for n, m in content.items() if m["value"] is not None}


def _verdict(path: Path) -> str:
    """Read a run's verdict on its consistency; empty without a readable file."""
    try:
        return str(json.loads(path.read_text(encoding="utf-8"))["verdict"])
    except (OSError, ValueError, KeyError, TypeError):
        return ""
