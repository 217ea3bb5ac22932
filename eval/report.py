# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The report of one run: where the robot went, the radio map, the numbers, what was left out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from slarm_graph.access_points import RadioMap
from slarm_graph.backend import Table
from slarm_graph.eval import report_page as html
from slarm_graph.eval.gain_figure import gain_figure
from slarm_graph.eval.metric_table import headlines
from slarm_graph.eval.metrics import Metric
from slarm_graph.eval.report_figures import geographic_figure, trajectory_figure
from slarm_graph.geographic import GeographicMap
from slarm_graph.grid import OccupancyGrid
from slarm_graph.readings import ScanStatus
from slarm_graph.trajectory import Trajectory

_MAX_TABLE_ROWS = 300
"""Rows of a table on the page: more than anybody reads; all of them are in the CSV beside it."""


@dataclass(frozen=True, slots=True)
class ReportContent:
    """Everything the report shows.

    Parameters
    ----------
    title, lead : str
    grid : OccupancyGrid
    trajectories : mapping of str to Trajectory
        By what to call them, all in the frame of the grid; the first is the estimate.
    geographic : GeographicMap
    radio : RadioMap or None
    metrics : sequence of Metric
    record : mapping
        As in `run.json`.
    scans : sequence of ScanStatus
    tables : sequence of Table
        The backend's own.
    notices : sequence of str
    config_text : str
        The resolved configuration.
    """

    title: str
    lead: str
    grid: OccupancyGrid
    trajectories: Mapping[str, Trajectory]
    geographic: GeographicMap
    radio: RadioMap | None
    metrics: Sequence[Metric]
    record: Mapping[str, object]
    scans: Sequence[ScanStatus]
    tables: Sequence[Table]
    notices: Sequence[str]
    config_text: str


def report_html(content: ReportContent) -> str:
    """Return the report as one self-contained page."""
    return html.page(
        content.title,
        [
            html.heading(content.title, content.lead),
            html.facts(_key_facts(content)),
            html.notices(content.notices),
            html.section(
                "Trajectory over the map", trajectory_figure(content.grid, content.trajectories)
            ),
            html.section("Geographic map", _geographic_part(content.geographic)),
            html.section("Channel power gain", _radio_part(content.radio)),
            html.section("Metrics", _metric_table(content.metrics)),
            html.side_by_side(
                html.section("Time by stage", _stage_bars(content.record)),
                html.section("Scans", dropped_table(content.scans)),
            ),
            *(html.section(_title_of(t.name), backend_table(t)) for t in content.tables),
            html.section(
                "Configuration and versions",
                html.folded("resolved configuration", html.code(content.config_text)),
                html.folded("run record", _record_table(content.record)),
            ),
        ],
    )


def count_by_reason(scans: Iterable[ScanStatus]) -> list[tuple[str, int]]:
    """Return how many scans have each status: the used ones first, then the commonest reasons."""
    reasons = Counter(scan.reason for scan in scans)
    used = reasons.pop("", 0)
    return [("used", used), *reasons.most_common()]


def dropped_table(scans: Sequence[ScanStatus]) -> str:
    """Return the table of used and dropped scans."""
    rows = [(reason, count, f"{count / len(scans):.1%}") for reason, count in _counts(scans)]
    return html.table(("status", "scans", "share"), rows)


def _counts(scans: Sequence[ScanStatus]) -> list[tuple[str, int]]:
    return count_by_reason(scans) if scans else []


def backend_table(table: Table) -> str:
    """Return a backend's table, cut where it is long."""
    left_out = len(table.rows) - _MAX_TABLE_ROWS
    more = f"<p>{left_out} more rows in {table.name}.csv</p>" if left_out > 0 else ""
    empty = "<p>none</p>" if not table.rows else ""
    return html.table(table.columns, table.rows[:_MAX_TABLE_ROWS]) + more + empty


def _geographic_part(geographic: GeographicMap) -> str:
    cell_m2 = geographic.geometry.resolution_m**2
    area_m2 = float(geographic.accessible.sum()) * cell_m2
    words = (
        f"{area_m2:.1f} m² accessible, in cells of {geographic.geometry.resolution_m:g} m; recovery"
        f" changed {geographic.changed_cells} of {geographic.states.size} cells. Obstacle heights:"
        f" {geographic.height_source}."
    )
    if "infinite" in geographic.height_source:
        words += (
            " An obstacle of infinite height hides all behind it, which never promises a signal"
            " that is not there; if heights are known, set recovery.known_sizes or"
            " recovery.default_height_m."
        )
    return geographic_figure(geographic) + f"<p>{words}</p>"


def _radio_part(radio: RadioMap | None) -> str:
    if radio is None:
        return "<p>No access point was given; add <code>--ap X Y Z</code>.</p>"
    frequencies = ", ".join(sorted({f"{ap.frequency_hz * 1e-9:g}" for ap in radio.access_points}))
    return gain_figure(radio) + (
        f"<p>{radio.scenario} at {frequencies} GHz, antenna {radio.antenna_height_m:g} m above the"
        f" floor, Rician factor {radio.rician_factor_db:g} dB, obstacle heights:"
        f" {radio.height_source}. Expected gain = minus path loss (3GPP TR 38.901).</p>"
    )


def _metric_table(metrics: Sequence[Metric]) -> str:
    rows = [(m.kind.title, m.value, m.unit, m.note, m.name) for m in metrics]
    return html.table(("metric", "value", "unit", "how", "key"), rows) if rows else ""


def _key_facts(content: ReportContent) -> list[tuple[str, str]]:
    estimate = next(iter(content.trajectories.values()))
    duration_s = (estimate.stamps_ns[-1] - estimate.stamps_ns[0]) * 1e-9
    found = [
        (f"{len(estimate)}", "scans used"),
        (f"{duration_s:.0f} s", "recorded"),
        (f"{estimate.path_length_m():.1f} m", "driven"),
    ]
    for metric in content.metrics:
        if metric.kind.headline:
            found.append((f"{metric.value:.3g} {metric.unit}".strip(), metric.kind.title))
    for kind in headlines():
        value = content.record.get(kind.name)
        if isinstance(value, (int, float)):
            text = f"{value:.0f}" if value >= 10 else f"{value:.1f}"
            found.append((f"{text} {kind.unit}".strip(), kind.title))
    return found


def _stage_bars(record: Mapping[str, object]) -> str:
    stages = record.get("stages")
    if not isinstance(stages, dict):
        return ""
    return html.bars([(str(name), float(seconds)) for name, seconds in stages.items()], "s")


def _record_table(record: Mapping[str, object]) -> str:
    rows: list[tuple[str, str]] = []
    for key, value in record.items():
        nested = value.items() if isinstance(value, dict) else [("", value)]
        rows += [(f"{key}.{name}" if name else key, str(inner)) for name, inner in nested]
    return html.table(("key", "value"), rows)


def _title_of(name: str) -> str:
    return name.replace("_", " ").capitalize()
