# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The paper's figures of closed loops that have ended: which are run, and what is made of them."""

import csv
import json
import shutil
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import pytest
from matplotlib.figure import Figure

from slarm_graph.app.outcomes import read_outcome
from slarm_graph.app.trials import Trial
from slarm_graph.errors import BadInput
from slarm_graph.eval.comparison import Outcome
from slarm_graph.paper import reproduce as module
from slarm_graph.paper.drives import DRIVES
from slarm_graph.paper.figures import Curve, _draw_panel
from slarm_graph.paper.plan import Plan
from slarm_graph.paper.reproduce import reproduce
from slarm_graph.paper.summary import Hypothesis

PLAN = Plan(resolutions_m=(0.2, 0.15), speeds_m_s=(1.0,), explorers=("ggmr",), seeds=2)
"""Two cell sizes that figure 4 does not show, both backends: four closed loops per seed."""


def accuracy(name: str) -> float:
    """Of a closed loop by its folder's name: by the cell size, less a hundredth per seed."""
    _, *_, cell, _, seed = name.split("_")
    return 1.0 - float(cell.removesuffix("m")) - 0.01 * int(seed)


def write_run(folder: Path, status: str = "ok") -> None:
    folder.mkdir(parents=True, exist_ok=True)
    values = {"accuracy": accuracy(folder.name), "drive_time_s": 100.0, "collisions": 0.0}
    for prior, less in (("with", 0.0), ("without", 0.2)):
        for radius in ("cell", "robot", "zero"):
            values[f"accuracy_re_{radius}_{prior}_sizes"] = accuracy(folder.name) - less
    metrics = {name: {"value": value} for name, value in values.items()}
    (folder / "metrics.json").write_text(json.dumps(metrics))
    (folder / "run.json").write_text(
        json.dumps({"status": status, "wall_s": 30.0, "git_revision": "0123abcdef"})
    )


@pytest.fixture
def ran(monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """Names of the closed loops of every comparison, which writes their folders at once."""
    names: list[list[str]] = []

    def compare(
        trials: Sequence[Trial], *, tell: Callable[[Outcome], None], **_: object
    ) -> tuple[Outcome, ...]:
        names.append([trial.folder.name for trial in trials])
        outcomes = []
        for trial in trials:
            write_run(trial.folder)
            outcomes.append(read_outcome(trial))
            tell(outcomes[-1])
        return tuple(outcomes)

    monkeypatch.setattr(module, "compare", compare)
    return names


@pytest.fixture
def no_theory(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave out what is the same whatever was run, and takes seconds."""
    guess = Hypothesis("R_e = one cell", 0.2, 0.0, 0.7)
    monkeypatch.setattr(module, "_theory", lambda *_: None)
    monkeypatch.setattr(module, "hypotheses", lambda *_: [guess])


def rows_of(folder: Path) -> list[dict[str, str]]:
    with (folder / "results.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def test_seeds_of_a_setting_are_gathered(tmp_path: Path, ran: list[list[str]]) -> None:
    said: list[str] = []
    outcomes = reproduce(tmp_path, PLAN, tell=said.append)
    assert len(outcomes) == 8
    assert [len(names) for names in ran] == [8]
    # The first seed first, and of it the quickest.
    assert ran[0][:2] == ["ggmr_pose_graph_0.2m_1ms_0", "ggmr_gmapping_0.2m_1ms_0"]
    assert said[0] == "ggmr_pose_graph_0.2m_1ms_0: ok, accuracy 0.8000"
    rows = rows_of(tmp_path)
    assert len(rows) == 2 * 2 * 2 * 3
    for row in rows:
        expected = 0.995 - float(row["resolution_m"]) - (0.2 if row["prior"] == "extent" else 0.0)
        assert float(row["accuracy"]) == pytest.approx(expected)
        assert float(row["accuracy_min"]) == pytest.approx(expected - 0.005)
        assert float(row["accuracy_sd"]) == pytest.approx(0.005)
        assert (row["seeds"], float(row["drive_time_s"])) == ("2", 100.0)
    pictures = {path.name for path in tmp_path.glob("*.png")}
    assert pictures == {"fig5_ggmr.png", "times_ggmr.png", "complexity.png"}


@pytest.mark.usefixtures("no_theory")
def test_figures_are_drawn_anew_after_every_seed(
    tmp_path: Path, ran: list[list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not once more after the last one: the end draws them all."""
    drawn: list[int] = []

    def show(folder: Path, plan: Plan, outcomes: dict[Trial, Outcome]) -> None:
        assert folder == tmp_path and plan is PLAN and len(outcomes) == 8
        drawn.append(sum(outcome.status == "ok" for outcome in outcomes.values()))

    monkeypatch.setattr(module, "show", show)
    reproduce(tmp_path, PLAN)
    assert drawn == [4, 8]


@pytest.mark.usefixtures("no_theory")
def test_only_what_is_missing_is_run(
    tmp_path: Path, ran: list[list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "show", lambda *_: None)
    there = [t.folder for t in PLAN.trials(tmp_path)]
    for folder in there[:5]:
        write_run(folder)
    write_run(there[5], status="partial")
    said: list[str] = []
    reproduce(tmp_path, PLAN, tell=said.append)
    assert said[0] == "5 of 8 closed loops are there already"
    assert ran == [[folder.name for folder in there[5:]]]
    reproduce(tmp_path, PLAN, tell=said.append)
    assert len(ran) == 1


@pytest.mark.usefixtures("no_theory")
def test_a_table_of_drives_stands_for_their_folders(tmp_path: Path, ran: list[list[str]]) -> None:
    """Carried on elsewhere, a reproduction drives what is missing and has the same results."""
    here, there = tmp_path / "here", tmp_path / "there"
    here.mkdir()
    there.mkdir()
    reproduce(here, replace(PLAN, seeds=1))
    said: list[str] = []
    reproduce(there, PLAN, elsewhere=[here / DRIVES], tell=said.append)
    assert said[0] == "4 of 8 closed loops are there already"
    assert len(ran[1]) == 4 and all(name.endswith("_1") for name in ran[1])
    reproduce(here, PLAN, elsewhere=[there / DRIVES])
    assert len(ran) == 2
    assert rows_of(there) == rows_of(here)
    assert (there / DRIVES).read_text() == (here / DRIVES).read_text()
    name, revision, *_ = (here / DRIVES).read_text().splitlines()[1].split(",")
    assert (name, revision) == ("ggmr_pose_graph_0.2m_1ms_0", "0123abc")


@pytest.mark.usefixtures("no_theory")
def test_a_table_that_is_missing_is_told(tmp_path: Path, ran: list[list[str]]) -> None:
    with pytest.raises(BadInput, match=r"none\.csv: no such file"):
        reproduce(tmp_path, PLAN, elsewhere=[tmp_path / "none.csv"])
    assert not ran


@pytest.mark.usefixtures("no_theory")
def test_drives_of_another_plan_stay_in_the_table(tmp_path: Path, ran: list[list[str]]) -> None:
    reproduce(tmp_path, PLAN)
    table = (tmp_path / DRIVES).read_text()
    shutil.rmtree(tmp_path / "runs")
    reproduce(tmp_path, replace(PLAN, resolutions_m=(0.2,)))
    assert len(ran) == 1
    assert (tmp_path / DRIVES).read_text() == table


@pytest.mark.parametrize(
    ("spoil", "told"),
    [
        (lambda text: text.replace("revision", "version"), "its header is not"),
        (lambda text: text.replace(",100.0,", ",fast,", 1), ":2: not a drive"),
        (lambda text: text.replace(",100.0,", ",inf,", 1), ":2: not a drive"),
        (lambda text: text.rsplit(",", 4)[0], ":9: not a drive"),
        (lambda text: text.rstrip() + ",7\n", ":9: not a drive"),
    ],
)
@pytest.mark.usefixtures("no_theory")
def test_what_is_no_table_of_drives_is_told(
    tmp_path: Path, ran: list[list[str]], spoil: Callable[[str], str], told: str
) -> None:
    reproduce(tmp_path, PLAN)
    table = tmp_path / DRIVES
    table.write_text(spoil(table.read_text()))
    with pytest.raises(BadInput, match=told):
        reproduce(tmp_path, PLAN)
    assert len(ran) == 1


def test_curves_of_one_drive_have_one_colour_and_known_sizes_are_broken() -> None:
    labels = [
        f"{backend}, {speed} m/s, with{sizes} sizes"
        for backend in ("pose_graph", "gmapping")
        for speed in (0.2, 1)
        for sizes in ("", "out")
    ]
    axes = Figure().subplots()
    _draw_panel(axes, [Curve(label, "R_e = 0", [0.1], [0.9], [0.0]) for label in labels], ())
    lines = [container[0] for container in axes.containers]
    assert [line.get_linestyle() for line in lines] == ["--", "-"] * 4
    colours = [line.get_color() for line in lines]
    assert colours[::2] == colours[1::2]
    assert len(set(colours)) == 4
