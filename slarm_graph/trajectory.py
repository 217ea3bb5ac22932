# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""A stamped path of the robot in the map."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slarm_graph.geometry import Floats, Pose2, compose, interpolate_poses


@dataclass(frozen=True, slots=True)
class Trajectory:
    """Poses `map_from_robot` over time.

    Parameters
    ----------
    stamps_ns : (N,) int64
        Strictly increasing [ns].
    poses : (N, 3) float64
        x [m], y [m], theta [rad] of the robot in the map.

    Raises
    ------
    ValueError
        When the shapes disagree, a value is not finite or the stamps do not increase.
    """

    stamps_ns: NDArray[np.int64]
    poses: Floats

    def __post_init__(self) -> None:
        object.__setattr__(self, "stamps_ns", np.asarray(self.stamps_ns, dtype=np.int64))
        object.__setattr__(self, "poses", np.asarray(self.poses, dtype=np.float64).reshape(-1, 3))
        if len(self.stamps_ns) != len(self.poses):
            raise ValueError(f"{len(self.stamps_ns)} stamps for {len(self.poses)} poses")
        bad = np.flatnonzero(~np.isfinite(self.poses).all(axis=1))
        if bad.size:
            raise ValueError(f"pose {bad[0]} is not finite: {self.poses[bad[0]]}")
        if np.any(np.diff(self.stamps_ns) <= 0):
            index = int(np.argmax(np.diff(self.stamps_ns) <= 0)) + 1
            raise ValueError(f"stamps must increase strictly; stamp {index} does not")

    def __len__(self) -> int:
        return len(self.stamps_ns)

    def at(self, stamps_ns: ArrayLike) -> Floats:
        """Interpolate poses (M, 3) at stamps (M,) [ns]; the ends are held outside the span."""
        return interpolate_poses(self.stamps_ns, self.poses, stamps_ns)

    def moved_to(self, robot_from_part: Pose2) -> Trajectory:
        """Return the path of a part fixed to the robot, for instance its laser."""
        return Trajectory(self.stamps_ns, compose(self.poses, robot_from_part.as_array()))

    def transformed(self, other_from_map: Pose2) -> Trajectory:
        """Return the same path expressed in another fixed frame."""
        return Trajectory(self.stamps_ns, compose(other_from_map.as_array(), self.poses))

    def path_length_m(self) -> float:
        """Sum of the distances between successive positions [m]."""
        return float(np.linalg.norm(np.diff(self.poses[:, :2], axis=0), axis=1).sum())
