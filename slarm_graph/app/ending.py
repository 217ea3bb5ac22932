# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Ending early and in time: on a signal, or at a limit of time or memory that was set.

Between two readings a run is asked to stop, and then writes what is known. Should that take longer
than anybody waits for a program that was told to stop, or need more memory than it may have, the
process is ended from a thread of its own; files are whole or absent at any time.
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
"""Exit codes as the README tells them; 130 is what shells give for 128 + SIGINT."""
GRACE_S: Final = 1.2
"""From a signal to the end of the process, of the two seconds that a terminal's user waits."""
_POLL_S: Final = 0.05
"""Between two looks at the memory; rendering fills a gigabyte in ten times this."""
_KEEP_SHARE: Final = 0.8
"""Share of the memory from which on no more is read, so that what is known can be written; with
half of it a limit of 1 GB would end runs that need 500 MB."""
_MB: Final = 1e6
"""Bytes of a megabyte (SI), the unit of `--max-memory`."""

LastWords = Callable[[str], None]
"""Records and tells why the process ends now."""
_last_words: list[LastWords] = []


class Recorded(Protocol):
    """Work whose record says that it is under way until it says how it ended."""

    def end_early(self, why: str, *, by_user: bool) -> None:
        """Record that it ended before its end."""
        ...

    def how_to_go_on(self, why: str) -> Iterator[str]:
        """Say why it is not whole, and how to go on."""
        ...


_under_way: WeakSet[Recorded] = WeakSet()


def begun(work: Recorded) -> None:
    """Let work be recorded as ended when the program ends, whatever it is doing then."""
    _under_way.add(work)


def ended(work: Recorded) -> None:
    """Take note that work is recorded as ended."""
    _under_way.discard(work)


def end_what_is_under_way(why: str, *, by_user: bool) -> Iterator[str]:
    """Record that it ended before its end; what a user did it to is told how to go on."""
    for work in list(_under_way):
        work.end_early(why, by_user=by_user)
        if by_user:
            yield from work.how_to_go_on(why)


def end_on_signals() -> None:
    """From now on end the process some time after SIGINT or SIGTERM, if it has not ended by then.

    Only while there are last words; without them whoever receives the exception is quick.
    """
    ours, theirs = socket.socketpair()
    theirs.setblocking(False)
    signal.set_wakeup_fd(theirs.fileno(), warn_on_full_buffer=False)

    def wait() -> None:
        """Wait for a signal, whatever the main thread is doing."""
        while ours.recv(1)[0] not in (signal.SIGINT, signal.SIGTERM):
            pass
        time.sleep(GRACE_S)
        if _last_words:
            _end_now("interrupted", 128 + signal.SIGINT)
        theirs.close()

    threading.Thread(target=wait, name="end-on-signals", daemon=True).start()


@contextmanager
def last_words(words: LastWords, limits: LimitsConfig) -> Iterator[None]:
    """Say what to do before the process is ended while the block runs, and end it at the limit."""
    done = threading.Event()
    _last_words.append(words)
    if limits.max_memory_mb is not None:
        watch = threading.Thread(target=_watch_memory, args=(limits.max_memory_mb, done))
        watch.daemon = True
        watch.start()
    try:
        yield
    finally:
        done.set()
        _last_words.remove(words)


def _watch_memory(limit_mb: float, done: threading.Event) -> None:
    while not done.wait(_POLL_S):
        if memory_mb() > limit_mb:
            _end_now(f"stopped: more than --max-memory {limit_mb:g} MB were needed", 1)


def _end_now(why: str, code: int) -> NoReturn:
    try:
        for words in reversed(_last_words):
            words(why)
        sys.stderr.flush()
    finally:
        os._exit(code)


class Stop:
    """Whether a run should stop after the present reading, and why."""

    def __init__(self, limits: LimitsConfig) -> None:
        self._limits = limits
        self._started_s = time.monotonic()
        self.by_user = False

    def why(self) -> str:
        """Return why to stop, empty for not at all."""
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
        """Take the first Ctrl-C or termination as a wish; the next one acts at once.

        Stopping between readings, never within, keeps the backend's state whole.
        """

        def on_signal(_number: int, _frame: FrameType | None) -> None:
            """Note the first signal and say what will happen; act on the second."""
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
    """Memory that the process occupies now [MB]; 0 where the system does not say."""
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    except (OSError, ValueError, IndexError):
        return 0.0
    return pages * os.sysconf("SC_PAGE_SIZE") / _MB
