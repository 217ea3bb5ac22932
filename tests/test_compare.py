# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Carrying a comparison out: runs that fail or crash alone, and the command."""

from __future__ import annotations

import csv
import json
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from test_cli import room_bag, run

from slarm_graph.app import compare as compare_module
from slarm_graph.app import comparison_folder
from slarm_graph.app.compare import compare
from slarm_graph.app.comparison_plan import ComparisonPlan, find_sources
from slarm_graph.app.fork_server import PROGRAM, ForkServer
from slarm_graph.app.outcomes import Process, carry_out
from slarm_graph.app.trials import KEYS, Trial, TrialSource
from slarm_graph.errors import BadInput
from slarm_graph.eval.agreement import Estimate
from slarm_graph.eval.comparison import Outcome
from slarm_graph.eval.comparison_page import ComparisonContent, comparison_html
from slarm_graph.grid import GridGeometry, OccupancyGrid
from slarm_graph.trajectory import Trajectory


class Crashing(Trial):
    """A trial whose process is taken down."""

    def command(self) -> list[str]:
        return [sys.executable, "-c", "import os; os.abort()"]


def test_a_crash_is_one_failed_run(tmp_path: Path) -> None:
    crash = Crashing(TrialSource("x.bag", False), "odometry", 0, tmp_path / "x")
    outcome = carry_out(crash, ForkServer())
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
    interrupted, start = threading.Event(), compare_module.start_trial

    def started(trial: Trial, template: ForkServer) -> Process:
        process = start(trial, template)
        if late and isinstance(trial, Waiting):
            interrupted.wait()
            time.sleep(0.3)
        return process

    monkeypatch.setattr(compare_module, "start_trial", started)
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
    start = compare_module.start_trial
    monkeypatch.setattr(
        compare_module, "start_trial", lambda t, by: started.append(t) or start(t, by)
    )
    truth = tmp_path / "c" / "good_odometry_0" / "trajectory.tum"
    external = f"theirs={truth},{truth.with_name('map.yaml')}"
    assert run("compare", bag, *words, "--seeds", 2, "--external", external) == 0
    assert [trial.seed for trial in started] == [1]
    output = capsys.readouterr()
    assert "1 of 2 runs done already, 1 left" in output.err
    assert "theirs" in output.out
    assert "Agreement without truth" in output.out
    for name in ("tables.md", "tables.tex", "comparison.csv", "report.html"):
        assert "theirs" in (tmp_path / "c" / name).read_text()
    page = (tmp_path / "c" / "report.html").read_text()
    links = re.findall(r'href="([^"]+/report.html)"', page)
    assert len(links) == 2
    assert all((tmp_path / "c" / link).is_file() for link in links)


def test_what_was_begun_goes_on_though_no_run_had_begun(tmp_path: Path) -> None:
    """A comparison is killed right after its folder was made."""
    comparison_folder.open_comparison(tmp_path, "c")
    bag = room_bag(tmp_path / "good.bag", 8)
    assert run("compare", bag, "--backends", "odometry", "--out", tmp_path, "--name", "c") == 0


def test_keys_of_a_comparison_at_work_are_not_taken_away(tmp_path: Path) -> None:
    at_work = comparison_folder.open_comparison(tmp_path, "c")
    key = at_work.path / KEYS / "good_odometry_0"
    key.parent.mkdir()
    key.write_text("key")
    with pytest.raises(BadInput, match="another process is at work"):
        comparison_folder.open_comparison(tmp_path, "c", overwrite=True)
    assert key.is_file()


def test_a_path_without_a_map_is_drawn_and_compared(tmp_path: Path) -> None:
    bag = room_bag(tmp_path / "good.bag", 8)
    words = ("--backends", "odometry", "--out", tmp_path, "--name", "c")
    assert run("compare", bag, *words) == 0
    lines = (tmp_path / "c" / "good_odometry_0" / "trajectory.tum").read_text().splitlines()
    (tmp_path / "theirs.tum").write_text("\n".join(lines))
    assert run("compare", bag, *words, "--external", f"theirs={tmp_path / 'theirs.tum'}") == 0
    page = (tmp_path / "c" / "report.html").read_text()
    assert '"name":"theirs"' in page[page.index("map and trajectories") :]
    assert "odometry and theirs" in (tmp_path / "c" / "tables.md").read_text()


def test_a_budget_starts_nothing_more_and_says_how_to_go_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    bag = room_bag(tmp_path / "good.bag", 8)
    words = ("--backends", "odometry", "--out", tmp_path, "--name", "c", "--budget", 0)
    monkeypatch.setattr(sys, "argv", ["slarm", "compare", str(bag), *map(str, words)])
    assert run("compare", bag, *words) == 1
    (told,) = (line for line in capsys.readouterr().err.splitlines() if "go on with" in line)
    assert told.endswith(f"slarm compare {bag} --backends odometry --out {tmp_path} --name c")
    with (tmp_path / "c" / "comparison.csv").open(newline="") as file:
        assert [row["status"] for row in csv.DictReader(file)] == ["missing"]


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("--upload",), "it needs --scheduler"),
        (("--budget", -1), "minutes, 0 or more"),
        (("--budget", "nan"), "minutes, 0 or more"),
    ],
)
def test_what_could_not_be_meant_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: tuple[object, ...], told: str
) -> None:
    bag = room_bag(tmp_path / "good.bag", 8)
    assert run("compare", bag, "--backends", "odometry", "--out", tmp_path / "o", *words) == 2
    assert told in capsys.readouterr().err
    assert not (tmp_path / "o").exists()


def test_an_interrupt_is_heard_where_a_shell_had_them_ignored(tmp_path: Path) -> None:
    """As it has for what it starts in the background of a script."""
    ignored = "import os, signal, sys; signal.signal(signal.SIGINT, signal.SIG_IGN); "
    start = [sys.executable, "-c", f"{ignored}os.execv(sys.argv[1], sys.argv[1:])", *PROGRAM]
    words = ("compare", "paper_room", "--backends", "odometry", "--name", "c", "--out", tmp_path)
    slow = ("--set", "explore.driving.speed_m_s=0.01")
    process = subprocess.Popen([*start, *map(str, words), *slow], stderr=subprocess.PIPE, text=True)
    folder = tmp_path / "c" / "paper_room_odometry_0"
    while not (folder / "log.txt").exists() and process.poll() is None:
        time.sleep(0.05)
    # In the moment in which its log is opened, a run does not yet write down how it ends.
    time.sleep(2.0)
    process.send_signal(signal.SIGINT)
    try:
        _, said = process.communicate(timeout=30)
    finally:
        process.kill()
    assert process.returncode == 130, said
    assert "go on with: slarm compare paper_room" in said
    assert json.loads((folder / "run.json").read_text())["status"] == "partial"


def test_going_on_does_not_begin_anew(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    bag = room_bag(tmp_path / "good.bag", 8)
    words = ("--backends", "odometry", "--out", tmp_path, "--name", "c", "--overwrite")
    monkeypatch.setattr(sys, "argv", ["slarm", "compare", str(bag), *map(str, words)])
    assert run("compare", bag, *words, "--budget", 0) == 1
    (told,) = (line for line in capsys.readouterr().err.splitlines() if "go on with" in line)
    assert told.endswith(f"slarm compare {bag} --backends odometry --out {tmp_path} --name c")


def test_the_map_below_all_paths_is_the_one_least_in_doubt() -> None:
    path = Trajectory(np.arange(2), np.zeros((2, 3)))
    grid = OccupancyGrid(GridGeometry(0.0, 0.0, 1.0, 2, 2), np.zeros((2, 2), dtype=np.float32))
    runs = [
        Outcome("a", name, 0, "ok", figures={"map_conflict_share": share}, verdict=verdict)
        for name, share, verdict in (
            ("odometry", 0.3, "inconsistent"),
            ("gmapping", 0.02, "doubtful"),
            ("pose_graph", 0.01, "consistent"),
            ("theirs", 0.0, "inconsistent"),
        )
    ]
    estimates = {("a", run.variant, 0): Estimate(path, grid) for run in runs}
    (view,) = comparison_folder._views(estimates, runs)
    assert view.ground == "pose_graph"
    assert list(view.estimates) == ["odometry", "gmapping", "pose_graph", "theirs"]
    content = ComparisonContent("t", "l", runs, views=[view])
    assert "The map is that of pose_graph." in comparison_html(content)


def test_a_process_dies_with_the_one_that_started_it(tmp_path: Path) -> None:
    mark = tmp_path / "alive"
    child = (
        "from slarm_graph.app.child_process import exit_with_parent; exit_with_parent()\n"
        "import time, pathlib\n"
        f"while True: pathlib.Path({str(mark)!r}).write_text(str(time.time())); time.sleep(0.02)"
    )
    parent = (
        "import sys, time; from slarm_graph.app.child_process import start_child\n"
        f"start_child([sys.executable, '-c', {child!r}]); time.sleep(60)"
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
