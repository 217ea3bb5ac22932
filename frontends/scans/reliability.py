# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether odometry holds, slips or hangs, learned from how matches agree with it."""

from __future__ import annotations

import copy
import math

import numpy as np

from slarm_graph.frontends.scans.closures import SURPRISING
from slarm_graph.geometry import Floats

_FAILS = 1.0 / 300.0
"""Probability that odometry begins to fail in a step, before failures are counted; and that a match
is false."""
RECOVERS = 0.2
"""Probability that it ends in a step: slips and jumps last for some scans."""
_SURE_NAT = 600.0
"""Log odds beyond which a float has no number for them."""
_STILL = 1e-9
"""Motion [m, rad] that is none: what subtracting equal poses kilometres away leaves at most."""
_COUNTED = 300.0
"""Steps that the first guess of a failure's probability is worth."""


class Reliability:
    """Probability that odometry holds, in a chain of three states: it holds, slips or hangs.

    How often it begins to fail is counted; how a failure ends is known.
    """

    def __init__(self) -> None:
        self.holds = 1.0 - _FAILS
        self._hangs, self._is_still, self._is_seen = 0.0, False, False
        self._failed, self._lasts = 0.0, 0.0
        self._steps, self._failures = _COUNTED, _COUNTED * _FAILS
        self._log_vouched = 0.0

    def branched(self) -> Reliability:
        """Return one of its own that has learned the same so far."""
        return copy.copy(self)

    @property
    def fails(self) -> float:
        """Probability that odometry begins to fail in a step, as counted."""
        return self._failures / self._steps

    def begin(self) -> None:
        """Begin a step of which nothing has been seen yet."""
        self._is_seen, self._log_vouched = False, 0.0

    def go_on(self, increment: Floats) -> None:
        """Let a step pass in which odometry reads a motion (3,), or none at all.

        What hangs reads none until it moves on, as any failure then: that may be all that was
        missed, in one. Unseen it ends as rarely as a failure begins. What fails in a step of no
        motion hangs; later in a stand, where nothing did, it began unseen.
        """
        is_still, was_still = bool(np.abs(increment).max() < _STILL), self._is_still
        hung, fell = self._hangs if is_still else 0.0, self.holds * self.fails
        slips = 1.0 - self.holds - hung
        if is_still and was_still:
            self._hangs = hung * (1.0 - self.fails) + slips * (1.0 - RECOVERS) + fell * self.fails
            slips = 0.0
        else:
            self._hangs = fell if is_still else 0.0
            slips = (slips + fell - self._hangs) * (1.0 - RECOVERS)
        self.holds = 1.0 - self._hangs - slips
        self._is_still = is_still
        self._lasts = self._failed = (1.0 - RECOVERS) * self._failed

    def judge(self, log_odds: float, log_vouched: float) -> None:
        """Update by Bayes' rule with a match.

        Encoders that hang say nothing of the motion: a stand is as probable as it is without.

        Parameters
        ----------
        log_odds : float
            How much more probable the match is where odometry holds than where it fails [nat].
        log_vouched : float
            How much more probable it is where odometry fails than where it is false itself [nat].
        """
        self._is_seen, self._log_vouched = True, log_vouched
        before, slips = self.holds, 1.0 - self.holds - self._hangs
        ratio = math.exp(min(log_odds, _SURE_NAT))
        holds, hangs = before * ratio, self._hangs * max(ratio, 1.0)
        total = max(holds + hangs + slips, 1e-300)
        self.holds, self._hangs = holds / total, hangs / total
        self._failed = 1.0 - self.holds
        self._steps += before
        self._failures += before * (1.0 - self.holds)

    def holds_on_a_path(self) -> float:
        """Return the probability that odometry holds, for a path along it.

        What may have failed while nothing was matched is rare and far off, which is for those to
        weigh who meet a contradiction: a spread wide enough for it would let any place be the one
        that is come back to.
        """
        return self.holds if self._is_seen or self.holds < 0.5 else 1.0

    def speaks_against_matches(self) -> bool:
        """Whether a match away from odometry may be the false one, instead of odometry.

        Matches are false as rarely as odometry fails where nothing is known. Where its failure is
        so much more probable that a false match is beyond what closures are asked for, odometry
        does not speak against one: it often fails, or was just seen to have failed, or the match
        lies where the velocity leads, and false ones lie anywhere.
        """
        failed = math.log(self._lasts + self.fails) + self._log_vouched
        return failed <= math.log(SURPRISING * _FAILS)
