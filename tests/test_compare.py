# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Comparing: the plan, runs that fail or crash alone, and the tables made of them."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from test_cli import room_bag, run

from slarm_graph.app import compare as compare_module
from slarm_graph.app.compare import carry_out, compare
from slarm_graph.app.trials import Trial, TrialSource, find_sources, trials
from slarm_graph.errors import BadInput
from slarm_graph.eval.comparison import (
    Outcome,
    comparison_html,
    run_rows,
    spread,
    summaries,
    summary_rows,
)


def outcomes() -> list[Outcome]:
    good = [Outcome("a.bag", "x", i, "ok", figures={"ate_rmse_m": 1.0 + i}) for i in range(3)]
    return [*good, Outcome("a.bag", "x", 3, "failed", "it broke"), Outcome("b.bag", "x", 0, "ok")]


def test_failures_stay_in_the_count_and_are_told() -> None:
    (_, (columns, rows)), (title, (_, by_mean)) = summaries(outcomes())
    assert columns == ("source", "backend", "ok", "ate_rmse_m", "problems")
    assert rows[0] == ("a.bag", "x", "3 of 4", "2 | 3", "failed: it broke")
    assert rows[1] == ("b.bag", "x", "1 of 1", "-", "")
    assert title.startswith("Mean")
    assert by_mean[0][3] == "2 ± 1"


def test_one_seed_needs_one_table_of_plain_values() -> None:
    ((_, (_, rows)),) = summaries(outcomes()[:1])
    assert rows == [("a.bag", "x", "1 of 1", "1")]


def test_the_summary_says_what_the_runs_say() -> None:
    columns, rows = summary_rows(outcomes())
    assert [dict(zip(columns, row, strict=True)) for row in rows] == [
        {
            "source": "a.bag",
            "backend": "x",
            "figure": "ate_rmse_m",
            "runs": 3,
            "median": 2.0,
            "worst": 3.0,
            "mean": 2.0,
            "sd": 1.0,
        }
    ]


def test_the_worst_accuracy_is_the_least() -> None:
    runs = [Outcome("a", "x", i, "ok", figures={"accuracy": 0.9 + i / 100}) for i in range(3)]
    assert summary_rows(runs)[1][0][5] == 0.9


def test_every_run_has_a_row_with_every_figure() -> None:
    columns, rows = run_rows(outcomes())
    assert len(rows) == 5
    assert all(len(row) == len(columns) for row in rows)
    assert rows[3][columns.index("problem")] == "it broke"
    assert rows[3][columns.index("ate_rmse_m")] is None


def test_spread_is_that_of_a_sample() -> None:
    s = spread([1.0, 2.0, 6.0])
    assert (s.mean, s.median, s.worst, s.count) == (3.0, 2.0, 6.0, 3)
    assert s.sd == pytest.approx(7.0**0.5)
    assert spread([1.0, 2.0], more_is_better=True).worst == 1.0
    assert spread([1000.0, 1300.0]).of_mean() == "1150 ± 212"
    assert spread([]).of_mean() == spread([]).of_median() == "-"


def test_page_escapes_what_it_shows() -> None:
    page = comparison_html([Outcome("<b>", "x", 0, "failed", "a & b")], "lead")
    body = page[page.index("<body>") :]
    assert "&lt;b&gt;" in body
    assert "a &amp; b" in body
    assert "<b>" not in body


def test_the_plan_covers_every_combination_and_finds_what_is_true(tmp_path: Path) -> None:
    for name in ("a.bag", "b.clf.gz", "a.relations", "b.tum"):
        (tmp_path / name).write_text("x")
    found = find_sources([str(tmp_path / "a.bag"), str(tmp_path / "b.clf.gz"), "paper_room"])
    plan = trials(found, ["x", "y"], 3, tmp_path, options=["--o"], for_recordings=["--r"])
    assert len({trial.folder for trial in plan}) == 3 * 2 * 3
    a, b, room = plan[0], plan[6], plan[12]
    assert a.options == ("--o", "--r", "--relations", str(tmp_path / "a.relations"))
    assert b.options == ("--o", "--r", "--ground-truth", str(tmp_path / "b.tum"))
    assert room.options == ("--o",)
    assert room.command()[3:6] == ["explore", "--world", "paper_room"]
    with pytest.raises(BadInput, match="no such file"):
        find_sources([str(tmp_path / "c.bag")])


def test_same_names_from_different_folders_do_not_meet(tmp_path: Path) -> None:
    sources = [TrialSource(str(tmp_path / folder / "run.bag"), False) for folder in "ab"]
    assert len({trial.folder for trial in trials(sources, ["x"], 1, tmp_path)}) == 2


class Crashing(Trial):
    """A trial whose process is taken down."""

    def command(self) -> list[str]:
        return [sys.executable, "-c", "import os; os.abort()"]


def test_a_crash_is_one_failed_run(tmp_path: Path) -> None:
    crash = Crashing(TrialSource("x.bag", False), "odometry", 0, tmp_path / "x")
    outcome = carry_out(crash)
    assert outcome.status == "failed"
    assert outcome.problem


class Waiting(Trial):
    """A trial that says it has begun, and takes long to end unless it is told to stop."""

    def command(self) -> list[str]:
        place = str(self.folder)
        wait = f"import time; open({place!r} + '.begun', 'w'); time.sleep(60)"
        return [sys.executable, "-c", f"{wait}; open({place!r} + '.ended', 'w')"]


@pytest.mark.parametrize("late", [False, True])
def test_an_interrupt_stops_what_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, late: bool
) -> None:
    """Also what is just being started, whose process is there before anybody knows of it."""
    interrupted, start = threading.Event(), compare_module._started

    def started(trial: Trial) -> subprocess.Popen[str]:
        process = start(trial)
        if late and isinstance(trial, Waiting):
            interrupted.wait()
            time.sleep(0.3)
        return process

    monkeypatch.setattr(compare_module, "_started", started)
    source = TrialSource("x.bag", False)
    waiting = Waiting(source, "odometry", 1, tmp_path / "waiting")
    begun, ended = (tmp_path / f"waiting.{how}" for how in ("begun", "ended"))

    def interrupt(_outcome: Outcome) -> None:
        while not begun.exists():
            time.sleep(0.01)
        interrupted.set()
        raise KeyboardInterrupt

    first = Crashing(source, "odometry", 0, tmp_path / "x")
    with pytest.raises(KeyboardInterrupt):
        compare([first, waiting], workers=2, tell=interrupt)
    assert not ended.exists()


def test_the_command_compares_and_one_failure_does_not_stop_the_rest(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    good, broken = room_bag(tmp_path / "good.bag", 8), tmp_path / "broken.bag"
    broken.write_bytes(good.read_bytes()[:3000])
    words = ("--backends", "odometry", "--ap", 0, 0, 2, "--out", tmp_path, "--name", "c")
    assert run("compare", broken, good, *words) == 1
    out = capsys.readouterr().out
    assert "1 of 2 runs ok" in out
    with (tmp_path / "c" / "comparison.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["status"] for row in rows] == ["failed", "ok"]
    assert rows[0]["problem"]
    assert (tmp_path / "c" / rows[1]["folder"] / "radio_map.npz").is_file()
    assert "good.bag, odometry" in (tmp_path / "c" / "report.html").read_text()
    assert json.loads((tmp_path / "c" / "run.json").read_text())["status"] == "partial"


@pytest.fixture
def scheduler() -> Iterator[str]:
    from distributed import LocalCluster

    with LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None
    ) as cluster:
        yield cluster.scheduler_address


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_the_same_trials_on_a_dask_cluster(tmp_path: Path, scheduler: str) -> None:
    bag = room_bag(tmp_path / "good.bag", 8)
    plan = trials(find_sources([str(bag)]), ["odometry"], 2, tmp_path)
    found = compare(plan, scheduler=scheduler)
    assert [outcome.status for outcome in found] == ["ok", "ok"]
