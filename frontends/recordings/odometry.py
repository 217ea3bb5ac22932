# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The odometry of a recording as one path, and its value at a scan's stamp."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slarm_graph.frontends.recordings.clock import seconds
from slarm_graph.frontends.recordings.messages import StampedTransforms
from slarm_graph.frontends.recordings.packed import Ints
from slarm_graph.frontends.recordings.rotations import bracket, usable_quaternions, yaws
from slarm_graph.frontends.recordings.transforms import TransformTree
from slarm_graph.geometry import Floats, between, interpolate_poses

_STILL_M = 1e-6
_STILL_RAD = 1e-6
_LEAST_GAP_S = 0.5
_ANY_GAP_NS = np.iinfo(np.int64).max


@dataclass(frozen=True, slots=True)
class OdometryPath:
    """Poses `odom_from_robot` over time.

    Parameters
    ----------
    stamp_ns : (N,) int64, strictly increasing
    poses : (N, 3) [m, m, rad]
    """

    stamp_ns: Ints
    poses: Floats

    def __len__(self) -> int:
        return len(self.stamp_ns)

    def never_moves(self) -> bool:
        """Whether all poses are one and the same."""
        return len(self) > 1 and bool(np.all(np.ptp(self.poses, axis=0) == 0.0))

    def span(self) -> str:
        """First and last stamp, for people."""
        if not len(self):
            return "no poses"
        return f"{seconds(self.stamp_ns[0])} to {seconds(self.stamp_ns[-1])}"

    def usual_gap_s(self) -> float:
        """Longest silence that is nothing unusual [s].

        Five times the spacing that 95 % of the poses keep, and at least half a second: loggers
        that write two poses at once, then none for long, are not told off.
        """
        if len(self) < 2:
            return _LEAST_GAP_S
        return max(_LEAST_GAP_S, 5e-9 * float(np.quantile(np.diff(self.stamp_ns), 0.95)))

    def at(self, stamps_ns: Ints, max_gap_s: float) -> tuple[Floats, NDArray[np.bool_]]:
        """Interpolate at some stamps.

        A silence longer than `max_gap_s` is bridged only when the robot stood still over it;
        beyond the ends the path is held for as long as poses usually are apart.

        Returns
        -------
        poses : (M, 3)
        known : (M,) bool
        """
        if len(self) == 0 or len(stamps_ns) == 0:
            return np.zeros((len(stamps_ns), 3)), np.zeros(len(stamps_ns), bool)
        max_gap_ns = round(max_gap_s * 1e9)
        before, after, _, known = bracket(self.stamp_ns, stamps_ns, max_gap_ns)
        step = np.abs(between(self.poses[before], self.poses[after]))
        still = (step[:, :2] < _STILL_M).all(axis=1) & (step[:, 2] < _STILL_RAD)
        inside = (stamps_ns >= self.stamp_ns[0]) & (stamps_ns <= self.stamp_ns[-1])
        if len(self) == 1:
            known = np.abs(stamps_ns - self.stamp_ns[0]) <= max_gap_ns
        poses = interpolate_poses(self.stamp_ns, self.poses, stamps_ns)
        return poses, known | (still & inside)


def path_from_messages(
    messages: StampedTransforms, *, use_record_time: bool = False
) -> tuple[OdometryPath, int]:
    """Build the path of an odometry topic; also return how many poses were unusable."""
    usable, quaternions = usable_quaternions(messages.quaternions)
    usable &= np.isfinite(messages.translations_m).all(axis=1)
    poses = np.column_stack([messages.translations_m[:, :2], yaws(quaternions)])[usable]
    stamps = (messages.record_ns if use_record_time else messages.stamp_ns)[usable]
    return sorted_path(stamps, poses), int(np.count_nonzero(~usable))


def path_from_tree(tree: TransformTree, odom: str, robot: str) -> OdometryPath:
    """Build the path from tf, one pose per update of any transform between the two frames."""
    edges = tree.changing(odom, robot)
    if not edges:
        return OdometryPath(np.zeros(0, np.int64), np.zeros((0, 3)))
    stamps = np.unique(np.concatenate([edge.stamp_ns for edge in edges]))
    rotations, places, known = tree.lookup(odom, robot, stamps, _ANY_GAP_NS)
    headings = np.arctan2(rotations[:, 1, 0], rotations[:, 0, 0])
    return sorted_path(stamps[known], np.column_stack([places[:, :2], headings])[known])


def sorted_path(stamps: Ints, poses: Floats) -> OdometryPath:
    """Sort poses (N, 3) by stamp (N,) [ns]; of equal stamps the first stays."""
    unique, first = np.unique(stamps, return_index=True)
    return OdometryPath(unique, poses[first])
