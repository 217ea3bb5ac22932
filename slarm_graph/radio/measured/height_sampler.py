# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Gibbs sampling of the heights of obstacles from the evidence of all access points.

The likelihood of one access point is that of a linear model, y = F f - w c - sum of w_k c_k + field
+ drift + noise: c counts the walls that each link certainly passes, c_k is 1 where the k-th
obstacle at its height blocks it, w is the loss of a wall and w_k ~ N(w, sd^2) that of the obstacle.
Field, drift and the other linear coefficients f are marginalised once, so that a height costs a few
inner products; w_k is marginalised when a height is drawn, and drawn after it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from slarm_graph.geometry import Floats

_SWEEPS, _BURN_IN = 400, 100
"""Sweeps over all obstacles, and how many of them are discarded as burn-in."""

_LOSS_SPREAD_DB = 1.75
"""Standard deviation of an obstacle's loss about that of a wall: light and heavy walls have 3.4 and
6.9 dB (COST 231, Table 4.7.2), of which this is half the difference."""


@dataclass(frozen=True, slots=True)
class HeightEvidence:
    """Sufficient statistics of one access point's readings on heights.

    Columns are the number of walls that each link certainly passes, and an indicator of the links
    that each of C levels of obstacles blocks; products are under the readings' precision.

    Parameters
    ----------
    readings : (1 + C,) float64
        Inner products of the columns with the readings.
    passed : (1 + C, 1 + C) float64
        Inner products of the columns with each other.
    wall_db, wall_sd_db : float
        Prior of the loss of a wall.
    """

    readings: Floats
    passed: Floats
    wall_db: float
    wall_sd_db: float


def marginalised(inner: Floats, fixed: int, mean: Floats, sd: Floats) -> tuple[Floats, Floats]:
    """Marginalise the linear coefficients out of inner products.

    Parameters
    ----------
    inner : (1 + fixed + K, 1 + fixed + K)
        Of readings, of the coefficients' columns, and of other columns.
    fixed : int
    mean, sd : (fixed,)
        Prior of the coefficients.

    Returns
    -------
    readings : (K,)
        Inner products of the other columns with the readings less their prior mean.
    among : (K, K)
        Of the other columns with each other.
    """
    own, rest = slice(1, 1 + fixed), slice(1 + fixed, None)
    inverse = np.linalg.inv(inner[own, own] + np.diag(sd**-2.0))
    explained = inner[rest, own] @ inverse
    left = inner[0, :] - mean @ inner[own, :]
    return left[rest] - explained @ left[own], inner[rest, rest] - explained @ inner[own, rest]


def height_probabilities(
    evidence: Sequence[HeightEvidence], log_priors: Sequence[Floats], rng: np.random.Generator
) -> list[Floats]:
    """Return the posterior probabilities (L,) of the levels of every obstacle.

    Parameters
    ----------
    evidence : sequence of HeightEvidence
        One per access point; their columns are the levels of the obstacles in order.
    log_priors : sequence of (L,)
    rng : numpy.random.Generator
    """
    starts = np.cumsum([1, *(len(prior) for prior in log_priors)]).tolist()
    chosen = [start + int(prior.argmax()) for start, prior in zip(starts, log_priors, strict=False)]
    states = [_GibbsState(one, chosen) for one in evidence]
    total = [np.zeros(len(prior)) for prior in log_priors]
    for sweep in range(_SWEEPS):
        for k, prior in enumerate(log_priors):
            levels = slice(starts[k], starts[k + 1])
            share = _normalised(prior + sum(state.log_likelihoods(k, levels) for state in states))
            drawn = int(np.searchsorted(share.cumsum(), rng.random()))
            for state in states:
                state.assign(k, levels.start + min(drawn, len(share) - 1), rng)
            if sweep >= _BURN_IN:
                total[k] += share
        for state in states:
            state.draw_wall_loss(rng)
    return [counts / counts.sum() for counts in total]


def _normalised(logs: Floats) -> Floats:
    """Probabilities (L,) from unnormalised log probabilities."""
    share = np.exp(logs - logs.max())
    return np.asarray(share / share.sum())


class _GibbsState:
    """Current sample of one access point: column and loss of every obstacle, loss of a wall."""

    def __init__(self, evidence: HeightEvidence, chosen: Sequence[int]) -> None:
        self._passed, self._evidence = evidence.passed, evidence
        self._column = list(chosen)
        self._takes_db = [evidence.wall_db] * len(chosen)
        self._wall_db = evidence.wall_db
        # Inner products (1 + C,) of all columns with the residuals.
        self._left = evidence.readings + self._wall_db * self._passed[0]
        for column, takes_db in zip(self._column, self._takes_db, strict=True):
            self._left += takes_db * self._passed[column]

    def log_likelihoods(self, k: int, levels: slice) -> Floats:
        """Remove an obstacle; return the log likelihood (L,) of each of its levels."""
        self._left -= self._takes_db[k] * self._passed[self._column[k]]
        precision = self._passed[levels, levels].diagonal() + _LOSS_SPREAD_DB**-2
        pull = self._wall_db * _LOSS_SPREAD_DB**-2 - self._left[levels]
        return np.asarray(0.5 * (pull**2 / precision - np.log(precision)))

    def assign(self, k: int, column: int, rng: np.random.Generator) -> None:
        """Set an obstacle to the level of a column, and draw its loss."""
        precision = float(self._passed[column, column]) + _LOSS_SPREAD_DB**-2
        pull = self._wall_db * _LOSS_SPREAD_DB**-2 - float(self._left[column])
        self._column[k] = column
        self._takes_db[k] = pull / precision + rng.standard_normal() * precision**-0.5
        self._left += self._takes_db[k] * self._passed[column]

    def draw_wall_loss(self, rng: np.random.Generator) -> None:
        """Draw the loss of a wall given the losses of the obstacles."""
        self._left -= self._wall_db * self._passed[0]
        prior = self._evidence.wall_sd_db**-2
        precision = float(self._passed[0, 0]) + prior + len(self._takes_db) * _LOSS_SPREAD_DB**-2
        pull = self._evidence.wall_db * prior + sum(self._takes_db) * _LOSS_SPREAD_DB**-2
        pull -= float(self._left[0])
        self._wall_db = pull / precision + rng.standard_normal() * precision**-0.5
        self._left += self._wall_db * self._passed[0]
