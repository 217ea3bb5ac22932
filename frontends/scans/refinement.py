# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Adapter of any scan matcher to the tracker: scan to latest keyframes, fused with the prediction.

`frontend.matcher` names it. Its results get posteriors as the tracker's own do, by the likelihood
grid of the local map.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from slarm_graph import parts
from slarm_graph.config import FrontendConfig, Stage
from slarm_graph.frontends.scans.local_map import LocalMap
from slarm_graph.frontends.scans.matcher import ScanMatcher
from slarm_graph.frontends.scans.odometry_filter import Prediction
from slarm_graph.frontends.scans.pose_candidates import PoseCandidate
from slarm_graph.frontends.scans.small_matrix import invert3
from slarm_graph.frontends.scans.small_pose import between3, compose3
from slarm_graph.geometry import Floats, Pose2

_ON_THE_GRID = "likelihood"
"""Name of the tracker's own matcher, on a grid of all its keyframes."""
_KEYFRAMES = 3
"""Keyframes that a scan is matched against: with one only, what it did not see is missing; twice as
many cost twice the time and add the drift between them."""

Refinement = Callable[[Floats, Floats, Prediction, Floats, float], PoseCandidate]
"""From points (K, 2) [m], the last pose (3,), the motion predicted since then, an initial guess
(3,) or an empty array, and the effective share of the points, to a candidate pose of the scan."""


def chosen_refinement(config: FrontendConfig, local_map: LocalMap) -> Refinement | None:
    """Build the refinement by the configured matcher; None where it is the tracker's own.

    Raises
    ------
    BadInput
        When there is no such matcher, or something it needs is not installed.
    """
    if config.matcher == _ON_THE_GRID:
        return None
    part = parts.load("matcher", config.matcher)
    settings = config.matcher_settings() or getattr(part, "settings", Stage)()
    return partial(_refined, part(settings, config.matching), local_map)


def _refined(
    matcher: ScanMatcher,
    local_map: LocalMap,
    points: Floats,
    base: Floats,
    prediction: Prediction,
    start: Floats,
    effective_share: float,
) -> PoseCandidate:
    expected = compose3(base, prediction.motion)
    guess = Pose2.from_array(start if len(start) else expected)
    target = local_map.latest_points(_KEYFRAMES)
    match = matcher.match(points, target, target_from_source=guess)
    if not match:
        return PoseCandidate(expected, np.zeros((3, 3)), 0.0, 0, match.iterations)
    information = invert3(match.covariance)
    total = effective_share * information + invert3(prediction.covariance)
    residual = between3(expected, match.target_from_source.as_array())
    step = invert3(total) @ (effective_share * information @ residual)
    pose = compose3(expected, step)
    return PoseCandidate(pose, information, match.score, match.inliers, match.iterations)
