# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Figures of trajectories for print: the maps hold their paths, and any trajectory has some."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from test_evaluation import noisy, room_drive

from slarm_graph.eval.evaluation import EvaluationOptions, evaluate
from slarm_graph.eval.trajectory_prints import save_prints
from slarm_graph.spatial import in_space


def test_printed_paths_lie_on_a_map_that_holds_them_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A metre is as long up as across, and a tenth of the way is no margin."""
    drawn: dict[str, Figure] = {}
    monkeypatch.setattr(Figure, "savefig", lambda self, path, **_: drawn.update({path.stem: self}))
    path = room_drive(60)
    found = evaluate(in_space(path), in_space(noisy(path)), EvaluationOptions())
    save_prints(tmp_path, {"one": found, "other": found})
    maps = [*drawn["paths"].axes, *drawn["error_on_path"].axes[:2]]
    low, high = path.poses[:, :2].min(axis=0), path.poses[:, :2].max(axis=0)
    for axes in maps:
        assert axes.get_aspect() == 1.0
        limits = np.array([axes.get_xlim(), axes.get_ylim()])
        assert (limits[:, 0] < low).all()
        assert (limits[:, 1] > high).all()
        assert (np.diff(limits)[:, 0] < 1.3 * (high - low).max() + 0.5).all()


def test_prints_need_no_drift(tmp_path: Path) -> None:
    still = replace(room_drive(20), poses=np.zeros((20, 3)))
    save_prints(
        tmp_path, {"still": evaluate(in_space(still), in_space(still), EvaluationOptions())}
    )
