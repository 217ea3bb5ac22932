# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The plane of motion of a trajectory in space, and its projection into it.

Robots drive in x and y, but camera poses (KITTI, ORB-SLAM) have y down and z ahead: projected onto
x and y, such a path is a line.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from slarm_graph.geometry import Floats
from slarm_graph.spatial import SpatialTrajectory
from slarm_graph.trajectory import Trajectory

_SNAP_RAD = math.radians(10.0)
"""A plane whose normal is nearer than this to an axis is aligned with it: floors and roads are
level, and a doubled angle would hide a camera that is mounted askew."""
_SAME_RAD = math.radians(20.0)
"""Planes of two files that differ by less are the same; conventions differ by 90 degrees."""
_FLAT = 0.25
"""Third extent over second; above it a path is not planar, and the axes' convention decides."""
_WIDE = 0.02
"""Second extent over first; below it a path is a line, in any plane through it."""
_LEVEL = math.cos(math.radians(60.0))
"""A body whose z axis is nearer to the plane is a camera, which looks along z; one whose z axis
stands farther out of it is a robot, which looks along x. To ask which of two axes lies more in the
plane would be to ask the noise: both do."""
_UPS = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]])
"""Up direction where the plane is normal to x, y (cameras: y is down) or z."""
_NAMES = ("y-z", "x-z", "x-y")


@dataclass(frozen=True, slots=True)
class Plane:
    """A plane of motion.

    Parameters
    ----------
    plane_from_space : (3, 3) float64
        Rotation whose third row is up.
    name : str
        Text for notices.
    sure : bool
        Whether the path determines it, or only convention.
    """

    plane_from_space: Floats
    name: str
    sure: bool

    @property
    def up(self) -> Floats:
        """The plane's normal (3,) in the file's frame."""
        return np.asarray(self.plane_from_space[2])

    def flipped(self) -> Plane:
        """Return the same plane with up and down exchanged."""
        return replace(self, plane_from_space=self.plane_from_space * [[1.0], [-1.0], [-1.0]])

    @property
    def is_xy(self) -> bool:
        """Whether it is the x-y plane, so that paths are not changed."""
        return bool(self.up[2] == 1.0)


def plane_of(path: SpatialTrajectory) -> Plane:
    """Find the plane of a path: by its positions; of a line by its rotations and direction."""
    positions = path.poses[:, :3] - path.poses[:, :3].mean(axis=0)
    _, extents, axes = np.linalg.svd(positions, full_matrices=False)
    if extents[0] < 1e-9 or len(path) < 3:
        return _across(2, sure=False)
    if extents[1] > _WIDE * extents[0] and extents[2] < _FLAT * extents[1]:
        return _with_normal(axes[2])
    if extents[1] <= _WIDE * extents[0]:
        axis = _turning_axis(path)
        if axis is not None:
            return _with_normal(axis)
        return _across(1 if np.argmax(np.abs(axes[0])) == 2 else 2, sure=False)
    return _across(int(np.argmin(np.ptp(positions, axis=0))), sure=False)


def _turning_axis(path: SpatialTrajectory) -> Floats | None:
    """Return the axis (3,) about which the body turns, where it mostly turns about one."""
    turns = Rotation.from_quat(path.poses[:, 3:])
    steps = (turns[1:] * turns[:-1].inv()).as_rotvec()
    _, extents, axes = np.linalg.svd(steps, full_matrices=False)
    return axes[0] if extents[0] > 1e-6 and extents[1] < _FLAT * extents[0] else None


def _with_normal(normal: Floats) -> Plane:
    axis = int(np.argmax(np.abs(normal)))
    if abs(normal[axis]) > math.cos(_SNAP_RAD):
        return _across(axis, sure=True)
    up = normal if normal @ _UPS[axis] > 0 else -normal
    ahead = np.eye(3)[int(np.argmin(np.abs(up)))]
    ahead = ahead - (ahead @ up) * up
    ahead /= np.linalg.norm(ahead)
    rows = np.stack([ahead, np.cross(up, ahead), up])
    slant = math.degrees(math.acos(abs(normal[axis])))
    return Plane(rows, f"{_NAMES[axis]} slanted by {slant:.0f} deg", True)


def _across(axis: int, *, sure: bool) -> Plane:
    """Return the plane normal to an axis, with its other axes in right-handed order."""
    up = _UPS[axis]
    ahead = np.eye(3)[(axis + 1) % 3]
    return Plane(np.stack([ahead, np.cross(up, ahead), up]), _NAMES[axis], sure)


def projected(path: SpatialTrajectory, plane: Plane) -> Trajectory:
    """Project a path into a plane; heights and tilts are dropped."""
    if plane.is_xy:
        return path.in_xy()
    positions = path.poses[:, :3] @ plane.plane_from_space.T
    turns = Rotation.from_matrix(plane.plane_from_space) * Rotation.from_quat(path.poses[:, 3:])
    # The yaw of the first pose is that of the axis in which its body looks; then it turns.
    in_plane = turns[0].as_matrix()[:2]
    first = in_plane[:, 2 if np.linalg.norm(in_plane[:, 2]) > _LEVEL else 0]
    turned = (turns * turns[0].inv()).as_quat()
    yaw = math.atan2(first[1], first[0]) + 2.0 * np.arctan2(turned[:, 2], turned[:, 3])
    return Trajectory(path.stamps_ns, np.column_stack([positions[:, :2], yaw]))


def planes_of(reference: SpatialTrajectory, estimate: SpatialTrajectory) -> tuple[Plane, Plane]:
    """Return the planes of motion of two paths.

    The reference's is used for both, unless the estimate's frame is clearly another one.
    """
    ours, theirs = plane_of(reference), plane_of(estimate)
    if not ours.sure:
        return (theirs, theirs) if theirs.sure else (ours, ours)
    apart_rad = math.acos(min(1.0, abs(float(ours.up @ theirs.up))))
    return (ours, theirs) if theirs.sure and apart_rad > _SAME_RAD else (ours, ours)


def level(path: SpatialTrajectory) -> Trajectory:
    """Project a path into its own plane of motion."""
    return projected(path, plane_of(path))
