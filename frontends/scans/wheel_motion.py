# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Motion by odometry alone, with the covariance of independent and of systematic errors."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from slarm_graph.frontends.scans.small_matrix import add3, matmul3
from slarm_graph.frontends.scans.small_pose import compose3, inverse_adjoint, transported3
from slarm_graph.geometry import Floats
from slarm_graph.kernels import kernel

_Parts = tuple[Floats, Floats, Floats, Floats]
"""Motion (3,), covariance (3, 3) with and without failures, and error Jacobian (3, 3)."""


@dataclass(frozen=True, slots=True)
class WheelMotion:
    """A motion by calibrated odometry alone, without scan matching.

    Parameters
    ----------
    motion : (3,) float64
        Pose of the robot now in its frame before [m, m, rad].
    covariance : (3, 3) float64
        Of the motion, in the body frame now, by errors independent per step; wider where odometry
        may have failed.
    covariance_if_working : (3, 3) float64
        The same given that it has not failed; the same number where it often fails.
    reading_variances : (3,) float64
        Variances of a reading of odometry: they count at both ends of a path and do not add up.
    error_jacobian : (3, 3) float64
        Of the motion, in the body frame now, with respect to the systematic errors of odometry.
    error_covariance : (3, 3) float64
        Present covariance of the systematic errors, which are the same in all steps.
    """

    motion: Floats
    covariance: Floats
    covariance_if_working: Floats
    reading_variances: Floats = field(default_factory=lambda: np.zeros(3))
    error_jacobian: Floats = field(default_factory=lambda: np.zeros((3, 3)))
    error_covariance: Floats = field(default_factory=lambda: np.zeros((3, 3)))

    def then(self, after: WheelMotion) -> WheelMotion:
        """Compose this motion with the one that follows."""
        motion, covariance, if_working, jacobian = _chained(
            (self.motion, self.covariance, self.covariance_if_working, self.error_jacobian),
            (after.motion, after.covariance, after.covariance_if_working, after.error_jacobian),
        )
        return WheelMotion(
            motion,
            covariance,
            if_working,
            after.reading_variances,
            jacobian,
            after.error_covariance,
        )

    def total_covariance(self) -> Floats:
        """Covariance (3, 3) by independent and systematic errors, without the readings' own."""
        return self.covariance + self._systematic_covariance()

    def total_covariance_if_working(self) -> Floats:
        """The same (3, 3) given that odometry has not failed."""
        return self.covariance_if_working + self._systematic_covariance()

    def _systematic_covariance(self) -> Floats:
        return np.asarray(self.error_jacobian @ self.error_covariance @ self.error_jacobian.T)


@kernel
def _chained(before: _Parts, after: _Parts) -> _Parts:
    """Compose two motions, their covariances and Jacobians."""
    motion = after[0]
    covariance = add3(transported3(before[1], motion), after[1])
    if_working = add3(transported3(before[2], motion), after[2])
    jacobian = add3(matmul3(inverse_adjoint(motion), before[3]), after[3])
    return compose3(before[0], motion), covariance, if_working, jacobian


NO_MOTION = WheelMotion(np.zeros(3), np.zeros((3, 3)), np.zeros((3, 3)))
"""Motion of no steps: what those of a path are composed with."""


def chained(before: WheelMotion | None, after: WheelMotion | None) -> WheelMotion | None:
    """Compose two motions; None where odometry is missing in one."""
    return before.then(after) if before is not None and after is not None else None
