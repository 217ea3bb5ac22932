# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""How far a job is: a bar with rate and time left on a terminal, a line every 10 s elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol, TextIO

LINE_EVERY_S = 10.0
"""Between two lines in a log, so that an hour's run writes a few hundred."""
_DRAW_EVERY_S = 0.1
"""Ten times a second looks smooth and costs nothing that shows."""


class Progress(Protocol):
    """Told what is going on; shows it or not."""

    def start(self, stage: str, total: int | None = None) -> None:
        """Begin a stage of `total` steps, unknown when None."""
        ...

    def advance(self) -> None:
        """One step is done; cheap enough for every scan."""
        ...

    def say(self, message: str) -> None:
        """Tell what a long step is doing: a heartbeat."""
        ...

    def close(self) -> None:
        """End the last stage."""
        ...


class Quiet:
    """Shows nothing."""

    def start(self, stage: str, total: int | None = None) -> None:
        """Ignore the stage."""

    def advance(self) -> None:
        """Ignore the step."""

    def say(self, message: str) -> None:
        """Ignore the message."""

    def close(self) -> None:
        """Do nothing."""


class Lines:
    """Writes a plain line now and then, for logs and pipes.

    Parameters
    ----------
    stream : text stream
    every_s : float
        Least time between two lines of one stage [s].
    """

    def __init__(self, stream: TextIO, every_s: float = LINE_EVERY_S) -> None:
        self._stream, self._every_s = stream, every_s
        self._stage, self._done = "", 0
        self._total: int | None = None
        self._started_s = self._shown_s = time.monotonic()

    def start(self, stage: str, total: int | None = None) -> None:
        """Begin a stage."""
        self._stage, self._total, self._done = stage, total, 0
        self._started_s = self._shown_s = time.monotonic()

    def advance(self) -> None:
        """Count a step, and write a line when one is due."""
        self._done += 1
        self._show("")

    def say(self, message: str) -> None:
        """Write the message when a line is due."""
        self._show(message)

    def close(self) -> None:
        """Do nothing: every line is complete."""

    def _show(self, message: str) -> None:
        now_s = time.monotonic()
        if now_s - self._shown_s < self._every_s:
            return
        self._shown_s = now_s
        elapsed_s = now_s - self._started_s
        parts = [f"{self._stage}:"]
        if self._done:
            parts.append(_rate_words(self._done, self._total, elapsed_s))
        parts.append(message or f"({elapsed_s:.0f} s so far)")
        print(" ".join(parts), file=self._stream, flush=True)


def _rate_words(done: int, total: int | None, elapsed_s: float) -> str:
    rate = done / elapsed_s
    if total is None:
        return f"{done}, {rate:.3g}/s"
    left_s = max(total - done, 0) / rate
    return f"{done} of {total} ({done / max(total, 1):.0%}), {rate:.3g}/s, {left_s:.0f} s left"


class Bar:
    """A live bar on a terminal."""

    def __init__(self) -> None:
        from rich.console import Console
        from rich.progress import (
            BarColumn,
            Progress,
            SpinnerColumn,
            TextColumn,
            TimeElapsedColumn,
            TimeRemainingColumn,
        )

        self._bar = Progress(
            SpinnerColumn(),
            TextColumn("{task.description}"),
            BarColumn(),
            TextColumn("{task.fields[count]}"),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
            TextColumn("{task.fields[words]}"),
            console=Console(stderr=True),
            transient=True,
        )
        self._task = self._bar.add_task("", total=None, count="", words="", start=True)
        self._done = 0
        self._total: int | None = None
        self._started_s = self._drawn_s = 0.0

    def start(self, stage: str, total: int | None = None) -> None:
        """Begin a stage with a fresh bar."""
        self._done, self._total = 0, total
        self._started_s = time.monotonic()
        self._bar.start()
        self._bar.reset(self._task, description=stage, total=total, count="", words="")

    def advance(self) -> None:
        """Count a step; drawn ten times a second."""
        self._done += 1
        now_s = time.monotonic()
        if now_s - self._drawn_s < _DRAW_EVERY_S:
            return
        self._drawn_s = now_s
        rate = self._done / max(now_s - self._started_s, 1e-9)
        of = "" if self._total is None else f" of {self._total}"
        self._bar.update(self._task, completed=self._done, count=f"{self._done}{of}, {rate:.3g}/s")

    def say(self, message: str) -> None:
        """Show the message behind the bar."""
        self._bar.update(self._task, words=message)

    def close(self) -> None:
        """Take the bar away."""
        self._bar.stop()


@contextmanager
def shown() -> Iterator[Progress]:
    """Give a progress fit for where standard error goes, and close it in the end."""
    progress: Progress
    progress = Bar() if sys.stderr.isatty() else Lines(sys.stderr)
    try:
        yield progress
    finally:
        progress.close()
