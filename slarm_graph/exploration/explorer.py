# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The seam of exploration: from coverage so far and pose to the next leg to drive."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

from slarm_graph.exploration.coverage_grid import CoverageGrid
from slarm_graph.geometry import Floats, Pose2


@dataclass(frozen=True, slots=True)
class Leg:
    """A path to drive.

    Parameters
    ----------
    points_m : (K, 2) float64
        Corners of the path in the map, beginning at the robot [m].
    more : bool
        Whether the explorer already knows that it will continue from the end.
    review_s : float
        Replan after this time of driving, as the map will have changed [s].
    """

    points_m: Floats
    more: bool = True
    review_s: float = math.inf


@dataclass(frozen=True, slots=True)
class Finished:
    """Why exploration ended."""

    reason: str


class Explorer(Protocol):
    """Decides where to drive next."""

    def next_goal(self, coverage: CoverageGrid, pose: Pose2) -> Leg | Finished:
        """Return the next path to drive from the pose, or that nothing is left to do.

        Parameters
        ----------
        coverage : CoverageGrid
            The map so far. It may differ from that of the last call in any way.
        pose : Pose2
            `map_from_robot` where the leg is to begin.
        """
        ...
