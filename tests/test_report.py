# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The report page: nothing occupied is lost when made coarser, every scan's status is counted."""

from __future__ import annotations

import base64
import itertools
import math
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import plotly.graph_objects as go
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from slarm_graph.access_points import AccessPoint, RadioMap
from slarm_graph.backend import Table as BackendTable
from slarm_graph.eval import report, report_figures
from slarm_graph.eval.gain_figure import gain_figure
from slarm_graph.eval.metric_table import kinds
from slarm_graph.eval.metrics import Metric
from slarm_graph.eval.page import (
    COLORS,
    Details,
    Facts,
    Figure,
    Notices,
    PageTable,
    Paragraph,
    Section,
    page,
    plain,
    shown,
)
from slarm_graph.eval.report import ReportContent, count_by_reason, scan_table, table_blocks
from slarm_graph.eval.report_figures import geographic_figure, map_picture
from slarm_graph.eval.trajectory_figures import GROUND_TRUTH, Marks, trajectory_figure
from slarm_graph.geographic import as_geographic
from slarm_graph.grid import GridGeometry, OccupancyGrid
from slarm_graph.readings import ScanStatus
from slarm_graph.trajectory import Trajectory
from slarm_graph.world import Solid


def decoded(uri: str) -> np.ndarray:
    data = np.frombuffer(base64.b64decode(uri.partition(",")[2]), dtype=np.uint8)
    image = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE)
    assert image is not None
    return image


def test_a_lonely_wall_cell_survives_a_coarser_picture_at_its_place() -> None:
    p = np.zeros((3001, 2002), dtype=np.float32)
    p[2999, 7] = 1.0
    picture, shown = map_picture(OccupancyGrid(GridGeometry(-1.0, 2.0, 0.05, 3001, 2002), p))
    image = decoded(picture)
    assert image.size <= 1_600_000
    assert shown.shape == image.shape
    row, col = np.argwhere(image == image.min())[0]
    cell = (shown.rows - 1 - row, col)
    assert np.abs(shown.center_of(cell) - [-1.0 + 7.5 * 0.05, 2.0 + 2999.5 * 0.05]).max() < 0.1


@pytest.mark.parametrize("count", [1, 3])
def test_gain_page_stays_small_whatever_the_map(count: int) -> None:
    geometry = GridGeometry(0.0, 0.0, 0.05, 900, 1100)
    loss = np.full((count, *geometry.shape), 70.0, dtype=np.float32)
    points = tuple(AccessPoint(f"AP{i}", 1.0 * i, 2.0, 2.5) for i in range(count))
    radio = RadioMap(geometry, points, loss, loss > 0, 0.5, "InF-SH", 7.0, "infinite")
    figure = gain_figure(radio)
    assert len(figure.json) < 1_000_000
    assert all(point.name in figure.json for point in points)
    assert ("best access point" in figure.json) == (count > 1)


def test_statuses_add_up_with_the_used_first() -> None:
    reasons = ["", "late", "", "blind", "late", ""]
    scans = [ScanStatus(i, reason) for i, reason in enumerate(reasons)]
    assert count_by_reason(scans) == [("used", 3), ("late", 2), ("blind", 1)]
    assert scan_table(scans).rows[1] == ("late", 2, "2 (33.3%)")


def test_long_tables_tell_what_is_left_out() -> None:
    table = BackendTable("loop_closures", ("a", "b"), tuple((i, "x") for i in range(350)))
    (folded,) = table_blocks(table)
    assert isinstance(folded, Details)
    assert folded.blocks[1] == Paragraph("50 more rows in loop_closures.csv")
    assert table_blocks(BackendTable("t", ("a",), ())) == (Paragraph("none"),)


def test_series_become_curves_and_paths_go_to_the_map() -> None:
    rows = tuple((i * 10**9, 5.0 + i, i % 2, "x") for i in range(20))
    figure, _ = table_blocks(BackendTable("particles", ("stamp_ns", "n_eff", "flag", "w"), rows))
    assert isinstance(figure, Figure)
    (curve,) = figure.content.data
    assert list(curve.x) == list(range(20))
    assert list(curve.y) == [5.0 + i for i in range(20)]
    path = tuple((i, 0.0, 1.0, 2.0) for i in range(20))
    assert table_blocks(BackendTable("p", ("stamp_ns", "x_m", "y_m", "theta_rad"), path)) == ()


@pytest.mark.parametrize(
    ("value", "text"),
    [(None, "-"), (float("nan"), "-"), (3.0, "3"), (0.123456, "0.1235"), ("a", "a"), (7, "7"),
     (math.inf, "-"), (-9999.4, "-9999"), (-9999.5, "-9999.500"), (123456.78912, "123456.789"),
     (-987654321.0, "-987654321"), (0.000012345, "1.234e-05"), (1234567890123, "1234567890123")],
)  # fmt: skip
def test_values_are_written_for_people(value: float | int | str | None, text: str) -> None:
    assert shown(value) == text


def test_the_true_path_looks_like_no_estimate() -> None:
    grid = OccupancyGrid(GridGeometry(0.0, 0.0, 1.0, 2, 2), np.zeros((2, 2), dtype=np.float32))
    path = Trajectory(np.arange(2), np.zeros((2, 3)))
    names = [*(f"estimate {index}" for index in range(len(COLORS) - 1)), GROUND_TRUTH]
    traces = trajectory_figure(grid, dict.fromkeys(names, path)).content.data
    looks = {t.name: (t.line.color, t.line.width) for t in traces if t.name in names}
    truth = looks.pop(GROUND_TRUTH)
    assert len({color for color, _ in looks.values()}) == len(looks)
    red, green, blue = (truth[0][i : i + 2] for i in (1, 3, 5))
    assert red == green == blue, "grey beside colours"
    assert truth[1] > max(width for _, width in looks.values())


def test_text_is_escaped_wherever_it_stands() -> None:
    evil = "<script>alert(1)</script>"
    figure = go.Figure(go.Scatter(x=[1], y=[2], name=plain(evil), text=[evil]))
    blocks = [
        Facts([(evil, evil)]),
        Notices([evil]),
        PageTable((evil,), [(evil,)]),
        Details(evil, (Paragraph(evil),)),
        Figure(figure, evil),
    ]
    whole = page(evil, evil, blocks, [Section(evil, blocks)])
    body = whole[whole.index("</title>") :]
    assert evil not in body[body.index("<body>") :]
    assert body.count("&lt;script&gt;alert(1)") >= 12


def test_parts_of_the_page_have_names_of_their_own() -> None:
    figure = Figure(go.Figure(), "nothing")
    whole = page("t", "l", [figure, figure], [])
    assert 'id="figure-0-data"' in whole
    assert 'id="figure-1-data"' in whole


def test_few_cells_are_drawn_sharply() -> None:
    p = np.zeros((3, 4), dtype=np.float32)
    p[0, 1] = 1.0
    picture, shown = map_picture(OccupancyGrid(GridGeometry(0.0, 0.0, 0.25, 3, 4), p))
    image = decoded(picture)
    assert shown.shape == (3, 4)
    times = image.shape[1] // 4
    assert image.shape == (3 * times, 4 * times)
    assert times >= 100
    assert np.array_equal(np.argwhere(image == 40).min(axis=0), [2 * times, times])
    assert (image == 40).sum() == times**2


def test_the_geographic_map_tells_states_and_heights() -> None:
    p = np.zeros((20, 30), dtype=np.float32)
    p[5, :] = 1.0
    box = Solid("box", np.array([[0.1, 0.2], [0.3, 0.2], [0.3, 0.4], [0.1, 0.4]]), 1.25)
    grid = OccupancyGrid(GridGeometry(0.0, 0.0, 0.05, 20, 30), p)
    page = geographic_figure(replace(as_geographic(grid), solids=(box,))).content.to_json()
    assert "1.25 m" in page
    assert "accessible" in page
    assert "obstacle" in page
    assert "out of reach" not in page


def test_a_label_does_not_hide_the_obstacle_it_is_of() -> None:
    p = np.zeros((400, 600), dtype=np.float32)
    ring = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    pillar, hall = Solid("pillar", 2.0 + 0.3 * ring, 6.5), Solid("hall", 10.0 + 9.0 * ring, 4.5)
    grid = OccupancyGrid(GridGeometry(0.0, 0.0, 0.1, 400, 600), p)
    page = geographic_figure(replace(as_geographic(grid), solids=(pillar, hall))).content.to_json()
    assert "pillar 6.5 m" in page
    assert ">6.5 m<" not in page.encode().decode("unicode_escape")
    assert ">4.5 m<" in page.encode().decode("unicode_escape")


@pytest.mark.parametrize("scale_px_m", [6.0, 10.0, 20.0])
def test_written_heights_lie_on_their_obstacles_and_never_on_each_other(scale_px_m: float) -> None:
    """At every scale at which the template may show them."""
    rng = np.random.default_rng(0)
    solids = []
    for _ in range(120):
        x, y, wide, deep = rng.uniform((0.0, 0.0, 0.1, 0.1), (40.0, 30.0, 6.0, 6.0))
        corners = ((x, y), (x + wide, y), (x + wide, y + deep), (x, y + deep))
        solids.append(Solid("wall", np.array(corners), round(float(rng.uniform(0.5, 3.0)), 2)))
    fig = go.Figure()
    report_figures._add_heights(fig, solids, 20.0)
    shown = [a for a in fig.layout.annotations if scale_px_m >= float(a.name)]
    assert 2 < len(shown) < len(solids)
    for one, other in itertools.combinations(shown, 2):
        wide_px = 4.0 * (len(one.text) + len(other.text) - 2 * len("<b></b>"))
        apart_x, apart_y = abs(one.x - other.x) * scale_px_m, abs(one.y - other.y) * scale_px_m
        assert apart_x >= wide_px - 0.1 or apart_y >= 18.0 - 0.1


def test_obstacles_tell_their_heights_in_one_line() -> None:
    ring = np.array([(0.0, 0.0), (2.0, 0.0), (1.0, 2.0)])
    fig = go.Figure()
    report_figures._add_outlines(
        fig, [Solid("a <b>", ring, 2.5), Solid("c", ring + 3.0, 1.0)], labelled=True
    )
    (trace,) = fig.data
    told = {
        (float(x), float(y)): word for x, y, word in zip(trace.x, trace.y, trace.text, strict=True)
    }
    assert told[2.0, 0.0] == "a &lt;b&gt; 2.5 m"
    assert told[3.0, 3.0] == told[4.0, np.float32(3.0 + 2.0 / 3.0)] == "c 1 m"


def small_content(**changes: Any) -> ReportContent:
    """A report of three poses on a free map."""
    cells = np.zeros((8, 8), dtype=np.float32)
    grid = OccupancyGrid(GridGeometry(0.0, 0.0, 0.5, 8, 8), cells)
    poses = np.array([[1.0, 1.0, 0.0], [1.0, 2.0, 0.0], [4.0, 2.0, 1.0]])
    path = Trajectory(np.array([0, 10**9, 61 * 10**9]), poses)
    return ReportContent("t", "l", grid, {"e": path}, as_geographic(grid), None,
                         **{"metrics": [], "record": {}, "scans": [], "tables": [],
                            "notices": [], "config_text": "", **changes})  # fmt: skip


def test_every_headline_is_among_the_key_facts_and_nothing_else_of_the_metrics() -> None:
    names = list(kinds())
    metrics = [Metric(name, 0.5 + k) for k, name in enumerate(names)]
    facts = report._key_facts(small_content(metrics=metrics, verdict="consistent"))
    assert facts[:4] == [
        ("3", "scans used"), ("61 s", "recorded"), ("4.0 m", "driven"),
        ("consistent", "says the run of itself"),
    ]  # fmt: skip
    expected = [
        (f"{m.value:.3g} {m.kind.unit}".strip(), m.kind.title) for m in metrics if m.kind.headline
    ]
    assert 0 < len(expected) < len(metrics)
    assert facts[4:] == expected


@pytest.mark.parametrize(
    ("source", "remedy", "hides"),
    [
        ("infinite", True, True),
        ("matched sizes (2 obstacles), else infinite", True, True),
        ("prior", True, False),
        ("matched sizes (2 obstacles), else default", False, False),
        ("default", False, False),
    ],
)
def test_what_unknown_heights_mean_is_said_where_there_are_any(
    source: str, remedy: bool, hides: bool
) -> None:
    geographic = replace(small_content().geographic, height_source=source)
    _, words = report._geographic_part(geographic)
    assert ("recovery.default_height_m" in words.text) == remedy
    assert ("hides all behind it" in words.text) == hides
    assert "16.0 m² accessible, in cells of 0.5 m" in words.text


def points_of(fig: go.Figure, name: str) -> np.ndarray:
    (trace,) = (t for t in fig.data if t.name == name)
    return np.column_stack([np.asarray(trace.x, float), np.asarray(trace.y, float)])


def test_all_marks_lie_where_they_are() -> None:
    content = small_content()
    path = content.trajectories["e"]
    closures = np.arange(8.0).reshape(2, 2, 2)
    marks = Marks(closures, [(1.0, 2.0, "no")], [(3.0, 2.5, "torn"), (0.5, 0.0, "b")])
    fig = trajectory_figure(content.grid, {"e": path}, marks).content
    assert points_of(fig, "start").tolist() == path.poses[:1, :2].tolist()
    assert points_of(fig, "end").tolist() == path.poses[-1:, :2].tolist()
    assert points_of(fig, "rejected closures (1)").tolist() == [[1.0, 2.0]]
    assert points_of(fig, "contradictions (2)").tolist() == [[3.0, 2.5], [0.5, 0.0]]
    line = points_of(fig, "loop closures (2)").reshape(2, 3, 2)
    np.testing.assert_array_equal(line[:, :2], closures)
    assert np.isnan(line[:, 2]).all()


def test_ellipses_hold_95_percent_of_what_is_drawn_from_the_covariances() -> None:
    """Their points lie at the 95 % quantile of the distance that the covariance of a pose makes."""
    rng = np.random.default_rng(0)
    poses = np.column_stack([rng.uniform(0.0, 4.0, (5, 2)), rng.uniform(-3.0, 3.0, 5)])
    roots = rng.normal(size=(5, 3, 3))
    covariances = roots @ roots.transpose(0, 2, 1)
    covariances[2] = np.nan
    marks = Marks(covariances=covariances)
    path = Trajectory(np.arange(5), poses)
    fig = trajectory_figure(small_content().grid, {"e": path}, marks).content
    rings = points_of(fig, "95 % ellipses").reshape(4, 26, 2)
    for ring, index in zip(rings, (0, 1, 3, 4), strict=True):
        turn = Rotation.from_euler("z", poses[index, 2]).as_matrix()[:2, :2]
        away = (ring[:-1] - poses[index, :2]) @ turn
        spread = np.linalg.inv(covariances[index][:2, :2])
        distances = np.einsum("ni,ij,nj->n", away, spread, away)
        np.testing.assert_allclose(distances, chi2(2).ppf(0.95), rtol=1e-3)
