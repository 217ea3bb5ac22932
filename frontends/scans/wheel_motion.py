# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Where odometry alone says that the robot went."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numba import njit

from slarm_graph.frontends.scans.small_matrix import sum3
from slarm_graph.frontends.scans.small_pose import carried3, compose3
from slarm_graph.geometry import Floats


@dataclass(frozen=True, slots=True)
class WheelMotion:
    """A motion by calibrated odometry alone, no scan having been looked at.

    Parameters
    ----------
    motion : (3,) float64
        Pose of the robot now in its frame before [m, m, rad].
    covariance : (3, 3) float64
        Of it, in the body frame now, for errors that add up along a path.
    reading : (3,) float64
        Variances of a reading of odometry: at either end, they do not add up.
    """

    motion: Floats
    covariance: Floats
    reading: Floats = field(default_factory=lambda: np.zeros(3))

    def then(self, after: WheelMotion) -> WheelMotion:
        """Return this motion and the one that follows as one."""
        both = _added(self.motion, self.covariance, after.motion, after.covariance)
        return WheelMotion(*both, after.reading)


@njit(cache=True, nogil=True)
def _added(
    motion: Floats, covariance: Floats, after: Floats, of_after: Floats
) -> tuple[Floats, Floats]:
    """Motion (3,) and its covariance (3, 3), after another one."""
    return compose3(motion, after), sum3(carried3(covariance, after), of_after)


def joined(before: WheelMotion | None, after: WheelMotion | None) -> WheelMotion | None:
    """Return two motions as one, where odometry tells of both."""
    return before.then(after) if before is not None and after is not None else None
