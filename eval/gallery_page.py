# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""A folder of tables and pictures as one self-contained page."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

from slarm_graph.eval.page import Cell, Gallery, PageTable, Section, page


def gallery_html(
    folder: Path, title: str, lead: str, pictures: Sequence[str], tables: Sequence[str]
) -> str:
    """Return a page with pictures, then tables, of those that are in the folder.

    Parameters
    ----------
    folder : Path
    title, lead : str
    pictures, tables : sequence of str
        File names; PNG and CSV.
    """
    shown = [
        Section(_title(name), (Gallery([(name, (folder / name).read_bytes())]),))
        for name in pictures
        if (folder / name).is_file()
    ]
    rows = [
        Section(_title(name), (_csv_table(folder / name),))
        for name in tables
        if (folder / name).is_file()
    ]
    return page(title, lead, (), [*shown, *rows])


def _csv_table(path: Path) -> PageTable:
    with path.open(newline="", encoding="utf-8") as file:
        columns, *rows = csv.reader(file)
    return PageTable(columns, [[_number(cell) for cell in row] for row in rows])


def _number(text: str) -> Cell:
    try:
        return float(text)
    except ValueError:
        return text


def _title(name: str) -> str:
    return name.rpartition(".")[0].replace("_", " ").capitalize()
