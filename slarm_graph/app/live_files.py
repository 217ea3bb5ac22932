# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""What is known while a robot explores, as files: a crash does not take the drive with it."""

from __future__ import annotations

import time

import numpy as np

from slarm_graph.app.driven_world import DrivenWorld
from slarm_graph.app.outputs import save_map, save_readings, save_trajectory
from slarm_graph.app.run_folder import RunFolder
from slarm_graph.exploration.closed_loop import ClosedLoop
from slarm_graph.exploration.live_map import FREE, OCCUPIED
from slarm_graph.geometry import Pose2
from slarm_graph.trajectory import Trajectory


class LiveFiles:
    """Writes readings, path and map every now and then, as the robot believes them at the time.

    Parameters
    ----------
    folder : RunFolder
    driven : DrivenWorld
    loop : ClosedLoop
        Only looked at: what is written when changes nothing of the drive.
    every_s : float
        Least wall time between two times of writing [s].
    """

    def __init__(
        self, folder: RunFolder, driven: DrivenWorld, loop: ClosedLoop, every_s: float
    ) -> None:
        self._folder, self._driven, self._loop = folder, driven, loop
        self._every_s, self._written_s = every_s, time.monotonic()
        self._poses: list[Pose2] = []

    def note(self) -> None:
        """Remember where the robot believes to be, and write when it is time."""
        self._poses.append(self._loop.pose)
        if time.monotonic() - self._written_s >= self._every_s:
            self.write()

    def write(self) -> None:
        """Write `odometry.tum`, `scans.csv`, `trajectory.tum` and `map.pgm/.yaml`."""
        save_readings(self._folder, self._driven.intake, self._driven.scan_statuses())
        if self._poses:
            stamps_ns = np.array(self._driven.intake.stamps_ns[: len(self._poses)])
            poses = np.array([pose.as_array() for pose in self._poses])
            save_trajectory(self._folder, "trajectory", Trajectory(stamps_ns, poses))
        live = self._loop.live
        occupied, free = live.states == OCCUPIED, live.states == FREE
        save_map(self._folder, "map", live.driving_geometry, occupied, free)
        self._written_s = time.monotonic()
