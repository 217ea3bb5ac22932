# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The folder of one run: made before the first scan, every file complete or absent."""

from __future__ import annotations

import errno
import json
import logging
import os
import resource
import sys
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path

from slarm_graph.app.allocation import return_freed
from slarm_graph.app.ending import register_unfinished, unregister_unfinished
from slarm_graph.app.folder_lock import FolderLock
from slarm_graph.app.progress import Progress
from slarm_graph.app.provenance import Facts, git_revision, versions
from slarm_graph.errors import BadInput, RunFailed
from slarm_graph.geometry import Pose2

_log = logging.getLogger(__name__)

RECORD = "run.json"
CHECKPOINT = "checkpoint"
_RUNNING = "running"
_LINK, _LINK_TEXT = "latest", "latest.txt"
_MB = 1024.0
"""Kilobytes of a megabyte: Linux reports memory in kilobytes, macOS in bytes."""


class RunFolder:
    """The folder of one run: its files and its record `run.json`.

    Parameters
    ----------
    path : Path
        An existing folder.
    earlier : mapping, optional
        The record to continue, such as that of an interrupted run that is resumed here.
    lock : FolderLock, optional
        On the folder, where it is locked already.
    """

    def __init__(
        self,
        path: Path,
        earlier: Mapping[str, object] | None = None,
        *,
        lock: FolderLock | None = None,
    ) -> None:
        self.path = path
        self._lock = lock or FolderLock(path)
        self._facts: Facts = dict(earlier or {})
        self._stages: dict[str, float] = {}
        self._stages_cpu_s: dict[str, float] = {}
        self._peaks_mb: dict[str, float] = {}
        self._earlier_s = _seconds(self._facts, "wall_s"), _seconds(self._facts, "cpu_s")
        self._started_s = time.monotonic()
        self._cpu_started_s = time.process_time()
        self._facts.setdefault("started", datetime.now().astimezone().isoformat(timespec="seconds"))
        register_unfinished(self)  # before the status `running`, so that it never stays at that
        self.note(
            status=_RUNNING,
            versions=versions(),
            git_revision=git_revision(),
            argv=list(sys.argv),
        )

    @contextmanager
    def replacing(self, name: str) -> Iterator[Path]:
        """Yield a temporary path to write, which is renamed to the file's name once complete."""
        if not self._lock.is_at(self.path):
            raise RunFailed(f"{self.path} was removed under way; nothing can be written there")
        target = self.path / name
        target.parent.mkdir(parents=True, exist_ok=True)
        thread = threading.current_thread()
        writer = "" if thread is threading.main_thread() else f".{thread.ident}"
        temporary = target.with_name(f".{target.stem}.partial{writer}{target.suffix}")
        try:
            yield temporary
            temporary.replace(target)
        finally:
            temporary.unlink(missing_ok=True)

    def write_text(self, name: str, text: str) -> None:
        """Write a text file atomically."""
        self.write_bytes(name, text.encode())

    def write_bytes(self, name: str, data: bytes) -> None:
        """Write a file atomically."""
        with self.replacing(name) as temporary:
            temporary.write_bytes(data)

    @contextmanager
    def stage(self, name: str, progress: Progress) -> Iterator[None]:
        """Show a stage of the flow, and record its time and memory."""
        progress.start(name)
        started_s, cpu_started_s = time.monotonic(), time.process_time()
        try:
            yield
        finally:
            spent_s = time.monotonic() - started_s
            _add(self._stages, name, spent_s)
            _add(self._stages_cpu_s, name, time.process_time() - cpu_started_s)
            return_freed()
            self._peaks_mb[name] = round(_peak_memory_mb(), 1)
            _log.info("%s took %.2f s", name, spent_s)
            self.note()

    def note(self, **facts: object) -> None:
        """Add facts to the record, update its times and write it."""
        self._facts.update(facts)
        wall_s = self._earlier_s[0] + time.monotonic() - self._started_s
        cpu_s = self._earlier_s[1] + time.process_time() - self._cpu_started_s
        self._facts |= {
            "wall_s": round(wall_s, 3),
            "cpu_s": round(cpu_s, 3),
            "peak_memory_mb": round(_peak_memory_mb(), 1),
            "stages": dict(self._stages),
            "stage_cpu_s": dict(self._stages_cpu_s),
            "stage_peak_mb": dict(self._peaks_mb),
        }
        self.write_text(RECORD, json.dumps(self._facts, indent=2) + "\n")
        if self._facts["status"] != _RUNNING:
            unregister_unfinished(self)

    def end_early(self, why: str, *, by_user: bool) -> None:
        """Record why the run ended early; `partial` where it has results or a user ended it."""
        more = by_user or (self.path / "trajectory.tum").is_file()
        self.note(status="partial" if more else "failed", problem=why)

    def resume_hints(self, why: str) -> Iterator[str]:
        """Yield lines for the user: why the run is incomplete, where it lies, how to resume it."""
        yield f"{why}; partial results are in {self.path}"
        if (self.path / CHECKPOINT).is_dir():
            yield f"go on with: slarm run --resume {self.path}"

    def record(self) -> Mapping[str, object]:
        """Return the record, as in `run.json`."""
        return dict(self._facts)


def create_run_folder(
    out: Path, name: str | None = None, *, overwrite: bool = False, kind: str = "run"
) -> RunFolder:
    """Make `OUT/<date_time>[_NN]`, or `OUT/NAME`, and point `OUT/latest` to it.

    Its record has the kind of work from the beginning (`was_begun`).

    Raises
    ------
    BadInput
        When nothing can be written there, another process is at work in it, or NAME is a folder
        with something in it: with `overwrite`, something else than a run.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
        path = _fresh(out) if name is None else _named(out, name)
        lock = FolderLock(path)
        if name is not None:
            _empty_folder(path, overwrite=overwrite)
        folder = RunFolder(path, {"kind": kind}, lock=lock)
        _link_latest(out, path.name)
    except OSError as error:
        if error.errno == errno.ENAMETOOLONG:
            raise BadInput(
                f"{out}, --name {name}: {error.strerror}; choose a shorter one"
            ) from None
        raise BadInput(
            f"cannot write to {out}: {error.strerror}; choose a folder with --out"
        ) from None
    return folder


def open_run_folder(path: Path) -> RunFolder:
    """Open an unfinished run's folder to resume the run.

    Raises
    ------
    BadInput
        When it is no run folder, or the run is finished.
    """
    read_record(path)
    lock = FolderLock(path)
    record = read_record(path)
    if record.get("status") == "ok":
        raise BadInput(f"{path}: this run is finished; there is nothing to resume")
    return RunFolder(path, record, lock=lock)


def was_begun(path: Path, kind: str) -> bool:
    """Whether a folder holds work of this kind, finished or not."""
    return (path / RECORD).is_file() and read_record(path).get("kind") == kind


def read_record(path: Path) -> Mapping[str, object]:
    """Read `run.json` of a run folder.

    Raises
    ------
    BadInput
        When there is none, or it cannot be read.
    """
    try:
        record = json.loads((path / RECORD).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        raise BadInput(f"{path}: not a run folder (no readable {RECORD} in it)") from None
    if not isinstance(record, dict):
        raise BadInput(f"{path}: not a run folder ({RECORD} is damaged)")
    return record


def recorded_laser(path: Path) -> Pose2 | None:
    """Return `robot_from_laser` as a run recorded it; None where there is no record of it."""
    try:
        found = read_record(path).get("robot_from_laser")
    except BadInput:
        return None
    return Pose2(*found) if isinstance(found, list) and len(found) == 3 else None


def _fresh(out: Path) -> Path:
    base = datetime.now().strftime("%Y-%m-%d_%H-%M-%S")
    for number in range(1, 1000):
        path = out / (base if number == 1 else f"{base}_{number:02d}")
        try:
            path.mkdir()
        except FileExistsError:
            continue
        return path
    raise BadInput(f"cannot find a free folder name below {out}")


def _named(out: Path, name: str) -> Path:
    path = out / name
    if path.parent != out or name in (_LINK, "..", ""):
        raise BadInput(f"--name {name}: expected a plain folder name")
    path.mkdir(exist_ok=True)
    return path


def _empty_folder(path: Path, *, overwrite: bool) -> None:
    """Empty a folder; results in it are removed only with `overwrite`, else refused."""
    if not any(entry.is_file() for entry in path.iterdir()):
        return
    if not (path / RECORD).is_file():
        raise BadInput(f"{path} holds something that is not a run; choose another --name")
    if not overwrite:
        status = str(read_record(path).get("status"))
        go_on = "" if status == "ok" else f"go on with it by --resume {path}, "
        raise BadInput(
            f"{path} holds a run already ({status[:20]}); {go_on}choose another --name, or"
            " replace it with --overwrite"
        )
    _clear(path)


def _clear(path: Path) -> None:
    """Remove an earlier run's files and checkpoint; other folders below stay."""
    for folder in (path, path / CHECKPOINT):
        if folder.is_dir():
            for entry in folder.iterdir():
                if entry.is_file():
                    entry.unlink()


def _link_latest(out: Path, name: str) -> None:
    """Point `latest` to the run: a relative link, or a text file where links are impossible."""
    link, temporary = out / _LINK, out / f".{_LINK}.{os.getpid()}"
    try:
        temporary.symlink_to(name, target_is_directory=True)
        temporary.replace(link)
    except (OSError, NotImplementedError):
        temporary.unlink(missing_ok=True)
        (out / _LINK_TEXT).write_text(f"{name}\n", encoding="utf-8")


def _add(spent: dict[str, float], name: str, seconds: float) -> None:
    """Add to the seconds of a stage, rounded to milliseconds."""
    spent[name] = round(spent.get(name, 0.0) + seconds, 3)


def _seconds(facts: Facts, key: str) -> float:
    value = facts.get(key, 0.0)
    return float(value) if isinstance(value, (int, float)) else 0.0


def _peak_memory_mb() -> float:
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / _MB
    return peak / _MB if sys.platform == "darwin" else peak
