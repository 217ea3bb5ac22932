# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""A trial, one run of a comparison: its command line, its folder, and whether it is done."""

from __future__ import annotations

import json
import shutil
from dataclasses import dataclass, field
from pathlib import Path

from slarm_graph.app.fork_server import PROGRAM
from slarm_graph.app.reference_files import ReferenceFiles
from slarm_graph.app.run_folder import RECORD

KEYS = "cells"
"""Subfolder of a comparison with a file per trial that holds its key."""


@dataclass(frozen=True, slots=True)
class TrialSource:
    """A recording, or a world to be explored.

    Parameters
    ----------
    place : str
        Path; of a world also the name of a shipped one.
    is_world : bool
    truth : ReferenceFiles
        Of a recording.
    """

    place: str
    is_world: bool
    truth: ReferenceFiles = field(default_factory=ReferenceFiles)


@dataclass(frozen=True, slots=True)
class Trial:
    """One run of a comparison: a cell of its table.

    Parameters
    ----------
    source : TrialSource
    backend : str
    seed : int
    folder : Path
        Its run folder, below the comparison's.
    options : tuple of str
        Further command-line arguments.
    setting : str
        Swept settings, as `KEY=VALUE` words; empty without a sweep.
    key : str
        Hash of everything that its result depends on; empty: never taken as done.
    """

    source: TrialSource
    backend: str
    seed: int
    folder: Path
    options: tuple[str, ...] = ()
    setting: str = ""
    key: str = ""

    def command(self) -> list[str]:
        """Return the command line of the run; it resumes an unfinished one."""
        if self._is_unfinished():
            return [*PROGRAM, "run", "--resume", str(self.folder)]
        place = self.source.place
        what = ("explore", "--world", place) if self.source.is_world else ("run", place)
        return [
            *PROGRAM,
            *what,
            *("--backend", self.backend, "--seed", str(self.seed)),
            *("--out", str(self.folder.parent), "--name", self.folder.name, "--overwrite"),
            *self.options,
        ]

    def is_done(self) -> bool:
        """Whether the folder holds this very run, finished."""
        return self._has_this_key() and self._status() == "ok"

    def _is_unfinished(self) -> bool:
        """Whether the folder holds this very run, unfinished and with a checkpoint."""
        there = (self.folder / "checkpoint").is_dir() and self._status() in ("running", "partial")
        return self._has_this_key() and there

    def _has_this_key(self) -> bool:
        try:
            return bool(self.key) and self._key_file().read_text(encoding="utf-8") == self.key
        except OSError:
            return False

    def _status(self) -> str:
        try:
            return str(json.loads((self.folder / RECORD).read_text(encoding="utf-8"))["status"])
        except (OSError, ValueError, KeyError, TypeError):
            return ""

    def _key_file(self) -> Path:
        return self.folder.parent / KEYS / self.folder.name

    def assign_folder(self) -> None:
        """Assign the folder to this trial: write the key, remove another trial's run."""
        if not self.key or self._has_this_key():
            return
        file = self._key_file()
        file.parent.mkdir(parents=True, exist_ok=True)
        # Another run's record must never be taken for this one's.
        if (self.folder / RECORD).is_file():
            shutil.rmtree(self.folder)
        file.write_text(self.key, encoding="utf-8")
