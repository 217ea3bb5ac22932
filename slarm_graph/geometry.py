# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""SE(2): one pose as a value, many poses as (N, 3) arrays, tangent order (x, y, theta)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


def wrap_angle(angle_rad: float) -> float:
    """Wrap one angle to (-pi, pi]."""
    wrapped = math.remainder(angle_rad, 2.0 * math.pi)
    return math.pi if wrapped == -math.pi else wrapped


def wrap_angles(angles_rad: ArrayLike) -> Floats:
    """Wrap angles of any shape to (-pi, pi]."""
    angles = np.asarray(angles_rad, dtype=np.float64)
    return np.pi - np.mod(np.pi - angles, 2.0 * np.pi)


@dataclass(frozen=True, slots=True)
class Pose2:
    """A pose in the plane, read `a_from_b`: the pose of frame b in frame a.

    Parameters
    ----------
    x, y : float
        Position [m].
    theta : float
        Heading [rad], wrapped to (-pi, pi].
    """

    x: float = 0.0
    y: float = 0.0
    theta: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "x", float(self.x))
        object.__setattr__(self, "y", float(self.y))
        object.__setattr__(self, "theta", wrap_angle(float(self.theta)))

    def __matmul__(self, other: Pose2) -> Pose2:
        """Compose: `a_from_c = a_from_b @ b_from_c`."""
        c, s = math.cos(self.theta), math.sin(self.theta)
        return Pose2(
            self.x + c * other.x - s * other.y,
            self.y + s * other.x + c * other.y,
            self.theta + other.theta,
        )

    def inverse(self) -> Pose2:
        """Return `b_from_a` of `a_from_b`."""
        c, s = math.cos(self.theta), math.sin(self.theta)
        return Pose2(-c * self.x - s * self.y, s * self.x - c * self.y, -self.theta)

    def between(self, other: Pose2) -> Pose2:
        """Return `self.inverse() @ other`."""
        return self.inverse() @ other

    def transform(self, points: ArrayLike) -> Floats:
        """Map points (N, 2) [m] of frame b into frame a."""
        return transform_points(self.as_array(), points)

    def as_array(self) -> Floats:
        """Return (3,) x [m], y [m], theta [rad]."""
        return np.array([self.x, self.y, self.theta])

    @staticmethod
    def from_array(values: ArrayLike) -> Pose2:
        """Build a pose from (3,) x [m], y [m], theta [rad]."""
        x, y, theta = np.asarray(values, dtype=np.float64).tolist()
        return Pose2(x, y, theta)

    @staticmethod
    def exp(tangent: ArrayLike) -> Pose2:
        """Exponential map of a tangent vector (3,) (x, y, theta), as `gtsam.Pose2.Expmap`."""
        vx, vy, w = (float(v) for v in np.asarray(tangent, dtype=np.float64))
        a, b = _sinc_terms(w)
        return Pose2(a * vx - b * vy, b * vx + a * vy, w)

    def log(self) -> Floats:
        """Logarithm (3,), the inverse of `exp`."""
        a, b = _sinc_terms(self.theta)
        scale = 1.0 / (a * a + b * b)
        return np.array(
            [scale * (a * self.x + b * self.y), scale * (a * self.y - b * self.x), self.theta]
        )


def adjoints(a_from_b: Floats) -> Floats:
    """Adjoints (..., 3, 3) of poses (..., 3): `a_from_b exp(v) = exp(Ad v) a_from_b`."""
    x, y, theta = a_from_b[..., 0], a_from_b[..., 1], a_from_b[..., 2]
    out = np.zeros((*theta.shape, 3, 3))
    out[..., 0, 0] = out[..., 1, 1] = np.cos(theta)
    out[..., 1, 0] = np.sin(theta)
    out[..., 0, 1] = -out[..., 1, 0]
    out[..., 0, 2], out[..., 1, 2], out[..., 2, 2] = y, -x, 1.0
    return out


def transform_covariances(
    a_from_b: Floats, covariances: Floats, a_from_c: Floats | None = None
) -> Floats:
    """Map covariances (..., 3, 3) of errors in frames b (rows) and c (columns) into frames a."""
    rows = adjoints(a_from_b)
    columns = rows if a_from_c is None else adjoints(a_from_c)
    return np.asarray(rows @ covariances @ columns.swapaxes(-1, -2))


def symmetric(matrices: NDArray[np.floating]) -> Floats:
    """Return the mean of matrices (..., N, N) and their transposes."""
    return np.asarray(0.5 * (matrices + matrices.swapaxes(-1, -2)))


def _sinc_terms(angle_rad: float) -> tuple[float, float]:
    """Return sin(w)/w and (1-cos(w))/w, continued through zero."""
    if angle_rad == 0.0:
        return 1.0, 0.0
    # 1 - cos(w) would cancel where w is small.
    half = math.sin(0.5 * angle_rad)
    return math.sin(angle_rad) / angle_rad, 2.0 * half * half / angle_rad


def compose(a_from_b: ArrayLike, b_from_c: ArrayLike) -> Floats:
    """Compose pose arrays of shape (..., 3), broadcasting like numpy."""
    a = np.asarray(a_from_b, dtype=np.float64)
    b = np.asarray(b_from_c, dtype=np.float64)
    c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
    return _poses(
        a[..., 0] + c * b[..., 0] - s * b[..., 1],
        a[..., 1] + s * b[..., 0] + c * b[..., 1],
        a[..., 2] + b[..., 2],
    )


def invert(a_from_b: ArrayLike) -> Floats:
    """Invert pose arrays of shape (..., 3)."""
    a = np.asarray(a_from_b, dtype=np.float64)
    c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
    return _poses(-c * a[..., 0] - s * a[..., 1], s * a[..., 0] - c * a[..., 1], -a[..., 2])


def _poses(x: Floats, y: Floats, theta: Floats) -> Floats:
    """Poses (..., 3) of their parts (...), the heading not yet wrapped: `np.stack` is slower."""
    out = np.empty((*theta.shape, 3))
    out[..., 0], out[..., 1], out[..., 2] = x, y, wrap_angles(theta)
    return out


def between(a_from_b: ArrayLike, a_from_c: ArrayLike) -> Floats:
    """Return `b_from_c` for pose arrays of shape (..., 3)."""
    return compose(invert(a_from_b), a_from_c)


def transform_points(a_from_b: ArrayLike, points: ArrayLike) -> Floats:
    """Map points (N, 2) [m] of frame b into frame a by one pose (3,)."""
    x, y, theta = np.asarray(a_from_b, dtype=np.float64)
    p = np.asarray(points, dtype=np.float64)
    c, s = math.cos(theta), math.sin(theta)
    px, py = p[..., 0], p[..., 1]
    out = np.empty(p.shape)
    out[..., 0] = x + c * px - s * py
    out[..., 1] = y + s * px + c * py
    return out


def one_per_cell(points: Floats, cell_m: float) -> Floats:
    """Keep the first of the points (K, 2) [m] in every square cell, in the order they came."""
    # Compiled code is loaded by whom it serves, not by all who need a pose.
    from slarm_graph.raster.firsts import first_in_cells

    kept: Floats = points[first_in_cells(points, cell_m)]
    return kept


def interpolate_poses(stamps_ns: NDArray[np.int64], poses: Floats, at_ns: ArrayLike) -> Floats:
    """Interpolate poses linearly in position and along the shorter arc in heading.

    Parameters
    ----------
    stamps_ns : (N,) int64, strictly increasing [ns]
    poses : (N, 3) [m, m, rad]
    at_ns : (M,) int64 [ns]; outside the span the nearest end is held

    Returns
    -------
    (M, 3) array [m, m, rad]
    """
    query = np.clip(np.asarray(at_ns, dtype=np.int64), stamps_ns[0], stamps_ns[-1])
    if len(stamps_ns) == 1:
        return np.repeat(poses[:1], len(query), axis=0)
    upper = np.clip(np.searchsorted(stamps_ns, query, side="left"), 1, len(stamps_ns) - 1)
    lower = upper - 1
    # Differences of integer nanoseconds stay exact; only their ratio becomes a float.
    span_ns = (stamps_ns[upper] - stamps_ns[lower]).astype(np.float64)
    share = ((query - stamps_ns[lower]) / span_ns)[:, None]
    step = poses[upper] - poses[lower]
    step[:, 2] = wrap_angles(step[:, 2])
    out = poses[lower] + share * step
    out[:, 2] = wrap_angles(out[:, 2])
    return np.asarray(out, dtype=np.float64)
