# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Localise an access point by its readings: marginal likelihood over a lattice of positions.

The part of field and drift in the readings' covariance does not depend on the position of the
access point, so that it is factored once; each position then costs a few solves.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from slarm_graph.access_points import AccessPoint
from slarm_graph.config import MeasuredConfig
from slarm_graph.geometry import Floats
from slarm_graph.radio.measured.fit import Hyperparameters, Problem, factored_at, fit_field
from slarm_graph.radio.measured.mean_function import MeanFunction
from slarm_graph.radio.measured.priors import FloorField
from slarm_graph.radio.measured.readings import Receiver, RssReadings

STEPS_M = (1.0, 0.25)
"""Steps of the lattice over the map, and of that around its best point; the posterior is wider than
the second."""

AROUND_M = 1.25
"""Half the side of the second lattice: beyond the neighbours of the first."""

HEIGHTS_M = (0.5, 1.0, 1.5, 2.0, 2.5, 3.0)
"""Heights tried: from a table to under a high ceiling."""

_STRONGEST = 0.05
"""The search begins at the centroid of this share of the readings; any point of the floor would
do."""

_EVERY, _FEW = 8, 100
"""Every eighth reading rules positions out first, if these are at least a hundred: a tenth of the
time that all of them take."""

_LINKS_AT_A_TIME = 1_000_000
"""Positions times readings evaluated at once: with three coefficients 24 MB, and as much in
between. A tenth takes more time, for the map is prepared for each traversal."""

_RULED_OUT = 15.0
"""Log likelihood ratio: chance makes a position that much likelier than the true one once in
3 x 10^6 (Markov's inequality), whatever the readings; a lattice has some thousand positions."""


@dataclass(frozen=True, slots=True)
class Located:
    """Posterior of an access point's position.

    Parameters
    ----------
    position_m : (3,) float64
        Posterior mean [m].
    covariance_m2 : (3, 3) float64
        Of the posterior [m^2].
    hyper : Hyperparameters
        Of field, drift and noise.
    """

    position_m: Floats
    covariance_m2: Floats
    hyper: Hyperparameters

    def sd_m(self) -> tuple[float, float, float]:
        """Standard deviations along x, y, z [m]."""
        x, y, z = np.sqrt(np.diag(self.covariance_m2)).tolist()
        return x, y, z


def locate(
    floor: FloorField, mean: MeanFunction, readings: RssReadings, config: MeasuredConfig
) -> Located:
    """Estimate the position of an access point, on a coarse lattice and then a fine one.

    Parameters
    ----------
    floor : FloorField
    mean : MeanFunction
        Its access point, if any, is replaced.
    readings : RssReadings
        Readings, of which those heard are used.
    config : MeasuredConfig
    """
    # The losses of single blocks say little about the position, and take long.
    mean, heard = replace(mean, blocks=None), readings.only(readings.heard)
    heard = heard.only(np.arange(0, len(heard), max(1, len(heard) // config.search_readings)))
    strong = heard.rss_dbm >= np.quantile(heard.rss_dbm, 1.0 - _STRONGEST)
    best = np.array([*heard.points_m[strong].mean(axis=0), HEIGHTS_M[3]])
    search = _Search(floor, _at(mean, best), heard)
    best = _likeliest(search, _over_map(mean))
    search = _Search(floor, _at(mean, best), heard, search.hyper)
    best = _likeliest(search, _around(best, AROUND_M, STEPS_M[-1]))
    # Once more about the best, with the hyperparameters of the second fit.
    lattice = _around(best, AROUND_M, STEPS_M[-1])
    search = _Search(floor, _at(mean, best), heard, search.hyper, again=False)
    logs = search.evidences(lattice)
    share = np.exp(logs - logs.max())
    share /= share.sum()
    middle = share @ lattice
    away = lattice - middle
    # Discretisation: the variance of a uniform distribution over a cell of the lattice.
    grain = np.diag(np.array([STEPS_M[-1], STEPS_M[-1], HEIGHTS_M[1] - HEIGHTS_M[0]]) ** 2 / 12.0)
    return Located(middle, (share[:, None] * away).T @ away + grain, search.hyper)


def _likeliest(search: _Search, lattice: Floats) -> Floats:
    """Position (3,) of greatest marginal likelihood among positions (P, 3)."""
    return np.asarray(lattice[np.argmax(search.evidences(lattice))])


def _at(mean: MeanFunction, position_m: Floats) -> MeanFunction:
    x, y, z = (float(v) for v in position_m)
    return replace(mean, access_point=AccessPoint("sought", x, y, z))


def _over_map(mean: MeanFunction) -> Floats:
    """Lattice (P, 3) over the whole map, at a ceiling's height."""
    x_min, x_max, y_min, y_max = mean.geographic.geometry.extent_m
    x, y = np.meshgrid(
        np.arange(x_min, x_max + STEPS_M[0], STEPS_M[0]),
        np.arange(y_min, y_max + STEPS_M[0], STEPS_M[0]),
    )
    return np.column_stack([x.ravel(), y.ravel(), np.full(x.size, HEIGHTS_M[3])])


def _around(middle: Floats, half_m: float, step_m: float) -> Floats:
    """Lattice (P, 3) around a position, at all heights."""
    steps = np.arange(-half_m, half_m + 0.5 * step_m, step_m)
    x, y, z = np.meshgrid(middle[0] + steps, middle[1] + steps, HEIGHTS_M)
    return np.column_stack([x.ravel(), y.ravel(), z.ravel()])


class _Search:
    """Marginal likelihood of positions under one set of hyperparameters and weights."""

    def __init__(
        self,
        floor: FloorField,
        mean: MeanFunction,
        heard: RssReadings,
        start: Hyperparameters | None = None,
        *,
        again: bool = True,
    ) -> None:
        # Positions are compared on the map without shifts: less time, and no other answer.
        self._mean, self._heard = mean, heard
        problem = Problem.of(floor, mean, heard, Receiver())
        self._coefficients = problem.coefficients
        fit = fit_field(problem, start, search=again)
        self.hyper = fit.hyper
        self._model, self._values = factored_at(problem, fit)
        self._part: _Search | None = None
        if len(heard) > _EVERY * _FEW:
            some = heard.only(np.arange(0, len(heard), _EVERY))
            self._part = _Search(floor, mean, some, fit.hyper, again=False)

    def evidences(self, lattice: Floats) -> Floats:
        """Log evidence of positions (P, 3); -inf where part of the readings rules one out."""
        logs = np.full(len(lattice), -np.inf)
        near = np.ones(len(lattice), dtype=np.bool_)
        if self._part is not None:
            rough = self._part.evidences(lattice)
            near = rough >= rough.max() - _RULED_OUT
        within = np.flatnonzero(near)
        for some in np.array_split(within, -(-len(within) * len(self._heard) // _LINKS_AT_A_TIME)):
            logs[some] = self._evidences_at(lattice[some])
        return logs

    def _evidences_at(self, positions_m: Floats) -> Floats:
        """Log marginal likelihoods (P,) of positions (P, 3)."""
        designs = self._mean.reading_designs_from(self._heard, positions_m)
        return self._model.log_evidences(designs, self._coefficients, self._values)
