# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Evidence of one access point's readings on obstacle heights, as sufficient statistics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slarm_graph.geometry import Floats
from slarm_graph.radio.measured.fit import Hyperparameters, Problem, factored_at, fit_field
from slarm_graph.radio.measured.height_sampler import HeightEvidence, marginalised
from slarm_graph.radio.measured.mean_function import MAP_TERMS, MeanFunction
from slarm_graph.radio.measured.priors import FloorField
from slarm_graph.radio.measured.readings import Receiver, RssReadings

_WALLS = MAP_TERMS.index("wall_db")


@dataclass(frozen=True, slots=True)
class LinkClearances:
    """Readings of one access point, and the lowest height of their links over G obstacles.

    Parameters
    ----------
    readings : RssReadings
        None of them censored.
    mean : MeanFunction
        On a map without the obstacles of uncertain height.
    lowest_m : (G, N) float64
        Lowest height over the plan [m]; inf where a link does not pass over it.
    hyper : Hyperparameters, optional
        Of field, drift and noise.
    """

    readings: RssReadings
    mean: MeanFunction
    lowest_m: Floats
    hyper: Hyperparameters | None = None

    def fitted(
        self, floor: FloorField, levels_m: Floats, shares: Sequence[Floats]
    ) -> LinkClearances:
        """Return it with hyperparameters fitted under given probabilities of heights (L,) [m]."""
        problem = self.problem(floor, self.expected_obstructions(levels_m, shares))
        return replace(self, hyper=fit_field(problem, self.hyper).hyper)

    def expected_obstructions(self, levels_m: Floats, shares: Sequence[Floats]) -> Floats:
        """Return the expected number (N,) of obstacles that block each link, over their heights."""
        total = np.zeros(len(self.readings))
        for lowest_m, share in zip(self.lowest_m, shares, strict=True):
            over = np.isfinite(lowest_m)
            lower = np.searchsorted(levels_m, lowest_m[over], side="right")
            total[over] += 1.0 - np.concatenate([[0.0], share.cumsum()])[lower]
        return total

    def problem(self, floor: FloorField, stopped: Floats) -> Problem:
        """Return the regression when so many obstacles block each link (N,)."""
        problem = Problem.of(floor, self.mean, self.readings, Receiver())
        problem.design[:, _WALLS] -= stopped
        return problem


def height_evidence(
    links: LinkClearances,
    floor: FloorField,
    levels_m: Floats,
    shares: Sequence[Floats],
    which: NDArray[np.int64],
) -> HeightEvidence:
    """Return the evidence on the heights of some obstacles, the others at their expected effect.

    Parameters
    ----------
    links : LinkClearances
        With hyperparameters.
    floor : FloorField
    levels_m : (L,)
    shares : sequence of G (L,)
        Probability of each height.
    which : (K,) int64
        Obstacles of which every height is a column of the design.
    """
    assert links.hyper is not None
    stopped = links.expected_obstructions(levels_m, shares)
    own = links.lowest_m[which]
    others = stopped - replace(links, lowest_m=own).expected_obstructions(
        levels_m, [shares[k] for k in which]
    )
    problem = links.problem(floor, stopped)
    factored, values = factored_at(problem, fit_field(problem, links.hyper, search=False))
    fixed = np.delete(problem.design, _WALLS, axis=1)
    certain = -problem.design[:, _WALLS] - stopped + others
    columns = (levels_m[None, :, None] > own[:, None, :]).reshape(-1, len(stopped)).T
    inner = factored.inner(np.column_stack([values, fixed, certain, columns]))
    prior = problem.coefficients
    means, sds = np.delete(prior.mean, _WALLS), np.delete(prior.sd, _WALLS)
    with_readings, among = marginalised(inner, fixed.shape[1], means, sds)
    return HeightEvidence(with_readings, among, float(prior.mean[_WALLS]), float(prior.sd[_WALLS]))
