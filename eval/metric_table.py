# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The table of metrics, `metric_kinds.csv`: name, unit, title and meaning of every metric.

Packages add theirs with an entry point of the group `slarm_graph.metrics`; see `MetricPart`.
"""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Any, Final

from slarm_graph.eval.metrics import Metric, MetricKind

_TABLE = Path(__file__).with_name("metric_kinds.csv")
_SUFFIXES: Final = ("m", "deg", "s", "db", "nat", "mb")


@cache
def kinds() -> Mapping[str, MetricKind]:
    """Return all kinds of metrics by name, those of plug-ins last."""
    from slarm_graph.eval.metric_parts import parts

    added = {kind.name: kind for part in parts() for kind in part.kinds}
    with _TABLE.open(newline="", encoding="utf-8") as file:
        rows: list[dict[str, Any]] = list(csv.DictReader(file))
    kinds = (MetricKind(**{**row, "headline": row["headline"] == "yes"}) for row in rows)
    built_in = {kind.name: kind for kind in kinds}
    return built_in | {name: kind for name, kind in added.items() if name not in built_in}


def kind_of(name: str) -> MetricKind:
    """Return the kind of a metric; of an unknown one, a kind derived from its name."""
    known = kinds().get(name)
    if known is not None:
        return known
    stem, _, suffix = name.rpartition("_")
    has_unit = suffix in _SUFFIXES
    title = (stem if has_unit else name).replace("_", " ")
    return MetricKind(name, suffix if has_unit else "", title, "", "always", "")


def headlines() -> tuple[MetricKind, ...]:
    """Return the kinds that short tables show, in the table's order."""
    return tuple(kind for kind in kinds().values() if kind.headline)


def in_table_order(metrics: Iterable[Metric]) -> tuple[Metric, ...]:
    """Sort metrics in the order of the table; of equal names the first is kept."""
    first: dict[str, Metric] = {}
    for metric in metrics:
        first.setdefault(metric.name, metric)
    places = {name: index for index, name in enumerate(kinds())}
    return tuple(sorted(first.values(), key=lambda m: places.get(m.name, len(places))))
