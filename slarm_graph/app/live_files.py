# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""What is known while a robot explores, as files: a crash does not take the drive with it."""

from __future__ import annotations

import time

from slarm_graph.app.map_images import of_layers, save_map
from slarm_graph.app.outputs import save_readings, save_trajectory
from slarm_graph.app.run_folder import RunFolder
from slarm_graph.exploration.closed_loop import ClosedLoop
from slarm_graph.reading_log import ReadingLog


class LiveFiles:
    """Writes readings, path and map every now and then, as the robot believes them at the time.

    Parameters
    ----------
    folder : RunFolder
    log : ReadingLog
    loop : ClosedLoop
        Only looked at: what is written when changes nothing of the drive.
    every_s : float
        Least wall time between two times of writing [s].
    """

    def __init__(
        self, folder: RunFolder, log: ReadingLog, loop: ClosedLoop, every_s: float
    ) -> None:
        self._folder, self._log, self._loop = folder, log, loop
        self._every_s, self._written_s = every_s, time.monotonic()

    def maybe(self) -> None:
        """Write when it is time."""
        if time.monotonic() - self._written_s >= self._every_s:
            self.write()

    def write(self) -> None:
        """Write `odometry.tum`, `scans.csv`, `trajectory.tum` and `map.pgm/.yaml`."""
        save_readings(self._folder, self._log)
        if len(self._log):
            save_trajectory(self._folder, "trajectory", self._loop.believed)
        live = self._loop.live
        save_map(self._folder, "map", live.driving_geometry, of_layers(live.occupied, live.free))
        self._written_s = time.monotonic()
