# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Which poses of two files belong together: between sparse stamps, and without any."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from test_cli import run

CASES = Path(__file__).parents[1] / ".." / "shared" / "data" / "cases"


@pytest.mark.parametrize(
    ("reference", "ate_m"), [("truth_1hz", 0.0281415), ("truth_5s", 0.0230970)]
)
def test_a_sparse_reference_is_met_in_between(
    reference: str, ate_m: float, capsys: pytest.CaptureFixture[str]
) -> None:
    """The figures are numpy's: positions interpolated, and Umeyama's alignment."""
    if not CASES.is_dir():
        pytest.skip(f"no {CASES}")
    place = CASES / "eval_control"
    assert run("eval", "trajectory", place / f"{reference}.tum", place / "est.tum", "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert found["ate_rmse_m"]["value"] == pytest.approx(ate_m, abs=1e-6)


def test_poses_without_stamps_are_compared_one_by_one_or_not_at_all(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = [f"1 0 0 {0.1 * i:.1f} 0 1 0 0 0 0 1 0\n" for i in range(9)]
    for name, count in (("ref", 9), ("est", 6)):
        (tmp_path / f"{name}.txt").write_text("".join(rows[:count]))
    assert run("eval", "trajectory", tmp_path / "ref.txt", tmp_path / "est.txt") == 2
    told = capsys.readouterr()
    assert "the reference has 9 and the estimate 6" in told.err
    assert not told.out
