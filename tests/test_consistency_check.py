# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The verdict where people meet it: files, notices, the map's picture, the command."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from slarm_graph.app.consistency_check import _with_pose
from slarm_graph.app.run_report import conflict_marks
from slarm_graph.consistency import ConflictPlace, Contradictions, Tear
from slarm_graph.eval.assessment import assess
from slarm_graph.eval.metric_parts import Subject
from slarm_graph.files.consistency import CONFLICT_COLUMNS, conflict_rows, consistency_json
from slarm_graph.files.texts import csv_text
from slarm_graph.trajectory import Trajectory

PLACE = ConflictPlace((0, 5), (10_000_000_000, 12_000_000_000), (1.0, -2.0), 0.7, 12.5, 20, 80, 4)
TEAR = Tear((3_000_000_000, 4_000_000_000), (5.0, 6.0), (0.3, 0.4, 0.2), 7.5)
GOOD = Contradictions(
    share=0.01,
    expected_share=0.01,
    expected_sigma=float("nan"),
    checked_share=0.8,
    compared=1000,
    places=(),
    tears=(),
    points_m=np.zeros((0, 2)),
)
BAD = replace(
    GOOD,
    share=0.2,
    places=(PLACE,),
    tears=(TEAR,),
    points_m=np.array([[1.0, -2.0], [1.1, -2.0]]),
    verdict="inconsistent",
    reasons=("visits contradict each other at 1 place(s)",),
)


def test_json_has_the_verdict_and_the_places() -> None:
    content = json.loads(consistency_json(BAD))
    assert list(content)[:3] == ["verdict", "reasons", "share"]
    assert content["places"][0]["contradicted"] == 80
    assert content["compared"] == 1000
    assert content["verdict"] == "inconsistent"
    assert content["expected_sigma"] is None
    assert content["places"][0]["later_ns"] == [10_000_000_000, 12_000_000_000]
    assert content["tears"][0]["evidence_nat"] == 7.5
    assert "points_m" not in content


def test_conflicts_have_a_row_each() -> None:
    assert csv_text(CONFLICT_COLUMNS, conflict_rows(BAD)).splitlines() == [
        "kind,x_m,y_m,extent_m,earlier_from_s,earlier_to_s,later_from_s,later_to_s,evidence_nat,"
        "looked_through,confirmed,pairs",
        "place,1.000,-2.000,0.700,0.000000000,0.000000005,10.000000000,12.000000000,12.5,80,20,4",
        "step,5.000,6.000,0.500,3.000000000,3.000000000,4.000000000,4.000000000,7.5,,,",
    ]
    assert not conflict_rows(GOOD)


def test_only_what_is_not_consistent_is_warned_of() -> None:
    assert GOOD.notices() == ()
    (notice,) = BAD.notices()
    assert "inconsistent" in notice and "20.0% of shared wall cells" in notice


def test_share_is_a_metric() -> None:
    trajectory = Trajectory(np.array([0, 1]), np.zeros((2, 3)))
    metrics = {m.name: m for m in assess(Subject(trajectory, consistency=BAD))}
    assert metrics["map_conflict_share"].value == 0.2
    assert metrics["map_conflict_share"].note.startswith("inconsistent")
    assert metrics["cross_checked_share"].value == 0.8


def test_conflicts_are_marked_on_the_map() -> None:
    marks = conflict_marks(BAD)
    assert marks[0] == (1.0, -2.0, "80 wall cells looked through")
    assert marks[1][:2] == (5.0, 6.0)
    assert len(marks) == 4
    assert not conflict_marks(GOOD)


def test_of_keyframes_only_their_scans_are_judged() -> None:
    scans = np.arange(0, 10) * 100_000_000
    assert _with_pose(scans, scans[::3] + 1000).tolist() == [k % 3 == 0 for k in range(10)]
    between = scans[:-1:2] + 50_000_000
    inside = (scans >= between[0]) & (scans <= between[-1])
    np.testing.assert_array_equal(_with_pose(scans, between), inside)


@pytest.mark.parametrize("arguments", [["one.bag"], ["none.bag", "none.tum"]])
def test_command_tells_what_is_missing(
    arguments: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from slarm_graph.app.cli import main

    monkeypatch.chdir(tmp_path)
    assert main(["eval", "consistency", *arguments]) == 2


def test_a_way_seen_once_has_no_expected_share() -> None:
    once = replace(GOOD, share=np.nan, expected_share=np.nan, compared=0, verdict="doubtful")
    way = Trajectory(np.arange(2) * 10**9, np.zeros((2, 3)))
    (share,) = (m for m in assess(Subject(way, consistency=once)) if m.name == "map_conflict_share")
    assert share.note == "doubtful; nothing seen twice"
