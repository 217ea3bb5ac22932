# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Output of the commands: tables on standard output, notices on standard error."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

from rich.console import Console
from rich.table import Table

from slarm_graph.counts import count_of
from slarm_graph.eval.metrics import INTERVAL, Metric, best_of, metrics_json
from slarm_graph.readings import ScanStatus

if TYPE_CHECKING:
    from slarm_graph.eval.comparison_tables import TextTable

_LOG_COLUMNS = 400
"""Width of tables in files and pipes: nothing of a comparison, of some 260, wraps."""


def show_metrics(metrics: Sequence[Metric], *, title: str, as_json: bool = False) -> None:
    """Print metrics as a table, or as the JSON of `metrics.json`."""
    if as_json:
        print(metrics_json(metrics), end="")
        return
    shown = any(m.interval_words() for m in metrics)
    rows = [
        (
            *(m.kind.title, f"{m.value:.6g}", m.unit),
            *([m.interval_words()] if shown else []),
            *(m.name, m.note),
        )
        for m in metrics
    ]
    columns = ("metric", "value", "unit", *([INTERVAL] if shown else []), "key", "how")
    show_table(columns, rows, title=title, right=(1,))


def show_metrics_of_many(metrics: Mapping[str, Sequence[Metric]], *, title: str = "") -> None:
    """Print the metrics of several results side by side, the best starred."""
    from slarm_graph.eval.metric_table import in_table_order

    values = {name: {m.name: m.value for m in found} for name, found in metrics.items()}
    every = in_table_order(m for found in metrics.values() for m in found)
    rows = []
    for metric in every:
        row = [of.get(metric.name, math.nan) for of in values.values()]
        best = best_of(row, metric.kind.better)
        shown = [f"{'*' if index in best else ''}{v:.4g}" for index, v in enumerate(row)]
        rows.append((metric.kind.titled(), *shown))
    show_table(("metric", *metrics), rows, title=title, right=range(1, len(metrics) + 1))


def show_table(
    columns: Sequence[str],
    rows: Iterable[Sequence[str]],
    *,
    title: str = "",
    right: Sequence[int] = (),
    markup: bool = False,
) -> None:
    """Print a table; it is never cut when standard output is not a terminal."""
    table = Table(title=title or None, title_justify="left", box=None, pad_edge=False)
    for index, column in enumerate(columns):
        # Folded and not cut: two keys that begin alike must not come out as one.
        table.add_column(column, justify="right" if index in right else "left", overflow="fold")
    for row in rows:
        table.add_row(*row)
    width = None if sys.stdout.isatty() else _LOG_COLUMNS
    Console(width=width, highlight=False, markup=markup).print(table)


def show_text_table(table: TextTable) -> None:
    """Print a table with its best cells in bold, or starred where output is no terminal."""
    bold = ("[bold]", "[/bold]") if sys.stdout.isatty() else ("*", "")
    rows = [
        [
            f"{bold[0]}{cell}{bold[1]}" if (r, c) in table.best else cell
            for c, cell in enumerate(row)
        ]
        for r, row in enumerate(table.rows)
    ]
    right = range(table.words, len(table.columns))
    show_table(table.columns, rows, title=table.title, right=right, markup=sys.stdout.isatty())
    print()


def show_notices(notices: Iterable[str]) -> None:
    """Print notices and warnings."""
    for notice in notices:
        line = notice if notice.startswith("warning: ") else f"note: {notice}"
        print(line, file=sys.stderr)


def show_scans(scans: Sequence[ScanStatus]) -> None:
    """Print how many scans were not used and why, where there are any."""
    from slarm_graph.eval.report import count_by_reason

    (_, _used), *dropped = count_by_reason(scans)
    if dropped:
        total = sum(count for _, count in dropped)
        reasons = ", ".join(f"{count} {reason}" for reason, count in dropped)
        print(
            f"note: {total} of {count_of(len(scans), 'scan')} not used: {reasons}", file=sys.stderr
        )
