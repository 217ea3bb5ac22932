# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""One run of a comparison in a process of its own, and what came of it.

A process dies with the worker that started it, so that two never write into one folder.
"""

from __future__ import annotations

import json
import signal
import subprocess
from collections.abc import Callable
from pathlib import Path

from slarm_graph.app.run_folder import RECORD
from slarm_graph.app.template import PROGRAM, Forked, Template
from slarm_graph.app.tied import started_tied
from slarm_graph.app.trials import Trial
from slarm_graph.eval.comparison import Outcome

Process = Forked | subprocess.Popen[str]
BEAT_S = 1.0
"""Between two looks at what runs; a run that ends in between is noticed at once all the same."""
_RECORDED = ("wall_s", "cpu_s", "peak_memory_mb", "scans_per_s")


def carry_out(
    trial: Trial, template: Template, stop: Callable[[], bool] = lambda: False
) -> Outcome:
    """Run a trial in a process of its own, if it is not done yet, and read what it left."""
    if trial.is_done():
        return read_outcome(trial)
    return waited_for(trial, started(trial, template), stop)


def started(trial: Trial, template: Template) -> Process:
    """Begin a trial in a process that ends with this one."""
    command = trial.command()
    trial.take_folder()
    ours = tuple(command[: len(PROGRAM)]) == PROGRAM
    return template.started(command[len(PROGRAM) :]) if ours else started_tied(command)


def waited_for(trial: Trial, process: Process, stop: Callable[[], bool] = lambda: False) -> Outcome:
    """Wait for a trial's process, interrupt it when that is wished, and read what it left."""
    while True:
        try:
            _, errors = process.communicate(timeout=BEAT_S)
        except subprocess.TimeoutExpired:
            if stop():
                process.send_signal(signal.SIGINT)
            continue
        break
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
        figures | recorded_metrics(trial.folder),
        trial.setting,
        _verdict(trial.folder / "consistency.json"),
    )


def recorded_metrics(folder: Path) -> dict[str, float]:
    """Read the values of a run's metrics, those that there are."""
    try:
        content = json.loads((folder / "metrics.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return {n: m["value"] for n, m in content.items() if m["value"] is not None}


def _verdict(path: Path) -> str:
    """Return what a run says of itself."""
    try:
        return str(json.loads(path.read_text(encoding="utf-8"))["verdict"])
    except (OSError, ValueError, KeyError, TypeError):
        return ""
