# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""One measured number with its unit, and sets of them as JSON and CSV."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Metric:
    """A measured number.

    Parameters
    ----------
    name : str
        Key with its unit as suffix, such as `ate_rmse_m`; shares are fractions from 0 to 1.
    value : float
    unit : str
        Empty for counts and shares.
    note : str
        How it came about: alignment, what it was matched with.
    """

    name: str
    value: float
    unit: str = ""
    note: str = ""


def metrics_json(metrics: Iterable[Metric]) -> str:
    """Return `{"name": {"value": ..., "unit": ..., "note": ...}}`; a missing value is null."""
    content = {
        m.name: {
            "value": m.value if math.isfinite(m.value) else None,
            "unit": m.unit,
            "note": m.note,
        }
        for m in metrics
    }
    return json.dumps(content, indent=2) + "\n"


def metrics_csv(metrics: Iterable[Metric]) -> str:
    """Return the columns name, value, unit, note as CSV text."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["name", "value", "unit", "note"])
    writer.writerows([m.name, repr(m.value), m.unit, m.note] for m in metrics)
    return text.getvalue()
