# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""A fork server: a process with all modules imported that forks itself for every run.

Each run is a process of its own: it ends alone, and it dies with the process that asked for it, as
in `child_process`. Linux only: elsewhere libraries do not survive a fork.
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

from slarm_graph.app.child_process import child_environment, start_child

PROGRAM = (sys.executable, "-m", "slarm_graph")
"""The command `slarm` in this Python interpreter."""
_MODULES = (
    "slarm_graph.app.cli_run",
    "slarm_graph.app.cli_output",
    "slarm_graph.app.execution",
    "slarm_graph.app.reference_files",
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
"""Modules that nearly every run imports, with the libraries that they import."""
_MOST_BYTES = 1 << 16
"""Longest command line of a run; a datagram of twice that fits into Linux's socket buffers."""


class ForkedProcess:
    """A process forked by the server, with the methods used of `subprocess.Popen`.

    Parameters
    ----------
    stdin_end : int
        Our end of the pipe to its standard input: it dies when this is closed.
    status_end : int
        Pipe from which its process id is read, and once it has ended its exit code.
    errors : binary file
        Its standard error.

    Raises
    ------
    OSError
        When the server has ended before it sent the process id.
    """

    def __init__(self, stdin_end: int, status_end: int, errors: BinaryIO) -> None:
        self._stdin, self._status, self._errors = stdin_end, status_end, errors
        self._text = b""
        self.returncode: int | None = None
        while b" " not in self._text:
            if not self._read_status():
                self._close()
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
            if not select.select([self._status], [], [], timeout)[0]:
                raise subprocess.TimeoutExpired("slarm", timeout)
            if not self._read_status():
                self._end()
        with self._errors:
            self._errors.seek(0)
            return None, self._errors.read().decode(errors="replace")

    def send_signal(self, number: int) -> None:
        """Send a signal, unless the process has ended."""
        pid, *ended = self._text.split()
        if not ended:
            with contextlib.suppress(ProcessLookupError):
                os.kill(int(pid), number)

    def _read_status(self) -> bytes:
        part = os.read(self._status, 64)
        self._text += part
        return part

    def _end(self) -> None:
        """Store the exit code and close the pipes."""
        _, *ended = self._text.split()
        self.returncode = int(ended[0]) if ended else -signal.SIGKILL
        self._close()

    def _close(self) -> None:
        os.close(self._stdin)
        os.close(self._status)


class ForkServer:
    """Starts runs of `slarm`, forked from one process that is started with the first run."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._running: tuple[subprocess.Popen[bytes], socket.socket] | None = None

    def start(self, words: Sequence[str]) -> ForkedProcess | subprocess.Popen[str]:
        """Start `slarm WORDS...` in a forked process; by `start_child` where that fails."""
        if sys.platform == "linux":
            with contextlib.suppress(OSError):
                return self._forked(words)
        return start_child([*PROGRAM, *words])

    def _forked(self, words: Sequence[str]) -> ForkedProcess:
        (theirs, stdin_end), (status_end, status_writer) = os.pipe(), os.pipe()
        errors = tempfile.TemporaryFile()  # noqa: SIM115 - the run writes it after this
        try:
            self._send(json.dumps(list(words)).encode(), (theirs, errors.fileno(), status_writer))
        finally:
            os.close(theirs)
            os.close(status_writer)
        return ForkedProcess(stdin_end, status_end, errors)

    def _send(self, message: bytes, ends: tuple[int, ...]) -> None:
        """Send a run to the server process, which is started where it is not running."""
        with self._lock:
            if self._running is None or self._running[0].poll() is not None:
                self.close()
                self._running = _start_server()
            socket.send_fds(self._running[1], [message], ends)

    def close(self) -> None:
        """End the server process; runs that were forked from it go on."""
        if self._running is not None:
            process, line = self._running
            line.close()
            process.kill()
            process.wait()
            self._running = None


def _start_server() -> tuple[subprocess.Popen[bytes], socket.socket]:
    """Start a server process; return it and our end of its socket, on whose closing it ends."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with theirs:
        process = subprocess.Popen(
            [sys.executable, "-m", __name__, str(theirs.fileno())],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            pass_fds=[theirs.fileno()],
            env=child_environment(),
            start_new_session=True,
        )
    return process, ours


def _serve(line: socket.socket) -> NoReturn:
    """Fork a run for every message until the socket is closed."""
    for name in _MODULES:
        importlib.import_module(name)
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # no waiting for processes that watch runs
    while True:
        message, ends, _, _ = socket.recv_fds(line, _MOST_BYTES, 3)
        if not message:
            os._exit(0)  # taking down all that is imported lasts seconds, in which nobody is served
        if os.fork() == 0:
            line.close()
            _watch(json.loads(message), *ends)
        for end in ends:
            os.close(end)


def _watch(words: list[str], stdin: int, stderr: int, status_writer: int) -> NoReturn:
    """Fork the run's process; send its process id, and its exit code when it has ended."""
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    pid = os.fork()
    if pid == 0:
        os.close(status_writer)
        _run(words, stdin, stderr)
    os.close(stdin)
    os.write(status_writer, b"%d " % pid)
    _, status = os.waitpid(pid, 0)
    with contextlib.suppress(BrokenPipeError):  # nobody is there any more
        os.write(status_writer, b"%d" % os.waitstatus_to_exitcode(status))
    os._exit(0)


def _run(words: list[str], stdin: int, stderr: int) -> NoReturn:
    """Run `slarm WORDS...` in this process, and exit."""
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
