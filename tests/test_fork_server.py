# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Runs forked from one process: as those of their own, and each ends alone."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
from test_cli import room_bag

from slarm_graph.app.fork_server import PROGRAM, ForkedProcess, ForkServer

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="elsewhere nothing is forked")

_DRIVE = ("explore", "--set", "explore.driving.speed_m_s=0.01", "--out")
"""Takes minutes."""


@pytest.fixture(scope="module")
def server() -> Iterator[ForkServer]:
    with closing(ForkServer()) as made:
        yield made


def begun(server: ForkServer, *words: object) -> ForkedProcess:
    process = server.start([str(word) for word in words])
    assert isinstance(process, ForkedProcess)
    return process


def test_a_forked_run_is_the_run_of_a_process_of_its_own(
    tmp_path: Path, server: ForkServer
) -> None:
    words = ("run", room_bag(tmp_path / "a.bag", 8), "--out", tmp_path, "--name")
    subprocess.run([*map(str, (*PROGRAM, *words, "own"))], check=True, capture_output=True)
    process = begun(server, *words, "forked")
    process.communicate(60.0)
    assert process.returncode == 0
    for name in ("trajectory.tum", "map.pgm", "scans.csv"):
        own, forked = (tmp_path / folder / name for folder in ("own", "forked"))
        assert own.read_bytes() == forked.read_bytes()


def test_a_failure_is_told(server: ForkServer) -> None:
    process = begun(server, "run", "/no/such.bag")
    _, errors = process.communicate(60.0)
    assert (process.returncode, errors) == (2, "slarm: no such file: /no/such.bag\n")
    process.send_signal(signal.SIGKILL)  # nobody is there any more


def test_a_fork_server_that_nobody_needs_is_gone_at_once(tmp_path: Path) -> None:
    """It does not take down what it imported: that lasts seconds."""
    mark = tmp_path / "taken down"
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    code = (
        f"import atexit, pathlib, socket; atexit.register(pathlib.Path({str(mark)!r}).touch)\n"
        "from slarm_graph.app.fork_server import _serve\n"
        f"_serve(socket.socket(fileno={theirs.fileno()}))"
    )
    with theirs:
        process = subprocess.Popen([sys.executable, "-c", code], pass_fds=[theirs.fileno()])
    ours.close()
    assert process.wait(120) == 0
    assert not mark.exists()


def test_a_killed_run_ends_alone(tmp_path: Path, server: ForkServer) -> None:
    other = begun(server, *_DRIVE, tmp_path / "other")
    process = begun(server, *_DRIVE, tmp_path)
    with pytest.raises(subprocess.TimeoutExpired):
        process.communicate(0.01)
    process.send_signal(signal.SIGKILL)
    process.communicate(60.0)
    assert process.returncode == -signal.SIGKILL
    assert _lives(other)
    other.send_signal(signal.SIGKILL)
    other.communicate(60.0)


def test_a_killed_fork_server_takes_nothing_along_and_is_replaced(tmp_path: Path) -> None:
    with closing(ForkServer()) as server:
        first = begun(server, *_DRIVE, tmp_path)
        assert server._running is not None
        process, _ = server._running
        process.kill()
        process.wait()
        second = begun(server, "run", "/no/such.bag")
        second.communicate(60.0)
        assert second.returncode == 2
        assert _lives(first)
        first.send_signal(signal.SIGKILL)
        first.communicate(60.0)


def test_a_run_dies_with_the_process_that_asked_for_it(tmp_path: Path) -> None:
    asking = (
        "from slarm_graph.app.fork_server import ForkServer; import time\n"
        f"run = ForkServer().start([*{_DRIVE!r}, {str(tmp_path)!r}])\n"
        "print(run._text.decode(), flush=True); time.sleep(60)"
    )
    with subprocess.Popen([sys.executable, "-c", asking], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        pid = int(process.stdout.readline())
        assert _is_there(pid)
        process.kill()
    deadline = time.monotonic() + 30.0
    while _is_there(pid) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert not _is_there(pid)


def _lives(process: ForkedProcess) -> bool:
    return process.returncode is None and _is_there(int(process._text.split()[0]))


def _is_there(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True
