# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Display of progress: a bar on a terminal, a line every 10 s in logs and pipes."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol, TextIO

LINE_EVERY_S = 10.0
"""Time between two lines in a log, so that an hour's run writes a few hundred."""
_DRAW_EVERY_S = 0.1
"""Time between two drawings: ten a second look smooth and cost nothing measurable."""
_STEPS_KNOWN = 8
"""Steps after the first ones before a rate is shown. With half as many the first loop closure sets
it, with twice as many none is shown of what takes a minute."""
_SHARE_OF_ONE = 0.5
"""Largest share of a rate's time in one step: in a longer one a kernel was compiled (40 s among the
first scans of a first run). With 0.25 long steps hide the rate, with 1 it shows hours left."""


class Progress(Protocol):
    """Receives stages, steps and messages of a run, to display them."""

    def start(self, stage: str, total: int | None = None) -> None:
        """Begin a stage of `total` steps, unknown when None."""
        ...

    def advance(self) -> None:
        """Count a step; cheap enough for every scan."""
        ...

    def say(self, message: str) -> None:
        """Show what a long step is doing: a heartbeat."""
        ...

    def close(self) -> None:
        """End the last stage."""
        ...


class Quiet:
    """A progress that displays nothing."""

    def start(self, stage: str, total: int | None = None) -> None:
        """Ignore the stage."""

    def advance(self) -> None:
        """Ignore the step."""

    def say(self, message: str) -> None:
        """Ignore the message."""

    def close(self) -> None:
        """Do nothing."""


class Pace:
    """Steps done and their rate over the latest half of them, without slow first steps.

    Parameters
    ----------
    total : int, optional
        Steps of the stage, unknown when None.
    """

    def __init__(self, total: int | None = None) -> None:
        self.done, self._total = 0, total
        self.started_s = self._last_s = time.monotonic()
        self._from = self._next = (0, self.started_s)
        self._slowest_s = (0.0, 0.0)

    def advance(self) -> None:
        """Count a step."""
        self.done += 1
        now_s = time.monotonic()
        earlier_s, later_s = self._slowest_s
        self._slowest_s = earlier_s, max(later_s, now_s - self._last_s)
        self._last_s = now_s
        if self.done & (self.done - 1) == 0:
            self._from, self._next = self._next, (self.done, now_s)
            self._slowest_s = self._slowest_s[1], 0.0

    def words(self) -> str:
        """Return the steps done, with rate and time left once they are known."""
        words = [str(self.done) if self._total is None else self._share(self._total)]
        rate = self._rate()
        if rate is not None:
            words.append(f"{rate:.3g}/s")
            if self._total is not None:
                words.append(f"{max(self._total - self.done, 0) / rate:.0f} s left")
        return ", ".join(words)

    def _share(self, total: int) -> str:
        return f"{self.done} of {total} ({self.done / max(total, 1):.0%})"

    def _rate(self) -> float | None:
        """Return the steps per second; None before it is known."""
        now_s = time.monotonic()
        steps, since_s = self.done - self._from[0], now_s - self._from[1]
        few = _STEPS_KNOWN if self._total is None else min(_STEPS_KNOWN, self._total // 8)
        slowest_s = max(*self._slowest_s, now_s - self._last_s)
        if not self._from[0] or steps < few or slowest_s > _SHARE_OF_ONE * since_s:
            return None
        return steps / since_s if since_s > 0.0 else None


class Lines:
    """A progress that writes a plain line at intervals, for logs and pipes.

    Parameters
    ----------
    stream : text stream
    every_s : float
        Least time between two lines of one stage [s].
    """

    def __init__(self, stream: TextIO, every_s: float = LINE_EVERY_S) -> None:
        self._stream, self._every_s = stream, every_s
        self._stage, self._pace = "", Pace()
        self._shown_s = self._pace.started_s

    def start(self, stage: str, total: int | None = None) -> None:
        """Begin a stage."""
        self._stage, self._pace = stage, Pace(total)
        self._shown_s = self._pace.started_s

    def advance(self) -> None:
        """Count a step, and write a line when one is due."""
        self._pace.advance()
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
        parts = [f"{self._stage}:"]
        if self._pace.done:
            parts.append(self._pace.words())
        parts.append(message or f"({now_s - self._pace.started_s:.0f} s so far)")
        print(" ".join(parts), file=self._stream, flush=True)


class Bar:
    """A progress that displays a bar on a terminal."""

    def __init__(self) -> None:
        from rich.console import Console
        from rich.progress import (
            BarColumn,
            Progress,
            SpinnerColumn,
            TextColumn,
            TimeElapsedColumn,
        )

        self._bar = Progress(
            SpinnerColumn(),
            TextColumn("{task.description}"),
            BarColumn(),
            TextColumn("{task.fields[count]}"),
            TimeElapsedColumn(),
            TextColumn("{task.fields[words]}"),
            console=Console(stderr=True),
            transient=True,
        )
        self._task = self._bar.add_task("", total=None, count="", words="", start=True)
        self._pace, self._drawn_s = Pace(), 0.0

    def start(self, stage: str, total: int | None = None) -> None:
        """Begin a stage with a fresh bar."""
        self._pace = Pace(total)
        self._bar.start()
        self._bar.reset(self._task, description=stage, total=total, count="", words="")

    def advance(self) -> None:
        """Count a step; drawn ten times a second."""
        self._pace.advance()
        now_s = time.monotonic()
        if now_s - self._drawn_s < _DRAW_EVERY_S:
            return
        self._drawn_s = now_s
        self._bar.update(self._task, completed=self._pace.done, count=self._pace.words())

    def say(self, message: str) -> None:
        """Show the message behind the bar."""
        self._bar.update(self._task, words=message)

    def close(self) -> None:
        """Take the bar away."""
        self._bar.stop()


@contextmanager
def show_progress() -> Iterator[Progress]:
    """Yield the progress that fits standard error (terminal or not), and close it in the end."""
    progress: Progress
    progress = Bar() if sys.stderr.isatty() else Lines(sys.stderr)
    try:
        yield progress
    finally:
        progress.close()
