# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Readings into a backend, one by one: kept going, counted, stopped cleanly, saved on the way."""

from __future__ import annotations

import logging
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

from slarm_graph.app.progress import Progress
from slarm_graph.backend import SlamBackend
from slarm_graph.errors import BadInput
from slarm_graph.reading_log import ReadingLog
from slarm_graph.readings import Source

_log = logging.getLogger(__name__)


SaveState = Callable[[SlamBackend, ReadingLog], None]


class Saver:
    """Saves the backend's state every now and then.

    Parameters
    ----------
    save : callable
        Given the backend and the log.
    every_s : float
        Least wall time between two saves [s].
    """

    def __init__(self, save: SaveState, every_s: float) -> None:
        self._save, self._every_s = save, every_s
        self._saved_s = time.monotonic()

    def maybe(self, backend: SlamBackend, log: ReadingLog) -> None:
        """Save when it is due."""
        if time.monotonic() - self._saved_s >= self._every_s:
            self.now(backend, log)

    def now(self, backend: SlamBackend, log: ReadingLog) -> None:
        """Save at once."""
        self._save(backend, log)
        self._saved_s = time.monotonic()


def feed(
    source: Source,
    backend: SlamBackend,
    saver: Saver,
    progress: Progress,
    taken_until_ns: int | None = None,
) -> ReadingLog:
    """Give a backend every reading it has not had yet, and return the log of all it has had.

    Ctrl-C ends it after the present reading, a second one at once. A failure after the first
    reading ends it too and is noted in the log, so that what is known so far is kept.

    Parameters
    ----------
    source : Source
    backend : SlamBackend
    saver : Saver
    progress : Progress
    taken_until_ns : int, optional
        Stamp of the latest reading that a restored backend has had [ns].

    Raises
    ------
    BadInput
        When the source cannot be read.
    """
    log = ReadingLog()
    progress.start("slam", source.info().scan_count)
    with stop_on_signal() as stop:
        try:
            for reading in source:
                progress.advance()
                is_new = taken_until_ns is None or reading.stamp_ns > taken_until_ns
                if is_new:
                    backend.update(reading)
                log.append(reading)
                if is_new:
                    saver.maybe(backend, log)
                if stop:
                    log.stop("interrupted", by_user=True)
                    break
            saver.now(backend, log)
        except BadInput:
            raise
        except Exception as error:
            if not len(log):
                raise
            log.stop("failed", str(error))
            _log.error(log.problem, exc_info=error)
    log.take_statuses(source)
    return log


@contextmanager
def stop_on_signal() -> Iterator[list[int]]:
    """Collect the first Ctrl-C or termination in a list; the next one acts at once.

    Stopping between readings, never within, keeps the backend's state whole.
    """
    received: list[int] = []

    def on_signal(number: int, _frame: FrameType | None) -> None:
        """Note the first signal and say what will happen; act on the second."""
        if received:
            raise KeyboardInterrupt
        received.append(number)
        _log.warning("stopping after this scan, then writing what is known; again to stop at once")

    try:
        before = [(s, signal.signal(s, on_signal)) for s in (signal.SIGINT, signal.SIGTERM)]
    except ValueError:  # not in the main thread, where signals never arrive
        before = []
    try:
        yield received
    finally:
        for number, handler in before:
            signal.signal(number, handler)
