# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The interface of recording formats: recognised by content, opened, checked and written."""

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
"""Returns the settings of a part by its name, as `RunConfig.section` does."""


class RecordingFormat(Protocol):
    """Reader and writer of recordings of one format."""

    endings: tuple[str, ...]
    """Extensions that `slarm convert` writes in this format; empty when it cannot write."""

    def sniff(self, paths: Sequence[Path]) -> bool:
        """Return, quickly, whether the files' content is of this format."""
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
        """Return problems of the files, besides errors of `open`; a `Look` also has facts."""
        ...

    def write(self, destination: Path, readings: Iterable[Reading]) -> int:
        """Write readings, and return how many."""
        ...


def format_of(paths: Sequence[Path], section: Sections | None = None) -> RecordingFormat:
    """Return the format of files, by their content."""
    return next(f for f in _registered(section) if f.sniff(paths))


def format_written_as(destination: Path, section: Sections | None = None) -> RecordingFormat:
    """Return the format that a file's extension stands for."""
    name = destination.name
    return next(f for f in _registered(section) if f.endings and name.endswith(f.endings))


def _registered(section: Sections | None) -> Iterator[RecordingFormat]:
    """Build every usable format, those of other packages first; log those that are not usable."""
    section = section or RunConfig().section
    names = parts.registered("recording format")
    for name in (*(name for name in names if name not in BUILT_IN), *BUILT_IN):
        try:
            made: RecordingFormat = parts.load("recording format", name)(section(name))
        except Exception as error:  # whatever a stranger's module does: other formats still work
            _log.warning("%s", error)
        else:
            yield made
