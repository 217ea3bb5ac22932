# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The local map that scans are matched against, and its keyframe criterion."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from slarm_graph.config import KeyframeConfig, MatchingConfig
from slarm_graph.frontends.scans.likelihood_grid import (
    LikelihoodGrid,
    add_segments,
    build_likelihood_grid,
    scan_segments,
)
from slarm_graph.frontends.scans.search_pyramid import SearchPyramid, build_pyramid
from slarm_graph.frontends.scans.small_pose import between3
from slarm_graph.geometry import Floats, Pose2, transform_points
from slarm_graph.kernels import kernel

_MARGIN_M = 4.0
"""Margin around the local map for further keyframes, so that it is seldom reallocated."""
_OBSERVED_BLOCK_M = 0.2
"""Side of the blocks of the observed space: a beam's width at 10 m and 1 degree."""
_LEVELS = 5
"""Of the pyramid: its largest blocks span 0.8 m of a grid of 0.05 m, about the least window."""


class LocalMap:
    """A likelihood grid of the last keyframes, between one and two windows of them.

    Keyframes are added in place; once there are two windows, the older one is dropped. So each
    keyframe is drawn about twice, however long the window.
    """

    def __init__(self, keyframes: KeyframeConfig, matching: MatchingConfig) -> None:
        self._rule = keyframes
        self._matching = matching
        self._segments: list[Floats] = []
        self._keyframes: list[tuple[Floats, Floats]] = []
        self._last_pose: Floats | None = None
        self._levels: SearchPyramid | None = None
        self.grid: LikelihoodGrid | None = None
        self.observed: NDArray[np.bool_] = np.zeros((0, 0), dtype=np.bool_)
        """Known space: blocks of `observed_step` x `observed_step` cells that a beam has passed."""
        self.observed_step = max(1, round(_OBSERVED_BLOCK_M / matching.resolution_m))

    def is_keyframe_due(self, local_from_robot: Pose2) -> bool:
        """Whether the robot has moved or turned enough for a new keyframe."""
        if self._last_pose is None:
            return True
        x, y, turn = between3(self._last_pose, local_from_robot.as_array()).tolist()
        return math.hypot(x, y) >= self._rule.distance_m or abs(turn) >= self._rule.angle_rad

    def latest_points(self, keyframes: int) -> Floats:
        """Return the points (M, 2) of the latest keyframes, one after the other [m]."""
        latest = self._keyframes[-keyframes:]
        return np.concatenate([transform_points(pose, points) for points, pose in latest])

    def levels(self) -> SearchPyramid:
        """Return the search pyramid of the grid, cached until the grid changes."""
        assert self.grid is not None
        if self._levels is None:
            self._levels = build_pyramid(self.grid, levels=_LEVELS)
        return self._levels

    def kept_state(self) -> dict[str, object]:
        """Leave out what can be rebuilt."""
        return {**self.__dict__, "_levels": None}

    def clear(self) -> None:
        """Drop all keyframes and the grid."""
        self._segments, self._keyframes = [], []
        self._last_pose = None
        self.grid = self._levels = None

    def add(self, points: Floats, local_from_robot: Pose2) -> None:
        """Add a keyframe: points (K, 2) [m] in the robot's frame."""
        self._last_pose, self._levels = local_from_robot.as_array(), None
        pose = self._last_pose
        segments = scan_segments(points, pose, self._matching.max_gap_m)
        self._segments.append(segments)
        self._keyframes.append((points, pose))
        if len(self._segments) >= 2 * self._rule.window:
            del self._segments[: self._rule.window], self._keyframes[: self._rule.window]
            self.grid = None
        if self.grid is None or not add_segments(self.grid, segments):
            self.grid = build_likelihood_grid(
                np.concatenate(self._segments),
                resolution_m=self._matching.resolution_m,
                sigma_m=self._matching.sigma_m,
                margin_m=_MARGIN_M,
            )
            shape = [-(-side // self.observed_step) for side in self.grid.values.shape]
            self.observed = np.zeros(shape, dtype=np.bool_)
            for keyframe in self._keyframes:
                self._mark_observed_by(*keyframe)
        else:
            self._mark_observed_by(points, pose)

    def _mark_observed_by(self, points: Floats, pose: Floats) -> None:
        assert self.grid is not None
        block_m = self.observed_step * self.grid.resolution_m
        corner = self.grid.origin_x_m, self.grid.origin_y_m
        _mark_observed(self.observed, points, pose, *corner, block_m)


@kernel
def _mark_observed(
    observed: NDArray[np.bool_],
    points: Floats,
    pose: Floats,
    corner_x: float,
    corner_y: float,
    block_m: float,
) -> None:
    """Mark the blocks that beams to points (K, 2) [m] pass, up to a block before the end."""
    rows, cols = observed.shape
    c, s = math.cos(pose[2]), math.sin(pose[2])
    start = pose[0] - corner_x, pose[1] - corner_y
    for i in range(len(points)):
        dx = pose[0] + c * points[i, 0] - s * points[i, 1] - corner_x - start[0]
        dy = pose[1] + s * points[i, 0] + c * points[i, 1] - corner_y - start[1]
        length = math.hypot(dx, dy)
        steps = math.floor(length / block_m - 1.0)
        for k in range(steps + 1):
            share = k * block_m / length
            col = math.floor((start[0] + share * dx) / block_m)
            row = math.floor((start[1] + share * dy) / block_m)
            if 0 <= row < rows and 0 <= col < cols:
                observed[row, col] = True
