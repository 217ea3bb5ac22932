# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The odometry of a recording as a path, interpolated at the scans' stamps."""

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

_STILL = 1e-6
"""Poses that differ by less [m, rad] are equal up to rounding to six decimals."""
_LEAST_GAP_S = 0.5
"""Shorter gaps are always usual: odometry has at least 2 Hz."""
_ANY_GAP_NS = np.iinfo(np.int64).max
FARTHEST_M = 1e7
"""Limit of plausible coordinates [m], those of UTM."""
FASTEST_M_S = 50.0
"""No robot on wheels is faster: poses that imply it, and return a moment later, are outliers. At
half as much, cars that carry lidars would lose poses."""
LONGEST_EXCURSION = 10
"""Most consecutive outliers; a path that stays away longer was reset."""
_LEAST_STEP_S = 0.02
"""Least duration of a step for its speed, as poses may be stamped in bunches."""


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
        """Whether all poses are equal."""
        return len(self) > 1 and bool(np.all(np.ptp(self.poses, axis=0) == 0.0))

    def span(self) -> str:
        """Format the first and last stamp."""
        if not len(self):
            return "no poses"
        return f"{seconds(self.stamp_ns[0])} to {seconds(self.stamp_ns[-1])}"

    def usual_gap_s(self) -> float:
        """Return the longest usual gap between poses [s].

        Five times the 95th percentile of the spacing, and at least half a second: some loggers
        write two poses at once, then none for long.
        """
        if len(self) < 2:
            return _LEAST_GAP_S
        return max(_LEAST_GAP_S, 5e-9 * float(np.quantile(np.diff(self.stamp_ns), 0.95)))

    def at(self, stamps_ns: Ints, max_gap_s: float) -> tuple[Floats, NDArray[np.bool_]]:
        """Interpolate at stamps (M,).

        A gap longer than `max_gap_s` is bridged only when the robot stood still over it;
        beyond the ends the last pose holds for as long as poses usually are apart.

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
        still = (step < _STILL).all(axis=1)
        inside = (stamps_ns >= self.stamp_ns[0]) & (stamps_ns <= self.stamp_ns[-1])
        if len(self) == 1:
            known = np.abs(stamps_ns - self.stamp_ns[0]) <= max_gap_ns
        poses = interpolate_poses(self.stamp_ns, self.poses, stamps_ns)
        return poses, known | (still & inside)


def path_from_messages(
    messages: StampedTransforms, *, use_record_time: bool = False
) -> tuple[OdometryPath, NDArray[np.bool_]]:
    """Build the path of an odometry topic; also return which messages (N,) were not usable."""
    usable, quaternions = usable_quaternions(messages.quaternions)
    usable &= places(messages.translations_m)
    stamps = messages.record_ns if use_record_time else messages.stamp_ns
    rows = np.flatnonzero(usable)
    poses = np.column_stack([messages.translations_m[rows, :2], yaws(quaternions[rows])])
    order = np.argsort(stamps[rows], kind="stable")
    usable[rows[order[outliers(stamps[rows][order], poses[order])]]] = False
    kept = usable[rows]
    return sorted_path(stamps[rows][kept], poses[kept]), ~usable


def places(translations_m: Floats) -> NDArray[np.bool_]:
    """Return which translations (N, 2 or 3) are finite and within `FARTHEST_M`."""
    with np.errstate(invalid="ignore"):
        return np.asarray((np.abs(translations_m) <= FARTHEST_M).all(axis=1))


def outliers(stamps_ns: Ints, poses: Floats) -> NDArray[np.bool_]:
    """Return which poses (N, 3), in order of time, are outliers: too far to reach, for a moment.

    A path that does not return within a few poses was reset, and is kept as it is.
    """
    away = np.zeros(len(poses), np.bool_)
    if len(poses) < 3 or not _too_fast(stamps_ns[:-1], poses[:-1], stamps_ns[1:], poses[1:]).any():
        return away
    good, row = 0, 1
    if (
        _too_fast(stamps_ns[:1], poses[:1], stamps_ns[1:2], poses[1:2])[0]
        and not (_too_fast(stamps_ns[1:2], poses[1:2], stamps_ns[2:3], poses[2:3])[0])
    ):
        away[0], good, row = True, 1, 2  # the first one is the odd one out
    while row < len(poses):
        ahead = slice(row, row + LONGEST_EXCURSION + 1)
        near = ~_too_fast(stamps_ns[good], poses[good], stamps_ns[ahead], poses[ahead])
        back = int(np.argmax(near)) if near.any() else 0
        away[row : row + back] = True
        good = row + back
        row = good + 1
    return away


def _too_fast(
    from_ns: Ints, from_poses: Floats, to_ns: Ints, to_poses: Floats
) -> NDArray[np.bool_]:
    step_m = np.linalg.norm(to_poses[..., :2] - from_poses[..., :2], axis=-1)
    return np.asarray(step_m > FASTEST_M_S * np.maximum((to_ns - from_ns) * 1e-9, _LEAST_STEP_S))


def path_from_tree(tree: TransformTree, odom: str, robot: str) -> OdometryPath:
    """Build the path from tf, one pose per update of any transform between the two frames."""
    edges = tree.changing(odom, robot)
    if not edges:
        return OdometryPath(np.zeros(0, np.int64), np.zeros((0, 3)))
    stamps = np.unique(np.concatenate([edge.stamp_ns for edge in edges]))
    rotations, at_m, known = tree.lookup(odom, robot, stamps, _ANY_GAP_NS)
    headings = np.arctan2(rotations[:, 1, 0], rotations[:, 0, 0])
    return sorted_path(stamps[known], np.column_stack([at_m[:, :2], headings])[known])


def sorted_path(stamps: Ints, poses: Floats) -> OdometryPath:
    """Sort poses (N, 3) by stamp (N,) [ns]; of equal stamps the first stays, and no excursion."""
    unique, first = np.unique(stamps, return_index=True)
    sorted_poses = poses[first]
    kept = places(sorted_poses[:, :2])
    unique, sorted_poses = unique[kept], sorted_poses[kept]
    kept = ~outliers(unique, sorted_poses)
    return OdometryPath(unique[kept], sorted_poses[kept])
