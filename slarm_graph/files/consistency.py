# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The verdict on a trajectory's consistency as `consistency.json` and rows of `conflicts.csv`."""

from __future__ import annotations

import json
import math
from dataclasses import asdict

from slarm_graph.consistency import Contradictions
from slarm_graph.stamps import ns_to_seconds

CONFLICT_COLUMNS = (
    "kind",
    "x_m",
    "y_m",
    "extent_m",
    "earlier_from_s",
    "earlier_to_s",
    "later_from_s",
    "later_to_s",
    "evidence_nat",
    "looked_through",
    "confirmed",
    "pairs",
)


def consistency_json(result: Contradictions) -> str:
    """Return everything but the points as JSON; unknown values are null, stamps are in ns."""
    content = asdict(result)
    del content["points_m"]
    content = {key: _known(value) for key, value in content.items()}
    first = ("verdict", "reasons")
    ordered = {key: content[key] for key in (*first, *(k for k in content if k not in first))}
    return json.dumps(ordered, indent=2) + "\n"


def _known(value: object) -> object:
    return None if isinstance(value, float) and not math.isfinite(value) else value


def conflict_rows(result: Contradictions) -> list[tuple[object, ...]]:
    """Return a row for every place in conflict, and for every step that odometry contradicts."""
    rows: list[tuple[object, ...]] = [
        (
            "place",
            *(f"{value:.3f}" for value in (*place.position_m, place.extent_m)),
            *(ns_to_seconds(ns) for ns in (*place.earlier_ns, *place.later_ns)),
            f"{place.evidence_nat:.1f}",
            place.contradicted,
            place.confirmed,
            place.pairs,
        )
        for place in result.places
    ]
    for tear in result.tears:
        before, after = (ns_to_seconds(ns) for ns in tear.stamps_ns)
        where = (f"{value:.3f}" for value in tear.position_m)
        off = f"{math.hypot(*tear.off[:2]):.3f}"
        evidence = f"{tear.evidence_nat:.1f}"
        rows.append(("step", *where, off, before, before, after, after, evidence, "", "", ""))
    return rows
