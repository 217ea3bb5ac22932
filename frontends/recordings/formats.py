# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The seam of recording formats: told by content, opened, looked into and written."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Protocol

from slarm_graph import parts
from slarm_graph.config import RunConfig, SourceConfig, Stage
from slarm_graph.frontends.recordings import BUILT_IN
from slarm_graph.frontends.recordings.findings import Finding
from slarm_graph.readings import Reading, Source

_log = logging.getLogger(__name__)

Sections = Callable[[str], Stage]
"""Gives the settings of a part by its name, as `RunConfig.section` does."""


class RecordingFormat(Protocol):
    """How recordings of one kind are read and written."""

    endings: tuple[str, ...]
    """Of files that `slarm convert` writes in this format; empty where it cannot write."""

    def sniff(self, paths: Sequence[Path]) -> bool:
        """Tell by their content, quickly, whether the files are of this format."""
        ...

    def open(self, paths: Sequence[Path], config: SourceConfig) -> Source:
        """Open the files as readings.

        Raises
        ------
        BadInput
            With one line: what is wrong, where, and how to mend it.
        """
        ...

    def check(self, paths: Sequence[Path], config: SourceConfig) -> Iterable[Finding]:
        """Tell what is wrong with the files, besides what `open` says; a `Look` tells more."""
        ...

    def write(self, destination: Path, readings: Iterable[Reading]) -> int:
        """Write readings, and return how many."""
        ...


def format_of(paths: Sequence[Path], section: Sections | None = None) -> RecordingFormat:
    """Return the format that files are of, by their content."""
    return next(f for f in _registered(section) if f.sniff(paths))


def format_written_as(destination: Path, section: Sections | None = None) -> RecordingFormat:
    """Return the format that a file's ending stands for."""
    name = destination.name
    return next(f for f in _registered(section) if f.endings and name.endswith(f.endings))


def _registered(section: Sections | None) -> Iterator[RecordingFormat]:
    """Build every format that can be used, those of others first; what cannot is told."""
    section = section or RunConfig().section
    names = parts.registered("recording format")
    for name in (*(name for name in names if name not in BUILT_IN), *BUILT_IN):
        try:
            made: RecordingFormat = parts.load("recording format", name)(section(name))
        except Exception as error:  # whatever a stranger's module does: other formats still work
            _log.warning("%s", error)
        else:
            yield made
