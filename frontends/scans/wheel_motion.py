# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Where odometry alone says that the robot went."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from slarm_graph.frontends.scans.small_matrix import product3, sum3
from slarm_graph.frontends.scans.small_pose import carried3, carried_by, compose3
from slarm_graph.geometry import Floats
from slarm_graph.kernels import kernel


@dataclass(frozen=True, slots=True)
class WheelMotion:
    """A motion by calibrated odometry alone, no scan having been looked at.

    Parameters
    ----------
    motion : (3,) float64
        Pose of the robot now in its frame before [m, m, rad].
    covariance : (3, 3) float64
        Of it, in the body frame now, for errors that are others in every step.
    reading : (3,) float64
        Variances of a reading of odometry: at either end, they do not add up.
    effect : (3, 3) float64
        Derivative of the motion, in the body frame now, by the systematic errors of odometry.
    of_errors : (3, 3) float64
        Covariance of these, as far as they are known now; the same errors all along.
    """

    motion: Floats
    covariance: Floats
    reading: Floats = field(default_factory=lambda: np.zeros(3))
    effect: Floats = field(default_factory=lambda: np.zeros((3, 3)))
    of_errors: Floats = field(default_factory=lambda: np.zeros((3, 3)))

    def then(self, after: WheelMotion) -> WheelMotion:
        """Return this motion and the one that follows as one."""
        motion, covariance, effect = _added(
            self.motion, self.covariance, self.effect, after.motion, after.covariance, after.effect
        )
        return WheelMotion(motion, covariance, after.reading, effect, after.of_errors)

    def total_covariance(self) -> Floats:
        """Covariance (3, 3) of the motion by all that it may be off by but the readings' own."""
        return np.asarray(self.covariance + self.effect @ self.of_errors @ self.effect.T)


@kernel
def _added(
    motion: Floats,
    covariance: Floats,
    effect: Floats,
    after: Floats,
    of_after: Floats,
    effect_after: Floats,
) -> tuple[Floats, Floats, Floats]:
    """Motion (3,), its covariance (3, 3) and the effect (3, 3) on it, after another one."""
    both = sum3(product3(carried_by(after), effect), effect_after)
    return compose3(motion, after), sum3(carried3(covariance, after), of_after), both


STOOD = WheelMotion(np.zeros(3), np.zeros((3, 3)))
"""Motion of no steps: what those of a path are added to."""


def joined(before: WheelMotion | None, after: WheelMotion | None) -> WheelMotion | None:
    """Return two motions as one, where odometry tells of both."""
    return before.then(after) if before is not None and after is not None else None
