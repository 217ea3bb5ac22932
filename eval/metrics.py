# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Metrics: a value with its kind (unit, title, meaning), and lists of them as JSON and CSV."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Literal

from slarm_graph.files.texts import csv_text

Better = Literal["less", "more", ""]


@dataclass(frozen=True, slots=True)
class MetricKind:
    """Name, unit and meaning of a metric: a row of the table of metrics.

    Parameters
    ----------
    name : str
        Key with its unit as suffix, such as `ate_rmse_m`; shares are fractions from 0 to 1.
    unit : str
        Empty for counts and shares.
    title : str
        Title in tables, without the unit.
    better : {"less", "more", ""}
        Which direction is better; empty for neither.
    applies : str
        When it is available.
    how : str
        How it is computed.
    headline : bool
        Whether short tables show it.
    """

    name: str
    unit: str
    title: str
    better: Better
    applies: str
    how: str
    headline: bool = False

    def titled(self) -> str:
        """Return the title with the unit in brackets."""
        return f"{self.title} [{self.unit}]" if self.unit else self.title


@dataclass(frozen=True, slots=True)
class Metric:
    """A metric's value; unit and title are in the table of metrics.

    Parameters
    ----------
    name : str
        Name of its kind.
    value : float
    note : str
        How this value was computed: alignment, number of matched poses.
    interval : (float, float), optional
        95 % confidence interval, by bootstrap.
    """

    name: str
    value: float
    note: str = field(default="", kw_only=True)
    interval: tuple[float, float] | None = field(default=None, kw_only=True)

    @property
    def kind(self) -> MetricKind:
        """Return the kind of this metric."""
        from slarm_graph.eval.metric_table import kind_of

        return kind_of(self.name)

    @property
    def unit(self) -> str:
        """Return the unit of its kind."""
        return self.kind.unit

    def interval_words(self) -> str:
        """Format the interval; empty where there is none."""
        if self.interval is None or not all(map(math.isfinite, self.interval)):
            return ""
        return "{:.3g} to {:.3g}".format(*self.interval)


INTERVAL = "95 % interval"
"""Title of the column of intervals."""


def best_of(values: Sequence[float], better: Better) -> frozenset[int]:
    """Return the indices of the best values.

    Values equal to the best in three digits are best, too; when all are, or neither direction is
    better, there is none.
    """
    known = {index: value for index, value in enumerate(values) if math.isfinite(value)}
    if not better or len(known) < 2:
        return frozenset()
    best = min(known.values()) if better == "less" else max(known.values())
    found = frozenset(i for i, value in known.items() if f"{value:.3g}" == f"{best:.3g}")
    return found if len(found) < len(known) else frozenset()


def metrics_json(metrics: Iterable[Metric]) -> str:
    """Return `{"name": {"value": ..., "unit": ..., "note": ...}}`; a missing value is null.

    Where there is one, the interval is added as `interval_95`.
    """
    return json.dumps({m.name: _as_json(m) for m in metrics}, indent=2) + "\n"


def _as_json(metric: Metric) -> dict[str, object]:
    value = metric.value if math.isfinite(metric.value) else None
    found: dict[str, object] = {"value": value, "unit": metric.unit, "note": metric.note}
    if metric.interval is not None and metric.interval_words():
        found["interval_95"] = list(metric.interval)
    return found


def metrics_csv(metrics: Iterable[Metric]) -> str:
    """Return the columns name, value, unit, note as CSV text."""
    rows = ([m.name, repr(m.value), m.unit, m.note] for m in metrics)
    return csv_text(("name", "value", "unit", "note"), rows)
