# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Which scans make the local map, and the local map itself."""

from __future__ import annotations

import math

import numpy as np

from slarm_graph.config import KeyframeConfig, MatchingConfig
from slarm_graph.frontends.scans.likelihood_grid import (
    LikelihoodGrid,
    add_segments,
    build_likelihood_grid,
    scan_segments,
)
from slarm_graph.geometry import Floats, Pose2

_MARGIN_M = 4.0


class LocalMap:
    """A likelihood grid of the last keyframes, between one and two windows of them.

    Keyframes are added in place; once there are two windows, the older one is dropped. So each
    keyframe is drawn about twice, however long the window.
    """

    def __init__(self, keyframes: KeyframeConfig, matching: MatchingConfig) -> None:
        self._rule = keyframes
        self._matching = matching
        self._segments: list[Floats] = []
        self._last_pose: Pose2 | None = None
        self.grid: LikelihoodGrid | None = None

    def wants(self, local_from_robot: Pose2) -> bool:
        """Whether the robot has moved on enough for a new keyframe."""
        if self._last_pose is None:
            return True
        moved = self._last_pose.between(local_from_robot)
        distance = math.hypot(moved.x, moved.y)
        return distance >= self._rule.distance_m or abs(moved.theta) >= self._rule.angle_rad

    def clear(self) -> None:
        """Forget everything."""
        self._segments = []
        self._last_pose = None
        self.grid = None

    def add(self, points: Floats, local_from_robot: Pose2) -> None:
        """Draw a keyframe's points (K, 2) [m] of the robot's frame."""
        self._last_pose = local_from_robot
        pose = local_from_robot.as_array()
        segments = scan_segments(points, pose, self._matching.max_gap_m)
        self._segments.append(segments)
        if len(self._segments) >= 2 * self._rule.window:
            del self._segments[: self._rule.window]
            self.grid = None
        if self.grid is None or not add_segments(self.grid, segments):
            self.grid = build_likelihood_grid(
                np.concatenate(self._segments),
                resolution_m=self._matching.resolution_m,
                sigma_m=self._matching.sigma_m,
                margin_m=_MARGIN_M,
            )
