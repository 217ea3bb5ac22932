# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Posterior distribution of an obstacle's height given signal strength, and its table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from slarm_graph.files.texts import csv_of
from slarm_graph.geometry import Floats

_SHARES = (0.05, 0.5, 0.95)
"""Quantiles in the table: the median and a 90 % interval."""


@dataclass(frozen=True, slots=True)
class HeightPosterior:
    """Prior and posterior distribution of one obstacle's height.

    Parameters
    ----------
    group : int
        Index of the map's group of solids.
    center_m : (2,) float64
        Of the plan [m].
    levels_m : (L,) float64
        Discrete heights, a step apart [m].
    prior, posterior : (L,) float64
        Probabilities of these.
    readings : int
        Number of those whose link is blocked at some of its heights and clear at others.
    """

    group: int
    center_m: Floats
    levels_m: Floats
    prior: Floats
    posterior: Floats
    readings: int

    def quantile_m(self, share: float, *, prior: bool = False) -> float:
        """Return a quantile of the posterior, or of the prior [m]."""
        reached = (self.prior if prior else self.posterior).cumsum()
        return float(self.levels_m[min(int(reached.searchsorted(share)), len(reached) - 1)])

    def mean_m(self) -> float:
        """Return the posterior's mean [m]."""
        return float(self.posterior @ self.levels_m)


def height_rows(heard: Sequence[HeightPosterior]) -> list[dict[str, float | int]]:
    """Return a table row per obstacle, rounded."""
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
    path.write_text(csv_of(height_rows(heard)), encoding="utf-8", newline="")
