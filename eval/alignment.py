# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Alignment of an estimated trajectory to a reference, in the plane or in space."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from scipy.spatial.transform import Rotation

from slarm_graph.counts import count_of
from slarm_graph.errors import BadInput
from slarm_graph.eval.association import Pairs
from slarm_graph.geometry import Floats, Pose2, between, transform_points, wrap_angles
from slarm_graph.spatial import between_in_space

_SHORTEST_PATH_M = 1e-6
"""A path within a micrometre is a point: below it, rounding would decide the rotation."""


class AlignmentMethod(StrEnum):
    """How the estimate is aligned to the reference before positions are compared."""

    NONE = "none"
    ORIGIN = "origin"
    """First pose on first pose."""
    SE2 = "se2"
    """Least squares over the positions in the plane, without scale (Umeyama 1991)."""
    SIM2 = "sim2"
    """The same with scale."""
    SE3 = "se3"
    """Least squares over the positions in space."""
    SIM3 = "sim3"
    """The same with scale."""
    YAW = "yaw"
    """Least squares over position and yaw; gravity fixes the rest (Zhang and Scaramuzza 2018)."""

    @property
    def in_space(self) -> bool:
        """Whether it needs paths in space."""
        return self in (AlignmentMethod.SE3, AlignmentMethod.SIM3, AlignmentMethod.YAW)

    @property
    def scales(self) -> bool:
        """Whether the estimate's scale is fitted."""
        return self in (AlignmentMethod.SIM2, AlignmentMethod.SIM3)


_NAMES = {"se2": "SE(2)", "sim2": "Sim(2)", "se3": "SE(3)", "sim3": "Sim(3)", "yaw": "yaw+position"}


@dataclass(frozen=True, slots=True)
class Alignment:
    """A motion of the estimate: `reference = scale * rotation @ estimate + shift`.

    Parameters
    ----------
    rotation : (D, D) float64
        D is 2 in the plane and 3 in space.
    shift_m : (D,) float64
    scale : float
    note : str
        Text for titles and tables.
    """

    rotation: Floats
    shift_m: Floats
    scale: float
    note: str

    @property
    def reference_from_estimate(self) -> Pose2:
        """The rigid part, in the plane [m, m, rad]."""
        return Pose2(float(self.shift_m[0]), float(self.shift_m[1]), self.yaw_rad)

    @property
    def yaw_rad(self) -> float:
        """Return the angle of the rotation about the vertical."""
        return math.atan2(float(self.rotation[1, 0]), float(self.rotation[0, 0]))

    def moved(self, poses: Floats) -> Floats:
        """Return poses of the estimate, (N, 3) or (N, 7), in the reference's frame."""
        places = positions(poses) @ (self.scale * self.rotation).T + self.shift_m
        if poses.shape[1] == 3:
            return np.column_stack([places, wrap_angles(poses[:, 2] + self.yaw_rad)])
        turns = Rotation.from_matrix(self.rotation) * Rotation.from_quat(poses[:, 3:])
        return np.column_stack([places, turns.as_quat()])


def positions(poses: Floats) -> Floats:
    """Return the positions (N, 2) of poses in the plane (N, 3), or (N, 3) of those in space."""
    return poses[:, :2] if poses.shape[1] == 3 else poses[:, :3]


def motions(start: Floats, end: Floats) -> Floats:
    """Return the pose of each end in the frame of its start, both (N, 3) or (N, 7)."""
    return between(start, end) if start.shape[1] == 3 else between_in_space(start, end)


def turned_rad(poses: Floats) -> Floats:
    """Return the rotation angle (N,) of each pose, at least 0 [rad]."""
    if poses.shape[1] == 3:
        return np.asarray(np.abs(wrap_angles(poses[:, 2])))
    return np.asarray(Rotation.from_quat(poses[:, 3:]).magnitude())


def align(
    pairs: Pairs, method: AlignmentMethod = AlignmentMethod.SE2, first: int | None = None
) -> Alignment:
    """Align the estimate to the reference.

    Parameters
    ----------
    pairs : Pairs
        In the plane for the methods of the plane, in space for those of space; either way for
        `none` and `origin`.
    method : AlignmentMethod
    first : int, optional
        Use only that many pairs from the beginning for the least-squares fit.

    Raises
    ------
    BadInput
        When `first` is less than two.
    """
    if method is AlignmentMethod.NONE:
        size = positions(pairs.reference).shape[1]
        return Alignment(np.eye(size), np.zeros(size), 1.0, "not aligned")
    if method is AlignmentMethod.ORIGIN:
        return replace(_origin(pairs), note="origin-aligned")
    if first is not None and first < 2:
        raise BadInput(f"alignment needs at least 2 poses, not {first}")
    reference, estimate = positions(pairs.reference[:first]), positions(pairs.estimate[:first])
    if max(np.ptp(reference, axis=0).max(), np.ptp(estimate, axis=0).max()) < _SHORTEST_PATH_M:
        words = "path length 0.00 m: rotation cannot be aligned, origin-aligned"
        return replace(_origin(pairs), note=words)
    flat = method is AlignmentMethod.YAW
    fitted = fit(estimate, reference, scaled=method.scales, about_vertical=flat)
    scope = "" if first is None else f" on the first {count_of(first, 'pose')}"
    return replace(fitted, note=f"{_NAMES[method]}-aligned{scope} by ({_words(fitted)})")


def _words(fitted: Alignment) -> str:
    shift = ", ".join(f"{value:.3f} m" for value in fitted.shift_m)
    if len(fitted.shift_m) == 2:
        angle_rad = fitted.yaw_rad
    else:
        angle_rad = float(Rotation.from_matrix(fitted.rotation).magnitude())
    scale = "" if fitted.scale == 1.0 else f", scale {fitted.scale:.4f}"
    return f"{shift}, {math.degrees(angle_rad):.3f} deg{scale}"


def _origin(pairs: Pairs) -> Alignment:
    if pairs.reference.shape[1] == 3:
        start = Pose2.from_array(pairs.reference[0])
        motion = start @ Pose2.from_array(pairs.estimate[0]).inverse()
        return Alignment(_turn(motion.theta), np.array([motion.x, motion.y]), 1.0, "")
    ours, theirs = (Rotation.from_quat(p[0, 3:]) for p in (pairs.reference, pairs.estimate))
    rotation = (ours * theirs.inv()).as_matrix()
    shift = pairs.reference[0, :3] - rotation @ pairs.estimate[0, :3]
    return Alignment(rotation, shift, 1.0, "")


def fit(
    source: Floats, target: Floats, *, scaled: bool = False, about_vertical: bool = False
) -> Alignment:
    """Return the least-squares motion of points (N, 2) or (N, 3) onto others (Umeyama 1991).

    Parameters
    ----------
    source, target : (N, D) float64
        [m]
    scaled : bool
        Fit the scale, too.
    about_vertical : bool
        Turn about z only.
    """
    source_mean, target_mean = source.mean(axis=0), target.mean(axis=0)
    s, t = source - source_mean, target - target_mean
    if s.shape[1] == 2 or about_vertical:
        # The optimal rotation maximises sum t . R s: in the plane an arctangent of two sums.
        cross = float(np.sum(s[:, 0] * t[:, 1] - s[:, 1] * t[:, 0]))
        theta = math.atan2(cross, float(np.sum(s[:, :2] * t[:, :2])))
        rotation = np.eye(s.shape[1])
        rotation[:2, :2] = _turn(theta)
    else:
        u, _, vt = np.linalg.svd(t.T @ s)
        handed = np.diag([1.0, 1.0, np.linalg.det(u) * np.linalg.det(vt)])
        rotation = u @ handed @ vt
    scale = float(np.sum(t * (s @ rotation.T)) / np.sum(s * s)) if scaled else 1.0
    if s.shape[1] == 2 and not scaled:
        shift = target_mean - transform_points(np.array([0.0, 0.0, theta]), source_mean)
    else:
        shift = target_mean - scale * rotation @ source_mean
    return Alignment(rotation, np.asarray(shift), scale, "")


def _turn(theta_rad: float) -> Floats:
    c, s = math.cos(theta_rad), math.sin(theta_rad)
    return np.array([[c, -s], [s, c]])
