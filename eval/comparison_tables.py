# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The tables of a comparison, for the terminal, CSV, Markdown and LaTeX (booktabs)."""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from slarm_graph.eval.agreement import Agreement
from slarm_graph.eval.comparison import (
    FEWEST_CLEAR,
    Group,
    Outcome,
    Spread,
    differences,
    groups,
    headlines_of,
)
from slarm_graph.eval.metric_table import kind_of
from slarm_graph.eval.metrics import best_of

Cell = float | int | str | None

_LETTERS = 94
"""Letters that fit into a line: LaTeX's article has 345 pt of text, and 4.6 pt for a letter of 10
pt, of which a table may be shrunk to the 8 pt of footnotes."""
_SHRUNK = r"\resizebox{\ifdim\width>\linewidth\linewidth\else\width\fi}{!}{% package graphicx"
_LATEX = str.maketrans(
    {
        "\\": r"\textbackslash{}",
        "&": r"\&",
        "%": r"\%",
        "$": r"\$",
        "#": r"\#",
        "_": r"\_",
        "{": r"\{",
        "}": r"\}",
        "~": r"\textasciitilde{}",
        "^": r"\textasciicircum{}",
        "±": r"$\pm$",
        "²": r"$^2$",
        "<": r"\textless{}",
        ">": r"\textgreater{}",
        "|": r"\textbar{}",
    }
)


@dataclass(frozen=True, slots=True)
class TextTable:
    """A formatted table.

    Parameters
    ----------
    title : str
    columns : tuple of str
        With units.
    rows : tuple of tuple of str
    best : frozenset of (int, int)
        Row and column of the cells that are the best of their kind.
    words : int
        Number of columns at the left that hold words.
    """

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    best: frozenset[tuple[int, int]] = frozenset()
    words: int = 2

    def markdown(self) -> str:
        """Return it as Markdown, the best in bold."""
        lines = [f"**{self.title}**", "", _markdown_row(self.columns)]
        lines.append(
            _markdown_row(["---"] * self.words + ["---:"] * (len(self.columns) - self.words))
        )
        for r, row in enumerate(self.rows):
            cells = [f"**{c}**" if (r, i) in self.best else c for i, c in enumerate(row)]
            lines.append(_markdown_row(cells))
        return "\n".join(lines) + "\n"

    def latex(self) -> str:
        """Return it as LaTeX for the packages booktabs and graphicx, the best in bold.

        Columns that do not fit on the page go into further tables below; a single one that is wider
        than the text is shrunk.
        """
        parts = self._parts()
        if len(parts) == 1:
            return self._latex_part(parts[0], self.title)
        titles = [f"{self.title}, part {k + 1} of {len(parts)}" for k in range(len(parts))]
        return "\n".join(map(self._latex_part, parts, titles))

    def _parts(self) -> list[list[int]]:
        """Return the columns of every part of the table; each repeats the columns of words."""
        words = list(range(self.words))
        room = left = _LETTERS - sum(map(self._width, words))
        parts: list[list[int]] = [[]]
        for column in range(self.words, len(self.columns)):
            if parts[-1] and self._width(column) > left:
                parts.append([])
                left = room
            parts[-1].append(column)
            left -= self._width(column)
        return [words + part for part in parts]

    def _width(self, column: int) -> int:
        """Return the width of a column in letters, with the space beside it."""
        cells = [row[column] for row in self.rows]
        return 2 + max(map(len, [*cells, *self._title_lines(column)]))

    def _title_lines(self, column: int) -> list[str]:
        """Return a column's title wrapped to the width of its cells."""
        below = max((len(row[column]) for row in self.rows), default=0)
        return textwrap.wrap(self.columns[column], max(below, 1), break_long_words=False)

    def _latex_part(self, columns: Sequence[int], title: str) -> str:
        numbers = len(columns) - self.words
        lines = [
            r"\begin{table}",
            r"\centering",
            rf"\caption{{{title.translate(_LATEX)}}}",
            _SHRUNK,
            rf"\begin{{tabular}}{{{'l' * self.words}{'r' * numbers}}}",
            r"\toprule",
            _latex_line(_stacked(self._title_lines(i)) for i in columns),
            r"\midrule",
        ]
        for r, row in enumerate(self.rows):
            if r and row[0] != self.rows[r - 1][0] and self.words > 1:
                lines.append(r"\addlinespace")
            lines.append(_latex_line(_latex_cell(row[i], (r, i) in self.best) for i in columns))
        return "\n".join([*lines, r"\bottomrule", r"\end{tabular}}", r"\end{table}"]) + "\n"


def _markdown_row(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cell.replace("|", r"\|") for cell in cells) + " |"


def _latex_line(cells: Iterable[str]) -> str:
    return " & ".join(cells) + r" \\"


def _latex_cell(text: str, bold: bool = False) -> str:
    plain = _in_math(text.translate(_LATEX))
    if plain[:1] in ("[", "*"):  # which the end of the line before would take for its own
        plain = "{}" + plain
    return rf"\textbf{{{plain}}}" if bold else plain


def _stacked(lines: Sequence[str]) -> str:
    """Return a title's lines one above the other."""
    text = r"\\".join(map(_latex_cell, lines))
    return rf"\begin{{tabular}}[b]{{@{{}}r@{{}}}}{text}\end{{tabular}}" if lines[1:] else text


def _in_math(text: str) -> str:
    """Set minus signs and powers of ten, which LaTeX would take for hyphens and words."""
    text = re.sub(r"(?<![\w.])-(?=\d)", "$-$", text)
    return re.sub(r"(?<=\d)e([+-]\d+)\b", lambda m: rf"$\cdot10^{{{int(m[1])}}}$", text)


def number(value: float, digits: int = 3) -> str:
    """Format a number with so many digits, or all before the decimal point."""
    if not math.isfinite(value):
        return "-"
    return f"{value:.0f}" if abs(value) >= 10.0**digits else f"{value:.{digits}g}"


def _mean(s: Spread) -> str:
    return number(s.mean) + (f" ± {number(s.sd, 2)}" if s.count > 1 else "")


def _median(s: Spread) -> str:
    return number(s.median) + (f" | {number(s.worst)}" if s.count > 1 else "")


def summary_tables(outcomes: Sequence[Outcome]) -> list[TextTable]:
    """Return short tables, a row per source and variant; the best of a source is marked.

    Runs that are not ok are counted, but not in the metrics.
    """
    found = groups(outcomes)
    if all(s.count < 2 for group in found for s in group.spreads.values()):
        return [_summary("Every source with every backend", outcomes, found, _median, "median")]
    return [
        _summary("Median | worst", outcomes, found, _median, "median"),
        _summary("Mean ± standard deviation", outcomes, found, _mean, "mean"),
    ]


def _summary(
    title: str,
    outcomes: Sequence[Outcome],
    found: Sequence[Group],
    written: Callable[[Spread], str],
    by: str,
) -> TextTable:
    names = headlines_of(o for o in outcomes if o.status == "ok")
    some_failed = any(group.problems for group in found)
    some_lost = any(group.lost for group in found)
    rows = []
    for g in found:
        counts = (str(g.runs), str(g.ok), *([str(g.lost)] if some_lost else []))
        cells = (written(g.spreads[n]) if n in g.spreads else "-" for n in names)
        rows.append((g.source, g.variant, *counts, *cells, *([g.problems] if some_failed else [])))
    columns = ("source", "backend", "n", "ok", *(["lost"] if some_lost else []))
    titles = tuple(kind_of(name).titled() for name in names)
    problems = ("problems",) if some_failed else ()
    best = _best(found, names, len(columns), by)
    return TextTable(title, (*columns, *titles, *problems), tuple(rows), best)


def _best(
    found: Sequence[Group], names: Sequence[str], offset: int, by: str
) -> frozenset[tuple[int, int]]:
    best: set[tuple[int, int]] = set()
    for source in dict.fromkeys(g.source for g in found):
        rows = [index for index, g in enumerate(found) if g.source == source]
        for column, name in enumerate(names):
            values = [
                float(getattr(found[r].spreads[name], by)) if name in found[r].spreads else math.nan
                for r in rows
            ]
            found_best = best_of(values, kind_of(name).better)
            best |= {(rows[index], offset + column) for index in found_best}
    return frozenset(best)


def difference_table(outcomes: Sequence[Outcome]) -> TextTable | None:
    """Return the paired differences of variants, those beyond chance marked."""
    found = differences(outcomes)
    if not found:
        return None
    rows, clear = [], set()
    for index, d in enumerate(found):
        is_known = all(map(math.isfinite, d.interval))
        interval = " to ".join(number(end) for end in d.interval) if is_known else "-"
        what = (kind_of(d.figure).titled(), f"{d.variant} - {d.than}")
        rows.append((*what, number(d.mean), interval, str(d.pairs)))
        if d.is_clear:
            clear.add((index, 2))
    columns = ("figure", "difference", "mean", "95 % interval", "n")
    title = (
        "Paired differences over sources and seeds (bold: the interval leaves out 0,"
        f" over {FEWEST_CLEAR} sources or more, or as many seeds of a single one)"
    )
    return TextTable(title, columns, tuple(rows), frozenset(clear))


def agreement_table(found: Sequence[Agreement]) -> TextTable | None:
    """Return how far seeds and backends agree."""
    if not found:
        return None
    columns = ("source", "between", "n", "end pose apart [m]", "paths apart [m]", "walls, IoU",
               "free space, IoU")  # fmt: skip
    rows = tuple(
        (a.source, a.between, str(a.runs), number(a.end_spread_m), number(a.path_rms_m),
         number(a.walls_iou), number(a.free_iou))
        for a in found
    )  # fmt: skip
    return TextTable("Agreement without truth", columns, rows)


Columns = tuple[str, ...]


def run_rows(outcomes: Sequence[Outcome]) -> tuple[Columns, list[tuple[Cell, ...]]]:
    """Return columns and one row per run, with every figure that any run has, for a CSV."""
    names = sorted({name for outcome in outcomes for name in outcome.figures})
    columns = ("source", "backend", "setting", "seed", "status", "problem", "verdict", "folder")
    rows: list[tuple[Cell, ...]] = [
        (
            *(o.source, o.backend, o.setting, o.seed, o.status, o.problem, o.verdict, o.folder),
            *(o.figures.get(name) for name in names),
        )
        for o in outcomes
    ]
    return (*columns, *names), rows


def summary_rows(outcomes: Sequence[Outcome]) -> tuple[Columns, list[tuple[Cell, ...]]]:
    """Return columns and one row per source, variant and figure, for a CSV."""
    columns = ("source", "backend", "figure", "unit", "runs", "ok", "lost", "n", "median", "worst",
               "mean", "sd", "mean_low_95", "mean_high_95")  # fmt: skip
    rows: list[tuple[Cell, ...]] = [
        (
            *(g.source, g.variant, name, kind_of(name).unit, g.runs, g.ok, g.lost, s.count),
            *(s.median, s.worst, s.mean, s.sd, *s.interval),
        )
        for g in groups(outcomes)
        for name, s in g.spreads.items()
    ]
    return columns, rows
