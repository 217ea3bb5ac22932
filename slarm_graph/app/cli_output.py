# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""What commands print: tables on standard output, notes on standard error."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

from rich.console import Console
from rich.table import Table

from slarm_graph.eval.metrics import Metric, best_of, metrics_json
from slarm_graph.readings import ScanStatus

if TYPE_CHECKING:
    from slarm_graph.app.run_folder import RunFolder
    from slarm_graph.eval.comparison import Outcome

_MAX_PICTURES = 8
"""Pictures in a gallery: two rows of four on a wide screen."""


def show_metrics(metrics: Sequence[Metric], *, title: str, as_json: bool = False) -> None:
    """Print metrics as a table, or as the JSON of `metrics.json`."""
    if as_json:
        print(metrics_json(metrics), end="")
        return
    rows = [(m.kind.title, f"{m.value:.6g}", m.unit, m.name, m.note) for m in metrics]
    show_table(("metric", "value", "unit", "key", "how"), rows, title=title, right=(1,))


def show_metrics_of_many(metrics: Mapping[str, Sequence[Metric]]) -> None:
    """Print metrics of several beside each other, the best with a star."""
    from slarm_graph.eval.metric_table import in_table_order

    values = {name: {m.name: m.value for m in found} for name, found in metrics.items()}
    every = in_table_order(m for found in metrics.values() for m in found)
    rows = []
    for metric in every:
        row = [of.get(metric.name, math.nan) for of in values.values()]
        best = best_of(row, metric.kind.better)
        shown = [f"{'*' if index == best else ''}{v:.4g}" for index, v in enumerate(row)]
        rows.append((metric.kind.titled(), *shown))
    show_table(("metric", *metrics), rows, right=range(1, len(metrics) + 1))


def show_table(
    columns: Sequence[str],
    rows: Iterable[Sequence[str]],
    *,
    title: str = "",
    right: Sequence[int] = (),
) -> None:
    """Print a table; it is never cut when standard output is not a terminal."""
    table = Table(title=title or None, title_justify="left", box=None, pad_edge=False)
    for index, column in enumerate(columns):
        table.add_column(column, justify="right" if index in right else "left")
    for row in rows:
        table.add_row(*row)
    Console(width=None if sys.stdout.isatty() else 200, highlight=False, markup=False).print(table)


def show_notices(notices: Iterable[str]) -> None:
    """Print what a user should know."""
    for notice in notices:
        print(f"note: {notice}", file=sys.stderr)


def show_scans(scans: Sequence[ScanStatus]) -> None:
    """Print how many scans were not used and why, where there are any."""
    from slarm_graph.eval.report import count_by_reason

    (_, _used), *dropped = count_by_reason(scans)
    if dropped:
        total = sum(count for _, count in dropped)
        reasons = ", ".join(f"{count} {reason}" for reason, count in dropped)
        print(f"note: {total} of {len(scans)} scans not used: {reasons}", file=sys.stderr)


def show_comparison(folder: RunFolder, outcomes: Sequence[Outcome], what: str) -> None:
    """Print and write a comparison: tables, as CSV by run and by backend, and `report.html`."""
    from slarm_graph.app.outputs import csv_text
    from slarm_graph.eval.comparison import (
        comparison_html,
        run_rows,
        summaries,
        summary_rows,
    )

    for title, (columns, rows) in summaries(outcomes):
        show_table(columns, rows, title=title)
    folder.write_text("comparison.csv", csv_text(*run_rows(outcomes)))
    folder.write_text("summary.csv", csv_text(*summary_rows(outcomes)))
    good = sum(outcome.status == "ok" for outcome in outcomes)
    lead = f"{what}; {good} of {len(outcomes)} runs ok"
    page = comparison_html(outcomes, lead, _pictures(folder, outcomes))
    folder.write_text("report.html", page)
    folder.note(status="ok" if good == len(outcomes) else "partial", runs=len(outcomes))
    print(f"{lead} -> {folder.path}/report.html")


def _pictures(folder: RunFolder, outcomes: Sequence[Outcome]) -> list[tuple[str, bytes]]:
    """Return the radio map of every source and backend at its first seed, with a caption."""
    first = {(o.source, o.backend): o for o in reversed(outcomes) if o.status == "ok"}
    found = [
        (f"{o.source}, {o.backend}", folder.path / o.folder / "radio_map.png")
        for o in outcomes
        if first.get((o.source, o.backend)) is o
    ]
    pictures = [(caption, path.read_bytes()) for caption, path in found if path.is_file()]
    return pictures[:_MAX_PICTURES]
