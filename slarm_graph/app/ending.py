# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Early end of a run: on a signal, or at a limit of time or memory.

A run checks between two readings whether to stop, and then writes its results so far. When that
takes longer than a grace period after the signal, or exceeds the memory limit, a separate thread
ends the process; files are whole or absent at any time.
"""

from __future__ import annotations

import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Final, NoReturn, Protocol
from weakref import WeakSet

if TYPE_CHECKING:
    from slarm_graph.config import LimitsConfig

OK, FAILED, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130
"""Exit codes, listed in the README; 130 is 128 + SIGINT, as in shells."""
GRACE_S: Final = 1.2
"""Time from a signal to the forced end, of the two seconds within which a run has to end."""
_POLL_S: Final = 0.05
"""Interval of checking the memory; rendering fills a gigabyte in ten times this."""
_KEEP_SHARE: Final = 0.8
"""Share of the memory limit at which reading stops, so that results can still be written; with half
of it a limit of 1 GB would end runs that need 500 MB."""
_MB: Final = 1e6
"""Bytes of a megabyte (SI), the unit of `--max-memory`."""

ExitHandler = Callable[[str], None]
"""Is called with the reason before the process is ended; records and prints it."""
_exit_handlers: list[ExitHandler] = []


class Unfinished(Protocol):
    """Work whose record has the status `running` until its end is recorded."""

    def end_early(self, why: str, *, by_user: bool) -> None:
        """Record that the work ended early."""
        ...

    def resume_hints(self, why: str) -> Iterator[str]:
        """Yield lines for the user: why the work is incomplete, how to resume it."""
        ...


_unfinished: WeakSet[Unfinished] = WeakSet()


def register_unfinished(work: Unfinished) -> None:
    """Have the end of this work recorded when the program ends early."""
    _unfinished.add(work)


def unregister_unfinished(work: Unfinished) -> None:
    """Forget work whose end has been recorded."""
    _unfinished.discard(work)


def end_unfinished(why: str, *, by_user: bool) -> Iterator[str]:
    """Record the early end of all unfinished work; after a user's interrupt yield how to resume."""
    for work in list(_unfinished):
        work.end_early(why, by_user=by_user)
        if by_user:
            yield from work.resume_hints(why)


def exit_after_signals() -> None:
    """From now on end the process `GRACE_S` after SIGINT or SIGTERM, if it has not ended by then.

    Only while there is an exit handler; without one the exception ends the process at once.
    """
    ours, theirs = socket.socketpair()
    theirs.setblocking(False)
    signal.set_wakeup_fd(theirs.fileno(), warn_on_full_buffer=False)

    def wait() -> None:
        """Wait for a signal and the grace period, whatever the main thread is doing."""
        while ours.recv(1)[0] not in (signal.SIGINT, signal.SIGTERM):
            pass
        time.sleep(GRACE_S)
        if _exit_handlers:
            _exit_now("interrupted", 128 + signal.SIGINT)
        theirs.close()

    threading.Thread(target=wait, name="end-on-signals", daemon=True).start()


@contextmanager
def exit_handler(handler: ExitHandler, limits: LimitsConfig) -> Iterator[None]:
    """Call `handler` when the process is ended while the block runs; end it at the memory limit."""
    done = threading.Event()
    _exit_handlers.append(handler)
    if limits.max_memory_mb is not None:
        watch = threading.Thread(target=_watch_memory, args=(limits.max_memory_mb, done))
        watch.daemon = True
        watch.start()
    try:
        yield
    finally:
        done.set()
        _exit_handlers.remove(handler)


def _watch_memory(limit_mb: float, done: threading.Event) -> None:
    while not done.wait(_POLL_S):
        if memory_mb() > limit_mb:
            _exit_now(f"stopped: more than --max-memory {limit_mb:g} MB were needed", 1)


def _exit_now(why: str, code: int) -> NoReturn:
    try:
        for handler in reversed(_exit_handlers):
            handler(why)
        sys.stderr.flush()
    finally:
        os._exit(code)


class Stop:
    """Whether a run should stop after the present reading, and why."""

    def __init__(self, limits: LimitsConfig) -> None:
        self._limits = limits
        self._started_s = time.monotonic()
        self.by_user = False

    def reason(self) -> str:
        """Return the reason to stop; empty for none."""
        if self.by_user:
            return "interrupted"
        most_s, most_mb = self._limits.max_time_s, self._limits.max_memory_mb
        if most_s is not None and time.monotonic() - self._started_s >= most_s:
            return f"stopped by --max-time {most_s:g}"
        if most_mb is not None and memory_mb() > _KEEP_SHARE * most_mb:
            return f"stopped by --max-memory {most_mb:g}"
        return ""

    @contextmanager
    def on_signals(self) -> Iterator[None]:
        """Stop after the present reading on the first SIGINT or SIGTERM, at once on the second.

        Stopping between readings, never within, keeps the backend's state whole.
        """

        def on_signal(_number: int, _frame: FrameType | None) -> None:
            """Note the first signal and print what will happen; raise on the second."""
            if self.by_user:
                raise KeyboardInterrupt
            self.by_user = True
            text = "slarm: stopping after this scan, then writing what is known; again to stop now"
            print(text, file=sys.stderr)

        try:
            before = [(s, signal.signal(s, on_signal)) for s in (signal.SIGINT, signal.SIGTERM)]
        except ValueError:  # not in the main thread, where signals never arrive
            before = []
        try:
            yield
        finally:
            for number, handler in before:
                signal.signal(number, handler)


def memory_mb() -> float:
    """Return the resident memory of the process [MB]; 0 where the system does not tell."""
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    except (OSError, ValueError, IndexError):
        return 0.0
    return pages * os.sysconf("SC_PAGE_SIZE") / _MB
