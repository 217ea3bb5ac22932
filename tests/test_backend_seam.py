# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""What all backends have in common."""

from __future__ import annotations

import numpy as np
import pytest

from slarm_graph import backends
from slarm_graph.backend import silent
from slarm_graph.config import RunConfig
from slarm_graph.files.worlds import load_world
from slarm_graph.frontends.simulation.world_recording import SourceFromWorld, waypoints
from slarm_graph.readings import Reading


@pytest.fixture(scope="module")
def readings() -> list[Reading]:
    way = waypoints(np.array([[-3.0, -2.8], [0.5, -2.6]]))
    room = load_world("paper_room")
    return list(SourceFromWorld(room, RunConfig().simulation, seed=1, script=way))


@pytest.mark.parametrize("name", ["odometry", "gmapping", "pose_graph"])
def test_every_reading_gets_a_pose_and_asking_twice_changes_nothing(
    name: str, readings: list[Reading]
) -> None:
    config = RunConfig(backend=name)
    backend = backends.make(name, config, np.random.default_rng(0), silent)
    for reading in readings:
        backend.update(reading)
    first, second = backend.result().trajectory, backend.result().trajectory
    np.testing.assert_array_equal(first.stamps_ns, [r.stamp_ns for r in readings])
    np.testing.assert_array_equal(first.poses, second.poses)
