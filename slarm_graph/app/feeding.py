# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The loop over readings: backend updates, progress, checkpoints, early end."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager

from slarm_graph.app.allocation import return_freed
from slarm_graph.app.checkpoint import Checkpoint
from slarm_graph.app.ending import Stop
from slarm_graph.app.progress import Progress
from slarm_graph.backend import SlamBackend
from slarm_graph.errors import BadInput
from slarm_graph.reading_log import ReadingLog
from slarm_graph.readings import Source

_log = logging.getLogger(__name__)
_LOADED_AFTER = (64, 256, 1024, 4096)
"""Readings after which freed memory is returned: code loaded by then has mostly run once. A whole
run of mit-csail takes the same memory within 2 MB with half and with double of each."""


def feed(
    source: Source,
    backend: SlamBackend,
    log: ReadingLog,
    checkpoint: Checkpoint,
    progress: Progress,
    stop: Stop,
    *,
    had_before: int = 0,
) -> None:
    """Update a backend with every reading that it has not had yet.

    Ctrl-C or a limit ends the loop after the present reading, a second Ctrl-C at once. A failure
    after the first reading ends it, too, and is noted in the log, so that results so far are kept.

    Parameters
    ----------
    source : Source
    backend : SlamBackend
    log : ReadingLog
        Empty; is filled with every reading that the backend has had.
    checkpoint : Checkpoint
    progress : Progress
    stop : Stop
    had_before : int
        Number of readings that a restored backend has had.

    Raises
    ------
    BadInput
        When the source cannot be read.
    """
    progress.start("slam", source.info().scan_count)
    with stop.on_signals(), log_early_end(log):
        for reading in source:
            progress.advance()
            if len(log) >= had_before:
                backend.update(reading)
            log.append(reading)
            if len(log) in _LOADED_AFTER:
                return_freed()
            if len(log) > had_before:
                checkpoint.write_if_due()
            if reason := stop.reason():
                log.stop(reason, by_user=stop.by_user)
                break
        checkpoint.write_last(ended_early=bool(log.problem))
    log.take_statuses(source)


@contextmanager
def log_early_end(log: ReadingLog) -> Iterator[None]:
    """Note a failure of the block in the log; raise only input errors, or without any reading."""
    try:
        yield
    except BadInput:
        raise
    except Exception as error:
        if not len(log):
            raise
        log.stop("failed", str(error))
        _log.error(log.problem, exc_info=error)
