# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Visits: stretches of a few metres of a trajectory, each with its view in its own frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from slarm_graph.consistency.views import View, clear_beams, view_of
from slarm_graph.geometry import Floats, between, compose, transform_points
from slarm_graph.kernels import kernel
from slarm_graph.readings import LaserScan

THIN_M, THIN_RAD = 0.1, 0.1
"""Motion between used scans [m, rad]: a cell, or what a cell subtends at a metre. Twice as far
leaves single beams beyond 5 m."""

VISIT_M = 5.0
"""Path length of a visit [m]: odometry or matching err by less than the tolerance over it. Half of
it leaves less evidence to a pair, twice hides errors inside and blurs their place."""

VISIT_SCANS = 8
"""Scans that a visit has at least, where they are metres apart."""


@dataclass(frozen=True, slots=True)
class Visits:
    """K stretches of a trajectory and their views, packed.

    Parameters
    ----------
    poses : (K, 3) float64
        `map_from_visit` [m, m, rad]: pose of each stretch's middle scan.
    scans : (K, 2) int64
        Index of the first and the last scan of each.
    path_m : (K, 2) float64
        Path length up to each stretch's first scan, and its last [m].
    walls : (W, 2) float64
        Walls of all visits, each in its visit's frame [m].
    wall_start : (K + 1,) int64
        Where each visit's walls begin, and their end.
    states : (C,) uint8
        States of the cells of all visits, row by row.
    state_start : (K + 1,) int64
        Where each visit's cells begin, and their end.
    lows : (K, 2) float64
        Corner of each visit's first cell, in its frame [m].
    shapes : (K, 2) int64
        Rows and columns of each visit's cells.
    """

    poses: Floats
    scans: NDArray[np.int64]
    path_m: Floats
    walls: Floats
    wall_start: NDArray[np.int64]
    states: NDArray[np.uint8]
    state_start: NDArray[np.int64]
    lows: Floats
    shapes: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.poses)

    def at(self, trajectory: Floats) -> Visits:
        """Return the same visits, each moved rigidly, at the poses of another trajectory (N, 3).

        Equal to building them anew while no visit is bent, and a thousand times as fast.
        """
        return replace(self, poses=trajectory[(self.scans[:, 0] + self.scans[:, 1]) // 2])


def build_visits(scans: Sequence[LaserScan], poses: Floats, visit_m: float = VISIT_M) -> Visits:
    """Split a trajectory into visits and build their views.

    Parameters
    ----------
    scans : sequence of N LaserScan
    poses : (N, 3) float64
        `map_from_robot` at each scan [m, m, rad].
    visit_m : float
        Least path length of a visit [m].
    """
    kept, path_m = thinned_by_motion(poses), path_lengths_m(poses)
    firsts = _first_scans(path_m[kept], visit_m)
    parts = [kept[a:b] for a, b in pairwise(firsts)]
    return pack_visits(scans, poses, path_m, parts)


def pack_visits(
    scans: Sequence[LaserScan], poses: Floats, path_m: Floats, parts: Sequence[NDArray[np.int64]]
) -> Visits:
    """Build a visit of each list of scans; empty ones are left out."""
    viewed = [(part, _view_at(scans, poses, part)) for part in parts]
    viewed = [(part, view) for part, view in viewed if view.states.size]
    views = [view for _, view in viewed]
    ends = np.array([(part[0], part[-1]) for part, _ in viewed], dtype=np.int64).reshape(-1, 2)
    return Visits(
        poses=poses[ends.sum(axis=1) // 2],
        scans=ends,
        path_m=path_m[ends],
        walls=np.concatenate([np.zeros((0, 2)), *(v.walls for v in views)]),
        wall_start=_starts([len(v.walls) for v in views]),
        states=np.concatenate([np.zeros(0, np.uint8), *(v.states.ravel() for v in views)]),
        state_start=_starts([v.states.size for v in views]),
        lows=np.array([v.low for v in views]).reshape(-1, 2),
        shapes=np.array([v.states.shape for v in views], dtype=np.int64).reshape(-1, 2),
    )


@kernel
def _moved_enough(poses: Floats, least_m: float, least_rad: float) -> NDArray[np.int64]:
    kept = np.empty(len(poses), dtype=np.int64)
    kept[0] = 0
    count = 1
    for i in range(1, len(poses)):
        last = poses[kept[count - 1]]
        turn = abs((poses[i, 2] - last[2] + np.pi) % (2.0 * np.pi) - np.pi)
        distance = np.hypot(poses[i, 0] - last[0], poses[i, 1] - last[1])
        if distance >= least_m or turn >= least_rad:
            kept[count] = i
            count += 1
    return kept[:count]


def thinned_by_motion(
    poses: Floats, least_m: float = THIN_M, least_rad: float = THIN_RAD
) -> NDArray[np.int64]:
    """Return the scans selected by a motion filter [m, rad]."""
    return np.asarray(_moved_enough(poses, least_m, least_rad)) if len(poses) else np.arange(0)


def path_lengths_m(poses: Floats) -> Floats:
    """Return the path length up to each pose (N,) [m]."""
    steps_m = np.hypot(*np.diff(poses[:, :2], axis=0).T)
    return np.asarray(np.r_[0.0, np.cumsum(steps_m)][: len(poses)])


def _first_scans(path_m: Floats, visit_m: float) -> list[int]:
    """Return the first scan of each visit, and the number of scans."""
    firsts = [0]
    for i in range(len(path_m)):
        if path_m[i] - path_m[firsts[-1]] >= visit_m and i - firsts[-1] >= VISIT_SCANS:
            firsts.append(i)
    return [*firsts, len(path_m)] if len(path_m) else [0]


def _view_at(scans: Sequence[LaserScan], poses: Floats, part: NDArray[np.int64]) -> View:
    """Return the view of some scans, in the frame of the middle one."""
    visit_from_robot = between(poses[(part[0] + part[-1]) // 2], poses[part])
    seen = [scans[i] for i in part]
    returns, clear_ends = (
        [transform_points(p, ends) for p, ends in zip(visit_from_robot, every, strict=True)]
        for every in ([scan.points_m() for scan in seen], map(_clear_ends_m, seen))
    )
    robot_from_laser = np.array([scan.robot_from_laser.as_array() for scan in seen])
    return view_of(returns, compose(visit_from_robot, robot_from_laser)[:, :2], clear_ends)


def _clear_ends_m(scan: LaserScan) -> Floats:
    """How far beams (M, 2) reach that have met nothing, in the robot's frame [m]."""
    return clear_beams(scan).points_m() if scan.is_clear().any() else np.zeros((0, 2))


def _starts(sizes: list[int]) -> NDArray[np.int64]:
    return np.asarray(np.r_[0, np.cumsum(np.array(sizes, dtype=np.int64))])
