# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""What all backends have in common."""

from __future__ import annotations

import numpy as np
import pytest

from slarm_graph import backends
from slarm_graph.backend import KnowsTrajectory, silent, trajectory_of
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
def test_the_trajectory_alone_is_that_of_the_result(name: str, readings: list[Reading]) -> None:
    config = RunConfig(backend=name)
    backend = backends.make(name, config, np.random.default_rng(0), silent)
    for reading in readings:
        backend.update(reading)
    alone, whole = trajectory_of(backend), backend.result().trajectory
    assert isinstance(backend, KnowsTrajectory) == (name != "odometry")
    np.testing.assert_array_equal(alone.stamps_ns, [r.stamp_ns for r in readings])
    np.testing.assert_array_equal(alone.stamps_ns, whole.stamps_ns)
    np.testing.assert_array_equal(alone.poses, whole.poses)
