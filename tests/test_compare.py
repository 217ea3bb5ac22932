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
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from test_cli import room_bag, run

from slarm_graph.app import compare as compare_module
from slarm_graph.app.compare import carry_out, compare
from slarm_graph.app.trials import ComparisonPlan, Trial, TrialSource, find_sources
from slarm_graph.errors import BadInput
from slarm_graph.eval.agreement import Estimate, agreements
from slarm_graph.eval.comparison import Outcome, differences, groups, spread
from slarm_graph.eval.comparison_page import ComparisonContent, comparison_html
from slarm_graph.eval.comparison_tables import run_rows, summary_rows, summary_tables
from slarm_graph.grid import GridGeometry, OccupancyGrid
from slarm_graph.trajectory import Trajectory


def outcomes() -> list[Outcome]:
    good = [Outcome("a.bag", "x", i, "ok", figures={"ate_rmse_m": 1.0 + i}) for i in range(3)]
    return [*good, Outcome("a.bag", "x", 3, "failed", "it broke"), Outcome("b.bag", "x", 0, "ok")]


def test_failures_stay_in_the_count_and_are_told() -> None:
    median, mean = summary_tables(outcomes())
    assert median.columns == ("source", "backend", "n", "ok", "ATE, RMSE [m]", "problems")
    assert median.rows[0] == ("a.bag", "x", "4", "3", "2 | 3", "failed: it broke")
    assert median.rows[1] == ("b.bag", "x", "1", "1", "-", "")
    assert median.rows[2] == ("all sources", "x", "5", "4", "2 | 3", "failed: it broke")
    assert mean.rows[0][4] == "2 ± 1"


def test_runs_that_call_themselves_wrong_are_counted() -> None:
    lost, fine = (
        Outcome("a", "x", seed, "ok", verdict=verdict, figures={"ate_rmse_m": 1.0})
        for seed, verdict in enumerate(("inconsistent", "consistent"))
    )
    runs = [lost, fine]
    (group,) = groups(runs)
    assert (group.runs, group.ok, group.lost, group.failed) == (2, 2, 1, 0)
    assert "lost" in summary_tables(runs)[0].columns


def test_one_seed_needs_one_table_of_plain_values() -> None:
    (table,) = summary_tables(outcomes()[:1])
    assert table.rows == (("a.bag", "x", "1", "1", "1"),)


def test_the_best_of_a_source_is_marked_the_way_its_figure_is_good() -> None:
    runs = [
        Outcome("a", name, 0, "ok", figures={"accuracy": value, "ate_rmse_m": value})
        for name, value in (("x", 0.9), ("y", 0.8))
    ]
    (table,) = summary_tables(runs)
    columns = list(table.columns)
    assert (0, columns.index("radio-map accuracy")) in table.best
    assert (1, columns.index("ATE, RMSE [m]")) in table.best
    assert len(table.best) == 2
    assert "**0.9**" in table.markdown()
    assert r"\textbf{0.8}" in table.latex()


def test_tables_are_latex_that_survives_any_name() -> None:
    table = summary_tables([Outcome("a_b & 5%{x}", "p=1", 0, "ok", figures={"accuracy": 1.0})])[0]
    text = table.latex()
    assert r"a\_b \& 5\%\{x\}" in text
    assert r"\toprule" in text
    assert text.count("&") == text.count(r"\&") + 2 * (len(table.columns) - 1)


def test_the_summary_says_what_the_runs_say() -> None:
    columns, rows = summary_rows(outcomes()[:4])
    row = dict(zip(columns, rows[0], strict=True))
    assert (row["figure"], row["unit"], row["runs"], row["n"]) == ("ate_rmse_m", "m", 4, 3)
    assert (row["median"], row["worst"], row["mean"], row["sd"]) == (2.0, 3.0, 2.0, 1.0)
    assert 1.0 <= row["mean_low_95"] < 2.0 < row["mean_high_95"] <= 3.0


def test_the_worst_accuracy_is_the_least() -> None:
    runs = [Outcome("a", "x", i, "ok", figures={"accuracy": 0.9 + i / 100}) for i in range(3)]
    columns, rows = summary_rows(runs)
    assert rows[0][columns.index("worst")] == 0.9


def test_differences_are_paired_by_source_and_seed() -> None:
    runs = [
        Outcome(source, name, seed, "ok", figures={"ate_rmse_m": level + better + 0.01 * seed})
        for source, level in (("a", 1.0), ("b", 50.0))
        for name, better in (("x", 0.0), ("y", -0.2))
        for seed in range(3)
    ]
    (found,) = differences([*runs, Outcome("c", "y", 0, "ok", figures={"ate_rmse_m": 9.0})])
    assert (found.variant, found.than, found.pairs) == ("y", "x", 6)
    assert found.mean == pytest.approx(-0.2)
    assert found.interval == pytest.approx((-0.2, -0.2))


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
    assert spread([]).count == 0


def test_runs_agree_with_themselves_and_not_with_others() -> None:
    stamps = np.arange(20) * 100_000_000
    line = np.column_stack([np.arange(20) * 0.2, np.sin(np.arange(20.0)), np.zeros(20)])
    cells = np.zeros((40, 60), dtype=np.float32)
    cells[10, :] = 1.0
    geometry = GridGeometry(0.0, 0.0, 0.1, 40, 60)
    one = Estimate(Trajectory(stamps, line), OccupancyGrid(geometry, cells))
    other = Estimate(
        Trajectory(stamps, line + np.array([0.3, 0.4, 0.0])),
        OccupancyGrid(geometry, np.roll(cells, 1, axis=0)),
    )
    found = agreements({("a", "x", 0): one, ("a", "x", 1): one, ("a", "y", 0): other})
    seeds, backends = found
    assert (seeds.between, seeds.end_spread_m, seeds.walls_iou) == ("seeds of x", 0.0, 1.0)
    assert (backends.between, backends.walls_iou) == ("x and y", 0.0)
    assert backends.end_spread_m == pytest.approx(0.5)
    assert backends.path_rms_m == pytest.approx(0.0, abs=1e-9)


def test_page_escapes_what_it_shows() -> None:
    page = comparison_html(ComparisonContent("t", "l", [Outcome("<b>", "x", 0, "failed", "a & b")]))
    body = page[page.index("<header>") :]
    assert "&lt;b&gt;" in body
    assert "a &amp; b" in body
    assert '<td class="short"><b></td>' not in body


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


def test_the_same_command_again_finishes_only_what_is_missing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    bag = room_bag(tmp_path / "good.bag", 8)
    words = ("--backends", "odometry", "--out", tmp_path, "--name", "c")
    assert run("compare", bag, *words) == 0
    assert run("eval", "trajectory", tmp_path / "c" / "good_odometry_0", bag) == 2
    started = []
    start = compare_module._started
    monkeypatch.setattr(compare_module, "_started", lambda t: started.append(t) or start(t))
    truth = tmp_path / "c" / "good_odometry_0" / "trajectory.tum"
    external = f"theirs={truth},{truth.with_name('map.yaml')}"
    assert run("compare", bag, *words, "--seeds", 2, "--external", external) == 0
    assert [trial.seed for trial in started] == [1]
    output = capsys.readouterr()
    assert "1 of 2 runs are done already, 1 left" in output.err
    assert "theirs" in output.out
    assert "Agreement without truth" in output.out
    for name in ("tables.md", "tables.tex", "comparison.csv", "report.html"):
        assert "theirs" in (tmp_path / "c" / name).read_text()


def test_a_budget_starts_nothing_more_and_says_how_to_go_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = room_bag(tmp_path / "good.bag", 8)
    words = ("--backends", "odometry", "--out", tmp_path, "--name", "c", "--budget", 0)
    assert run("compare", bag, *words) == 1
    assert "go on with: slarm" in capsys.readouterr().err
    with (tmp_path / "c" / "comparison.csv").open(newline="") as file:
        assert [row["status"] for row in csv.DictReader(file)] == ["missing"]


def test_a_process_dies_with_the_one_that_started_it(tmp_path: Path) -> None:
    mark = tmp_path / "alive"
    child = (
        "from slarm_graph.app.tied import die_with_starter; die_with_starter()\n"
        "import time, pathlib\n"
        f"while True: pathlib.Path({str(mark)!r}).write_text(str(time.time())); time.sleep(0.02)"
    )
    parent = (
        "import sys, time; from slarm_graph.app.tied import started_tied\n"
        f"started_tied([sys.executable, '-c', {child!r}]); time.sleep(60)"
    )
    process = subprocess.Popen([sys.executable, "-c", parent])
    while not mark.exists():
        time.sleep(0.02)
    process.kill()
    process.wait()
    deadline, before = time.monotonic() + 30.0, ""
    while (now := mark.read_text()) != before and time.monotonic() < deadline:
        before = now
        time.sleep(0.5)
    assert now == before


@pytest.fixture
def scheduler() -> Iterator[str]:
    from distributed import LocalCluster

    with LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None
    ) as cluster:
        yield cluster.scheduler_address


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("upload", [False, True])
def test_the_same_trials_on_a_dask_cluster(tmp_path: Path, scheduler: str, upload: bool) -> None:
    bag = room_bag(tmp_path / "good.bag", 8)
    plan = ComparisonPlan(find_sources([str(bag)]), ("odometry",), 2).trials(tmp_path)
    found = compare(plan, scheduler=scheduler, upload=upload)
    assert [outcome.status for outcome in found] == ["ok", "ok"]
    assert all(trial.is_done() for trial in plan)
