# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Any scan matcher in the tracker: a scan against the latest keyframes, leaning on the prediction.

`frontend.matcher` names it. What it says of a scan is judged as the tracker's own answers are, on
the likelihood grid of the local map.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from slarm_graph import parts
from slarm_graph.config import FrontendConfig, Stage
from slarm_graph.frontends.scans.keyframes import LocalMap
from slarm_graph.frontends.scans.matcher import ScanMatcher
from slarm_graph.frontends.scans.odometry_filter import Prediction
from slarm_graph.frontends.scans.places import Place
from slarm_graph.frontends.scans.small_matrix import invert3
from slarm_graph.frontends.scans.small_pose import between3, compose3
from slarm_graph.geometry import Floats, Pose2

_ON_THE_GRID = "likelihood"
"""The matcher that the tracker is itself, on a grid of all its keyframes."""
_KEYFRAMES = 3
"""That a scan is matched against: of one only, what it did not see is missing; twice as many cost
twice the time and bring in the drift between them."""

Refinement = Callable[[Floats, Floats, Prediction, Floats, float], Place]
"""From points (K, 2) [m], the last pose (3,), the motion predicted since then, where to begin (3,),
else empty, and what share of the scan's evidence counts, to the place of the scan."""


def chosen_refinement(config: FrontendConfig, local_map: LocalMap) -> Refinement | None:
    """Build the refinement by the matcher that is chosen; None where it is the tracker's own.

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
    evidence: float,
) -> Place:
    expected = compose3(base, prediction.motion)
    begin = Pose2.from_array(start if len(start) else expected)
    target = local_map.latest_points(_KEYFRAMES)
    match = matcher.match(points, target, target_from_source=begin)
    if not match:
        return Place(expected, np.zeros((3, 3)), 0.0, 0, match.iterations)
    information = invert3(match.covariance)
    both = evidence * information + invert3(prediction.covariance)
    away = between3(expected, match.target_from_source.as_array())
    step = invert3(both) @ (evidence * information @ away)
    pose = compose3(expected, step)
    return Place(pose, information, match.score, match.inliers, match.iterations)
