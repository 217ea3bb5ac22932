# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""When odometry speaks against a match that lies elsewhere."""

from __future__ import annotations

import numpy as np
import pytest

from slarm_graph.frontends.scans.reliability import Reliability

GOES, STANDS = np.array([0.1, 0.0, 0.02]), np.zeros(3)
AGREES_NAT, DISAGREES_NAT = 5.0, -300.0


def stepped(reliability: Reliability, log_odds: float, increment: np.ndarray = GOES) -> bool:
    """Let a step pass and be judged; return whether odometry spoke against its match."""
    reliability.begin()
    reliability.go_on(increment)
    reliability.judge(log_odds, 0.0)
    return reliability.speaks_against_matches()


@pytest.mark.parametrize(("every", "expected"), [(50, True), (5, False)])
def test_odometry_that_fails_often_does_not(every: int, expected: bool) -> None:
    """Where it rarely does, the match that says so may be the false one."""
    reliability, spoke = Reliability(), not expected
    for k in range(1, 900):
        fails = k % every == 0
        speaks = stepped(reliability, DISAGREES_NAT if fails else AGREES_NAT)
        spoke = speaks if fails else spoke
    assert spoke == expected


def test_nor_does_what_was_just_seen_to_fail() -> None:
    """Encoders hang for three steps: only in the first the match may be the false one."""
    reliability = Reliability()
    assert all(stepped(reliability, AGREES_NAT) for _ in range(100))
    hung = [stepped(reliability, DISAGREES_NAT, STANDS) for _ in range(3)]
    assert hung == [True, False, False]
    assert reliability.holds < 0.01
    after = [stepped(reliability, AGREES_NAT) for _ in range(20)]
    assert after[-1]
    assert reliability.holds > 0.9
