# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The plan of a comparison: every combination once, each with a key of its own."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from slarm_graph.app.comparison_plan import ComparisonPlan, find_sources
from slarm_graph.errors import BadInput


def test_the_plan_covers_every_combination_and_finds_what_is_true(tmp_path: Path) -> None:
    for name in ("a.bag", "b.clf.gz", "a.relations", "b.tum"):
        (tmp_path / name).write_text("x")
    found = find_sources([str(tmp_path / "a.bag"), str(tmp_path / "b.clf.gz"), "paper_room"])
    plan = ComparisonPlan(found, ("odometry", "gmapping"), 3, for_recordings=("--r",)).trials(
        tmp_path
    )
    assert len({trial.folder for trial in plan}) == 3 * 2 * 3
    a, b, room = plan[0], plan[6], plan[12]
    relations = str(tmp_path / "a.relations")
    assert a.options == ("--r", "--ground-truth", "none", "--relations", relations)
    assert b.options[1:3] == ("--ground-truth", str(tmp_path / "b.tum"))
    assert "beside the recording" in found[0].truth.found[0]
    assert room.options == ()
    assert room.command()[3:6] == ["explore", "--world", "paper_room"]
    with pytest.raises(BadInput, match="no such file"):
        find_sources([str(tmp_path / "c.bag")])


def test_truth_is_given_once_or_for_each_or_forbidden(tmp_path: Path) -> None:
    for name in ("a.bag", "b.bag", "a.relations", "r", "s"):
        (tmp_path / name).write_text("x")
    bags, one, two = [str(tmp_path / n) for n in ("a.bag", "b.bag")], tmp_path / "r", tmp_path / "s"
    assert [s.truth.relations for s in find_sources(bags, relations=[one])] == [one, one]
    assert [s.truth.relations for s in find_sources(bags, relations=[one, two])] == [one, two]
    assert [s.truth.relations for s in find_sources(bags, relations=[Path("none")])] == [None, None]
    with pytest.raises(BadInput, match="3 times for 2 sources"):
        find_sources(bags, relations=[one, two, one])


def test_a_sweep_multiplies_and_spares_backends_it_does_not_concern(tmp_path: Path) -> None:
    sweeps = ("gmapping.particles=5,30", "mapping.resolution_m=0.05,0.1")
    plan = ComparisonPlan(find_sources(["paper_room"]), ("odometry", "gmapping"), 1, sweeps=sweeps)
    found = plan.trials(tmp_path)
    assert [t.setting for t in found if t.backend == "odometry"] == [
        "mapping.resolution_m=0.05",
        "mapping.resolution_m=0.1",
    ]
    assert len([t for t in found if t.backend == "gmapping"]) == 4
    assert len({t.folder for t in found}) == len({t.key for t in found}) == 6
    assert found[2].options[:2] == ("--set", "gmapping.particles=5")
    with pytest.raises(BadInput, match="expected KEY=V1,V2"):
        ComparisonPlan(find_sources(["paper_room"]), ("odometry",), 1, sweeps=("x",)).trials(
            tmp_path
        )


def test_a_cell_s_key_is_that_of_all_its_result_depends_on(tmp_path: Path) -> None:
    bag = tmp_path / "a.bag"

    def key(content: str = "x", **changes: object) -> str:
        bag.write_text(content)
        plan = ComparisonPlan(find_sources([str(bag)]), ("odometry",), 1)
        return replace(plan, **changes).trials(tmp_path)[0].key

    coarse = ("mapping.resolution_m=0.1",)
    keys = [key(), key("y"), key(settings=coarse), key(for_recordings=("--ap",))]
    (tmp_path / "a.tum").write_text("truth")
    assert len({*keys, key()}) == 5
    assert key(settings=coarse) == key(sweeps=coarse)


def test_same_names_from_different_folders_do_not_meet(tmp_path: Path) -> None:
    for folder in "ab":
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "run.bag").write_text(folder)
    sources = find_sources([str(tmp_path / folder / "run.bag") for folder in "ab"])
    assert (
        len({trial.folder for trial in ComparisonPlan(sources, ("odometry",), 1).trials(tmp_path)})
        == 2
    )
