# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""How high an obstacle is by what was heard behind it: the answer, and as a table."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from slarm_graph.geometry import Floats

_SHARES = (0.05, 0.5, 0.95)
"""Quantiles told: the median, and between which nine of ten heights lie."""


@dataclass(frozen=True, slots=True)
class HeightPosterior:
    """How high one obstacle is, before and after readings.

    Parameters
    ----------
    group : int
        Of the map's groups of solids.
    center_m : (2,) float64
        Of the plan [m].
    levels_m : (L,) float64
        Heights, a step apart [m].
    prior, posterior : (L,) float64
        How likely each is.
    readings : int
        Of which the links are stopped at some of its heights and not at others.
    """

    group: int
    center_m: Floats
    levels_m: Floats
    prior: Floats
    posterior: Floats
    readings: int

    def quantile_m(self, share: float, *, prior: bool = False) -> float:
        """Return the height [m] that a share of the posterior, or of the prior, does not exceed."""
        reached = (self.prior if prior else self.posterior).cumsum()
        return float(self.levels_m[min(int(reached.searchsorted(share)), len(reached) - 1)])

    def mean_m(self) -> float:
        """Return the posterior's mean [m]."""
        return float(self.posterior @ self.levels_m)


def height_rows(heard: Sequence[HeightPosterior]) -> list[dict[str, float | int]]:
    """Return a row per obstacle, rounded for people."""
    rows: list[dict[str, float | int]] = []
    for one in heard:
        row: dict[str, float | int] = {"obstacle": one.group}
        row |= zip(("x_m", "y_m"), (round(float(v), 3) for v in one.center_m), strict=True)
        for words, prior in (("prior", True), ("height", False)):
            for share in _SHARES:
                row[f"{words}_q{100 * share:02.0f}_m"] = round(
                    one.quantile_m(share, prior=prior), 3
                )
        rows.append(row | {"height_mean_m": round(one.mean_m(), 3), "readings": one.readings})
    return rows


def write_heights_csv(path: Path, heard: Sequence[HeightPosterior]) -> None:
    """Write a line per obstacle."""
    with path.open("w", encoding="utf-8", newline="") as file:
        rows = height_rows(heard)
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
