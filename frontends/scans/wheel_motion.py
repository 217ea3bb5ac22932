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

_Parts = tuple[Floats, Floats, Floats, Floats]
"""A motion (3,), its covariance (3, 3) in all and where nothing failed, and the effect on it."""


@dataclass(frozen=True, slots=True)
class WheelMotion:
    """A motion by calibrated odometry alone, no scan having been looked at.

    Parameters
    ----------
    motion : (3,) float64
        Pose of the robot now in its frame before [m, m, rad].
    covariance : (3, 3) float64
        Of it, in the body frame now, for errors that are others in every step; wider where
        odometry may have failed.
    held : (3, 3) float64
        The same had it not failed, unless it does often.
    reading : (3,) float64
        Variances of a reading of odometry: at either end, they do not add up.
    effect : (3, 3) float64
        Derivative of the motion, in the body frame now, by the systematic errors of odometry.
    of_errors : (3, 3) float64
        Covariance of these, as far as they are known now; the same errors all along.
    """

    motion: Floats
    covariance: Floats
    held: Floats
    reading: Floats = field(default_factory=lambda: np.zeros(3))
    effect: Floats = field(default_factory=lambda: np.zeros((3, 3)))
    of_errors: Floats = field(default_factory=lambda: np.zeros((3, 3)))

    def then(self, after: WheelMotion) -> WheelMotion:
        """Return this motion and the one that follows as one."""
        motion, covariance, held, effect = _added(
            (self.motion, self.covariance, self.held, self.effect),
            (after.motion, after.covariance, after.held, after.effect),
        )
        return WheelMotion(motion, covariance, held, after.reading, effect, after.of_errors)

    def total_covariance(self) -> Floats:
        """Covariance (3, 3) of the motion by all that it may be off by but the readings' own."""
        return self.covariance + self._of_effect()

    def held_covariance(self) -> Floats:
        """Covariance (3, 3) of the same had odometry not failed."""
        return self.held + self._of_effect()

    def _of_effect(self) -> Floats:
        return np.asarray(self.effect @ self.of_errors @ self.effect.T)


@kernel
def _added(before: _Parts, after: _Parts) -> _Parts:
    """Return the parts of two motions as those of one."""
    motion = after[0]
    covariance = sum3(carried3(before[1], motion), after[1])
    held = sum3(carried3(before[2], motion), after[2])
    effect = sum3(product3(carried_by(motion), before[3]), after[3])
    return compose3(before[0], motion), covariance, held, effect


STOOD = WheelMotion(np.zeros(3), np.zeros((3, 3)), np.zeros((3, 3)))
"""Motion of no steps: what those of a path are added to."""


def joined(before: WheelMotion | None, after: WheelMotion | None) -> WheelMotion | None:
    """Return two motions as one, where odometry tells of both."""
    return before.then(after) if before is not None and after is not None else None
