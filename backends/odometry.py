# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The null backend: the odometry as recorded, the baseline every other has to beat."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.random import Generator

from slarm_graph.backend import Heartbeat, SlamResult, silent
from slarm_graph.config import FrontendConfig, Stage
from slarm_graph.counts import count_of
from slarm_graph.errors import BadInput, RunFailed
from slarm_graph.geometry import Floats, Pose2, compose, invert
from slarm_graph.readings import Reading
from slarm_graph.snapshots import State, restore_state, state_of
from slarm_graph.trajectory import Trajectory


class OdometryBackend:
    """Wheel odometry as recorded: the baseline every other backend has to beat.

    The map's origin is the robot's first pose.

    Parameters
    ----------
    settings, frontend, rng, heartbeat
        Not used: nothing is set, drawn or long.
    """

    settings: ClassVar[type[Stage]] = Stage

    def __init__(
        self,
        settings: Stage,
        frontend: FrontendConfig,
        rng: Generator,
        heartbeat: Heartbeat = silent,
    ) -> None:
        del settings, frontend, rng, heartbeat
        self._stamps_ns: list[int] = []
        self._odometry: list[Pose2 | None] = []

    def update(self, reading: Reading) -> None:
        """Take one reading."""
        self._stamps_ns.append(reading.stamp_ns)
        self._odometry.append(reading.odom_from_robot)

    def map_from_robot(self) -> Pose2:
        """Return the last known odometry pose relative to the first."""
        known = [pose for pose in (self._first(), self._last()) if pose is not None]
        return known[0].between(known[-1]) if known else Pose2()

    def result(self) -> SlamResult:
        """Return the odometry as the trajectory."""
        if not self._stamps_ns:
            raise RunFailed("no scan was usable")
        poses, missing = self._filled()
        trajectory = Trajectory(np.array(self._stamps_ns), compose(invert(poses[0]), poses))
        notices = (
            (f"{count_of(missing, 'scan')} without odometry given the last pose before",)
            if missing
            else ()
        )
        return SlamResult(trajectory, notices=notices)

    def snapshot(self) -> State:
        """Return all readings' odometry."""
        return state_of(self)

    def restore(self, state: State) -> None:
        """Continue from a snapshot."""
        restore_state(state, self)

    def _filled(self) -> tuple[Floats, int]:
        """Return `odom_from_robot` (N, 3), the last pose held in gaps, and their number."""
        held = self._first()
        if held is None:
            raise BadInput(
                "backend odometry needs odometry, and the recording has none;"
                " use --backend pose_graph or gmapping"
            )
        poses, missing = [], 0
        for pose in self._odometry:
            missing += pose is None
            held = pose or held
            poses.append(held.as_array())
        return np.array(poses), missing

    def _first(self) -> Pose2 | None:
        return next((pose for pose in self._odometry if pose is not None), None)

    def _last(self) -> Pose2 | None:
        return next((pose for pose in reversed(self._odometry) if pose is not None), None)
