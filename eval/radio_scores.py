# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Accuracy of a recovered map and its radio map, as values and metrics."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slarm_graph.eval.metrics import Metric


@dataclass(frozen=True, slots=True)
class LinkAccuracy:
    """Agreement of one access point's map with the truth; shares are by area, from 0 to 1.

    Parameters
    ----------
    access_point : str
        Its name.
    accuracy, gain_hit : float
        As in `RadioAccuracy`.
    los_agreement : float
        Share of the cells accessible in both whose line of sight is of one class in both: clear,
        blocked or unknown.
    los_unknown, los_unknown_reference : float
        Share of those cells whose line of sight the map, and the reference, does not know.
    los_brier : float
        Mean squared error of the probability of line of sight there, 0 for certain and right.
    gain_rmse_db, gain_mae_db : float
        Of the cells accessible in both [dB].
    """

    access_point: str
    accuracy: float
    gain_hit: float
    los_agreement: float
    los_unknown: float
    los_unknown_reference: float
    los_brier: float
    gain_rmse_db: float
    gain_mae_db: float


@dataclass(frozen=True, slots=True)
class RadioAccuracy:
    """Agreement of a recovered map with the truth; shares are by area, from 0 to 1.

    Parameters
    ----------
    links : tuple of LinkAccuracy
        One per access point of the reference; at least one.
    coverage_accessible : float
        Share of the reference-accessible cells that are called accessible.
    coverage_observed, coverage_visited, coverage_footprint : float
        The three coverage layers, as shares of the reference-accessible cells.
    false_accessible : float
        Cells called accessible that are not, as a share of all that are called so.
    iou : float
        Intersection over union of accessible cells.
    tolerance_db : float
    expansion_radius_m : float
        The map kept from obstacles (the paper's R_e) [m].
    smallest_gap_db : float
        Smallest loss that blocking adds in a reference-accessible cell [dB].
    """

    links: tuple[LinkAccuracy, ...]
    coverage_accessible: float
    coverage_observed: float
    coverage_visited: float
    coverage_footprint: float
    false_accessible: float
    iou: float
    tolerance_db: float
    expansion_radius_m: float
    smallest_gap_db: float

    @property
    def accuracy(self) -> float:
        """Reference-accessible, called accessible, and gain within the tolerance: mean over APs."""
        return self._mean("accuracy")

    @property
    def worst(self) -> LinkAccuracy:
        """The access point of the least accuracy."""
        return min(self.links, key=lambda link: link.accuracy)

    @property
    def gain_hit(self) -> float:
        """Share of the cells found whose gain is within the tolerance; accuracy / coverage."""
        return self._mean("gain_hit")

    @property
    def los_agreement(self) -> float:
        """Share of the cells accessible in both whose line of sight is of one class in both."""
        return self._mean("los_agreement")

    @property
    def los_brier(self) -> float:
        """Mean squared error of the probability of line of sight."""
        return self._mean("los_brier")

    @property
    def gain_rmse_db(self) -> float:
        """Root of the mean squared gain error over all access points [dB]."""
        return float(np.sqrt(np.mean([link.gain_rmse_db**2 for link in self.links])))

    @property
    def gain_mae_db(self) -> float:
        """Mean absolute gain error over all access points [dB]."""
        return self._mean("gain_mae_db")

    def _unknown_note(self) -> str:
        """Return a note where the reference itself does not know the line of sight of all links."""
        share = self._mean("los_unknown_reference")
        return (
            f"{share:.2%} unknown to the reference itself; agrees where both are" if share else ""
        )

    def _mean(self, name: str) -> float:
        return float(np.mean([getattr(link, name) for link in self.links]))

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings of limitations of the metrics."""
        if self.tolerance_db < self.smallest_gap_db:
            return ()
        return (
            f"a tolerance of {self.tolerance_db:g} dB cannot tell blocked from clear links, which"
            f" differ by as little as {self.smallest_gap_db:.2f} dB here",
        )

    def metrics(self) -> tuple[Metric, ...]:
        """Return the accuracy as metrics of the run folder."""
        note = f"|gain error| <= {self.tolerance_db:g} dB; R_e = {self.expansion_radius_m:g} m"
        each = ", ".join(f"{link.access_point} {link.accuracy:.4f}" for link in self.links)
        mean = f"mean of {len(self.links)} access points" if len(self.links) > 1 else ""
        notes = "; ".join(part for part in (note, mean, *self.warnings) if part)
        shares = ("coverage_observed", "coverage_visited", "coverage_footprint", "gain_hit")
        others = ("coverage_accessible", "false_accessible", "iou")
        return (
            Metric("accuracy", self.accuracy, note=notes),
            Metric("accuracy_worst_ap", self.worst.accuracy, note=f"of {each}"),
            *(Metric(name, getattr(self, name)) for name in shares + others),
            Metric("los_agreement", self.los_agreement, note=self._unknown_note()),
            Metric("los_unknown", self._mean("los_unknown")),
            Metric("los_brier", self.los_brier),
            Metric("gain_rmse_db", self.gain_rmse_db),
            Metric("gain_mae_db", self.gain_mae_db),
        )
