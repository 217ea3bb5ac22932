# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""A process that has everything imported and forks itself for every run that is wished.

A run is a process of its own all the same: it ends alone, and it dies with the one that asked for
it, as in `tied`. Only Linux: elsewhere libraries do not bear to be forked.
"""

from __future__ import annotations

import contextlib
import importlib
import json
import os
import select
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from threading import Lock
from typing import BinaryIO, NoReturn

from slarm_graph.app.tied import started_tied, tied_environment

PROGRAM = (sys.executable, "-m", "slarm_graph")
"""How `slarm` is called by this very Python."""
_MODULES = (
    "slarm_graph.app.cli_run",
    "slarm_graph.app.cli_output",
    "slarm_graph.app.execution",
    "slarm_graph.app.known_truth",
    "slarm_graph.backends.gmapping",
    "slarm_graph.backends.pose_graph",
    "slarm_graph.exploration.ggmr_plus",
    "slarm_graph.frontends.recordings.carmen",
    "slarm_graph.frontends.recordings.ros1_file",
    "slarm_graph.frontends.simulation.simulator",
    "slarm_graph.radio.netcdf",
    "slarm_graph.radio.pictures",
    "matplotlib.backends.backend_agg",
    "plotly.graph_objects",
    "scipy.optimize",
)
"""What nearly every run imports by and by, with the libraries below it."""
_MOST_BYTES = 1 << 16
"""Of a run's command line; a datagram of twice that still fits into Linux's socket buffers."""


class Forked:
    """A process forked from a template, with what is used of a `subprocess.Popen`.

    Parameters
    ----------
    life : int
        Our end of what is its standard input: it dies when that is closed.
    told : int
        Where its number is told, and once it has ended its exit code.
    errors : binary file
        Its standard error.

    Raises
    ------
    OSError
        When nobody tells its number.
    """

    def __init__(self, life: int, told: int, errors: BinaryIO) -> None:
        self._life, self._told, self._errors = life, told, errors
        self._text = b""
        self.returncode: int | None = None
        while b" " not in self._text:
            if not self._heard():
                self._let_go()
                errors.close()
                raise OSError("the process that runs are forked from has ended")

    def communicate(self, timeout: float) -> tuple[None, str]:
        """Wait for the end and return what the process said on its standard error.

        Raises
        ------
        subprocess.TimeoutExpired
            When it has not ended after so long [s].
        """
        while self.returncode is None:
            if not select.select([self._told], [], [], timeout)[0]:
                raise subprocess.TimeoutExpired("slarm", timeout)
            if not self._heard():
                self._end()
        with self._errors:
            self._errors.seek(0)
            return None, self._errors.read().decode(errors="replace")

    def send_signal(self, number: int) -> None:
        """Send it a signal as long as it lives."""
        pid, *ended = self._text.split()
        if not ended:
            with contextlib.suppress(ProcessLookupError):
                os.kill(int(pid), number)

    def _heard(self) -> bytes:
        part = os.read(self._told, 64)
        self._text += part
        return part

    def _end(self) -> None:
        """Take note of the exit code, and let go of a process that nobody watches any more."""
        _, *ended = self._text.split()
        self.returncode = int(ended[0]) if ended else -signal.SIGKILL
        self._let_go()

    def _let_go(self) -> None:
        os.close(self._life)
        os.close(self._told)


class Template:
    """Starts runs of `slarm`, forked from one process that is begun when the first is wished."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._begun: tuple[subprocess.Popen[bytes], socket.socket] | None = None

    def started(self, words: Sequence[str]) -> Forked | subprocess.Popen[str]:
        """Start `slarm WORDS...` as `started_tied` does; as it itself does where forks fail."""
        if sys.platform == "linux":
            with contextlib.suppress(OSError):
                return self._forked(words)
        return started_tied([*PROGRAM, *words])

    def _forked(self, words: Sequence[str]) -> Forked:
        (theirs, life), (told, tell) = os.pipe(), os.pipe()
        errors = tempfile.TemporaryFile()  # noqa: SIM115 - the run writes it after this
        try:
            self._send(json.dumps(list(words)).encode(), (theirs, errors.fileno(), tell))
        finally:
            os.close(theirs)
            os.close(tell)
        return Forked(life, told, errors)

    def _send(self, message: bytes, ends: tuple[int, ...]) -> None:
        """Hand a run to the template, to a new one where there is none or it has been killed."""
        with self._lock:
            if self._begun is None or self._begun[0].poll() is not None:
                self.close()
                self._begun = _begun()
            socket.send_fds(self._begun[1], [message], ends)

    def close(self) -> None:
        """End the template; runs that were forked from it go on."""
        if self._begun is not None:
            process, line = self._begun
            line.close()
            process.kill()
            process.wait()
            self._begun = None


def _begun() -> tuple[subprocess.Popen[bytes], socket.socket]:
    """Start a template and return it with our end of the line, with which it ends."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with theirs:
        process = subprocess.Popen(
            [sys.executable, "-m", __name__, str(theirs.fileno())],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            pass_fds=[theirs.fileno()],
            env=tied_environment(),
            start_new_session=True,
        )
    return process, ours


def _serve(line: socket.socket) -> NoReturn:
    """Fork a run for every message until nobody is there to send more."""
    for name in _MODULES:
        importlib.import_module(name)
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # nobody waits for those who watch the runs
    while True:
        message, ends, _, _ = socket.recv_fds(line, _MOST_BYTES, 3)
        if not message:
            os._exit(0)  # taking down all that is imported lasts seconds, in which nobody is served
        if os.fork() == 0:
            line.close()
            _watch(json.loads(message), *ends)
        for end in ends:
            os.close(end)


def _watch(words: list[str], stdin: int, stderr: int, tell: int) -> NoReturn:
    """Fork once more, tell the number of the run's process, and when it has ended how."""
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    pid = os.fork()
    if pid == 0:
        os.close(tell)
        _run(words, stdin, stderr)
    os.close(stdin)
    os.write(tell, b"%d " % pid)
    _, status = os.waitpid(pid, 0)
    with contextlib.suppress(BrokenPipeError):  # nobody is there any more
        os.write(tell, b"%d" % os.waitstatus_to_exitcode(status))
    os._exit(0)


def _run(words: list[str], stdin: int, stderr: int) -> NoReturn:
    """Be `slarm WORDS...`."""
    code = 1
    try:
        from slarm_graph.app.cli import main

        os.setsid()
        os.dup2(stdin, 0)
        os.dup2(stderr, 2)
        sys.argv = ["slarm", *words]
        code = main()
    finally:
        sys.stdout.flush()
        os._exit(code)


if __name__ == "__main__":
    _serve(socket.socket(fileno=int(sys.argv[1])))
