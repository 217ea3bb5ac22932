# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The posterior of pose candidates."""

from __future__ import annotations

import numpy as np
import pytest

from slarm_graph.config import KeyframeConfig, MatchingConfig
from slarm_graph.frontends.scans.local_map import LocalMap
from slarm_graph.frontends.scans.odometry_filter import Prediction
from slarm_graph.frontends.scans.pose_candidates import PoseCandidate, PosePrior, with_posterior
from slarm_graph.frontends.scans.scan_fit import TrueMatchFit
from slarm_graph.geometry import Floats, Pose2

UNSURE_ALONG = np.diag([1.0 / 2.0**2, 1.0 / 0.01**2, 1.0 / 0.01**2])
"""Information of a match along a wall: 2 m along it, 1 cm across, 0.01 rad."""


def along_x(first_m: float, last_m: float) -> Floats:
    """Points (K, 2) of a wall 2 m to the left."""
    count = int((last_m - first_m) / 0.05) + 1
    return np.column_stack([np.linspace(first_m, last_m, count), np.full(count, 2.0)])


def posterior_of(wall: Floats, nothing_known: float = 0.01) -> float:
    """Of a place 1.5 m ahead, where odometry is sure to 1 cm that the robot has not moved."""
    local_map = LocalMap(KeyframeConfig(), MatchingConfig())
    local_map.add(wall, Pose2())
    true_fit = TrueMatchFit()
    for _ in range(30):
        true_fit.learn(0.9)
    sure = Prediction(np.zeros(3), np.diag([0.01, 0.01, 0.01]) ** 2)
    prior = PosePrior(np.zeros(3), (sure,), np.ones(3), nothing_known)
    place = PoseCandidate(np.array([1.5, 0.0, 0.0]), UNSURE_ALONG, 0.9, 60, 5)
    return with_posterior(place, along_x(-0.5, 0.5), local_map, prior, true_fit).log_posterior


def test_a_place_reaches_as_far_as_the_scan_fits() -> None:
    """Along a wall the match may be anywhere; of a board as long as the scan it is where it is."""
    anywhere, there_only = posterior_of(along_x(-4.0, 4.0)), posterior_of(along_x(1.0, 2.0))
    assert anywhere > -1.0
    assert there_only < anywhere - 10.0


def test_a_match_is_as_much_less_likely_as_nothing_is_likely_to_be_known() -> None:
    rare, usual = (posterior_of(along_x(-4.0, 4.0), nothing) for nothing in (0.0, 0.8))
    assert rare - usual == pytest.approx(-np.log(0.2))
