# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Single poses and normal densities inside compiled loops; `slarm_graph.geometry` has the many."""

from __future__ import annotations

import math

import numpy as np

from slarm_graph.frontends.scans.small_matrix import invert3, sandwich3, times3
from slarm_graph.geometry import Floats
from slarm_graph.kernels import kernel

_TAILS = 4.0
"""Degrees of freedom of what odometry and velocity miss: of four recordings, 3 to 10 % of the steps
lie beyond the 99.9 % quantile of a normal distribution."""
BASIN = np.diag([0.05, 0.05, 0.025]) ** 2
"""Of a place: poses so near fit alike [m, m, rad]. The fall-off of the likelihood, at 2 m."""
SEARCHED = np.array([1.5, 1.5, 0.8])
"""How far around what is expected places are searched for, to either side [m, m, rad]."""


@kernel
def wrapped(angle: float) -> float:
    """Return the angle within (-pi, pi]."""
    return angle - 2.0 * math.pi * math.ceil((angle - math.pi) / (2.0 * math.pi))


@kernel
def moved(pose: Floats, motion: Floats) -> Floats:
    """Compose a pose (3,) with a motion (3,); the heading is not wrapped."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    out = np.empty(3)
    out[0] = pose[0] + c * motion[0] - s * motion[1]
    out[1] = pose[1] + s * motion[0] + c * motion[1]
    out[2] = pose[2] + motion[2]
    return out


@kernel
def compose3(a: Floats, b: Floats) -> Floats:
    """Pose (3,) of c in frame a's parent, from a in it and c in a."""
    out = moved(a, b)
    out[2] = wrapped(out[2])
    return out


@kernel
def between3(a: Floats, b: Floats) -> Floats:
    """Pose (3,) of b seen from a."""
    c, s = math.cos(a[2]), math.sin(a[2])
    dx, dy = b[0] - a[0], b[1] - a[1]
    out = np.empty(3)
    out[0] = c * dx + s * dy
    out[1] = -s * dx + c * dy
    out[2] = wrapped(b[2] - a[2])
    return out


@kernel
def carried_by(motion: Floats) -> Floats:
    """Adjoint (3, 3) that carries what a pose is off by into the frame a motion (3,) leads to."""
    c, s = math.cos(motion[2]), math.sin(motion[2])
    adjoint = np.zeros((3, 3))
    adjoint[0, 0], adjoint[0, 1] = c, s
    adjoint[1, 0], adjoint[1, 1] = -s, c
    # A turn before the motion swings its end sideways.
    adjoint[0, 2] = -c * motion[1] + s * motion[0]
    adjoint[1, 2] = s * motion[1] + c * motion[0]
    adjoint[2, 2] = 1.0
    return adjoint


@kernel
def carried3(covariance: Floats, motion: Floats) -> Floats:
    """Covariance (3, 3) of a pose in its own frame, in the frame that a motion (3,) leads to."""
    return sandwich3(carried_by(motion), covariance)


@kernel
def squared_sigmas(miss: Floats, covariance: Floats) -> float:
    """Squared Mahalanobis length of a difference of motions (3,), its angle wrapped."""
    away = miss.copy()
    away[2] = wrapped(away[2])
    told = times3(invert3(covariance), away)
    return float(away[0] * told[0] + away[1] * told[1] + away[2] * told[2])


@kernel
def log_volume(covariance: Floats) -> float:
    """Log of the determinant of 2 pi times a covariance (3, 3)."""
    m = covariance
    determinant = (
        m[0, 0] * (m[1, 1] * m[2, 2] - m[1, 2] * m[2, 1])
        - m[0, 1] * (m[1, 0] * m[2, 2] - m[1, 2] * m[2, 0])
        + m[0, 2] * (m[1, 0] * m[2, 1] - m[1, 1] * m[2, 0])
    )
    return 3.0 * math.log(2.0 * math.pi) + math.log(max(determinant, 1e-300))


@kernel
def log_tails(squared: float) -> float:
    """Log of Student's t in 3 dimensions at a squared Mahalanobis length, less that at 0."""
    return -0.5 * (_TAILS + 3.0) * math.log1p(squared / _TAILS)


@kernel
def log_density(miss: Floats, covariance: Floats) -> float:
    """Log density at a difference of motions (3,), its angle wrapped: Student's t."""
    return log_tails(squared_sigmas(miss, covariance)) - 0.5 * log_volume(covariance)
