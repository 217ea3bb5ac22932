# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Every matcher keeps the same promises."""

from __future__ import annotations

import numpy as np
import pytest
from test_scan_matching import room_points

from slarm_graph.frontends.scans.matcher import (
    CorrelativeMatcher,
    IcpMatcher,
    LikelihoodMatcher,
    ScanMatcher,
)
from slarm_graph.geometry import Floats, Pose2, wrap_angle

MATCHERS = {
    "likelihood": LikelihoodMatcher(),
    "correlative": CorrelativeMatcher(),
    "icp": IcpMatcher(),
}


@pytest.fixture(params=MATCHERS)
def matcher(request: pytest.FixtureRequest) -> ScanMatcher:
    return MATCHERS[request.param]


def error_of(found: Pose2, truth: Pose2) -> Floats:
    return truth.between(found).as_array()


def test_matches_a_noiseless_pair(matcher: ScanMatcher) -> None:
    target_pose, truth = Pose2(0.1, 0.0, 0.2), Pose2(0.25, -0.1, 0.1)
    found = matcher.match(
        room_points(target_pose @ truth, beams=360),
        room_points(target_pose, beams=360),
        target_from_source=truth @ Pose2(0.08, -0.06, 0.05),
    )
    assert found
    assert np.all(np.abs(error_of(found.target_from_source, truth)) < [0.01, 0.01, 0.005])
    assert found.inliers > 250
    assert found.score > 0.7


def test_errors_are_as_large_as_the_covariance_says(matcher: ScanMatcher) -> None:
    """NEES per degree of freedom over noisy pairs, the guess off by a few centimetres."""
    nees = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        target_pose = Pose2(*rng.uniform(-0.4, 0.4, 3))
        truth = Pose2(*rng.normal(0.0, [0.15, 0.15, 0.1]))
        found = matcher.match(
            room_points(target_pose @ truth, rng, beams=360),
            room_points(target_pose, rng, beams=360),
            target_from_source=truth @ Pose2(*rng.normal(0.0, [0.03, 0.03, 0.02])),
        )
        assert found
        error = error_of(found.target_from_source, truth)
        error[2] = wrap_angle(error[2])
        nees.append(error @ np.linalg.solve(found.covariance, error) / 3.0)
    assert 0.5 < np.mean(nees) < 2.0


@pytest.mark.parametrize("count", [0, 1, 5])
def test_too_few_returns_are_a_failure_with_a_reason(matcher: ScanMatcher, count: int) -> None:
    scan, guess = room_points(Pose2()), Pose2(0.1, 0.0, 0.0)
    for source, target in ((scan[:count], scan), (scan, scan[:count])):
        found = matcher.match(source, target, target_from_source=guess)
        assert not found
        assert "return" in found.reason
        assert found.target_from_source == guess


def test_scans_of_different_places_do_not_match(matcher: ScanMatcher) -> None:
    elsewhere = 40.0 + room_points(Pose2())
    found = matcher.match(elsewhere, room_points(Pose2()), target_from_source=Pose2())
    assert not found
    assert found.reason


def test_returns_that_are_not_finite_are_refused(matcher: ScanMatcher) -> None:
    broken = room_points(Pose2())
    broken[3] = np.nan
    assert "finite" in matcher.match(broken, broken, target_from_source=Pose2()).reason


def test_a_straight_wall_leaves_the_way_along_it_open() -> None:
    """The covariance is wide along the wall, narrow across it."""
    wall = np.stack([np.arange(-3.0, 3.0, 0.03), np.full(200, 1.0)], axis=-1)
    found = LikelihoodMatcher().match(wall, wall, target_from_source=Pose2(0.0, 0.02, 0.0))
    sigma = np.sqrt(np.diag(found.covariance))
    assert sigma[0] > 20.0 * sigma[1]
    assert abs(found.target_from_source.y) < 0.005


def test_the_search_comes_from_afar() -> None:
    truth = Pose2(0.6, -0.5, 0.5)
    matcher = CorrelativeMatcher()
    found = matcher.match(
        room_points(truth, beams=360), room_points(Pose2(), beams=360), target_from_source=Pose2()
    )
    assert found
    assert np.all(np.abs(error_of(found.target_from_source, truth)) < [0.02, 0.02, 0.01])
