# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Scan-to-map matching from predictions of any uncertainty."""

from __future__ import annotations

import numpy as np
import pytest

from slarm_graph.config import KeyframeConfig, MatchingConfig
from slarm_graph.frontends.scans.local_map import LocalMap
from slarm_graph.frontends.scans.local_matching import LocalMatcher, _agree, _subsamples
from slarm_graph.frontends.scans.odometry_filter import Prediction
from slarm_graph.frontends.scans.pose_candidates import PosePrior
from slarm_graph.geometry import Floats, Pose2, between, invert, transform_points

VAGUE = np.diag([0.05, 0.05, np.radians(3.0)]) ** 2
"""Of a turn of 30 degrees by odometry that is off by a tenth."""
TRUE = np.array([0.3, 0.1, np.radians(-30.0)])


def walls() -> Floats:
    """Points (K, 2) of pillars 8 to 12 m away, and of a screen round a half of the robot."""
    rng, bearings = np.random.default_rng(5), np.linspace(0.0, np.pi, 4000)
    screen = TRUE[:2] + 2.0 * np.column_stack([np.cos(bearings), np.sin(bearings)])
    sights, ranges_m = rng.uniform(-np.pi, 0.0, 40), rng.uniform(8.0, 12.0, 40)
    middles = ranges_m[:, None] * np.column_stack([np.cos(sights), np.sin(sights)])
    faces = np.linspace(-0.2, 0.2, 100)[:, None]
    turns = rng.uniform(-np.pi, np.pi, 40)
    return np.concatenate(
        [screen, *(m + faces * [np.cos(t), np.sin(t)] for m, t in zip(middles, turns, strict=True))]
    )


def seen_from(pose: Floats) -> Floats:
    """Returns (K, 2) in the robot's frame, one a degree, in beam order."""
    points = transform_points(invert(pose), walls())
    points = points[np.argsort(np.hypot(points[:, 0], points[:, 1]), kind="stable")]
    beams = np.round(np.degrees(np.arctan2(points[:, 1], points[:, 0]))).astype(np.int64)
    _, nearest = np.unique(beams, return_index=True)
    return points[nearest]


@pytest.mark.parametrize("off_deg", [-4.5, -3.0, 0.5, 3.0, 4.5])
def test_a_turn_that_odometry_has_wrong_is_found_where_things_are_far(off_deg: float) -> None:
    """Pillars 10 m away lie 0.8 m beside where they were expected: no slope leads there.

    The screen fits whatever the turn, and scans have fitted little better before.
    """
    local_map, matcher = (
        LocalMap(KeyframeConfig(), MatchingConfig()),
        LocalMatcher(MatchingConfig()),
    )
    local_map.add(seen_from(np.zeros(3)), Pose2())
    for fits in [0.5, 0.8, 0.6, 0.7] * 10:
        matcher.true_fit.learn(fits)
    expected = TRUE + np.array([0.0, 0.0, np.radians(off_deg)])
    prior = PosePrior(np.zeros(3), (Prediction(expected, VAGUE),), np.ones(3))
    places = matcher.candidates(seen_from(TRUE), local_map, prior, relocalise=False, single=True)
    away = between(TRUE, places[0].pose)
    assert np.hypot(away[0], away[1]) < 0.05
    assert abs(away[2]) < np.radians(0.3)


@pytest.mark.parametrize(("sd_deg", "is_found"), [(3.0, False), (6.0, True)])
def test_near_a_prediction_is_searched_as_far_as_it_is_uncertain(
    sd_deg: float, is_found: bool
) -> None:
    """The turn is off by 20 degrees: beyond four times three, within four times six."""
    local_map, matcher = (
        LocalMap(KeyframeConfig(), MatchingConfig()),
        LocalMatcher(MatchingConfig()),
    )
    local_map.add(seen_from(np.zeros(3)), Pose2())
    unsure = np.diag([0.05, 0.05, np.radians(sd_deg)]) ** 2
    expected = TRUE + np.array([0.0, 0.0, np.radians(20.0)])
    prior = PosePrior(np.zeros(3), (Prediction(expected, unsure),), np.ones(3))
    near = matcher._near_prediction(seen_from(TRUE), local_map, prior)
    away = [between(TRUE, place.pose) for place in near]
    assert any(abs(turn) < np.radians(0.3) for _, _, turn in away) == is_found


def test_where_fronts_are_alike_a_search_proves_nothing() -> None:
    """Three fronts stand 0.6 m behind each other; a new one halfway looks like any of them."""
    front = np.column_stack([np.linspace(-1.0, 2.0, 61), np.full(61, 2.0)])
    local_map = LocalMap(KeyframeConfig(), MatchingConfig())
    for aside_m in (-0.6, 0.0, 0.6):
        local_map.add(np.add(front, [0.0, aside_m]), Pose2())
    matcher = LocalMatcher(MatchingConfig())
    for _ in range(30):
        matcher.true_fit.learn(0.9)
    sure = Prediction(np.zeros(3), np.diag([0.07, 0.07, 0.02]) ** 2)
    prior = PosePrior(np.zeros(3), (sure,), np.ones(3))
    places = matcher.candidates(
        np.subtract(front, [0.0, 0.3]), local_map, prior, relocalise=False, single=True
    )
    assert places[0].inliers == 0, "the prediction is kept"
    assert any(place.inliers for place in places[1:]), "another front was found"


@pytest.mark.parametrize("count", [0, 1, 100, 159, 160, 239, 240, 1000, 1081])
def test_many_returns_are_searched_for_by_two_samples(count: int) -> None:
    """Each of every n-th return, halfway between those of the other; few are searched for whole."""
    points = np.arange(2.0 * count).reshape(count, 2)
    samples = _subsamples(points)
    if count < 160:
        assert len(samples) == 1
        np.testing.assert_array_equal(samples[0], points)
        return
    step = count // 80
    first, second = ([int(x) // 2 for x in sample[:, 0]] for sample in samples)
    assert first == list(range(0, count, step))
    assert second == list(range(step // 2, count, step))
    assert 80 <= len(first) < 160


def test_predictions_agree_as_far_as_both_are_uncertain() -> None:
    """Up to four standard deviations, chi squared of 3 at a thousandth."""
    sure = np.diag([0.03, 0.03, 0.03]) ** 2
    unsure = np.diag([0.04, 0.04, 0.04]) ** 2
    one = Prediction(np.array([0.5, 0.0, 3.1]), sure)
    for off, agree in [(0.0, True), (0.19, True), (0.21, False)]:
        aside = Prediction(np.array([0.5, off, 3.1]), unsure)
        turned = Prediction(np.array([0.5, 0.0, 3.1 + off - 2.0 * np.pi]), unsure)
        for other in (aside, turned):
            assert _agree((one, other)) == agree
            assert _agree((one, one, other)) == agree
            # All are held against the first.
            assert _agree((other, one)) == agree
    assert _agree((one,))
