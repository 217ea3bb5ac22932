# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""How noisy odometry and matches are, learned from what they are apart.

What is left between odometry and matches is noise of both. They are told apart by its correlation
in time: an error of driving stays in the path, an error of a match is taken back by the next one
(covariance matching: Mehra, "On the Identification of Variances and Adaptive Kalman Filtering",
IEEE T-AC 15(2), 1970). So is an error of reading odometry: stamps that are off shift it along the
way and the turn, whole ticks and degrees are rounded. Matches are wrong in all directions in
proportion to what their points say; to the side, where wheels do not move, odometry has no reading
to get wrong, and what is taken back there is the matches'.
"""

from __future__ import annotations

import copy
import math

import numpy as np
from numpy.typing import NDArray

from slarm_graph.geometry import Floats
from slarm_graph.kernels import kernel

_FIRST_STEPS, _MOST_STEPS = 20.0, 100.0
"""Steps that the first guess of the noise is worth, and that are remembered."""
_PATH_STEPS = 10
"""Steps that are added up: longer than an error of a match lasts, shorter than a drive."""
_LEAST_STEP = 0.01
"""Share of odometry's guessed variance that is believed at least: a tenth of its noise."""
_MOST_MATCH = 1000.0
"""Most of what a match's variance may be more than by its points alone: 30 times its noise."""
_ASIDE = 1
"""The axis in which wheels do not move."""
_ALIKE = 2.0
"""Factor within which two ratios may both be of the matches alone: each is learned from
`_MOST_STEPS` with a standard deviation of a quarter, so 93 % of two that are lie within it."""


class OdometryNoise:
    """Noise of odometry, step by step and along a path, and of matches, as known so far."""

    def __init__(self) -> None:
        self.excess: Floats = np.ones(3)
        """Variance of odometry's noise in x, y and theta over the guessed one."""
        self.match_excess: Floats = np.ones(3)
        """Variance of a match's noise over that which its points alone would have, at least 1."""
        self.path_excess: Floats = np.ones(3)
        """As `excess`, per step of a path of many steps: errors that go on add up."""
        self.reading: Floats = np.zeros(3)
        """Variance (3,) of a reading of odometry: what is taken back and is not the matches'."""
        self._sum: Floats = np.zeros(3)
        self._summed = 0
        self._all_tell = self._tells = np.ones(3, dtype=np.bool_)
        self._sum_square: Floats = np.zeros(3)
        self._sums = _FIRST_STEPS / _PATH_STEPS
        self._steps = _FIRST_STEPS
        self._square: Floats = np.full(3, np.nan)
        self._product: Floats = np.zeros(3)
        self._guess: Floats = np.zeros(3)
        self._claim: Floats = np.zeros(3)
        self._last: Floats | None = None

    def branched(self) -> OdometryNoise:
        """Return one of its own that has learned the same so far."""
        other = copy.copy(self)
        # The others are never changed in place.
        other._square, other._product = self._square.copy(), self._product.copy()
        other._guess, other._claim = self._guess.copy(), self._claim.copy()
        return other

    def interrupt(self) -> None:
        """Note that the next miss does not follow one."""
        self._last = None

    def learn(self, miss: Floats, guess: Floats, claimed: Floats, tells: NDArray[np.bool_]) -> None:
        """Learn from what odometry and a match are apart in a step.

        Parameters
        ----------
        miss, guess, claimed : (3,) float64
            Difference [m, m, rad], and variances guessed of odometry and claimed by a match.
        tells : (3,) bool
            Along which axes the match tells anything.
        """
        if math.isnan(self._square[0]):
            # A first match that says less than odometry is no guess of how well others match.
            first = np.minimum(claimed, guess)
            self._square, self._product = guess + 2.0 * first, -first
            self._guess, self._claim = guess.copy(), first
            self._sum_square = _PATH_STEPS * guess + 2.0 * first
        last, self._last = self._last, miss
        both_tell, self._tells = tells & self._tells, tells
        if last is None:
            self._begin_sum()
            return
        self._steps = min(self._steps + 1.0, _MOST_STEPS)
        averages = self._square, self._product, self._guess, self._claim
        rates = tells / self._steps, both_tell / self._steps
        self.excess, self.match_excess, self.reading, taken_back = _learned_noise(
            averages, miss, last, guess, claimed, rates
        )
        self._add_up(miss, taken_back, tells)

    def _begin_sum(self) -> None:
        self._sum, self._summed, self._all_tell = np.zeros(3), 0, np.ones(3, dtype=np.bool_)

    def _add_up(self, miss: Floats, taken_back: Floats, tells: NDArray[np.bool_]) -> None:
        """Learn how the misses of many steps add up (Allan, Proc. IEEE 54(2), 1966)."""
        self._sum, self._summed = self._sum + miss, self._summed + 1
        self._all_tell = self._all_tell & tells
        if self._summed < _PATH_STEPS:
            return
        self._sums = min(self._sums + 1.0, _MOST_STEPS / _PATH_STEPS)
        rate = self._all_tell / self._sums
        self._sum_square = self._sum_square + rate * (self._sum**2 - self._sum_square)
        self._begin_sum()
        of_step = (self._sum_square - 2.0 * taken_back) / _PATH_STEPS
        self.path_excess = np.maximum(of_step / self._guess, _LEAST_STEP)


@kernel
def _learned_noise(
    averages: tuple[Floats, Floats, Floats, Floats],
    miss: Floats,
    last: Floats,
    guess: Floats,
    claimed: Floats,
    rates: tuple[Floats, Floats],
) -> tuple[Floats, Floats, Floats, Floats]:
    """Tell the noise of odometry from that of matches.

    Parameters
    ----------
    averages : tuple of four (3,) float64
        Of squared misses, of products of two misses that follow each other, and of what odometry
        and matches were guessed to have; learned in place.
    miss, last : (3,) float64
        Of this step, and of the one before.
    guess, claimed : (3,) float64
        Variances of this step.
    rates : tuple of two (3,) float64
        Weight of this step in the averages, and of the two in that of products.

    Returns
    -------
    excess, match_excess, reading, taken_back : (3,) float64
        As in `OdometryNoise`; the last is the variance that the next match takes back.
    """
    square, product, guessed, claim = averages
    rate, rate_of_both = rates
    ratio, taken_back = np.empty(3), np.empty(3)
    for k in range(3):
        square[k] += rate[k] * (miss[k] * miss[k] - square[k])
        product[k] += rate_of_both[k] * (miss[k] * last[k] - product[k])
        guessed[k] += rate[k] * (guess[k] - guessed[k])
        claim[k] += rate[k] * (claimed[k] - claim[k])
        ratio[k] = min(-product[k], 0.5 * square[k]) / claim[k]
        taken_back[k] = min(max(ratio[k], 1.0), _MOST_MATCH) * claim[k]
    total, count = 0.0, 0
    for k in range(3):
        if ratio[k] < _ALIKE * ratio[_ASIDE] and _ALIKE * ratio[k] > ratio[_ASIDE]:
            total += ratio[k]
            count += 1
    of_matches = total / count if count else 1.0
    excess, match_excess, reading = np.empty(3), np.empty(3), np.empty(3)
    for k in range(3):
        match_excess[k] = min(max(of_matches, 1.0), _MOST_MATCH)
        of_match = match_excess[k] * claim[k]
        excess[k] = max(square[k] - 2.0 * of_match, _LEAST_STEP * guessed[k]) / guessed[k]
        reading[k] = max(taken_back[k] - of_match, 0.0)
    return excess, match_excess, reading, taken_back
