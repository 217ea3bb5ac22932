# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""A process that dies with the one that started it, however that one ends.

The starter holds the other end of the process's standard input and never writes to it. When the
starter is gone, killed or not, the system closes that end and the process reads the end of it.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import weakref
from collections.abc import Sequence

_TIED = "SLARM_TIED_TO_STDIN"


def started_tied(command: Sequence[str]) -> subprocess.Popen[str]:
    """Start a process in a session of its own: Ctrl-C does not reach it by itself."""
    theirs, ours = os.pipe()
    try:
        process = subprocess.Popen(
            command,
            stdin=theirs,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            env=tied_environment(),
            start_new_session=True,
        )
    except BaseException:
        os.close(ours)
        raise
    finally:
        os.close(theirs)
    weakref.finalize(process, os.close, ours)
    return process


def tied_environment() -> dict[str, str]:
    """Return the environment of a process that `die_with_starter` ties to its starter."""
    return {**os.environ, "PYTHONUNBUFFERED": "1", _TIED: "1"}


def die_with_starter() -> None:
    """Kill this process as soon as the one that started it tied is gone; else do nothing."""
    if os.environ.pop(_TIED, ""):
        threading.Thread(target=_wait, daemon=True, name="tied to its starter").start()


def _wait() -> None:
    # Not through sys.stdin, whose lock the interpreter takes when it ends.
    while os.read(sys.__stdin__.fileno() if sys.__stdin__ else 0, 1024):
        pass
    os.kill(os.getpid(), signal.SIGKILL)
