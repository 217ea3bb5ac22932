# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""A backend that is told the truth: with it, explorers differ by what they decide alone."""

from __future__ import annotations

import numpy as np

from slarm_graph.backend import SlamResult
from slarm_graph.geometry import Floats, Pose2
from slarm_graph.readings import Reading
from slarm_graph.trajectory import Trajectory
from slarm_graph.world import World


class TruthBackend:
    """Knows where the robot is in a world; makes no map of its own."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._stamps_ns: list[int] = []
        self._poses: list[Floats] = []

    def update(self, reading: Reading) -> None:
        """Note the true pose."""
        self._stamps_ns.append(reading.stamp_ns)
        self._poses.append(self._world.truth().as_array())

    def map_from_robot(self) -> Pose2:
        """Return the true pose."""
        return self._world.truth()

    def result(self) -> SlamResult:
        """Return the true trajectory."""
        return SlamResult(Trajectory(np.array(self._stamps_ns), np.array(self._poses)))

    def snapshot(self) -> bytes:
        """There is nothing to keep."""
        return b""

    def restore(self, state: bytes) -> None:
        """There is nothing to restore."""
