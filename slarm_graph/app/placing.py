# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""A backend's result moved to where the robot is known to have started."""

from __future__ import annotations

from slarm_graph.backend import SlamResult
from slarm_graph.geometry import Pose2
from slarm_graph.trajectory import Trajectory


def placed(slam: SlamResult, truth: Trajectory | None) -> SlamResult:
    """Start where the robot is known to have started; at the origin where that is not known.

    Parameters
    ----------
    slam : SlamResult
        In the backend's own map frame.
    truth : Trajectory or None
        `map_from_robot` as the source knows it.
    """
    if truth is None or not len(truth):
        return slam
    mine_from_robot = Pose2.from_array(slam.trajectory.poses[0])
    start = Pose2.from_array(truth.at(slam.trajectory.stamps_ns[:1])[0])
    return slam.transformed(start @ mine_from_robot.inverse())
