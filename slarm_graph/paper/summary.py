# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""What the runs of the reproduction came to, and how the figures show it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Final

import numpy as np

from slarm_graph.eval.comparison import Outcome
from slarm_graph.paper.figures import (
    Curve,
)
from slarm_graph.paper.plan import Plan, Setting
from slarm_graph.paper.theory import (
    PAPER_BEST,
    PAPER_COARSE,
)

PAPER_POINTS: Final = ((0.05, PAPER_BEST, "paper, 1 m/s"), (0.15, PAPER_COARSE, "paper"))
"""Cells' sides [m] and accuracies that the paper prints, with what it says of them."""
_EXPANSION_NAMES: Final = {"cell": "one cell", "robot": "robot radius", "zero": "0"}


@dataclass(frozen=True, slots=True)
class Row:
    """Mean and standard deviation over the seeds of one setting, prior and expansion."""

    explorer: str
    backend: str
    resolution_m: float
    speed_m_s: float
    prior: str
    expansion: str
    seeds: int
    accuracy: float
    accuracy_sd: float
    accuracy_min: float
    ate_rmse_m: float
    drive_time_s: float
    planning_s: float
    wall_s: float
    collisions: float


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """A guess at what the paper measured, from the true room without SLAM error."""

    name: str
    resolution_m: float
    speed_m_s: float
    accuracy: float


def summarise(outcomes: Sequence[tuple[Setting, Outcome]], plan: Plan) -> list[Row]:
    """Gather the seeds of every setting, prior and expansion."""
    rows = []
    for setting in sorted({s for s, _ in outcomes}, key=lambda s: tuple(asdict(s).values())):
        figures = [outcome.figures for s, outcome in outcomes if s == setting]
        for prior in plan.priors:
            for expansion in plan.expansions:
                name = variant_name(expansion, with_sizes=prior == "extent+sizes")
                rows.append(_row(setting, prior, expansion, figures, name))
    return rows


def variant_name(expansion: str, *, with_sizes: bool) -> str:
    """Key of the metric of a drive recovered with an expansion radius and sizes or none."""
    return f"accuracy_re_{expansion}_{'with' if with_sizes else 'without'}_sizes"


def _row(
    setting: Setting, prior: str, expansion: str, figures: Sequence[Mapping[str, float]], name: str
) -> Row:
    def mean(key: str) -> float:
        """Mean over the seeds."""
        return float(np.mean([one.get(key, np.nan) for one in figures]))

    accuracy = np.array([one.get(name, np.nan) for one in figures])
    return Row(
        **asdict(setting),
        prior=prior,
        expansion=expansion,
        seeds=len(figures),
        accuracy=float(accuracy.mean()),
        accuracy_sd=float(accuracy.std()),
        accuracy_min=float(accuracy.min()),
        ate_rmse_m=mean("ate_rmse_unaligned_m"),
        drive_time_s=mean("drive_time_s"),
        planning_s=mean("planning_s"),
        wall_s=mean("wall_s"),
        collisions=mean("collisions"),
    )


def measured_curves(rows: Sequence[Row]) -> list[Curve]:
    """Lines of figure 5: a panel per expansion, a line per backend, speed and prior."""
    curves = []
    for key in sorted({(r.expansion, r.backend, r.speed_m_s, r.prior) for r in rows}):
        mine = [r for r in rows if (r.expansion, r.backend, r.speed_m_s, r.prior) == key]
        expansion, backend, speed, prior = key
        sizes = "with sizes" if prior == "extent+sizes" else "without sizes"
        curves.append(
            Curve(
                f"{backend}, {speed:g} m/s, {sizes}",
                f"R_e = {_EXPANSION_NAMES[expansion]}",
                [r.resolution_m for r in mine],
                [r.accuracy for r in mine],
                [r.accuracy_sd for r in mine],
            )
        )
    return curves


def guessed_curves(guesses: Sequence[Hypothesis]) -> list[Curve]:
    """Lines of the panel of hypotheses."""
    curves = []
    for name, speed in sorted({(g.name, g.speed_m_s) for g in guesses}):
        mine = [g for g in guesses if (g.name, g.speed_m_s) == (name, speed)]
        label = name if speed == 0.0 else f"{name}, {speed:g} m/s"
        x, y = [g.resolution_m for g in mine], [g.accuracy for g in mine]
        curves.append(Curve(label, "hypotheses, no SLAM error", x, y, [0.0] * len(x)))
    return curves


def times_of(rows: Sequence[Row]) -> dict[str, list[tuple[float, float, float, float]]]:
    """Drive, planning and wall time over the cell size, per backend and speed."""
    lines: dict[str, list[tuple[float, float, float, float]]] = {}
    for row in rows:
        point = (row.resolution_m, row.drive_time_s, row.planning_s, row.wall_s)
        line = lines.setdefault(f"{row.backend}, {row.speed_m_s:g} m/s", [])
        if point not in line:
            line.append(point)
    return lines
