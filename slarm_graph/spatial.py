# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""A stamped path in space, as other tools write it: read and measured, never estimated here."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation, Slerp

from slarm_graph.geometry import Floats
from slarm_graph.trajectory import Trajectory


@dataclass(frozen=True, slots=True)
class SpatialTrajectory:
    """Poses over time, in space.

    Parameters
    ----------
    stamps_ns : (N,) int64
        Strictly increasing [ns].
    poses : (N, 7) float64
        x, y, z [m] and the unit quaternion x, y, z, w of the body in a fixed frame.
    timed : bool
        False where the file carries no time and the stamps only count the poses.
    """

    stamps_ns: NDArray[np.int64]
    poses: Floats
    timed: bool = True

    def __len__(self) -> int:
        return len(self.stamps_ns)

    def at(self, stamps_ns: ArrayLike) -> Floats:
        """Interpolate poses (M, 7) at stamps (M,) [ns]; the ends are held outside the span."""
        query = np.clip(np.asarray(stamps_ns, np.int64), self.stamps_ns[0], self.stamps_ns[-1])
        if len(self.stamps_ns) == 1:
            return np.repeat(self.poses[:1], len(query), axis=0)
        known_s = (self.stamps_ns - self.stamps_ns[0]) * 1e-9
        query_s = (query - self.stamps_ns[0]) * 1e-9
        places = [np.interp(query_s, known_s, self.poses[:, axis]) for axis in range(3)]
        turned = Slerp(known_s, Rotation.from_quat(self.poses[:, 3:]))(query_s)
        return np.column_stack([*places, turned.as_quat()])

    def in_xy(self) -> Trajectory:
        """Return x, y and the yaw of the body's x axis."""
        x, y, z, w = self.poses[:, 3:].T
        yaw = np.arctan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z)
        return Trajectory(self.stamps_ns, np.column_stack([self.poses[:, :2], yaw]))


def in_space(trajectory: Trajectory) -> SpatialTrajectory:
    """Return a planar path at height 0 in space."""
    half = trajectory.poses[:, 2] / 2.0
    nil = np.zeros((len(trajectory), 3))
    poses = np.column_stack([trajectory.poses[:, :2], nil, np.sin(half), np.cos(half)])
    return SpatialTrajectory(trajectory.stamps_ns, poses)


def between_in_space(a_from_b: Floats, a_from_c: Floats) -> Floats:
    """Return `b_from_c` (N, 7) of poses (N, 7) with one frame in common."""
    from_a = Rotation.from_quat(a_from_b[:, 3:]).inv()
    places = from_a.apply(a_from_c[:, :3] - a_from_b[:, :3])
    return np.column_stack([places, (from_a * Rotation.from_quat(a_from_c[:, 3:])).as_quat()])
