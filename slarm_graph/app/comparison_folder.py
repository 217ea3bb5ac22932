# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The folder of a comparison: opened anew or to go on, and what is made of its runs."""

from __future__ import annotations

import math
import shutil
from collections.abc import Iterable, Sequence
from pathlib import Path

from slarm_graph.app.outputs import csv_text
from slarm_graph.app.run_folder import RECORD, RunFolder, create_run_folder, read_record
from slarm_graph.app.trials import KEYS
from slarm_graph.errors import BadInput
from slarm_graph.eval.agreement import Estimate, agreements
from slarm_graph.eval.comparison import Outcome
from slarm_graph.eval.comparison_page import ComparisonContent, SourceView, comparison_html
from slarm_graph.eval.comparison_tables import (
    TextTable,
    agreement_table,
    difference_table,
    run_rows,
    summary_rows,
    summary_tables,
)
from slarm_graph.files.maps import read_map
from slarm_graph.files.trajectories import read_trajectory

_MAX_PICTURES = 8
"""Radio maps on the page; each takes some 50 kB."""
_MAX_VIEWS = 8
"""Sources whose maps are on the page; each takes some 300 kB."""
_MAX_COMPARED = 60
"""Runs that are compared with each other; the pairs of more take longer than the runs."""


def open_comparison(out: Path, name: str | None, *, overwrite: bool = False) -> RunFolder:
    """Open the folder of a comparison that was begun under that name, or make one.

    With `overwrite` it is begun anew.
    """
    path = out / name if name else None
    if overwrite and path is not None:
        shutil.rmtree(path / KEYS, ignore_errors=True)
    if path is not None and (path / KEYS).is_dir() and (path / RECORD).is_file():
        return RunFolder(path, read_record(path))
    return create_run_folder(out, name, overwrite=overwrite)


def write_comparison(folder: RunFolder, outcomes: Sequence[Outcome], what: str) -> list[TextTable]:
    """Write tables (CSV, Markdown, LaTeX) and the page; return the tables to be shown."""
    good = sum(outcome.status == "ok" for outcome in outcomes)
    lead = f"{what}; {good} of {len(outcomes)} runs ok"
    estimates = _estimates(folder.path, outcomes)
    found = agreements(estimates)
    tables = [*summary_tables(outcomes), difference_table(outcomes), agreement_table(found)]
    shown = [table for table in tables if table is not None]
    folder.write_text("comparison.csv", csv_text(*run_rows(outcomes)))
    folder.write_text("summary.csv", csv_text(*summary_rows(outcomes)))
    folder.write_text("tables.md", "\n".join(table.markdown() for table in shown))
    folder.write_text("tables.tex", "\n".join(table.latex() for table in shown))
    views = _views(estimates, outcomes)
    pictures = _pictures(folder.path, outcomes)
    content = ComparisonContent("Backend comparison", lead, outcomes, found, views, pictures)
    folder.write_text("report.html", comparison_html(content))
    status = "ok" if good == len(outcomes) else "partial"
    folder.note(status=status, problem="", runs=len(outcomes))
    return shown


def _estimates(folder: Path, outcomes: Sequence[Outcome]) -> dict[tuple[str, str, int], Estimate]:
    """Read what the runs came to, as far as it is there."""
    found = {}
    for outcome in [o for o in outcomes if o.status == "ok"][:_MAX_COMPARED]:
        place = folder / outcome.folder
        try:
            trajectory = read_trajectory(place / "trajectory.tum")
            grid = read_map(place / "map.yaml")
            true_path = place / "ground_truth.tum"
            truth = read_trajectory(true_path) if true_path.is_file() else None
        except BadInput:
            continue
        found[outcome.source, outcome.variant, outcome.seed] = Estimate(trajectory, grid, truth)
    return found


def _views(
    estimates: dict[tuple[str, str, int], Estimate], outcomes: Sequence[Outcome]
) -> list[SourceView]:
    """Return every source with the first run of each variant, over the map least in doubt."""
    doubts = {(o.source, o.variant, o.seed): _doubt(o) for o in outcomes}
    views = []
    for source in list(dict.fromkeys(key[0] for key in estimates))[:_MAX_VIEWS]:
        first: dict[str, tuple[str, str, int]] = {}
        for key in estimates:
            if key[0] == source:
                first.setdefault(key[1], key)
        ground = min(first, key=lambda variant: doubts[first[variant]])
        views.append(SourceView(source, {v: estimates[key] for v, key in first.items()}, ground))
    return views


def _doubt(outcome: Outcome) -> tuple[bool, float]:
    """Return a key by which runs whose maps contradict themselves least come first."""
    return outcome.lost, outcome.figures.get("map_conflict_share", math.inf)


def _pictures(folder: Path, outcomes: Sequence[Outcome]) -> list[tuple[str, bytes]]:
    """Return the radio map of every source and variant at its first seed, with a caption."""
    first: dict[tuple[str, str], Outcome] = {}
    for outcome in _finished(outcomes):
        first.setdefault((outcome.source, outcome.variant), outcome)
    found = [
        (f"{o.source}, {o.variant}", folder / o.folder / "radio_map.png") for o in first.values()
    ]
    pictures = [(caption, path.read_bytes()) for caption, path in found if path.is_file()]
    return pictures[:_MAX_PICTURES]


def _finished(outcomes: Iterable[Outcome]) -> Iterable[Outcome]:
    return (outcome for outcome in outcomes if outcome.status == "ok")
