# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Trials on the workers of a dask cluster, also of one that shares no files with this machine."""

from __future__ import annotations

import atexit
import shutil
import tempfile
from concurrent.futures import Future
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

from slarm_graph.app.outcomes import carry_out, read_outcome
from slarm_graph.app.template import Template
from slarm_graph.app.trials import Trial
from slarm_graph.eval.comparison import Outcome

Files = dict[str, bytes]
"""Contents by path, relative to the folder that they share."""


def carry_out_on_worker(trial: Trial, stop: str) -> Outcome:
    """Run a trial on a worker that sees the comparison's folder.

    Parameters
    ----------
    trial : Trial
    stop : str
        Name of the event by which runs are asked to stop.
    """
    import distributed

    event = distributed.Event(stop)
    return carry_out(trial, _template(), lambda: bool(event.is_set()))


@cache
def _template() -> Template:
    """Return what a worker starts all its runs with."""
    template = Template()
    atexit.register(template.close)
    return template


def carry_out_uploaded(trial: Trial, files: Files, stop: str) -> Files:
    """Run a trial on a worker that sees nothing of ours, and return its run folder."""
    with tempfile.TemporaryDirectory(prefix="slarm-") as place:
        folder = Path(place)
        for name, content in files.items():
            path = folder / "source" / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
        moved = _moved(trial, folder)
        outcome = carry_out_on_worker(moved, stop)
        found = _contents(moved.folder)
        return found or {"problem.txt": outcome.problem.encode()}


class Elsewhere:
    """Sends sources out and takes run folders back."""

    def __init__(self, client: Any) -> None:
        self._client = client
        self._sent: dict[str, Any] = {}

    def submit(self, pool: Any, trial: Trial, stop: str) -> Future[Outcome]:
        """Hand a trial with its source to the scheduler; a source is sent once."""
        place = trial.source.place
        if place not in self._sent:
            files = _source_files(trial)
            self._sent[place] = self._client.scatter([files], broadcast=False, hash=False)[0]
        raw = self._client.submit(carry_out_uploaded, trial, self._sent[place], stop, pure=False)
        outcome: Future[Outcome] = Future()
        raw.add_done_callback(lambda done: _deliver(done, trial, outcome))
        return outcome


def _deliver(done: Any, trial: Trial, outcome: Future[Outcome]) -> None:
    """Unpack a run folder that came back, and tell what is in it."""
    try:
        files = done.result()
        shutil.rmtree(trial.folder, ignore_errors=True)
        trial.take_folder()
        for name, content in files.items():
            path = (trial.folder / name).resolve()
            if trial.folder.resolve() in path.parents:
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(content)
        outcome.set_result(read_outcome(trial, files.get("problem.txt", b"").decode()))
    except BaseException as error:
        outcome.set_exception(error)


def _source_files(trial: Trial) -> Files:
    """Read a source and every file that the options name, by their names on the worker."""
    source, files = Path(trial.source.place), Files()
    if source.is_dir():
        files |= {f"{source.name}/{name}": data for name, data in _contents(source).items()}
    for word in (trial.source.place, *trial.options):
        path = Path(word)
        if path.is_absolute() and path.is_file():
            files[path.name] = path.read_bytes()
    return files


def _moved(trial: Trial, folder: Path) -> Trial:
    """Return a trial as it is on the worker."""

    def there(word: str) -> str:
        """Return where a file named here lies there; other words as they are."""
        path = folder / "source" / Path(word).name
        return str(path) if Path(word).is_absolute() and path.exists() else word

    return replace(
        trial,
        source=replace(trial.source, place=there(trial.source.place)),
        folder=folder / trial.folder.name,
        options=tuple(map(there, trial.options)),
    )


def _contents(folder: Path) -> Files:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }
