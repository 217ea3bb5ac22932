# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Child processes that exit with their parent, however the parent ends.

The parent holds the other end of the child's standard input and never writes to it. When the parent
is gone, killed or not, the system closes that end and the child reads end of file.
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


def start_child(command: Sequence[str]) -> subprocess.Popen[str]:
    """Start a child in a session of its own: Ctrl-C on the terminal does not reach it."""
    theirs, ours = os.pipe()
    try:
        process = subprocess.Popen(
            command,
            stdin=theirs,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            env=child_environment(),
            start_new_session=True,
        )
    except BaseException:
        os.close(ours)
        raise
    finally:
        os.close(theirs)
    weakref.finalize(process, os.close, ours)
    return process


def child_environment() -> dict[str, str]:
    """Return the environment of a child in which `exit_with_parent` takes effect."""
    return {**os.environ, "PYTHONUNBUFFERED": "1", _TIED: "1"}


def exit_with_parent() -> None:
    """Kill this process as soon as its parent is gone, when `start_child` started it."""
    if os.environ.pop(_TIED, ""):
        threading.Thread(target=_wait, daemon=True, name="exit with parent").start()


def _wait() -> None:
    # Not through sys.stdin, whose lock the interpreter takes when it ends.
    while os.read(sys.__stdin__.fileno() if sys.__stdin__ else 0, 1024):
        pass
    os.kill(os.getpid(), signal.SIGKILL)
