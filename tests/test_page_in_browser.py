# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The page in headless Chromium: no errors, toggles, pointers with units, phone, desk and print."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import plotly.graph_objects as go
import pytest

from slarm_graph.access_points import AccessPoint, RadioMap
from slarm_graph.backend import Table as BackendTable
from slarm_graph.eval.comparison import Outcome
from slarm_graph.eval.comparison_page import ComparisonContent, comparison_html
from slarm_graph.eval.comparison_tables import difference_table, summary_tables
from slarm_graph.eval.metric_table import headlines
from slarm_graph.eval.metrics import Metric
from slarm_graph.eval.page import Figure, page
from slarm_graph.eval.report import ReportContent, report_html
from slarm_graph.eval.trajectory_figures import GROUND_TRUTH, RAW_ODOMETRY, Marks
from slarm_graph.geographic import as_geographic
from slarm_graph.grid import GridGeometry, OccupancyGrid
from slarm_graph.readings import ScanStatus
from slarm_graph.trajectory import Trajectory
from slarm_graph.world import Solid

CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), ""
)
FLAGS = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
    *("--hide-scrollbars", "--virtual-time-budget=30000", "--enable-logging=stderr"),
)
EVIL = "<img src=x onerror=console.error('struck')>$\\frac{$%{x}"
WORDS = """
<script>
// Words of titles, numbers, keys and names before bars that go over more than one line.
const CELLS = "th, td.number, .bars td:first-child, td.short:last-child";
const brokenWords = () => Array.from(document.querySelectorAll(CELLS))
  .flatMap((cell) => {
    const walker = document.createTreeWalker(cell, NodeFilter.SHOW_TEXT), found = [];
    for (let node = walker.nextNode(); node; node = walker.nextNode())
      for (const word of node.data.matchAll(/\\S{1,32}(?!\\S)/g)) {
        if (word.index && /\\S/.test(node.data[word.index - 1])) continue;
        const range = document.createRange();
        range.setStart(node, word.index); range.setEnd(node, word.index + word[0].length);
        if (new Set(Array.from(range.getClientRects(), (r) => r.top)).size > 1) found.push(word[0]);
      }
    return found;
  });
</script>
"""
PAPER = """
<script>
addEventListener("load", () => { const wait = setInterval(() => {
  if (document.documentElement.dataset.ready !== "1") return;
  clearInterval(wait);
  const out = document.createElement("script"), wide = document.querySelector(".wide");
  const name = wide.querySelector("tbody td"), broken = brokenWords();
  wide.scrollLeft = 1e4;
  const left = (element) => element.getBoundingClientRect().left;
  out.type = "application/json"; out.id = "found";
  out.textContent = JSON.stringify({ broken, scrolled: wide.scrollLeft,
    name: name.textContent, off: left(name) - left(wide),
    groups: Array.from(wide.querySelectorAll("tr.group"), (row) => row.textContent),
    cells: document.querySelectorAll("td.number").length,
    page: document.documentElement.scrollWidth });
  document.body.append(out);
}, 50); });
</script>
"""
PROBE = """
<script>
addEventListener("load", () => { const wait = setInterval(() => {
  if (document.documentElement.dataset.ready !== "1") return;
  clearInterval(wait);
  const plots = Array.from(document.querySelectorAll(".plot")), first = plots[0], found = {};
  found.plots = plots.length;
  found.drawn = plots.filter((p) => p.querySelector("svg.main-svg")).length;
  found.width = innerWidth; found.page = document.documentElement.scrollWidth;
  found.widest = Math.max(...plots.map((p) => p.querySelector("svg.main-svg").clientWidth));
  found.broken = brokenWords();
  const boxes = (plot, kind) => Array.from(plot.querySelectorAll(kind))
    .map((element) => element.getBoundingClientRect());
  const curves = plots.filter((p) => !Number(p.dataset.aspect));
  // Titles of curves, and what they lie on.
  const titles = "text[class^=y][class$=title], .annotation text";
  const others = "g[class^=y][class$=tick] text, .modebar-btn, .bglayer .bg";
  found.titles = curves.flatMap((p) => boxes(p, titles)).length;
  const meet = (a, b) => a.left < b.right && b.left < a.right
    && a.top < b.bottom && b.top < a.bottom;
  found.covered = curves.flatMap((p) => boxes(p, titles)
    .flatMap((a) => boxes(p, others).filter((b) => meet(a, b)))).length;
  found.legend = Array.from(first.querySelectorAll(".legendtext")).map((t) => t.textContent);
  found.hover = plots.flatMap((p) => p.data.map((t) => t.hovertemplate || "")).filter(Boolean);
  const index = first.data.findIndex((t) => t.name === "raw odometry");
  const before = first.data[index].visible;
  Plotly.restyle(first, { visible: true }, [index]).then(() => {
    found.toggled = [before, first.data[index].visible];
    document.getElementById("theme").click();
    found.theme = document.documentElement.dataset.theme;
    found.background = getComputedStyle(document.body).backgroundColor;
    const out = document.createElement("script");
    out.type = "application/json"; out.id = "found"; out.textContent = JSON.stringify(found);
    document.body.append(out);
  });
}, 50); });
</script>
"""
AGAIN = """
<script>
addEventListener("load", () => { const wait = setInterval(() => {
  if (document.documentElement.dataset.ready !== "1") return;
  clearInterval(wait);
  const bars = () => Array.from(document.querySelectorAll(".colorbar text"))
    .filter((t) => t.textContent === "gain [dB]").length;
  const labels = () => document.querySelectorAll(".annotation").length;
  const first = document.querySelector(".plot");
  const toggled = first.data.findIndex((t) => t.name === "raw odometry");
  Plotly.restyle(first, { visible: true }, [toggled]).then(() => {
    const found = { bars: [bars()], labels: [labels()] };
    dispatchEvent(new Event("beforeprint"));
    found.bars.push(bars()); found.labels.push(labels());
    found.visible = first.data[toggled].visible;
    found.overlap = Array.from(document.querySelectorAll(".plot")).filter((plot) => {
      const legend = plot.querySelector(".legend"), map = plot.querySelector(".bglayer .bg");
      if (!legend || !map) return false;
      return legend.getBoundingClientRect().bottom > map.getBoundingClientRect().top + 4;
    }).length;
    const out = document.createElement("script");
    out.type = "application/json"; out.id = "found"; out.textContent = JSON.stringify(found);
    document.body.append(out);
  });
}, 50); });
</script>
"""

TALL_PX = 5000
"""Of the pictures that are taken; pytest keeps them for the last three times that it ran."""
PAPER_PX = 688
"""A4 less the page's margins of 14 mm, at 96 dots an inch."""

pytestmark = pytest.mark.skipif(not CHROMIUM, reason="no Chromium on this machine")


@pytest.fixture(scope="module")
def report() -> str:
    stamps = 10**18 + 10**8 * np.arange(200, dtype=np.int64)
    angle = np.linspace(0.0, 6.0, 200)
    poses = np.column_stack([2.0 * np.cos(angle), np.sin(angle), angle])
    path, drifted = Trajectory(stamps, poses), Trajectory(stamps, poses + angle[:, None])
    cells = np.zeros((60, 90), dtype=np.float32)
    cells[5, :] = cells[:, 7] = 1.0
    geometry = GridGeometry(-4.0, -3.0, 0.1, 60, 90)
    grid = OccupancyGrid(geometry, cells)
    points = tuple(AccessPoint(name, x, 0.0, 2.5) for name, x in ((EVIL, -1.0), ("AP2", 1.0)))
    loss = np.stack([60.0 + geometry.centers()[..., 0] ** 2] * 2).astype(np.float32)
    radio = RadioMap(geometry, points, loss, loss > 61.0, 0.5, "InF-SH", 7.0, "known")
    corner = np.array([(0.0, 0.0), (0.5, 0.0), (0.5, 0.5), (0.0, 0.5)])
    solids = tuple(Solid(EVIL, corner + 0.6 * n - 2.0, 1.0 + n) for n in range(5))
    rows = tuple((int(s), 20.0 + i % 7, i % 2, 9 * i) for i, s in enumerate(stamps))
    marks = Marks(poses[:20, :2].reshape(-1, 2, 2), [(0.0, 0.0, EVIL)], [(1.0, 1.0, EVIL)],
                  np.tile(0.01 * np.eye(3), (200, 1, 1)))  # fmt: skip
    return report_html(
        ReportContent(
            f"{EVIL}.bag, pose_graph", EVIL, grid,
            {EVIL: path, RAW_ODOMETRY: drifted, GROUND_TRUTH: path},
            replace(as_geographic(grid), solids=solids), radio,
            [Metric("ate_rmse_m", 0.012345, note=EVIL, interval=(0.05, 0.2)),
             Metric("relations_translation_sd_m", 0.012345, note="10 of 10 relations")],
            {"wall_s": 3.0, "stages": {"optimisation and map": 2.0},
             "stage_peak_mb": {"optimisation and map": 300.0}},
            [ScanStatus(1), ScanStatus(2, EVIL)],
            (BackendTable("particles", ("stamp_ns", "n_eff", "flag", "common_update"), rows),),
            [EVIL], EVIL, (f"backend: a -> {EVIL}",), marks, "consistent",
        )
    )  # fmt: skip


def chromium(tmp_path: Path, *words: str) -> subprocess.CompletedProcess[str]:
    profile = f"--user-data-dir={tmp_path / 'profile'}"
    done = subprocess.run(
        [CHROMIUM, *FLAGS, profile, *words],
        capture_output=True,
        text=True,
        timeout=400,
        check=False,
    )
    console = [line for line in done.stderr.splitlines() if "CONSOLE" in line]
    assert not console, console
    return done


def probed(tmp_path: Path, report: str, width: int, probe: str = PROBE) -> dict[str, object]:
    file = tmp_path / "page.html"
    # A frame of that width, because the window itself has a least width.
    (tmp_path / "inner.html").write_text(report.replace("</body>", WORDS + probe + "</body>"))
    file.write_text(
        f'<!doctype html><link rel="icon" href="data:,"><body style="margin:0"><iframe id="f"'
        f' src="inner.html" style="border:0;width:{width}px;height:{TALL_PX}px"></iframe><script>'
        "const wait = setInterval(() => { const d = document.getElementById('f').contentDocument;"
        "const out = d && d.getElementById('found'); if (!out) return; clearInterval(wait);"
        "document.body.append(document.importNode(out, true)); }, 100);</script>"
    )
    taken = (f"--window-size={width},{TALL_PX}", f"--screenshot={tmp_path / f'{width}.png'}")
    words = ("--allow-file-access-from-files", *taken, "--dump-dom")
    done = chromium(tmp_path, *words, file.as_uri())
    found = re.search(
        r'<script type="application/json" id="found">(.*?)</script>', done.stdout, re.S
    )
    assert found, done.stdout[-2000:]
    content: dict[str, object] = json.loads(found.group(1))
    return content


@pytest.mark.parametrize("width", [390, 1400])
def test_the_page_works_at_phone_and_desk_width(tmp_path: Path, report: str, width: int) -> None:
    found = probed(tmp_path, report, width)
    assert found["drawn"] == found["plots"] == 6
    seen = cv2.imread(str(tmp_path / f"{width}.png"))
    assert seen.shape[0] == TALL_PX
    assert np.ptp(seen[:, : width // 2]) > 200, "the picture shows something"
    assert found["width"] == width
    assert found["page"] <= width, "the page scrolls sideways"
    assert found["broken"] == []
    assert found["titles"] >= 3
    assert found["covered"] == 0, "a title lies on numbers, tools or curves"
    assert found["widest"] > 0.8 * min(width, 1200)
    assert found["toggled"] == ["legendonly", True]
    assert found["theme"] == "dark"
    assert found["background"] == "rgb(20, 24, 30)"
    assert any(EVIL in str(name) for name in found["legend"]), "names are text"
    hover = " ".join(found["hover"])
    assert " m" in hover
    assert " dB" in hover
    assert " s" in hover


def test_it_prints(tmp_path: Path, report: str) -> None:
    (tmp_path / "page.html").write_text(report)
    target = tmp_path / "page.pdf"
    chromium(tmp_path, f"--print-to-pdf={target}", (tmp_path / "page.html").as_uri())
    assert target.stat().st_size > 50_000
    assert 3 <= target.read_bytes().count(b"/Type /Page\n") <= 14


def test_what_was_drawn_for_a_phone_prints_as_if_drawn_for_paper(
    tmp_path: Path, report: str
) -> None:
    found = probed(tmp_path, report, 390, AGAIN)
    assert found["bars"] == [1, 1]
    assert found["labels"][0] < found["labels"][1]
    assert found["visible"] is True, "what was switched on stays so"
    assert found["overlap"] == 0


def compared() -> str:
    """A comparison with every figure of the short tables, and numbers as long as they get."""
    runs = [
        Outcome(
            source, backend, seed, "ok",
            figures={kind.name: 0.012345 * (seed + 1) for kind in headlines()},
        )
        for source in ("mit-csail.clf.gz", "paper_room")
        for backend in ("odometry", "pose_graph")
        for seed in range(2)
    ]  # fmt: skip
    told = difference_table(runs)
    assert told is not None
    return comparison_html(ComparisonContent("t", "l", runs, [*summary_tables(runs), told]))


@pytest.mark.parametrize("width", [390, 1400])
def test_no_title_of_a_comparison_is_broken(tmp_path: Path, width: int) -> None:
    found = probed(tmp_path, compared(), width, PAPER)
    assert found["broken"] == []
    assert found["page"] <= width
    assert found["groups"] == ["mit-csail.clf.gz", "paper_room", "all sources"]
    assert found["scrolled"] > 0
    assert (found["name"], found["off"]) == ("odometry", 0), "the names of rows stay in sight"


@pytest.mark.parametrize("kind", ["run", "comparison"])
def test_no_table_is_cut_and_no_number_broken_on_paper(
    tmp_path: Path, report: str, kind: str
) -> None:
    text = report if kind == "run" else compared()
    assert "@media print" in text
    found = probed(tmp_path, text.replace("@media print", "@media all"), PAPER_PX, PAPER)
    assert found["cells"] > 3
    assert found["broken"] == []
    assert found["page"] <= PAPER_PX


def test_a_page_of_nothing_but_a_figure_is_whole(tmp_path: Path) -> None:
    (tmp_path / "page.html").write_text(page("t", "l", [Figure(go.Figure(), "nothing")], []))
    chromium(tmp_path, "--dump-dom", (tmp_path / "page.html").as_uri())
