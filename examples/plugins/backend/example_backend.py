# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""A SLAM backend of one's own.

slarm run your.bag --backend scaled_odometry --set scaled_odometry.scale=1.02
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.random import Generator
from pydantic import Field

from slarm_graph import (
    FrontendConfig,
    Heartbeat,
    Pose2,
    Reading,
    RunFailed,
    SlamResult,
    Stage,
    State,
    Trajectory,
    restore_state,
    state_of,
)


class ScaledOdometryConfig(Stage):
    """The backend `scaled_odometry`."""

    scale: float = Field(default=1.0, gt=0)
    """True travel over what the wheels report."""


class ScaledOdometry:
    """Wheel odometry, its travel multiplied by a factor."""

    settings: ClassVar[type[Stage]] = ScaledOdometryConfig

    def __init__(
        self,
        settings: ScaledOdometryConfig,
        frontend: FrontendConfig,
        rng: Generator,
        heartbeat: Heartbeat,
    ) -> None:
        self._scale = settings.scale
        self._last: Pose2 | None = None
        self._stamps_ns: list[int] = []
        self._poses: list[Pose2] = []

    def update(self, reading: Reading) -> None:
        """Move on by what the wheels say."""
        now = reading.odom_from_robot or self._last or Pose2()
        moved = (self._last or now).between(now)
        scaled = Pose2(self._scale * moved.x, self._scale * moved.y, moved.theta)
        self._poses.append(self.map_from_robot() @ scaled)
        self._stamps_ns.append(reading.stamp_ns)
        self._last = now

    def map_from_robot(self) -> Pose2:
        """Return the present pose."""
        return self._poses[-1] if self._poses else Pose2()

    def result(self) -> SlamResult:
        """Return the path so far."""
        if not self._poses:
            raise RunFailed("no scan was usable")
        poses = np.array([pose.as_array() for pose in self._poses])
        return SlamResult(Trajectory(np.array(self._stamps_ns), poses))

    def snapshot(self) -> State:
        """Return the whole state, as data."""
        return state_of(self)

    def restore(self, state: State) -> None:
        """Go on from a snapshot."""
        restore_state(state, self)
