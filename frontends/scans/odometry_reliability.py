# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Reliability of odometry: a hidden Markov model of its failures, updated by matches."""

from __future__ import annotations

import copy
import math

from slarm_graph.frontends.scans.closures import GATE_CHI2
from slarm_graph.geometry import Floats

_PRIOR_STEPS = 300.0
"""Steps that the prior of the failure rate is worth, one failure in them."""
_FAILS = 1.0 / _PRIOR_STEPS
"""Prior probability that odometry begins to fail in a step; and that a match is false."""
_RECOVERS = 0.2
"""Probability that a failure ends in a step: slips and jumps last for some scans."""
_HAS_GYROSCOPE = _FAILS
"""Probability that a failure in which the heading goes on is of frozen encoders, beside which a
gyroscope turns: as rare as failures are. Three times as often, and intel.bag is 4 % worse
(three draws of it as good)."""
_MAX_LOG_ODDS = 600.0
"""Log odds beyond which their exponential overflows a float."""
_NO_MOTION = 1e-9
"""Motion [m, rad] that is none: what subtracting equal poses kilometres away leaves at most."""


class OdometryReliability:
    """Hidden Markov model of odometry with three states: working, slipping, frozen encoders.

    The failure rate is learned; the recovery probability is fixed.
    """

    def __init__(self) -> None:
        self.p_working = 1.0 - _FAILS
        self._p_frozen, self._is_still, self._is_matched = 0.0, False, False
        self._p_failed, self._p_still_failed = 0.0, 0.0
        self._steps, self._failures = _PRIOR_STEPS, _PRIOR_STEPS * _FAILS
        self._log_match_odds = 0.0

    def branched(self) -> OdometryReliability:
        """Return an independent copy."""
        return copy.copy(self)

    @property
    def failure_rate(self) -> float:
        """Learned probability that odometry begins to fail in a step."""
        return self._failures / self._steps

    def begin_step(self) -> None:
        """Begin a step that no match has been seen of yet."""
        self._is_matched, self._log_match_odds = False, 0.0

    def predict(self, increment: Floats) -> None:
        """Predict the state probabilities over a step with an increment (3,) of odometry.

        Frozen encoders read no way until they recover; that step is a failure, too, as it may
        contain all the motion missed. While they read none, recovery is as rare as failure. A
        failure in a step of zero motion is a freeze; later in a standstill that began without one,
        it starts unnoticed. The heading may go on, by a gyroscope.
        """
        has_way = math.hypot(increment[0], increment[1]) > _NO_MOTION
        is_still, was_still = not has_way and abs(increment[2]) < _NO_MOTION, self._is_still
        frozen, failing = 0.0 if has_way else self._p_frozen, self.p_working * self.failure_rate
        slipping = 1.0 - self.p_working - frozen
        frozen *= 1.0 - self.failure_rate
        if is_still and was_still:
            frozen += slipping * (1.0 - _RECOVERS) + failing * self.failure_rate
            slipping = 0.0
        else:
            freezing = 0.0 if has_way else failing * (1.0 if is_still else _HAS_GYROSCOPE)
            frozen += freezing
            slipping = (slipping + failing - freezing) * (1.0 - _RECOVERS)
        self._p_frozen = frozen
        self.p_working = 1.0 - self._p_frozen - slipping
        self._is_still = is_still
        self._p_still_failed = self._p_failed = (1.0 - _RECOVERS) * self._p_failed

    def update(self, log_odds: float, log_match_odds: float) -> None:
        """Update the state probabilities by Bayes' rule with a match.

        Frozen encoders carry no information: a standstill is as probable with them as without.

        Parameters
        ----------
        log_odds : float
            Of the match if odometry works against if it fails [nat].
        log_match_odds : float
            Of the match if odometry fails against if the match is false [nat].
        """
        self._is_matched, self._log_match_odds = True, log_match_odds
        before, slipping = self.p_working, 1.0 - self.p_working - self._p_frozen
        ratio = math.exp(min(log_odds, _MAX_LOG_ODDS))
        working, frozen = before * ratio, self._p_frozen * max(ratio, 1.0)
        total = max(working + frozen + slipping, 1e-300)
        self.p_working, self._p_frozen = working / total, frozen / total
        self._p_failed = 1.0 - self.p_working
        self._steps += before
        self._failures += before * (1.0 - self.p_working)

    def p_working_on_path(self) -> float:
        """Return the probability that odometry works, for a path by odometry alone.

        1 while nothing is matched: an unnoticed failure is rare and large, and is weighed where a
        contradiction appears. A covariance wide enough for it would accept any loop closure.
        """
        return self.p_working if self._is_matched or self.p_working < 0.5 else 1.0

    def contradicts_matches(self) -> bool:
        """Whether a match that disagrees with odometry may be false, rather than odometry.

        A priori both are equally rare. A failure of odometry is more probable by more than the gate
        of loop closures where it fails often, has just failed, or the match agrees with the
        predicted velocity (false matches lie anywhere); then odometry does not contradict a match.
        """
        failed = math.log(self._p_still_failed + self.failure_rate) + self._log_match_odds
        return failed <= math.log(GATE_CHI2 * _FAILS)
