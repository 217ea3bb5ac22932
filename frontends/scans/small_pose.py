# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""SE(2) and densities of single poses in compiled loops; arrays of poses: `geometry`."""

from __future__ import annotations

import math

import numpy as np

from slarm_graph.frontends.scans.small_matrix import invert3, matvec3, sandwich3
from slarm_graph.geometry import Floats
from slarm_graph.kernels import kernel

DEGREES_OF_FREEDOM = 4.0
"""Degrees of freedom of Student's t of residuals, as Lange, Little and Taylor ("Robust Statistical
Modeling Using the t Distribution", JASA 84, 1989) advise where they are not estimated: of four
recordings 3 to 10 % of the steps of odometry and velocity lie beyond the 99.9 % quantile of a
normal distribution, and in the fit of true matches crowds and new furniture come now and then. In
the calibration of odometry, where a residual of five sigmas counts a sixth, with half a hall is
0.072 m in place of 0.075 (mean of three) and edmonton 0.89 in place of 0.71 (one of three draws),
with double 0.092 and 0.68, with no tails 0.090 in place of 0.079 (of eight); mit-csail and
fr-clinic 5.6 m deep move less than by draws."""
BASIN_COVARIANCE = np.diag([0.05, 0.05, 0.025]) ** 2
"""Covariance of the basin of an optimum: poses that fit alike [m^2, m^2, rad^2], by the fall-off of
the likelihood at 2 m."""
SEARCH_REACH = np.array([1.5, 1.5, 0.8])
"""Half the search window around a predicted pose [m, m, rad]."""


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
    """Compose two poses (3,): that of b, given in frame a, in a's parent frame."""
    out = moved(a, b)
    out[2] = wrapped(out[2])
    return out


@kernel
def between3(a: Floats, b: Floats) -> Floats:
    """Relative pose (3,) of b in frame a: inverse of a, composed with b."""
    c, s = math.cos(a[2]), math.sin(a[2])
    dx, dy = b[0] - a[0], b[1] - a[1]
    out = np.empty(3)
    out[0] = c * dx + s * dy
    out[1] = -s * dx + c * dy
    out[2] = wrapped(b[2] - a[2])
    return out


@kernel
def inverse_adjoint(motion: Floats) -> Floats:
    """Adjoint (3, 3) of the inverse of a motion (3,): maps pose errors to the frame after it."""
    c, s = math.cos(motion[2]), math.sin(motion[2])
    adjoint = np.zeros((3, 3))
    adjoint[0, 0], adjoint[0, 1] = c, s
    adjoint[1, 0], adjoint[1, 1] = -s, c
    # A heading error before the motion displaces its end sideways.
    adjoint[0, 2] = -c * motion[1] + s * motion[0]
    adjoint[1, 2] = s * motion[1] + c * motion[0]
    adjoint[2, 2] = 1.0
    return adjoint


@kernel
def transported3(covariance: Floats, motion: Floats) -> Floats:
    """Transport a body-frame covariance (3, 3) of a pose to the frame after a motion (3,)."""
    return sandwich3(inverse_adjoint(motion), covariance)


@kernel
def squared_mahalanobis(residual: Floats, covariance: Floats) -> float:
    """Squared Mahalanobis distance of a residual (3,), its angle wrapped."""
    wrapped_residual = residual.copy()
    wrapped_residual[2] = wrapped(wrapped_residual[2])
    scaled = matvec3(invert3(covariance), wrapped_residual)
    return float(
        wrapped_residual[0] * scaled[0]
        + wrapped_residual[1] * scaled[1]
        + wrapped_residual[2] * scaled[2]
    )


@kernel
def log_det_2pi(covariance: Floats) -> float:
    """Log of the determinant of 2 pi times a covariance (3, 3)."""
    m = covariance
    determinant = (
        m[0, 0] * (m[1, 1] * m[2, 2] - m[1, 2] * m[2, 1])
        - m[0, 1] * (m[1, 0] * m[2, 2] - m[1, 2] * m[2, 0])
        + m[0, 2] * (m[1, 0] * m[2, 1] - m[1, 1] * m[2, 0])
    )
    return 3.0 * math.log(2.0 * math.pi) + math.log(max(determinant, 1e-300))


@kernel
def log_student_t(squared: float, dimensions: float = 3.0) -> float:
    """Log of Student's t at a squared Mahalanobis distance, over that at 0."""
    return -0.5 * (DEGREES_OF_FREEDOM + dimensions) * math.log1p(squared / DEGREES_OF_FREEDOM)


@kernel
def log_density(residual: Floats, covariance: Floats) -> float:
    """Log density of a residual (3,), its angle wrapped: Student's t."""
    return log_student_t(squared_mahalanobis(residual, covariance)) - 0.5 * log_det_2pi(covariance)
