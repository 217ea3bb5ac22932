# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The local map that scans are matched against, and its keyframe criterion."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slarm_graph.config import KeyframeConfig, MatchingConfig
from slarm_graph.frontends.scans.likelihood_grid import (
    LikelihoodGrid,
    add_segments,
    build_likelihood_grid,
    scan_segments,
)
from slarm_graph.frontends.scans.moving_objects import NO_TRAILS, trail_cells
from slarm_graph.frontends.scans.moving_returns import (
    FARTHEST_M,
    LOOKS_NOWHERE,
    ClearSectors,
    seen_through,
)
from slarm_graph.frontends.scans.search_pyramid import SearchPyramid, build_pyramid
from slarm_graph.frontends.scans.small_objects import is_wide
from slarm_graph.frontends.scans.small_pose import between3
from slarm_graph.geometry import Floats, Pose2, transform_points
from slarm_graph.kernels import kernel

_MARGIN_M = 4.0
"""Margin around the local map for further keyframes, so that it is seldom reallocated."""
_OBSERVED_BLOCK_M = 0.2
"""Side of the blocks of the observed space: a beam's width at 10 m and 1 degree."""
_LEVELS = 5
"""Of the pyramid: its largest blocks span 0.8 m of a grid of 0.05 m, about the least window."""

_AGES = (1, 2, 4, 8, 16, 32)
"""Keyframes back that a new one is compared with, for what has come and what has gone: with every
keyframe a few times, half a metre later and more. All 80 leave halls 34, 40, 103 and 124 at 0.053
0.163 0.061 0.043 m in place of 0.038 0.093 0.052 0.045, and take a third more time for a
whole recording."""


@dataclass(frozen=True, slots=True)
class _MapKeyframe:
    """A scan of the local map.

    Parameters
    ----------
    points : (K, 2) float64
        In the robot's frame [m].
    pose : (3,) float64
    clear : ClearSectors
    is_small : (K,) bool
        Which of the points belong to objects that may move.
    small : (M, 2) float64
        These, in the local map [m].
    gone : (K,) bool
        Which of them another keyframe has looked through.
    stays : (K,) bool
        Which of them are in the grid: neither these nor others of an object that moves.
    segments : (S, 4) float64
        Pieces of wall of those that stay [m].
    """

    points: Floats
    pose: Floats
    clear: ClearSectors
    is_small: NDArray[np.bool_]
    small: Floats
    gone: NDArray[np.bool_]
    stays: NDArray[np.bool_]
    segments: Floats


class LocalMap:
    """A likelihood grid of the last keyframes, between one and two windows of them.

    Keyframes are added in place; once there are two windows, the older one is dropped. So each
    keyframe is drawn about twice, however long the window; and once more with every keyframe that
    shows that something has come or gone, which is taken out.
    """

    def __init__(self, keyframes: KeyframeConfig, matching: MatchingConfig) -> None:
        self._rule = keyframes
        self._matching = matching
        self._keyframes: list[_MapKeyframe] = []
        self._last_pose: Floats | None = None
        self._levels: SearchPyramid | None = None
        self._trails = NO_TRAILS
        self.grid: LikelihoodGrid | None = None
        self.observed: NDArray[np.bool_] = np.zeros((0, 0), dtype=np.bool_)
        """Known space: blocks of `observed_step` x `observed_step` cells that a beam has passed."""
        self.met: NDArray[np.int32] = np.zeros((0, 0), dtype=np.int32)
        """Number of keyframes that have met something in each of these blocks."""
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
        return np.concatenate([transform_points(k.pose, k.points[k.stays]) for k in latest])

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
        self._keyframes, self._last_pose, self._trails = [], None, NO_TRAILS
        self.grid = self._levels = None

    def add(
        self, points: Floats, local_from_robot: Pose2, clear: ClearSectors = LOOKS_NOWHERE
    ) -> None:
        """Add a keyframe; what has come or gone since the others is in the grid no longer.

        Parameters
        ----------
        points : (K, 2) float64
            In the robot's frame [m].
        local_from_robot : Pose2
        clear : ClearSectors
            How far its scan looks.
        """
        pose = local_from_robot.as_array()
        self._last_pose, self._levels = pose, None
        for k, before in self._earlier():
            gone = before.gone | _gone(
                before.points, before.is_small, between3(pose, before.pose), clear
            )
            self._keyframes[k] = replace(before, gone=gone)
        self._keyframes.append(self._keyframe(points, pose, clear))
        if self._take_out_moving():
            self.grid = None
        keyframe = self._keyframes[-1]
        if len(self._keyframes) >= 2 * self._rule.window:
            del self._keyframes[: self._rule.window]
            self.grid = None
        if self.grid is None or not add_segments(self.grid, keyframe.segments):
            self.grid = build_likelihood_grid(
                np.concatenate([k.segments for k in self._keyframes]),
                resolution_m=self._matching.resolution_m,
                sigma_m=self._matching.sigma_m,
                margin_m=_MARGIN_M,
            )
            shape = [-(-side // self.observed_step) for side in self.grid.values.shape]
            self.observed, self.met = np.zeros(shape, np.bool_), np.zeros(shape, np.int32)
            for each in self._keyframes:
                self._mark_observed_by(each)
        else:
            self._mark_observed_by(keyframe)

    def static(self, points: Floats, pose: Floats, within_m: float) -> Floats:
        """Return points without the small objects that have come since earlier keyframes.

        Parameters
        ----------
        points : (K, 2) float64
            Of a robot at `pose`, in its frame and in beam order [m].
        pose : (3,) float64
        within_m : float
            Range up to which the pose is sure enough.
        """
        is_small, came = ~is_wide(points), np.zeros(len(points), dtype=np.bool_)
        small = points[is_small]
        for _, keyframe in self._earlier():
            seen = between3(keyframe.pose, pose), keyframe.clear.laser, keyframe.clear.ranges_m
            came[is_small] |= seen_through(small, *seen, within_m)
        if self._trails is not NO_TRAILS:
            near = np.hypot(small[:, 0], small[:, 1]) < within_m
            came[is_small] |= near & self._trails.contain(transform_points(pose, small))
        return points[~came] if came.any() else points

    def _earlier(self) -> list[tuple[int, _MapKeyframe]]:
        """Return the keyframes that a new one is compared with, and their indices."""
        return [(-age, self._keyframes[-age]) for age in _AGES if age <= len(self._keyframes)]

    def _keyframe(self, points: Floats, pose: Floats, clear: ClearSectors) -> _MapKeyframe:
        """Make a keyframe of all returns; which of them others have looked through is marked."""
        is_small, gone = ~is_wide(points), np.zeros(len(points), dtype=np.bool_)
        for _, before in self._earlier():
            gone |= _gone(points, is_small, between3(before.pose, pose), before.clear)
        small = transform_points(pose, points[is_small])
        segments = scan_segments(points, pose, self._matching.max_gap_m)
        every = np.ones_like(gone)
        return _MapKeyframe(points, pose, clear, is_small, small, gone, every, segments)

    def _take_out_moving(self) -> bool:
        """Take what moves out of the last keyframes; whether any but the newest has changed.

        Where hardly anything would stay of one, the poses are wrong, or only people were seen;
        either way it is all there is.
        """
        first, newest = max(0, len(self._keyframes) - max(_AGES) - 1), len(self._keyframes) - 1
        recent, changed = self._keyframes[first:], False
        small = np.concatenate([k.small for k in recent])
        self._trails = trail_cells(small, np.concatenate([k.gone[k.is_small] for k in recent]))
        ends = np.cumsum([len(k.small) for k in recent])
        on_trails = np.split(self._trails.contain(small), ends[:-1])
        for k, (keyframe, on_trail) in enumerate(zip(recent, on_trails, strict=True), first):
            if not (on_trail.any() or keyframe.gone.any()):
                continue
            stays = keyframe.stays & ~keyframe.gone
            stays[keyframe.is_small] &= ~on_trail
            if self._matching.min_points <= stays.sum() < keyframe.stays.sum():
                self._keyframes[k] = self._with_static(keyframe, stays)
                changed |= k < newest
        return changed

    def _with_static(self, keyframe: _MapKeyframe, stays: NDArray[np.bool_]) -> _MapKeyframe:
        static = keyframe.points[stays]
        segments = scan_segments(static, keyframe.pose, self._matching.max_gap_m)
        return replace(keyframe, stays=stays, segments=segments)

    def _mark_observed_by(self, keyframe: _MapKeyframe) -> None:
        assert self.grid is not None
        block_m = self.observed_step * self.grid.resolution_m
        corner = self.grid.origin_x_m, self.grid.origin_y_m
        _mark_observed(self.observed, keyframe.points, keyframe.pose, *corner, block_m)
        _count_met(self.met, keyframe.points[keyframe.stays], keyframe.pose, *corner, block_m)


def _gone(
    points: Floats, is_small: NDArray[np.bool_], seen_from: Floats, clear: ClearSectors
) -> NDArray[np.bool_]:
    """Which points (K, 2) a scan looks through; only small things where beams do not return.

    These may be sent towards glass, or into the sun.
    """
    gone = seen_through(points, seen_from, clear.laser, clear.returned_m, FARTHEST_M)
    small = points[is_small]
    gone[is_small] |= seen_through(small, seen_from, clear.laser, clear.ranges_m, FARTHEST_M)
    return gone


@kernel
def _count_met(
    met: NDArray[np.int32],
    points: Floats,
    pose: Floats,
    corner_x: float,
    corner_y: float,
    block_m: float,
) -> None:
    """Count one more keyframe for the blocks that its points (K, 2) [m] lie in."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for is_first in (True, False):
        for i in range(len(points)):
            x = pose[0] + c * points[i, 0] - s * points[i, 1] - corner_x
            y = pose[1] + s * points[i, 0] + c * points[i, 1] - corner_y
            col, row = math.floor(x / block_m), math.floor(y / block_m)
            if not (0 <= row < met.shape[0] and 0 <= col < met.shape[1]):
                continue
            # A negative number has been counted already.
            if is_first and met[row, col] >= 0:
                met[row, col] = -met[row, col] - 1
            elif not is_first and met[row, col] < 0:
                met[row, col] = -met[row, col]


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
