# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The explorer does not drive on on a map that contradicts itself: it goes back to find itself."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from test_closed_loop import TruthBackend, random_room, share_of_reachable

from slarm_graph import parts
from slarm_graph.backend import SlamResult
from slarm_graph.config import ExploreConfig, RunConfig, SimulationConfig
from slarm_graph.exploration.closed_loop import ClosedLoop, Exploration
from slarm_graph.frontends.simulation.simulator import SimulatedWorld
from slarm_graph.geometry import Floats
from slarm_graph.trajectory import Trajectory

ROOM = random_room(3)
CONFIG = ExploreConfig(explorer="ggmr", resolution_m=0.15)
LEAST_READINGS = 800
"""Before the map is told wrong: 24 m of way, so that every wall was seen before and is again."""


BACK_M = 0.8
"""Nearer to the start than where the map was found to be torn, by more than the robot is long."""


def home_m(here: Floats) -> float:
    """Distance to the start [m]."""
    return math.hypot(here[0] - ROOM.start.x, here[1] - ROOM.start.y)


class Torn(TruthBackend):
    """Puts the first half of the way 0.8 m off, until the robot has gone back towards its start."""

    def __init__(self, world: SimulatedWorld, *, heals: bool) -> None:
        super().__init__(world)
        self._heals = heals
        self.torn_at: Floats | None = None
        self.healed_at: Floats | None = None

    def result(self) -> SlamResult:
        true = super().result()
        poses = true.trajectory.poses.copy()
        if len(poses) < LEAST_READINGS or self.healed_at is not None:
            return true
        here = poses[-1, :2].copy()
        self.torn_at = here if self.torn_at is None else self.torn_at
        if self._heals and home_m(here) < home_m(self.torn_at) - BACK_M:
            self.healed_at = here
            return true
        poses[: len(poses) // 2, :2] += (-0.6, -0.6)
        return replace(true, trajectory=Trajectory(true.trajectory.stamps_ns, poses))


def drive(*, heals: bool) -> tuple[Exploration, Torn]:
    world = SimulatedWorld(ROOM, SimulationConfig(), np.random.default_rng(0))
    backend, extent = Torn(world, heals=heals), ROOM.extent_m()
    explorer = parts.make("explorer", CONFIG.explorer, RunConfig(), CONFIG.driving)
    loop = ClosedLoop(world, backend, explorer, CONFIG, extent_m=extent, start=ROOM.start)
    while loop.step():
        assert loop.survey.readings < 6000
    return loop.outcome(), backend


def test_a_map_that_was_torn_is_explored_to_its_end() -> None:
    outcome, backend = drive(heals=True)
    assert backend.healed_at is not None
    assert "contradicts" not in outcome.finished.reason
    observed, footprint = share_of_reachable(ROOM, outcome)
    assert observed > 0.97
    assert footprint > 0.85


def test_on_a_map_that_stays_torn_the_robot_goes_back_and_says_so() -> None:
    outcome, backend = drive(heals=False)
    assert "contradicts itself" in outcome.finished.reason
    assert backend.torn_at is not None
    assert home_m(outcome.truth.poses[-1, :2]) < home_m(backend.torn_at) - BACK_M
    assert outcome.report.collisions == 0
