# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The report page of a run: trajectory, maps, metrics, dropped scans, configuration."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from slarm_graph.access_points import RadioMap
from slarm_graph.backend import Table as BackendTable
from slarm_graph.counts import count_of
from slarm_graph.eval.gain_figure import gain_curves, gain_figure, measured_figure
from slarm_graph.eval.metric_table import headlines
from slarm_graph.eval.metrics import INTERVAL, Metric
from slarm_graph.eval.page import (
    Bars,
    Block,
    Cell,
    Code,
    Details,
    Facts,
    Notices,
    PageTable,
    Paragraph,
    Section,
    page,
)
from slarm_graph.eval.report_figures import HEIGHT_WORDS, MAP_WORDS, geographic_figure
from slarm_graph.eval.run_figures import error_figure, table_figure
from slarm_graph.eval.trajectory_figures import GROUND_TRUTH, Marks, trajectory_figure
from slarm_graph.geographic import CellState, GeographicMap
from slarm_graph.grid import OccupancyGrid
from slarm_graph.radio.measured.files import fitted_rows
from slarm_graph.radio.measured.height_posterior import HeightPosterior, height_rows
from slarm_graph.radio.measured.measured_map import MeasuredMap
from slarm_graph.raster.bands import windows
from slarm_graph.readings import ScanStatus
from slarm_graph.trajectory import Trajectory

_MAX_TABLE_ROWS = 300
"""Most rows shown of a backend's table; the CSV beside the page has all."""


@dataclass(frozen=True, slots=True)
class ReportContent:
    """The content of the report.

    Parameters
    ----------
    title, lead : str
    grid : OccupancyGrid
    trajectories : mapping of str to Trajectory
        By label, all in the frame of the grid; the first is the estimate.
    geographic : GeographicMap
    radio : RadioMap or None
    metrics : sequence of Metric
    record : mapping
        As in `run.json`.
    scans : sequence of ScanStatus
    tables : sequence of BackendTable
        The backend's own.
    notices : sequence of str
    config_text : str
        The resolved configuration.
    config_changes : sequence of str
        Settings that are not the default, as `key: default -> value`.
    marks : Marks
        Loop closures, contradictions and covariances, drawn in the map.
    verdict : str
        The run's verdict on its own consistency.
    measured : MeasuredMap or None
    heights : sequence of HeightPosterior
        What was heard of heights that nobody had said.
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
    tables: Sequence[BackendTable]
    notices: Sequence[str]
    config_text: str
    config_changes: Sequence[str] = ()
    marks: Marks = field(default_factory=Marks)
    verdict: str = ""
    measured: MeasuredMap | None = None
    heights: Sequence[HeightPosterior] = ()


def report_html(content: ReportContent) -> str:
    """Return the report as one self-contained page."""
    paths = {name: path for t in content.tables if (path := t.path()) for name in (t.name,)}
    trajectories = {**content.trajectories, **{n.replace("_", " "): p for n, p in paths.items()}}
    top: list[Block] = [Facts(_key_facts(content)), Notices(content.notices)]
    return page(
        content.title,
        content.lead,
        top,
        [
            Section(
                "Trajectory over the map",
                (
                    trajectory_figure(content.grid, trajectories, content.marks),
                    Paragraph(MAP_WORDS + " Entries of the legend switch on and off."),
                ),
            ),
            Section("Errors along the way", _error_part(content)),
            Section("Metrics", _metric_table(content.metrics)),
            Section("Geographic map", _geographic_part(content.geographic)),
            Section("Radio map", _radio_part(content.radio)),
            *_measured_part(content.measured),
            *_heights_part(content.heights),
            Section("Scans", (scan_table(content.scans),) if content.scans else ()),
            Section("Time and memory by stage", _stage_bars(content.record)),
            *(Section(_title_of(t.name), table_blocks(t)) for t in content.tables),
            Section("Configuration and versions", _configuration(content)),
        ],
    )


def count_by_reason(scans: Iterable[ScanStatus]) -> list[tuple[str, int]]:
    """Return the number of scans by status: the used ones, then the dropped ones by reason."""
    reasons = Counter(scan.reason for scan in scans)
    used = reasons.pop("", 0)
    return [("used", used), *reasons.most_common()]


def scan_table(scans: Sequence[ScanStatus]) -> Bars:
    """Return a table of the used scans and of the dropped ones by reason."""
    total = max(len(scans), 1)
    return Bars(
        [
            (reason, count, f"{count} ({count / total:.1%})")
            for reason, count in count_by_reason(scans)
        ]
    )


def table_blocks(table: BackendTable) -> tuple[Block, ...]:
    """Return a backend's table as a figure where it is a time series, else as rows, cut if long."""
    if not table.rows:
        return (Paragraph("none"),)
    figure = table_figure(table)
    if table.path() is not None:
        return ()
    left_out = len(table.rows) - _MAX_TABLE_ROWS
    more = (
        (Paragraph(f"{count_of(left_out, 'more row')} in {table.name}.csv"),)
        if left_out > 0
        else ()
    )
    keep = [i for i, name in enumerate(table.columns) if name != "stamp_ns"]
    columns = [table.columns[i].replace("_", " ") for i in keep]
    rows = PageTable(columns, [[row[i] for i in keep] for row in table.rows[:_MAX_TABLE_ROWS]])
    shown = Details(count_of(len(table.rows), "row"), (rows, *more))
    return (figure, shown) if figure else (shown,)


def _error_part(content: ReportContent) -> tuple[Block, ...]:
    truth = content.trajectories.get(GROUND_TRUTH)
    if truth is None:
        return ()
    estimates = {n: t for n, t in content.trajectories.items() if n != GROUND_TRUTH}
    figure = error_figure({name: (truth, estimate) for name, estimate in estimates.items()})
    words = Paragraph("Each trajectory is laid onto the truth by SE(2), without scale.")
    return (figure, words) if figure else ()


def _geographic_part(geographic: GeographicMap) -> tuple[Block, ...]:
    cell_m2 = geographic.geometry.resolution_m**2
    accessible = sum(
        int(np.count_nonzero(geographic.states[part.cells] == CellState.ACCESSIBLE))
        for part in windows(geographic.where)
    )
    area_m2 = accessible * cell_m2
    words = (
        f"{area_m2:.1f} m² accessible, in cells of {geographic.geometry.resolution_m:g} m; recovery"
        f" changed {geographic.changed_cells} of {geographic.states.size} cells. Obstacle heights:"
        f" {geographic.height_source}. Expansion radius R_e = {geographic.expansion_radius_m:g} m."
    )
    if "prior" in geographic.height_source:
        words += (
            " Where nobody said how high an obstacle is, a link has a probability of line of sight"
            " and the gain is the expected one; if heights are known, set recovery.known_sizes or"
            " recovery.default_height_m."
        )
    if "infinite" in geographic.height_source:
        words += (
            " An obstacle of infinite height hides all behind it, which never promises a signal"
            " that is not there; if heights are known, set recovery.known_sizes or"
            " recovery.default_height_m."
        )
    elif geographic.solids:
        words += f" {HEIGHT_WORDS}"
    return geographic_figure(geographic), Paragraph(words)


def _radio_part(radio: RadioMap | None) -> tuple[Block, ...]:
    if radio is None:
        return (Paragraph("No access point was given; add --ap X Y Z."),)
    frequencies = ", ".join(sorted({f"{ap.frequency_hz * 1e-9:g}" for ap in radio.access_points}))
    words = (
        f"{radio.scenario} at {frequencies} GHz, antenna {radio.antenna_height_m:g} m above the"
        f" floor, Rician factor {radio.rician_factor_db:g} dB, obstacle heights:"
        f" {radio.height_source}, R_e = {radio.expansion_radius_m:g} m. Expected gain = minus path"
        " loss (3GPP TR 38.901); all access points on one scale."
    )
    return gain_figure(radio), Paragraph(words), gain_curves(radio)


def _measured_part(measured: MeasuredMap | None) -> tuple[Section, ...]:
    """Return the section on the measured radio map; empty without one."""
    if measured is None:
        return ()
    rows = fitted_rows(measured)
    table = PageTable(tuple(rows[0]), [tuple(row.values()) for row in rows])
    words = (
        "Expected level from the readings on the way: a multi-wall law with a residual field that"
        " does not pass walls. The standard deviation is that of the expected level; a new reading"
        " spreads farther (noise and drift in the table)."
    )
    blocks = (measured_figure(measured), Paragraph(words), Details("what was fitted", (table,)))
    return (Section("Measured signal strength", blocks),)


def _heights_part(heights: Sequence[HeightPosterior]) -> tuple[Section, ...]:
    """Return the section on heights that were heard, none where nothing was."""
    if not heights:
        return ()
    rows = height_rows(heights)
    table = PageTable(tuple(rows[0]), [tuple(row.values()) for row in rows])
    words = (
        "Heights that nobody has said, by what was heard behind obstacles: quantiles of the prior,"
        " by class of plan, and of the posterior. Line of sight is that of the posterior."
    )
    return (Section("Heights of obstacles", (Paragraph(words), table)),)


def _metric_table(metrics: Sequence[Metric]) -> tuple[Block, ...]:
    if not metrics:
        return ()
    shown = any(m.interval_words() for m in metrics)
    columns = ("metric", "value", "unit", *([INTERVAL] if shown else []), "how", "key")
    rows: list[tuple[Cell, ...]] = [
        (
            *(m.kind.title, m.value, m.unit),
            *([m.interval_words()] if shown else []),
            *(m.note, m.name),
        )
        for m in metrics
    ]
    return (PageTable(columns, rows),)


def _key_facts(content: ReportContent) -> list[tuple[str, str]]:
    estimate = next(iter(content.trajectories.values()))
    duration_s = (estimate.stamps_ns[-1] - estimate.stamps_ns[0]) * 1e-9
    found = [
        (f"{len(estimate)}", "scans used"),
        (f"{duration_s:.0f} s", "recorded"),
        (f"{estimate.path_length_m():.1f} m", "driven"),
    ]
    if content.verdict:
        found.append((content.verdict, "says the run of itself"))
    for metric in content.metrics:
        if metric.kind.headline:
            found.append((f"{metric.value:.3g} {metric.unit}".strip(), metric.kind.title))
    for kind in headlines():
        value = content.record.get(kind.name)
        if isinstance(value, (int, float)):
            text = f"{value:.0f}" if value >= 10 else f"{value:.1f}"
            found.append((f"{text} {kind.unit}".strip(), kind.title))
    return found


def _stage_bars(record: Mapping[str, object]) -> tuple[Block, ...]:
    stages, peaks = record.get("stages"), record.get("stage_peak_mb")
    if not isinstance(stages, dict):
        return ()
    memory = peaks if isinstance(peaks, dict) else {}
    rows = []
    for name, seconds in stages.items():
        peak = f", {memory[name]:.0f} MB" if name in memory else ""
        rows.append((str(name), float(seconds), f"{float(seconds):.2f} s{peak}"))
    words = Paragraph("Memory is the process's peak up to the end of the stage.")
    return (Bars(rows), words) if memory else (Bars(rows),)


def _configuration(content: ReportContent) -> tuple[Block, ...]:
    changes = content.config_changes
    rows = [_change(change) for change in changes]
    table: tuple[Block, ...] = (Paragraph("All settings are the defaults."),)
    if rows:
        table = (PageTable(("setting", "default", "here"), rows),)
    return (
        *table,
        Details("resolved configuration", (Code(content.config_text),)),
        Details("run record", (_record_table(content.record),)),
    )


def _change(text: str) -> tuple[str, str, str]:
    key, _, values = text.partition(": ")
    before, _, after = values.partition(" -> ")
    return key, before, after


def _record_table(record: Mapping[str, object]) -> PageTable:
    rows: list[tuple[str, str]] = []
    for key, value in record.items():
        nested = value.items() if isinstance(value, dict) else [("", value)]
        rows += [(f"{key}.{name}" if name else key, str(inner)) for name, inner in nested]
    return PageTable(("key", "value"), rows)


def _title_of(name: str) -> str:
    return name.replace("_", " ").capitalize()
