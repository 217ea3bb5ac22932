# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Many runs beside each other: one row per run, one per source and backend, and a page."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import plotly.graph_objects as go

from slarm_graph.eval import report_page as html
from slarm_graph.eval.metric_table import headlines, kind_of

Columns = tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of one run of a comparison.

    Parameters
    ----------
    source, backend : str
    seed : int
    status : str
        `ok`, `partial` or `failed`, as in `run.json`.
    problem : str
        Why it is not `ok`.
    folder : str
        The run's folder, relative to the comparison's.
    figures : mapping of str to float
        Metrics, and time and memory from the run's record.
    """

    source: str
    backend: str
    seed: int
    status: str
    problem: str = ""
    folder: str = ""
    figures: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Spread:
    """Mean, standard deviation, median and worst of a figure over the runs that have it."""

    mean: float
    sd: float
    median: float
    worst: float
    count: int

    def of_mean(self) -> str:
        """Write mean and standard deviation."""
        if not self.count:
            return "-"
        sd = f"{self.sd:.2g}" if self.sd < 100.0 else f"{self.sd:.0f}"
        return f"{self.mean:.4g}" + (f" ± {sd}" if self.count > 1 else "")

    def of_median(self) -> str:
        """Write median and worst."""
        if not self.count:
            return "-"
        return f"{self.median:.4g}" + (f" | {self.worst:.4g}" if self.count > 1 else "")


def run_rows(outcomes: Sequence[Outcome]) -> tuple[Columns, list[tuple[html.Cell, ...]]]:
    """Return columns and one row per run, with every figure that any run has."""
    names = sorted({name for outcome in outcomes for name in outcome.figures})
    columns = ("source", "backend", "seed", "status", "problem", "folder", *names)
    rows: list[tuple[html.Cell, ...]] = [
        (
            *(o.source, o.backend, o.seed, o.status, o.problem, o.folder),
            *(o.figures.get(name) for name in names),
        )
        for o in outcomes
    ]
    return columns, rows


Rows = tuple[Columns, list[tuple[str, ...]]]


def summaries(outcomes: Sequence[Outcome]) -> list[tuple[str, Rows]]:
    """Return titled short tables, one row per source and backend, of as many as are needed.

    Runs that are not ok stay in the count, and out of the figures.
    """
    if len({outcome.seed for outcome in outcomes}) < 2:
        return [("Every source with every backend", _summary(outcomes, Spread.of_median))]
    return [
        ("Median | worst over seeds", _summary(outcomes, Spread.of_median)),
        ("Mean ± standard deviation over seeds", _summary(outcomes, Spread.of_mean)),
    ]


def _summary(outcomes: Sequence[Outcome], written: Callable[[Spread], str]) -> Rows:
    names = _headlines_of(outcomes)
    some_failed = bool(_problems_of(outcomes))
    rows: list[tuple[str, ...]] = []
    for source, backend, group in _groups(outcomes):
        good = [o for o in group if o.status == "ok"]
        cells = (written(_spread_of(good, name)) for name in names)
        row = (source, backend, f"{len(good)} of {len(group)}", *cells)
        rows.append((*row, _problems_of(group)) if some_failed else row)
    columns = ("source", "backend", "ok", *names)
    return (*columns, "problems") if some_failed else columns, rows


def _headlines_of(outcomes: Sequence[Outcome]) -> list[str]:
    return [k.name for k in headlines() if any(k.name in o.figures for o in outcomes)]


def _problems_of(outcomes: Sequence[Outcome]) -> str:
    return "; ".join(sorted({f"{o.status}: {o.problem}" for o in outcomes if o.status != "ok"}))


def summary_rows(outcomes: Sequence[Outcome]) -> tuple[Columns, list[tuple[html.Cell, ...]]]:
    """Return columns and one row per source, backend and figure of the short tables."""
    columns = ("source", "backend", "figure", "runs", "median", "worst", "mean", "sd")
    rows: list[tuple[html.Cell, ...]] = []
    for source, backend, group in _groups(outcomes):
        good = [o for o in group if o.status == "ok"]
        for name in (kind.name for kind in headlines()):
            s = _spread_of(good, name)
            if s.count:
                rows.append((source, backend, name, s.count, s.median, s.worst, s.mean, s.sd))
    return columns, rows


def _spread_of(outcomes: Sequence[Outcome], name: str) -> Spread:
    values = [o.figures[name] for o in outcomes if name in o.figures]
    return spread(values, more_is_better=kind_of(name).better == "more")


def spread(values: Sequence[float], *, more_is_better: bool = False) -> Spread:
    """Summarise values; the worst is the largest, or the smallest where more is better."""
    if not values:
        return Spread(math.nan, math.nan, math.nan, math.nan, 0)
    v = np.array(values, dtype=np.float64)
    sd = float(v.std(ddof=1)) if len(v) > 1 else 0.0
    worst = float(v.min() if more_is_better else v.max())
    return Spread(float(v.mean()), sd, float(np.median(v)), worst, len(v))


def comparison_html(
    outcomes: Sequence[Outcome], lead: str, pictures: Sequence[tuple[str, bytes]] = ()
) -> str:
    """Return the comparison as one self-contained page.

    Parameters
    ----------
    outcomes : sequence of Outcome
    lead : str
        One line below the title.
    pictures : sequence of (caption, PNG content)
    """
    all_columns, all_rows = run_rows(outcomes)
    short = [html.section(title, html.table(*rows)) for title, rows in summaries(outcomes)]
    figures = [
        html.section(kind_of(name).title, html.figure(_strip(outcomes, name), 380))
        for name in _headlines_of(outcomes)
    ]
    links = [(o.folder, f"{o.folder}/report.html") for o in outcomes if o.status == "ok"]
    return html.page(
        "Backend comparison",
        [
            html.heading("Backend comparison", lead),
            *short,
            html.section("Radio maps", html.gallery(pictures)),
            *figures,
            html.section("Every run", html.table(all_columns, all_rows)),
            html.section("Reports", html.links(links)),
        ],
    )


def _strip(outcomes: Sequence[Outcome], name: str) -> go.Figure:
    """Draw every run's figure as a point, sources side by side, backends by colour."""
    fig = go.Figure()
    for backend in dict.fromkeys(outcome.backend for outcome in outcomes):
        mine = [o for o in outcomes if o.backend == backend and name in o.figures]
        fig.add_box(
            x=[o.source for o in mine],
            y=[o.figures[name] for o in mine],
            text=[f"seed {o.seed}" for o in mine],
            name=backend,
            boxpoints="all",
            pointpos=0,
            jitter=0.3,
        )
    fig.update_layout(boxmode="group")
    # Room above, where a single run would else lie on the frame.
    top = 1.1 * max((o.figures[name] for o in outcomes if name in o.figures), default=0.0)
    fig.update_yaxes(
        title=kind_of(name).titled(),
        rangemode="tozero",
        autorangeoptions_include=top,
        gridcolor="#dfe4ea",
    )
    return fig


def _groups(outcomes: Sequence[Outcome]) -> Iterator[tuple[str, str, list[Outcome]]]:
    for source, backend in dict.fromkeys((o.source, o.backend) for o in outcomes):
        yield (
            source,
            backend,
            [o for o in outcomes if (o.source, o.backend) == (source, backend)],
        )
