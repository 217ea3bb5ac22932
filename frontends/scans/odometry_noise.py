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
"""

from __future__ import annotations

import copy
import math

import numpy as np
from numpy.typing import NDArray

from slarm_graph.geometry import Floats
from slarm_graph.kernels import kernel

_FIRST_STEPS, _MOST_STEPS = 20.0, 100.0
"""Steps that the prior of the noise is worth, and the memory of the averages."""
_PATH_STEPS = 10
"""Steps per sum of residuals: longer than an error of a match lasts, shorter than a drive."""
_MIN_FACTOR = 0.01
"""Lower bound of odometry's variance over the model's: a tenth of the standard deviation."""
_MAX_MATCH_FACTOR = 1000.0
"""Upper bound of a match's variance over the nominal one: 30 times the standard deviation."""
_LATERAL = 1
"""Index of the axis in which wheels do not move."""
_MAX_RATIO = 2.0
"""Factor within which two axes' ratios may both be of the matches alone: each is learned from
`_MOST_STEPS` with a standard deviation of a quarter, so 93 % of two that are lie within it."""


class OdometryNoise:
    """Estimator of the noise of odometry, per step and along a path, and of matches."""

    def __init__(self) -> None:
        self.variance_factor: Floats = np.ones(3)
        """Actual over model variance of odometry's noise in x, y and theta."""
        self.match_variance_factor: Floats = np.ones(3)
        """Actual over nominal variance of a match, at least 1."""
        self.path_variance_factor: Floats = np.ones(3)
        """As `variance_factor`, per step of a path of many steps: correlated errors add up."""
        self.reading_variances: Floats = np.zeros(3)
        """Variance (3,) of a reading of odometry: taken back by the next, and not the matches'."""
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
        self, residual: Floats, model: Floats, nominal: Floats, informative: NDArray[np.bool_]
    ) -> None:
        """Update the estimates by the residual between odometry and a match in a step.

        Parameters
        ----------
        residual, model, nominal : (3,) float64
            Difference [m, m, rad], and model variances of odometry and nominal ones of a match.
        informative : (3,) bool
            Along which axes the match is surer than odometry.
        """
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
        self.variance_factor, self.match_variance_factor, self.reading_variances, taken_back = (
            _estimated_noise(averages, residual, previous, model, nominal, rates)
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
        self.path_variance_factor = np.maximum(step_variance / self._mean_model, _MIN_FACTOR)


@kernel
def _estimated_noise(
    averages: tuple[Floats, Floats, Floats, Floats],
    residual: Floats,
    previous: Floats,
    model: Floats,
    nominal: Floats,
    rates: tuple[Floats, Floats],
) -> tuple[Floats, Floats, Floats, Floats]:
    """Separate the noise of odometry from that of matches.

    Parameters
    ----------
    averages : tuple of four (3,) float64
        Of squared residuals, of products of successive residuals, and of model and nominal
        variances; updated in place.
    residual, previous : (3,) float64
        Of this step, and of the one before.
    model, nominal : (3,) float64
        Variances of this step.
    rates : tuple of two (3,) float64
        Weight of this step in the averages, and of the two in that of products.

    Returns
    -------
    variance_factor, match_variance_factor, reading_variances, taken_back : (3,) float64
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
    variance_factor, match_variance_factor, reading_variances = (
        np.empty(3),
        np.empty(3),
        np.empty(3),
    )
    for k in range(3):
        match_variance_factor[k] = min(max(match_ratio, 1.0), _MAX_MATCH_FACTOR)
        match_variance = match_variance_factor[k] * mean_nominal[k]
        variance_factor[k] = (
            max(square[k] - 2.0 * match_variance, _MIN_FACTOR * mean_model[k]) / mean_model[k]
        )
        reading_variances[k] = max(taken_back[k] - match_variance, 0.0)
    return variance_factor, match_variance_factor, reading_variances, taken_back
