# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""What makes two hypotheses of a path, and how long a scan may show nothing of the map."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from test_moving_returns import scan_of

from slarm_graph.config import FrontendConfig
from slarm_graph.frontends.scans.hypotheses import PathHypothesis, branch, prune
from slarm_graph.frontends.scans.odometry_filter import Prediction
from slarm_graph.frontends.scans.pose_candidates import (
    PoseCandidate,
    PosePrior,
    distinct,
    unmatched_candidate,
)
from slarm_graph.frontends.scans.tracker import ScanTracker
from slarm_graph.geometry import Pose2
from slarm_graph.readings import Reading

SURE = Prediction(np.zeros(3), np.diag([0.008, 0.008, 0.005]) ** 2)
PRIOR = PosePrior(np.zeros(3), (SURE,), np.ones(3))
SHARP = np.diag(1.0 / np.array([0.003, 0.003, 0.001]) ** 2)
"""Information of a match to 3 mm and 1 mrad."""
CONTRADICTING_M = 4.04 * math.hypot(0.008, 0.003)
"""A match this far from the prediction is beyond its gate, chi2 of 16.3 of 3 degrees of freedom."""


def match(x_m: float, log_posterior: float = -3.0, turn_rad: float = 0.0) -> PoseCandidate:
    """A match so far ahead of the prediction."""
    return PoseCandidate(np.array([x_m, 0.0, turn_rad]), SHARP, 0.8, 60, 5, log_posterior)


@pytest.mark.parametrize(
    ("x_m", "count"),
    [(0.0, 1), (0.99 * CONTRADICTING_M, 1), (1.01 * CONTRADICTING_M, 2), (0.09, 2), (0.2, 2)],
)
def test_a_match_and_the_prediction_it_contradicts_are_two(x_m: float, count: int) -> None:
    """All that is seen may walk on, by less than poses are merged at."""
    hidden = unmatched_candidate(SURE, PRIOR)
    for candidates in ([match(x_m), hidden], [match(x_m, -9.0), hidden]):
        found = distinct(candidates, PRIOR)
        assert len(found) == count
        assert found[0] is max(candidates, key=lambda c: c.log_posterior)


def test_two_matches_or_two_predictions_are_one_place() -> None:
    likelier = match(0.09)
    assert distinct([match(0.0, -4.0), likelier], PRIOR) == [likelier]
    assert len(distinct([match(0.0), match(0.0, turn_rad=0.06)], PRIOR)) == 2
    assert len(distinct([unmatched_candidate(SURE, PRIOR)] * 2, PRIOR)) == 1


def after(x_m: float | None) -> PathHypothesis:
    """Where a match so far ahead leads, or none."""
    candidate = unmatched_candidate(SURE, PRIOR) if x_m is None else match(x_m)
    return branch(PathHypothesis(), [candidate], PRIOR, 0.2)[0]


@pytest.mark.parametrize(("x_m", "count"), [(0.01, 1), (0.09, 2)])
def test_who_takes_for_false_what_another_matched_is_another(x_m: float, count: int) -> None:
    assert len(prune([after(x_m), after(None)])) == count
    assert len(prune([after(x_m), after(0.0)])) == 1


def test_what_hides_the_map_lasts() -> None:
    """It begins once in a hundred scans, and goes on with a probability of 0.8."""
    hidden, seen = after(None), after(0.0)
    for hypothesis, nothing in ((PathHypothesis(), 0.01), (hidden, 0.8), (seen, 0.01)):
        prior = hypothesis.predict(0.2, Pose2(), 0.0)
        assert prior.nothing_known == nothing
        first = prior.predictions[0]
        unmatched = unmatched_candidate(first, prior)
        assert unmatched.log_posterior == pytest.approx(math.log(nothing * first.probability))


def test_a_new_local_map_is_expected_to_be_seen() -> None:
    """Five scans that fit nowhere, and the map begins anew with what they show."""
    rng, tracker = np.random.default_rng(0), ScanTracker(FrontendConfig())
    room = np.array([[-4.0, -4.0, 4.0, -4.0], [4.0, -4.0, 4.0, 4.0], [4.0, 4.0, -4.0, 4.0]])
    known = scan_of(np.zeros((0, 3)), room, np.zeros(3), np.zeros(361))
    shown = []
    for k in range(10):
        ranges_m = rng.uniform(0.3, 0.6, 361)
        scan = known if k < 4 else replace(known, ranges_m=ranges_m)
        tracker.track(Reading((k + 1) * 200_000_000, scan, Pose2()))
        shown.append(tracker._hypotheses[0].shows_map)
    assert shown[:9] == [True] * 4 + [False] * 4 + [True]
