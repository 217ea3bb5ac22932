# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Readings of odometry that were amiss by themselves: the next ones take them back.

Wheels that slip lose way for good. A reading of another moment than the scan's, where stamps are
late or bunch up, does not: odometry over it and the step after is right.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slarm_graph.frontends.scans.small_pose import between3, carried3, compose3
from slarm_graph.geometry import Floats


@dataclass(frozen=True, slots=True)
class Detour:
    """The last steps on which odometry was not believed, or the last one where it was.

    Parameters
    ----------
    told, moved : (3,) float64
        Motion over them by odometry, and as it was found [m, m, rad].
    told_covariance, moved_covariance : (3, 3) float64
        Of both, in the body frame at the end.
    """

    told: Floats
    told_covariance: Floats
    moved: Floats
    moved_covariance: Floats

    def then(self, other: Detour) -> Detour:
        """Return these steps and another after them as one."""
        return Detour(
            compose3(self.told, other.told),
            carried3(self.told_covariance, other.told) + other.told_covariance,
            compose3(self.moved, other.moved),
            carried3(self.moved_covariance, other.moved) + other.moved_covariance,
        )

    def taken_back(self, told: Floats, covariance: Floats) -> tuple[Floats, Floats]:
        """Motion (3,) and covariance (3, 3) of the next step where odometry holds over all of them.

        Parameters
        ----------
        told : (3,) float64
            The next step by odometry [m, m, rad].
        covariance : (3, 3) float64
            Of it.
        """
        noise = carried3(self.told_covariance + self.moved_covariance, told) + covariance
        return np.asarray(between3(self.moved, compose3(self.told, told))), noise
