# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""A run that ends before its work has begun says so in its record, whatever ended it."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from test_cli import room_bag, run

from slarm_graph.app import execution
from slarm_graph.app.run_folder import create_run_folder, read_record
from slarm_graph.errors import BadInput


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("moment_s", [0.0, 0.1, 0.3])
def test_an_interrupt_right_after_the_folder_is_made_is_recorded(
    tmp_path: Path, number: signal.Signals, moment_s: float
) -> None:
    """Imports follow for most of a second; shells tell 130 for both ways Python ends then."""
    bag, record = room_bag(tmp_path / "room.bag", 5), tmp_path / "r" / "run.json"
    command = [sys.executable, "-m", "slarm_graph", "run", str(bag), "-b", "odometry"]
    process = subprocess.Popen(
        [*command, "--out", str(tmp_path), "--name", "r"], stderr=subprocess.PIPE, text=True
    )
    while process.poll() is None and not record.exists():
        time.sleep(0.001)
    time.sleep(moment_s)
    process.send_signal(number)
    _, said = process.communicate(timeout=60)
    assert process.returncode in (130, -signal.SIGINT)
    assert json.loads(record.read_text())["status"] == "partial"
    assert f"partial results are in {record.parent}" in said


@pytest.mark.parametrize(
    ("error", "code", "status"),
    [(KeyboardInterrupt(), 130, "partial"), (BadInput("x"), 2, "failed")],
)
def test_what_ends_a_command_before_it_records_is_recorded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: BaseException, code: int, status: str
) -> None:
    def fail(*_: object) -> None:
        raise error

    monkeypatch.setattr(execution, "execute", fail)
    bag = room_bag(tmp_path / "room.bag", 5)
    assert run("run", bag, "--out", tmp_path, "--name", "r") == code
    assert read_record(tmp_path / "r")["status"] == status


def test_a_finished_run_stays_finished(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = create_run_folder(tmp_path, "r")
    folder.note(status="ok")
    assert run("run", tmp_path / "no.bag", "--out", tmp_path) == 2
    assert read_record(folder.path)["status"] == "ok"
    assert "partial" not in capsys.readouterr().err
