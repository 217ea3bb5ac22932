# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Variances of odometry and of matches, estimated from the residuals between them.

The residuals are noise of both, separated by their correlation in time: an error of driving stays
in the path (white residuals), an error of a match is taken back by the next one (anticorrelated)
(covariance matching: Mehra, "On the Identification of Variances and Adaptive Kalman Filtering",
IEEE T-AC 15(2), 1970). So is an error of reading odometry: wrong stamps shift it along the motion,
encoder ticks and degrees are rounded. The errors of matches are proportional to their nominal ones
in all directions; laterally, where wheels do not move, odometry has no reading error, and what is
taken back there is the matches'.

Of odometry's noise there are three sources: some per step, some per distance and some per angle.
How much of each there is depends on the robot, the floor and the clock; squared residuals of steps
that differ in distance and angle tell them apart.
"""

from __future__ import annotations

import copy
import math

import numpy as np
from numpy.typing import NDArray

from slarm_graph.frontends.scans.small_matrix import matvec3
from slarm_graph.geometry import Floats
from slarm_graph.kernels import kernel

_FIRST_STEPS, _MOST_STEPS = 20.0, 100.0
"""Steps that the prior of the noise is worth, and the memory of the averages."""
_PATH_STEPS = 10
"""Steps per sum of residuals: longer than an error of a match lasts, shorter than a drive."""
_PRIOR_LOG_VARIANCE, _STEP_LOG_VARIANCE = 2.0 / _FIRST_STEPS, 2.0 / _MOST_STEPS**2
"""Variance of the log variance of a source a priori, and its growth per step. A squared residual
over its variance has itself a variance of 2: so many steps weigh as much as the prior, and a filter
in its steady state remembers so many."""
MIN_FACTOR = 0.01
"""Lower bound of odometry's variance over the prior's: a tenth of the standard deviation."""
_MAX_MATCH_FACTOR = 1000.0
"""Upper bound of a match's variance over the nominal one: 30 times the standard deviation."""
_LATERAL = 1
"""Index of the axis in which wheels do not move."""
_MATCH_SIGMA = 0.25
"""Relative standard deviation of a variance of matches that is learned from `_MOST_STEPS`."""
_MAX_RATIO = 2.0
"""Factor within which two axes' ratios may both be of the matches alone: 93 % of two that are lie
within it, as unsure as they are."""


class OdometryNoise:
    """Estimator of the noise of odometry, per step and along a path, and of matches."""

    def __init__(self) -> None:
        self.source_factors: Floats = np.ones((3, 3))
        """Actual over prior variance of every source of odometry's noise, in x, y and theta."""
        self.match_variance_factor: Floats = np.ones(3)
        """Actual over nominal variance of a match, at least 1."""
        self.path_variance_factor: Floats = np.ones(3)
        """Variance per step of a path over that of a step: correlated errors add up."""
        self.reading_variances: Floats = np.zeros(3)
        """Variance (3,) of a reading of odometry: taken back by the next, and not the matches'."""
        self._log_covariances: Floats = np.stack([_PRIOR_LOG_VARIANCE * np.eye(3)] * 3)
        self._sum: Floats = np.zeros(3)
        self._sum_length = 0
        self._all_informative = self._is_informative = np.ones(3, dtype=np.bool_)
        self._sum_square: Floats = np.zeros(3)
        self._sum_count = _FIRST_STEPS / _PATH_STEPS
        self._steps = _FIRST_STEPS
        self._square: Floats = np.full(3, np.nan)
        self._product: Floats = np.zeros(3)
        self._mean_model: Floats = np.zeros(3)
        self._mean_nominal: Floats = np.zeros(3)
        self._previous: Floats | None = None

    def branched(self) -> OdometryNoise:
        """Return an independent copy."""
        other = copy.copy(self)
        # The others are never changed in place.
        other._square, other._product = self._square.copy(), self._product.copy()
        other._mean_model, other._mean_nominal = self._mean_model.copy(), self._mean_nominal.copy()
        return other

    def interrupt(self) -> None:
        """Note that the next residual does not follow one."""
        self._previous = None

    def learn(
        self, residual: Floats, sources: Floats, nominal: Floats, informative: NDArray[np.bool_]
    ) -> None:
        """Update the estimates by the residual between odometry and a match in a step.

        Parameters
        ----------
        residual, nominal : (3,) float64
            Difference [m, m, rad], and nominal variances of a match.
        sources : (3, 3) float64
            Prior variances of odometry, by source and axis.
        informative : (3,) bool
            Along which axes the match is surer than odometry.
        """
        model = noise_variances(sources, self.source_factors)
        if math.isnan(self._square[0]):
            # A first match less certain than odometry is no prior of the matches' noise.
            first = np.minimum(nominal, model)
            self._square, self._product = model + 2.0 * first, -first
            self._mean_model, self._mean_nominal = model.copy(), first
            self._sum_square = _PATH_STEPS * model + 2.0 * first
        previous, self._previous = self._previous, residual
        both_informative, self._is_informative = informative & self._is_informative, informative
        if previous is None:
            self._begin_sum()
            return
        self._steps = min(self._steps + 1.0, _MOST_STEPS)
        averages = self._square, self._product, self._mean_model, self._mean_nominal
        rates = informative / self._steps, both_informative / self._steps
        self.match_variance_factor, self.reading_variances, taken_back = _estimated_noise(
            averages, residual, previous, model, nominal, rates
        )
        self.source_factors, self._log_covariances = _updated_sources(
            self.source_factors,
            self._log_covariances,
            residual,
            sources,
            self.match_variance_factor * nominal,
            informative,
        )
        self._update_path_factor(residual, taken_back, informative)

    def _begin_sum(self) -> None:
        self._sum, self._sum_length, self._all_informative = (
            np.zeros(3),
            0,
            np.ones(3, dtype=np.bool_),
        )

    def _update_path_factor(
        self, residual: Floats, taken_back: Floats, informative: NDArray[np.bool_]
    ) -> None:
        """Update the variance of sums of residuals (Allan, Proc. IEEE 54(2), 1966)."""
        self._sum, self._sum_length = self._sum + residual, self._sum_length + 1
        self._all_informative = self._all_informative & informative
        if self._sum_length < _PATH_STEPS:
            return
        self._sum_count = min(self._sum_count + 1.0, _MOST_STEPS / _PATH_STEPS)
        rate = self._all_informative / self._sum_count
        self._sum_square = self._sum_square + rate * (self._sum**2 - self._sum_square)
        self._begin_sum()
        step_variance = (self._sum_square - 2.0 * taken_back) / _PATH_STEPS
        self.path_variance_factor = np.maximum(step_variance / self._mean_model, MIN_FACTOR)


@kernel
def noise_variances(sources: Floats, factors: Floats) -> Floats:
    """Variances (3,) of a step by those of its sources (3, 3) times factors (3, 3)."""
    total = np.zeros(3)
    for source in range(3):
        for k in range(3):
            total[k] += factors[source, k] * sources[source, k]
    return total


@kernel
def _updated_sources(
    factors: Floats,
    log_covariances: Floats,
    residual: Floats,
    sources: Floats,
    match_variances: Floats,
    informative: NDArray[np.bool_],
) -> tuple[Floats, Floats]:
    """Update the variances of odometry's sources by one residual.

    An extended Kalman filter for each axis, whose state are the three log variances: a squared
    residual over its variance is 1 on average, with a variance of 2, and goes with a log variance
    by that source's share.

    Parameters
    ----------
    factors, log_covariances : (3, 3), (3, 3, 3) float64
        By source and axis; covariances of their logarithms, by axis.
    residual, match_variances : (3,) float64
    sources : (3, 3) float64
        As of `OdometryNoise.learn`.
    informative : (3,) bool

    Returns
    -------
    factors, log_covariances : (3, 3), (3, 3, 3) float64
    """
    factors, log_covariances = factors.copy(), log_covariances.copy()
    share = np.empty(3)
    for k in range(3):
        if not informative[k]:
            continue
        variance = 2.0 * match_variances[k]
        for s in range(3):
            variance += factors[s, k] * sources[s, k]
        P, spread = log_covariances[k], 2.0
        for s in range(3):
            share[s] = factors[s, k] * sources[s, k] / variance
        gain = matvec3(P, share)
        for s in range(3):
            spread += share[s] * gain[s]
        # The mean of 1 / x is 1 plus the relative variance of x, here of what matches are off by.
        unsure = _MATCH_SIGMA * 2.0 * match_variances[k] / variance
        excess = residual[k] * residual[k] / variance - (1.0 + unsure * unsure)
        for s in range(3):
            factor = factors[s, k] * math.exp(gain[s] * excess / spread)
            factors[s, k] = max(factor, MIN_FACTOR)
            for other in range(3):
                P[s, other] -= gain[s] * gain[other] / spread
        for s in range(3):
            P[s, s] += _STEP_LOG_VARIANCE
        for s in range(3):
            bound = math.sqrt(min(1.0, _PRIOR_LOG_VARIANCE / P[s, s]))
            for other in range(3):
                P[s, other] *= bound
                P[other, s] *= bound
    return factors, log_covariances


@kernel
def _estimated_noise(
    averages: tuple[Floats, Floats, Floats, Floats],
    residual: Floats,
    previous: Floats,
    model: Floats,
    nominal: Floats,
    rates: tuple[Floats, Floats],
) -> tuple[Floats, Floats, Floats]:
    """Separate the noise of matches, and of readings of odometry, from that of driving.

    Parameters
    ----------
    averages : tuple of four (3,) float64
        Of squared residuals, of products of successive residuals, and of variances of odometry and
        nominal ones of matches; updated in place.
    residual, previous : (3,) float64
        Of this step, and of the one before.
    model, nominal : (3,) float64
        Variances of this step.
    rates : tuple of two (3,) float64
        Weight of this step in the averages, and of the two in that of products.

    Returns
    -------
    match_variance_factor, reading_variances, taken_back : (3,) float64
        As in `OdometryNoise`; the last is the variance that the next match takes back.
    """
    square, product, mean_model, mean_nominal = averages
    rate, product_rate = rates
    ratio, taken_back = np.empty(3), np.empty(3)
    for k in range(3):
        square[k] += rate[k] * (residual[k] * residual[k] - square[k])
        product[k] += product_rate[k] * (residual[k] * previous[k] - product[k])
        mean_model[k] += rate[k] * (model[k] - mean_model[k])
        mean_nominal[k] += rate[k] * (nominal[k] - mean_nominal[k])
        ratio[k] = min(-product[k], 0.5 * square[k]) / mean_nominal[k]
        taken_back[k] = min(max(ratio[k], 1.0), _MAX_MATCH_FACTOR) * mean_nominal[k]
    total, count = 0.0, 0
    for k in range(3):
        if ratio[k] < _MAX_RATIO * ratio[_LATERAL] and _MAX_RATIO * ratio[k] > ratio[_LATERAL]:
            total += ratio[k]
            count += 1
    match_ratio = total / count if count else 1.0
    match_variance_factor, reading_variances = np.empty(3), np.empty(3)
    for k in range(3):
        match_variance_factor[k] = min(max(match_ratio, 1.0), _MAX_MATCH_FACTOR)
        match_variance = match_variance_factor[k] * mean_nominal[k]
        reading_variances[k] = max(taken_back[k] - match_variance, 0.0)
    return match_variance_factor, reading_variances, taken_back
