# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Truth that only lies beside a recording, and is of another time, costs no run its report."""

from __future__ import annotations

from pathlib import Path

import pytest
from test_cli import room_bag

from slarm_graph.app.cli import main

RELATION = "{0:.3f} {1:.3f} 0.5 0 0 0 0 0\n"


def relations_at(path: Path, first_s: float) -> Path:
    """Write one relation over a second."""
    path.write_text(RELATION.format(first_s, first_s + 1.0))
    return path


def test_truth_found_beside_is_left_out_with_a_word_and_truth_given_is_an_error(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = room_bag(tmp_path / "drive.bag", 30)
    beside = relations_at(tmp_path / "drive.relations", 5e8)
    words = ["run", str(bag), "--backend", "odometry", "--out", str(tmp_path / "out"), "--name"]
    assert main([*words, "found"]) == 0
    folder = tmp_path / "out" / "found"
    assert (folder / "report.html").is_file()
    assert "relations_used" not in (folder / "metrics.json").read_text()
    assert "note: not compared: no relation lies within" in capsys.readouterr().err
    assert main([*words, "given", "--relations", str(beside)]) == 2
    assert "relation" in capsys.readouterr().err
