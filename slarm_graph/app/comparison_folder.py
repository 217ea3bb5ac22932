# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The folder of a comparison: created or continued, and the tables and page written to it."""

from __future__ import annotations

import math
import shutil
from collections.abc import Sequence
from pathlib import Path

from slarm_graph.app.folder_lock import FolderLock
from slarm_graph.app.run_folder import RunFolder, create_run_folder, read_record, was_begun
from slarm_graph.app.trials import KEYS
from slarm_graph.counts import count_of
from slarm_graph.errors import BadInput
from slarm_graph.eval.agreement import Estimate, agreements, aligned_to
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
from slarm_graph.files.texts import csv_text
from slarm_graph.files.trajectories import read_trajectory

Key = tuple[str, str, int]
"""Source, variant and seed of a run."""

_KIND = "comparison"
_MAX_PICTURES = 8
"""Radio maps on the page; each takes some 50 kB."""
_MAX_VIEWS = 8
"""Sources whose maps are on the page; each takes some 300 kB."""
_MAX_COMPARED = 60
"""Runs that are compared with each other; the pairs of more take longer than the runs."""


def open_comparison(out: Path, name: str | None, *, overwrite: bool = False) -> RunFolder:
    """Open the folder of a comparison that was begun under that name, or make one.

    With `overwrite` all its runs are repeated.
    """
    path = out / name if name else None
    if path is not None and was_begun(path, _KIND) and not overwrite:
        lock = FolderLock(path)
        return RunFolder(path, read_record(path), lock=lock)
    folder = create_run_folder(out, name, overwrite=overwrite, kind=_KIND)
    if overwrite:  # nobody else is at work there any more
        shutil.rmtree(folder.path / KEYS, ignore_errors=True)
    return folder


def write_comparison(folder: RunFolder, outcomes: Sequence[Outcome], what: str) -> list[TextTable]:
    """Write tables (CSV, Markdown, LaTeX) and the page; return the tables to print."""
    good = sum(outcome.status == "ok" for outcome in outcomes)
    lead = f"{what}; {good} of {count_of(len(outcomes), 'run')} ok"
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
    reports = [o.folder for o in outcomes if _has_page(folder.path, o)]
    content = ComparisonContent(
        "Backend comparison", lead, outcomes, shown, views, pictures, reports
    )
    folder.write_text("report.html", comparison_html(content))
    status = "ok" if good == len(outcomes) else "partial"
    folder.note(status=status, problem="", runs=len(outcomes))
    return shown


def _estimates(folder: Path, outcomes: Sequence[Outcome]) -> dict[Key, Estimate]:
    """Read trajectories and maps of finished runs; align those of other systems to ours."""
    found, theirs = {}, []
    finished = [outcome for outcome in outcomes if outcome.status == "ok"]
    for outcome in finished[:_MAX_COMPARED]:
        place = folder / outcome.folder
        try:
            found[_key(outcome)] = _estimate(place)
        except BadInput:
            continue
        if "external" in read_record(place):
            theirs.append(outcome)
    for outcome in theirs:
        ours = [o for o in finished if o.source == outcome.source and o not in theirs]
        known = [o for o in ours if _key(o) in found]
        if known:
            best = found[_key(min(known, key=_consistency_key))]
            found[_key(outcome)] = aligned_to(best, found[_key(outcome)])
    return found


def _estimate(place: Path) -> Estimate:
    trajectory = read_trajectory(place / "trajectory.tum")
    grid_path, true_path = place / "map.yaml", place / "ground_truth.tum"
    grid = read_map(grid_path) if grid_path.is_file() else None
    return Estimate(trajectory, grid, read_trajectory(true_path) if true_path.is_file() else None)


def _key(outcome: Outcome) -> Key:
    return outcome.source, outcome.variant, outcome.seed


def _views(estimates: dict[Key, Estimate], outcomes: Sequence[Outcome]) -> list[SourceView]:
    """Return every source with the first run of each variant, over the most consistent map."""
    doubts = {_key(o): _consistency_key(o) for o in outcomes}
    views = []
    for source in list(dict.fromkeys(key[0] for key in estimates))[:_MAX_VIEWS]:
        first: dict[str, Key] = {}
        for key in estimates:
            if key[0] == source:
                first.setdefault(key[1], key)
        mapped = [v for v, key in first.items() if estimates[key].grid is not None]
        if not mapped:
            continue
        ground = min(mapped, key=lambda variant: doubts[first[variant]])
        views.append(SourceView(source, {v: estimates[key] for v, key in first.items()}, ground))
    return views


def _consistency_key(outcome: Outcome) -> tuple[bool, float]:
    """Return a sort key by which the most consistent run comes first."""
    return outcome.lost, outcome.figures.get("map_conflict_share", math.inf)


def _pictures(folder: Path, outcomes: Sequence[Outcome]) -> list[tuple[str, bytes]]:
    """Return the radio map of every source and variant at its first seed, with a caption."""
    first: dict[tuple[str, str], Outcome] = {}
    for outcome in outcomes:
        if outcome.status == "ok":
            first.setdefault((outcome.source, outcome.variant), outcome)
    found = [
        (f"{o.source}, {o.variant}", folder / o.folder / "radio_map.png") for o in first.values()
    ]
    pictures = [(caption, path.read_bytes()) for caption, path in found if path.is_file()]
    return pictures[:_MAX_PICTURES]


def _has_page(folder: Path, outcome: Outcome) -> bool:
    return bool(outcome.folder) and (folder / outcome.folder / "report.html").is_file()
