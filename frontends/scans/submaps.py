# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Keyframes, and the likelihood grids of runs of them that other scans are matched against."""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from operator import attrgetter
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from slarm_graph.config import MatchingConfig
from slarm_graph.frontends.scans.likelihood_grid import (
    LikelihoodGrid,
    build_likelihood_grid,
    scan_segments,
)
from slarm_graph.frontends.scans.wheel_motion import WheelMotion
from slarm_graph.geometry import Floats, Pose2, between, transform_points
from slarm_graph.kernels import kernel

Prepared = TypeVar("Prepared")

FINE_GRIDS = 24
"""Submaps or regions cached: the result is the same with any number. Half of them are rebuilt in 2
to 10 % more cases, double in 10 to 25 % fewer."""
_VIEW_RANGE_M = 8.0
"""Range of the returns that a view center is the mean of: a room or two."""


@dataclass(frozen=True, slots=True)
class Keyframe:
    """A scan that is a node of the pose graph.

    Parameters
    ----------
    scan : int
        Index among all scans.
    points_m : (K, 2) float64
        Returns in the robot's frame [m].
    local_from_robot : Pose2
        From the tracker.
    covariance : (3, 3) float64
        Of the motion since the keyframe before, in this keyframe's body frame.
    view_center_m : (2,) float64
        Mean of its near returns, in the robot's frame [m].
    wheels : WheelMotion or None
        Motion since the keyframe before by odometry alone; None where there is none.
    lag_covariance : (3, 3) float64
        Of the motion from odometry's stamp to that at which the points were matched.
    is_matched : bool
        Whether its scan was matched; else its pose is by odometry, or by constant velocity.
    clear_ends_m : (M, 2) float64
        How far the beams reach that have met nothing, in the robot's frame [m].
    """

    scan: int
    points_m: Floats
    local_from_robot: Pose2
    covariance: Floats
    view_center_m: Floats
    wheels: WheelMotion | None = None
    lag_covariance: Floats = field(default_factory=lambda: np.zeros((3, 3)))
    is_matched: bool = True
    clear_ends_m: Floats = field(default_factory=lambda: np.zeros((0, 2)))


def view_center(points: Floats) -> Floats:
    """Mean (2,) [m] of the points (K, 2) within 8 m; the robot itself where there are none."""
    near = points[np.hypot(points[:, 0], points[:, 1]) < _VIEW_RANGE_M]
    return np.asarray(near.mean(axis=0)) if len(near) else np.zeros(2)


@dataclass(frozen=True, slots=True)
class Submap:
    """A run of keyframes held rigid, in the frame of one of them.

    Parameters
    ----------
    first, last : int
        Keyframes first <= k < last.
    anchor : int
        Keyframe whose robot frame is the submap's frame.
    center_m : (2,) float64
        Mean of its keyframes' view centers, in the anchor's frame [m].
    """

    first: int
    last: int
    anchor: int
    center_m: Floats


def make_submap(keyframes: Sequence[Keyframe], first: int, last: int, anchor: int) -> Submap:
    """Describe the run of keyframes first <= k < last."""
    members = keyframes[first:last]
    poses = np.array([m.local_from_robot.as_array() for m in members])
    relative = between(keyframes[anchor].local_from_robot.as_array(), poses)
    centers = np.array(
        [transform_points(p, m.view_center_m) for p, m in zip(relative, members, strict=True)]
    )
    return Submap(first, last, anchor, centers.mean(axis=0))


def likelihood_of(
    points: Sequence[Floats], poses: Floats, matching: MatchingConfig
) -> LikelihoodGrid:
    """Likelihood grid of scans (each (K, 2) [m] in the robot's frame) at poses (M, 3)."""
    segments = _segments(*_flat(points), poses, matching.max_gap_m)
    return build_likelihood_grid(
        segments, resolution_m=matching.resolution_m, sigma_m=matching.sigma_m
    )


def joined_returns(points: Sequence[Floats], poses: Floats) -> Floats:
    """All returns (K, 2) of scans (each (K, 2) [m] in its robot's frame) at poses (M, 3) [m]."""
    return np.asarray(_joined(*_flat(points), poses))


def _flat(points: Sequence[Floats]) -> tuple[Floats, NDArray[np.int64]]:
    """Concatenated scans (K, 2), and the offsets of each and of the end."""
    return np.concatenate(points), np.cumsum([0, *(len(p) for p in points)])


class SubmapCache(Generic[Prepared]):
    """Least-recently-used cache of what is built of submaps for matching.

    Parameters
    ----------
    capacity : int
    prepare : callable
        Builds it from what is read of a submap's keyframes and their poses (M, 3).
    read : callable
        By default the returns (K, 2) of a keyframe [m].
    """

    def __init__(
        self,
        capacity: int,
        prepare: Callable[[Sequence[Any], Floats], Prepared],
        read: Callable[[Keyframe], Any] = attrgetter("points_m"),
    ) -> None:
        self._capacity = capacity
        self._prepare, self._read = prepare, read
        self._kept: OrderedDict[tuple[int, int, int], Prepared] = OrderedDict()

    def kept_state(self) -> dict[str, object]:
        """Leave out what can be rebuilt."""
        return {**self.__dict__, "_kept": OrderedDict()}

    def clear(self) -> None:
        """Empty the cache."""
        self._kept.clear()

    def of(self, submap: Submap, keyframes: Sequence[Keyframe]) -> Prepared:
        """Return what is built of a submap, in its anchor's frame."""
        key = (submap.first, submap.last, submap.anchor)
        prepared = self._kept.pop(key, None)
        if prepared is None:
            members = keyframes[submap.first : submap.last]
            anchor = keyframes[submap.anchor].local_from_robot.as_array()
            poses = between(anchor, np.array([m.local_from_robot.as_array() for m in members]))
            prepared = self._prepare([self._read(m) for m in members], poses)
        self._kept[key] = prepared
        while len(self._kept) > self._capacity:
            self._kept.popitem(last=False)
        return prepared


@kernel
def _segments(points: Floats, offsets: NDArray[np.int64], poses: Floats, max_gap: float) -> Floats:
    """Segments (S, 4) of all scans in the common frame."""
    out = np.empty((len(points), 4))
    count = 0
    for k in range(len(poses)):
        part = scan_segments(points[offsets[k] : offsets[k + 1]], poses[k], max_gap)
        for i in range(len(part)):
            for end in range(4):
                out[count, end] = part[i, end]
            count += 1
    return out[:count]


@kernel
def _joined(points: Floats, offsets: NDArray[np.int64], poses: Floats) -> Floats:
    """Points (K, 2) of all scans in the common frame."""
    out = np.empty_like(points)
    for k in range(len(poses)):
        c, s = math.cos(poses[k, 2]), math.sin(poses[k, 2])
        for i in range(offsets[k], offsets[k + 1]):
            out[i, 0] = poses[k, 0] + c * points[i, 0] - s * points[i, 1]
            out[i, 1] = poses[k, 1] + s * points[i, 0] + c * points[i, 1]
    return out
