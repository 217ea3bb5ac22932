# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""A backend's result moved to where the robot is known to have started."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from slarm_graph.app.intake import scans_at
from slarm_graph.backend import SlamResult
from slarm_graph.config import MappingConfig
from slarm_graph.geometry import Pose2
from slarm_graph.mapping import render
from slarm_graph.readings import LaserScan, Source
from slarm_graph.trajectory import Trajectory


def placed(slam: SlamResult, source: Source, config: MappingConfig) -> SlamResult:
    """Start where the source says the robot started; at the origin where it does not know.

    Parameters
    ----------
    slam : SlamResult
        In the backend's own map frame.
    source : Source
        Read to its end.
    config : MappingConfig
    """
    truth = source.info().truth
    if truth is None or not len(truth):
        return slam
    mine_from_robot = Pose2.from_array(slam.trajectory.poses[0])
    start = Pose2.from_array(truth.at(slam.trajectory.stamps_ns[:1])[0])
    trajectory = slam.trajectory.transformed(start @ mine_from_robot.inverse())
    return along(slam, trajectory, scans_at(source, trajectory.stamps_ns), config)


def along(
    slam: SlamResult, trajectory: Trajectory, scans: Sequence[LaserScan], config: MappingConfig
) -> SlamResult:
    """Replace a result's trajectory, and its grid by one rendered anew from the scans of it."""
    return replace(slam, trajectory=trajectory, grid=render(scans, trajectory, config))
