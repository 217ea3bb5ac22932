# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The page of a comparison: tables, trajectories over a map, every run as a point, links."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import plotly.graph_objects as go

from slarm_graph.counts import count_of
from slarm_graph.errors import BadInput
from slarm_graph.eval.agreement import Estimate, is_same_drive
from slarm_graph.eval.assessment import ground_truth_in_map
from slarm_graph.eval.comparison import Outcome, headlines_of
from slarm_graph.eval.comparison_tables import TextTable, run_rows
from slarm_graph.eval.map_difference import CLASS_STYLES, difference_classes
from slarm_graph.eval.metric_table import kind_of
from slarm_graph.eval.page import (
    Block,
    Details,
    Figure,
    Gallery,
    LinkList,
    PageTable,
    Paragraph,
    Section,
    page,
    plain,
)
from slarm_graph.eval.report_figures import MAP_WORDS, difference_figure
from slarm_graph.eval.run_figures import error_figure
from slarm_graph.eval.trajectory_figures import GROUND_TRUTH, trajectory_figure
from slarm_graph.trajectory import Trajectory

_FLATTENED = 20.0
"""Ratio of the largest to the smallest value from which on the axis is logarithmic."""

_OWN_WAYS = (
    "Each robot explored on a way of its own: the true path drawn is that of the map's robot;"
    " errors are to the true path of each."
)


@dataclass(frozen=True, slots=True)
class SourceView:
    """The results of one source that are shown.

    Parameters
    ----------
    name : str
    estimates : mapping of str to Estimate
        One run of every variant.
    ground : str
        The variant whose map is the background.
    """

    name: str
    estimates: Mapping[str, Estimate]
    ground: str


@dataclass(frozen=True, slots=True)
class ComparisonContent:
    """The content of the page.

    Parameters
    ----------
    title, lead : str
    outcomes : sequence of Outcome
    tables : sequence of TextTable
    views : sequence of SourceView
    pictures : sequence of (caption, PNG content)
        Radio maps.
    reports : sequence of str
        Folders of the runs that have a page of their own.
    """

    title: str
    lead: str
    outcomes: Sequence[Outcome]
    tables: Sequence[TextTable] = ()
    views: Sequence[SourceView] = ()
    pictures: Sequence[tuple[str, bytes]] = ()
    reports: Sequence[str] = ()


def comparison_html(content: ComparisonContent) -> str:
    """Return the comparison as one self-contained page."""
    outcomes = content.outcomes
    figures = [
        Section(kind_of(name).title, (_strip(outcomes, name),)) for name in headlines_of(outcomes)
    ]
    columns, rows = run_rows(outcomes)
    titles = [kind_of(name).titled() if "_" in name else name for name in columns]
    links = [(folder, f"{folder}/report.html") for folder in content.reports]
    return page(
        content.title,
        content.lead,
        (),
        [
            *(Section(t.title, (as_block(t),)) for t in content.tables),
            *(Section(f"{v.name}: map and trajectories", _view(v)) for v in content.views),
            Section("Radio maps", (Gallery(content.pictures),) if content.pictures else ()),
            *figures,
            Section(
                "Every run", (Details(count_of(len(rows), "run"), (PageTable(titles, rows),)),)
            ),
            Section("Reports", (LinkList(links),) if links else ()),
        ],
    )


def as_block(table: TextTable) -> PageTable:
    """Return a table for the page."""
    alike = any(a[0] == b[0] for a, b in pairwise(table.rows))
    grouped = alike and table.words > 1
    return PageTable(table.columns, table.rows, table.best, table.words, grouped)


def _view(view: SourceView) -> tuple[Block, ...]:
    ground = view.estimates[view.ground]
    assert ground.grid is not None
    others = {name: e for name, e in view.estimates.items() if name != view.ground}
    paths = {name: estimate.trajectory for name, estimate in view.estimates.items()}
    blocks: list[Block] = [trajectory_figure(ground.grid, paths | _true_path(ground))]
    blocks.append(Paragraph(f"{MAP_WORDS} The map is that of {view.ground}."))
    if not all(is_same_drive(ground, other) for other in others.values()):
        blocks.append(Paragraph(_OWN_WAYS))
    figure = error_figure(
        {n: (e.truth, e.trajectory) for n, e in view.estimates.items() if e.truth is not None}
    )
    blocks += [figure] if figure else []
    mapped = [(name, other) for name, other in others.items() if other.grid is not None]
    blocks += [_difference(view.ground, ground, *other) for other in mapped[:1]]
    return tuple(blocks)


def _difference(reference: str, ground: Estimate, name: str, other: Estimate) -> Details:
    names = {"wall only in EST": f"wall only in {name}"}
    names["wall only in REF"] = f"wall only in {reference}"
    looks = {k: (names.get(label, label), color) for k, (label, color) in CLASS_STYLES.items()}
    assert ground.grid is not None
    assert other.grid is not None
    motion = ground.map_from_grid.inverse() @ other.map_from_grid
    classes = difference_classes(ground.grid, other.grid, motion)
    figure = difference_figure(classes, ground.grid.geometry, looks)
    return Details(f"difference of the maps: {reference}, {name}", (figure,))


def _true_path(of: Estimate) -> dict[str, Trajectory]:
    """Return the true path aligned to the run's map; empty where it is not known."""
    try:
        return {GROUND_TRUTH: ground_truth_in_map(of.truth, of.trajectory)} if of.truth else {}
    except BadInput:
        return {}


def _strip(outcomes: Sequence[Outcome], name: str) -> Figure:
    """Draw every run's figure as a point, sources side by side, variants by colour."""
    fig = go.Figure()
    kind = kind_of(name)
    for variant in dict.fromkeys(outcome.variant for outcome in outcomes):
        mine = [o for o in outcomes if o.variant == variant and name in o.figures]
        fig.add_box(
            x=[plain(o.source) for o in mine],
            y=[o.figures[name] for o in mine],
            text=[f"seed {o.seed}" for o in mine],
            name=plain(variant),
            boxpoints="all",
            pointpos=0,
            jitter=0.3,
            marker={"size": 7},
            hovertemplate=f"%{{text}}: %{{y:.4g}} {kind.unit}<extra>{plain(variant)}</extra>",
        )
    values = [o.figures[name] for o in outcomes if name in o.figures]
    fig.update_layout(boxmode="group")
    if min(values) > 0.0 and max(values) > _FLATTENED * min(values):
        fig.update_yaxes(title=kind.titled(), type="log")
    else:
        # Room above, where a single run would else lie on the frame.
        top = {"autorangeoptions_include": 1.1 * max(values)}
        fig.update_yaxes(title=kind.titled(), rangemode="tozero", **top)
    return Figure(fig, f"{kind.title} of every run", height_px=400)
