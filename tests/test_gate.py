# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The benchmark gate notices what gets worse, and says what it leaves out."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from types import ModuleType

import pytest
from benchmark_scripts import script

FOLDER = Path(__file__).resolve().parents[1] / "benchmarks"


@pytest.fixture
def gate(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> ModuleType:
    module = script("gate")
    monkeypatch.setattr(module, "RECORDED", tmp_path / "recorded.json")
    monkeypatch.setattr(sys, "argv", ["gate.py"])
    return module


@pytest.mark.parametrize(
    ("name", "now", "verdict"),
    [
        ("ate_rmse_m", 0.104, "same"),
        ("ate_rmse_m", 0.106, "worse"),
        ("ate_rmse_m", 0.094, "better"),
        ("accuracy", 0.106, "better"),
        ("accuracy", 0.094, "worse"),
        ("map_entropy_nat", 0.106, "worse"),
        ("gain_rmse_db", 0.1051, "worse"),
    ],
)
def test_verdict(gate: ModuleType, name: str, now: float, verdict: str) -> None:
    assert gate.Difference("run", name, now, 0.1).verdict() == verdict


def test_figures_near_zero(gate: ModuleType) -> None:
    assert gate.Difference("run", "gain_rmse_db", 0.0009, 0.0).verdict() == "same"
    assert gate.Difference("run", "gain_rmse_db", 0.0011, 0.0).verdict() == "worse"


def test_negative_figures(gate: ModuleType) -> None:
    assert gate.Difference("run", "map_entropy_nat", -5.0, -6.0).verdict() == "worse"
    assert gate.Difference("run", "map_entropy_nat", -7.0, -6.0).verdict() == "better"


def test_it_fails_when_something_got_worse(
    gate: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    gate.RECORDED.write_text(json.dumps({"room": {"ate_rmse_m": 0.1, "accuracy": 0.9}}))
    monkeypatch.setattr(gate, "measured", lambda folder: {"room": {"ate_rmse_m": 0.2}})
    assert gate.main() == 1
    assert "WORSE: room ate_rmse_m 0.1 -> 0.2" in capsys.readouterr().out
    monkeypatch.setattr(sys, "argv", ["gate.py", "--record"])
    assert gate.main() == 0
    monkeypatch.setattr(sys, "argv", ["gate.py"])
    assert gate.main() == 0


def test_missing_recordings_are_told(
    gate: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    runs = [run for run, _, _ in gate.commands(tmp_path)]
    assert runs == ["paper_room pose_graph", "paper_room gmapping"]
    assert "skipped: intel" in capsys.readouterr().out


def test_recorded_figures_are_those_that_are_compared(gate: ModuleType) -> None:
    recorded = json.loads((FOLDER / "recorded.json").read_text())
    names = (*gate.RECORDINGS, *gate.WORLDS)
    assert recorded.keys() == {f"{name} {backend}" for name in names for backend in gate.BACKENDS}
    for run, figures in recorded.items():
        kind = "world" if run.split()[0] in gate.WORLDS else "recording"
        assert tuple(sorted(figures)) == tuple(sorted(gate.FIGURES[kind]))
