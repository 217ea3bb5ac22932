# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Trials on the workers of a dask cluster, with or without a shared file system."""

from __future__ import annotations

import atexit
import shutil
import tempfile
from concurrent.futures import Future
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

from slarm_graph.app.fork_server import ForkServer
from slarm_graph.app.outcomes import carry_out, read_outcome
from slarm_graph.app.trials import Trial
from slarm_graph.eval.comparison import Outcome

Files = dict[str, bytes]
"""Contents of files by their path relative to a common folder."""


def carry_out_on_worker(trial: Trial, stop: str) -> Outcome:
    """Run a trial on a worker that shares the comparison's folder.

    Parameters
    ----------
    trial : Trial
    stop : str
        Name of the dask event that asks runs to stop.
    """
    import distributed

    event = distributed.Event(stop)
    return carry_out(trial, _fork_server(), lambda: bool(event.is_set()))


@cache
def _fork_server() -> ForkServer:
    """Return the fork server of this worker."""
    server = ForkServer()
    atexit.register(server.close)
    return server


def carry_out_uploaded(trial: Trial, files: Files, stop: str) -> Files:
    """Run a trial on a worker without a shared file system; return its run folder's files."""
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


class UploadingClient:
    """Sends trials with their sources to a cluster and stores the run folders that come back."""

    def __init__(self, client: Any) -> None:
        self._client = client
        self._sent: dict[str, Any] = {}

    def submit(self, pool: Any, trial: Trial, stop: str) -> Future[Outcome]:
        """Submit a trial with its source; each source is sent once."""
        place = trial.source.place
        if place not in self._sent:
            files = _source_files(trial)
            self._sent[place] = self._client.scatter([files], broadcast=False, hash=False)[0]
        raw = self._client.submit(carry_out_uploaded, trial, self._sent[place], stop, pure=False)
        outcome: Future[Outcome] = Future()
        raw.add_done_callback(lambda done: _deliver(done, trial, outcome))
        return outcome


def _deliver(done: Any, trial: Trial, outcome: Future[Outcome]) -> None:
    """Write the run folder that came back, and resolve the future with its outcome."""
    try:
        files = done.result()
        shutil.rmtree(trial.folder, ignore_errors=True)
        trial.assign_folder()
        for name, content in files.items():
            path = (trial.folder / name).resolve()
            if trial.folder.resolve() in path.parents:
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(content)
        outcome.set_result(read_outcome(trial, files.get("problem.txt", b"").decode()))
    except BaseException as error:
        outcome.set_exception(error)


def _source_files(trial: Trial) -> Files:
    """Read a source and every file that the options name; keys are their paths on the worker."""
    source, files = Path(trial.source.place), Files()
    if source.is_dir():
        files |= {f"{source.name}/{name}": data for name, data in _contents(source).items()}
    for word in (trial.source.place, *trial.options):
        path = Path(word)
        if path.is_absolute() and path.is_file():
            files[path.name] = path.read_bytes()
    return files


def _moved(trial: Trial, folder: Path) -> Trial:
    """Return the trial with the paths that it has on the worker."""

    def there(word: str) -> str:
        """Return a file's path on the worker; other words unchanged."""
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
