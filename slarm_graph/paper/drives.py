# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Table of the closed loops of a reproduction that have ended: what each came to.

It stands for their run folders: a reproduction is carried on elsewhere, or put together from what
several machines have driven.
"""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Final

from slarm_graph.app.run_folder import RECORD
from slarm_graph.app.trials import Trial
from slarm_graph.errors import BadInput
from slarm_graph.eval.comparison import Outcome
from slarm_graph.paper.plan import EXPANSIONS
from slarm_graph.paper.summary import variant_name

DRIVES: Final = "drives.csv"
FIGURES: Final = (
    "accuracy",
    *(variant_name(radius, with_sizes=known) for radius in EXPANSIONS for known in (True, False)),
    "ate_rmse_unaligned_m",
    "drive_time_s",
    "planning_s",
    "wall_s",
    "collisions",
)
"""All that the reproduction's tables and curves are made of."""
_HEADER: Final = ("drive", "revision", *FIGURES)


def read_drives(path: Path) -> dict[str, dict[str, str]]:
    """Read the rows of a table by the name of the drive.

    Raises
    ------
    BadInput
        Naming the file that is no such table, or the line that is no row of one.
    """
    if not path.is_file():
        raise BadInput(f"{path}: no such file; it is the {DRIVES} of another reproduction")
    rows: dict[str, dict[str, str]] = {}
    with path.open(newline="", encoding="utf-8") as file:
        reader = csv.DictReader(file)
        if tuple(reader.fieldnames or ()) != _HEADER:
            raise BadInput(f"{path}: its header is not {','.join(_HEADER)}; move it away")
        for row in reader:
            if None in row or None in row.values() or not _has_numbers(row):
                raise BadInput(f"{path}:{reader.line_num}: not a drive; remove the line")
            rows[row["drive"]] = row
    return rows


def _has_numbers(row: Mapping[str, str]) -> bool:
    try:
        return all(not row[name] or math.isfinite(float(row[name])) for name in FIGURES)
    except ValueError:
        return False


def outcome_of(trial: Trial, row: Mapping[str, str]) -> Outcome:
    """Return what a row of the table says of its drive."""
    figures = {name: float(row[name]) for name in FIGURES if row[name]}
    place, name = Path(trial.source.place).name, trial.folder.name
    return Outcome(place, trial.backend, trial.seed, "ok", folder=name, figures=figures)


def write_drives(
    path: Path, outcomes: Iterable[tuple[Trial, Outcome]], before: Mapping[str, Mapping[str, str]]
) -> None:
    """Write a table of what has ended well.

    Parameters
    ----------
    path : Path
    outcomes : iterable of (Trial, Outcome)
    before : mapping of str to row
        Of an earlier table: rows of drives without a run folder, and of other plans, stay.
    """
    ended = [(trial, outcome) for trial, outcome in outcomes if outcome.status == "ok"]
    driven = {t.folder.name: _row(t, o) for t, o in ended if (t.folder / RECORD).is_file()}
    unfinished = path.with_suffix(".part")
    with unfinished.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, _HEADER)
        writer.writeheader()
        writer.writerows({**before, **driven}.values())
    unfinished.replace(path)


def _row(trial: Trial, outcome: Outcome) -> dict[str, str]:
    record = json.loads((trial.folder / RECORD).read_text(encoding="utf-8"))
    head = {"drive": trial.folder.name, "revision": str(record.get("git_revision", ""))[:7]}
    return head | {n: str(outcome.figures[n]) for n in FIGURES if n in outcome.figures}
