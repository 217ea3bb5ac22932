# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The tables of a comparison: what counts, what is best, and what agrees."""

from __future__ import annotations

import re
import shutil
import subprocess
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from slarm_graph.eval.agreement import Estimate, agreements, aligned_to
from slarm_graph.eval.comparison import Outcome, differences, groups, spread
from slarm_graph.eval.comparison_page import ComparisonContent, SourceView, comparison_html
from slarm_graph.eval.comparison_tables import (
    TextTable,
    difference_table,
    number,
    run_rows,
    summary_rows,
    summary_tables,
)
from slarm_graph.eval.metric_table import headlines
from slarm_graph.eval.metrics import best_of
from slarm_graph.eval.run_figures import error_figure
from slarm_graph.geometry import Pose2
from slarm_graph.grid import GridGeometry, OccupancyGrid
from slarm_graph.trajectory import Trajectory

PDFLATEX = shutil.which("pdflatex") or ""


def outcomes() -> list[Outcome]:
    good = [Outcome("a.bag", "x", i, "ok", figures={"ate_rmse_m": 1.0 + i}) for i in range(3)]
    return [*good, Outcome("a.bag", "x", 3, "failed", "it broke"), Outcome("b.bag", "x", 0, "ok")]


def test_a_problem_is_told_once_with_how_often_it_came() -> None:
    failed = [Outcome("a.bag", "x", seed, "failed", "it broke") for seed in range(2)]
    other = Outcome("a.bag", "x", 2, "failed", "it stopped")
    assert groups([*failed, other])[0].problems == "2 x failed: it broke; failed: it stopped"


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


def test_values_that_read_alike_are_equally_good() -> None:
    values = [0.02742, 0.027419, 0.05, float("nan")]
    assert best_of(values, "less") == {0, 1}
    assert best_of(values, "more") == {2}
    assert best_of(values[:2], "less") == best_of(values, "") == frozenset()


def test_tables_are_latex_that_survives_any_name() -> None:
    table = summary_tables([Outcome("a_b & 5%{x}", "p=1", 0, "ok", figures={"accuracy": 1.0})])[0]
    text = table.latex()
    assert r"a\_b \& 5\%\{x\}" in text
    assert r"\toprule" in text
    assert text.count("&") == text.count(r"\&") + 2 * (len(table.columns) - 1)


@pytest.mark.skipif(not PDFLATEX, reason="no pdflatex on this machine")
def test_tables_are_set_by_latex_and_fit_the_page(tmp_path: Path) -> None:
    names = ["ate_rmse_m", *(kind.name for kind in headlines())]
    nasty = r"a_b & 5%{x}~^\#$<|> ± m²"
    runs = [
        Outcome(source, name, seed, "ok", figures=dict.fromkeys(names, -1.5e-5 * (1 + seed)))
        for source, name, seed in product((nasty, "[1].bag", "*"), (nasty, "y"), range(2))
    ]
    failed = Outcome("*", "y", 2, "failed", nasty)
    tables = [*summary_tables([*runs, failed]), difference_table(runs)]
    body = "\n".join(table.latex() for table in tables if table is not None)
    head = r"\documentclass{article}\usepackage{booktabs,graphicx}\begin{document}"
    (tmp_path / "t.tex").write_text(f"{head}\n{body}\n\\end{{document}}\n", encoding="utf-8")
    words = [PDFLATEX, "-interaction=nonstopmode", "-halt-on-error", "t.tex"]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-1500:]
    assert "Overfull" not in done.stdout
    assert (tmp_path / "t.pdf").stat().st_size > 5_000


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
    assert found.independent == 2


@pytest.mark.parametrize("count", [2, 4, 5, 7])
def test_all_pairs_of_few_variants_are_told_and_of_many_those_with_the_first(count: int) -> None:
    """Every mean by brute force over the seeds that both have."""
    rng = np.random.default_rng(count)
    runs = [
        Outcome("a", f"v{v}", seed, "ok", figures={"ate_rmse_m": float(rng.uniform())})
        for v in range(count)
        for seed in range(3)
        if (v, seed) != (1, 2)
    ]
    found = {(d.variant, d.than): (d.mean, d.pairs) for d in differences(runs)}
    couples = [(v, than) for v in range(count) for than in range(v) if than == 0 or count <= 4]
    assert sorted(found) == sorted((f"v{v}", f"v{than}") for v, than in couples)
    values = {(run.backend, run.seed): run.figures["ate_rmse_m"] for run in runs}
    for (variant, than), (mean, pairs) in found.items():
        apart = [
            values[variant, seed] - values[than, seed]
            for seed in range(3)
            if {(variant, seed), (than, seed)} <= values.keys()
        ]
        assert (mean, pairs) == (pytest.approx(np.mean(apart)), len(apart))


@pytest.mark.parametrize(("shift_m", "told"), [(0.0, False), (1.0, True)])
def test_the_page_says_when_every_robot_went_its_own_way(shift_m: float, told: bool) -> None:
    way = Trajectory(np.arange(30) * 10**9, np.column_stack([np.arange(30.0)] * 3))
    other = replace(way, poses=way.poses + shift_m)
    grid = OccupancyGrid(GridGeometry(0.0, 0.0, 1.0, 4, 4), np.zeros((4, 4), np.float32))
    runs = {"x": Estimate(way, grid, way), "y": Estimate(other, grid, other)}
    content = ComparisonContent("t", "l", [], [], [SourceView("a", runs, "x")])
    assert ("on a way of its own" in comparison_html(content)) == told


def twice(values: list[float], sources: list[str]) -> list[Outcome]:
    """Runs of two variants that differ by the given values, in order of source and seed."""
    return [
        Outcome(source, name, sources[:index].count(source), "ok", figures={"ate_rmse_m": figure})
        for index, (value, source) in enumerate(zip(values, sources, strict=True))
        for name, figure in (("x", 1.0), ("y", 1.0 + value))
    ]


@pytest.mark.parametrize(
    ("values", "sources", "clear"),
    [
        ([0.1] * 20, ["a"] * 20, False),  # a backend without random numbers, seed by seed
        ([0.1, 0.2] * 10, ["a", "b"] * 10, False),  # two recordings say little of others
        ([0.1, 0.2, 0.3, 0.2, 0.1], list("abcde"), False),
        ([0.1, 0.2, 0.3, 0.2, 0.1, 0.3], list("abcdef"), True),
        ([0.1, 0.12, 0.13, 0.14, 0.15, 0.16], ["a"] * 6, True),  # seeds that do differ
        ([0.1, -0.2, 0.3, -0.2, 0.1, -0.3], list("abcdef"), False),
    ],
)
def test_what_chance_or_repetition_brings_is_not_called_clear(
    values: list[float], sources: list[str], clear: bool
) -> None:
    runs = twice(values, sources)
    (found,) = differences(runs)
    assert found.is_clear is clear
    table = difference_table(runs)
    assert table is not None
    assert ((0, 2) in table.best) is clear


def test_a_repeated_figure_has_no_interval() -> None:
    (found,) = differences(twice([0.1] * 5, ["a"] * 5))
    assert np.isnan(found.interval).all()
    table = difference_table(twice([0.1] * 5, ["a"] * 5))
    assert table is not None
    assert table.rows[0][3] == "-"


def test_large_spreads_and_small_numbers_are_written_for_people() -> None:
    assert (number(470.0, 2), number(0.0234, 2), number(1234.0), number(-0.5)) == (
        "470", "0.023", "1234", "-0.5",
    )  # fmt: skip
    runs = [
        Outcome("a-1", "x", i, "ok", figures={"scans_per_s": v}) for i, v in enumerate((1, 941))
    ]
    assert summary_tables(runs)[1].rows[0][4] == "471 ± 665"
    table = TextTable("t", ("a", "b", "c"), (("run-2", "y - x", "-1.5 to 2.3e-05"),))
    assert r"run-2 & y - x & $-$1.5 to 2.3$\cdot10^{-5}$ \\" in table.latex()


def test_columns_without_room_go_into_a_table_below() -> None:
    titles = ("source", "backend", *(f"figure {index} [m]" for index in range(9)))
    row = ("a.bag", "gmapping", *(f"{index}.2345 ± 0.012" for index in range(9)))
    text = TextTable("t", titles, (row,), frozenset({(0, 10)})).latex()
    parts = text.split(r"\end{table}")[:-1]
    assert [part.count("gmapping") for part in parts] == [1, 1, 1]
    assert "{t, part 3 of 3}" in parts[2]
    assert r"\textbf{8.2345 $\pm$ 0.012} \\" in parts[2]
    assert all(f"{index}.2345" in text for index in range(9))
    for part in parts:
        (form,) = re.findall(r"\{tabular\}\{(l*r*)\}", part)
        assert part.count("&") == 2 * (len(form) - 1)
        assert part.count("{") == part.count("}")
    assert r"\caption{t}" in TextTable("t", titles[:4], (row[:4],)).latex()


def test_a_title_is_not_wider_than_its_column() -> None:
    text = TextTable("t", ("a", "b", "wall thickness, sigma [m]"), (("1", "2", "0.01"),)).latex()
    assert r"@{}}wall\\thickness,\\sigma\\{}[m]\end{tabular} \\" in text


def test_every_run_has_a_row_with_every_figure() -> None:
    columns, rows = run_rows(outcomes())
    assert len(rows) == 5
    assert all(len(row) == len(columns) for row in rows)
    assert rows[3][columns.index("problem")] == "it broke"
    assert rows[3][columns.index("ate_rmse_m")] is None


def test_spread_is_that_of_a_sample() -> None:
    s = spread([[1.0, 2.0], [6.0]])
    assert (s.mean, s.median, s.worst, s.count) == (3.0, 2.0, 6.0, 3)
    assert s.sd == pytest.approx(7.0**0.5)
    assert spread([[1.0, 2.0]], more_is_better=True).worst == 1.0
    assert spread([]).count == spread([[]]).count == 0
    assert spread([[0.1] * 3, [0.1] * 7]).sd == 0.0


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


def test_another_systems_result_is_compared_where_it_belongs() -> None:
    stamps = np.arange(40) * 100_000_000
    line = np.column_stack([np.arange(40) * 0.1, np.sin(np.arange(40.0) / 6), np.zeros(40)])
    geometry = GridGeometry.covering(-3.0, 8.0, -4.0, 5.0, 0.1)
    x, y = np.moveaxis(geometry.centers(), -1, 0)
    away = Pose2(2.0, -1.0, 0.6)  # their frame

    def drawn(map_from_grid: Pose2) -> OccupancyGrid:
        """The same L of walls in a free room, as seen from a frame."""
        x_m, y_m = np.moveaxis(map_from_grid.transform(np.stack([x, y], axis=-1)), -1, 0)
        walls = ((abs(x_m) < 0.3) & (y_m > 0) & (y_m < 2)) | (
            (abs(y_m) < 0.3) & (x_m > 0) & (x_m < 3)
        )
        return OccupancyGrid(geometry, walls.astype(np.float32))

    ours = Estimate(Trajectory(stamps, line), drawn(Pose2()))
    path = ours.trajectory.transformed(away.inverse())
    theirs = Estimate(path, drawn(away))
    (apart,) = agreements({("a", "x", 0): ours, ("a", "y", 0): theirs})
    assert apart.end_spread_m > 1.0
    assert apart.walls_iou < 0.3
    laid = aligned_to(ours, theirs)
    np.testing.assert_allclose(laid.trajectory.poses, line, atol=1e-9)
    for runs in ((ours, laid), (laid, ours)):
        found = agreements({("a", str(n), 0): run for n, run in enumerate(runs)})
        assert found[0].end_spread_m < 1e-9
        assert found[0].walls_iou > 0.8
    (bare,) = agreements({("a", "x", 0): ours, ("a", "y", 0): Estimate(path)})
    assert np.isnan(bare.walls_iou)
    assert bare.path_rms_m == pytest.approx(0.0, abs=1e-9)


def test_robots_on_ways_of_their_own_are_judged_by_these() -> None:
    stamps = np.arange(20) * 100_000_000
    ahead = np.column_stack([np.arange(20) * 0.2, np.zeros(20), np.zeros(20)])
    curved = ahead + np.column_stack([np.zeros(20), np.sin(np.arange(20.0)), np.zeros(20)])
    grid = OccupancyGrid(GridGeometry(0.0, 0.0, 0.1, 40, 60), np.eye(40, 60, dtype=np.float32))
    runs = {
        name: Estimate(Trajectory(stamps, way), grid, Trajectory(stamps, way))
        for name, way in (("x", ahead), ("y", curved))
    }
    (found,) = agreements({("room", name, 0): run for name, run in runs.items()})
    assert np.isnan([found.end_spread_m, found.path_rms_m]).all()
    assert found.walls_iou == 1.0
    same_way = replace(runs["y"], truth=runs["x"].truth)
    (found,) = agreements({("room", "x", 0): runs["x"], ("room", "y", 0): same_way})
    assert found.path_rms_m > 0.1
    ways = {name: run.trajectory for name, run in runs.items()}
    figure = error_figure({name: (way, way) for name, way in ways.items()})
    assert figure is not None
    assert max(np.max(trace.y) for trace in figure.content.data) < 1e-6


def test_page_escapes_what_it_shows() -> None:
    runs = [Outcome("<b>", "x", 0, "failed", "a & b")]
    page = comparison_html(ComparisonContent("t", "l", runs, summary_tables(runs)))
    body = page[page.index("<header>") :]
    assert "&lt;b&gt;" in body
    assert "a &amp; b" in body
    assert '<td class="short"><b></td>' not in body
