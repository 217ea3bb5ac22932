# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The null backend and the registry it is found in."""

from __future__ import annotations

import numpy as np
import pytest

from slarm_graph import backends
from slarm_graph.backend import SlamBackend
from slarm_graph.config import RunConfig
from slarm_graph.errors import BadInput, RunFailed
from slarm_graph.geometry import Pose2, between
from slarm_graph.readings import LaserScan, Reading

POSES = [Pose2(1.0, 2.0, 0.5), Pose2(1.2, 2.1, 0.6), None, Pose2(1.6, 2.4, 1.0)]


def made(name: str = "odometry") -> SlamBackend:
    return backends.make(name, RunConfig(), np.random.default_rng(0), lambda _message: None)


def reading(index: int, pose: Pose2 | None) -> Reading:
    return Reading(index * 10**8, LaserScan(np.full(12, 2.0), 0.0, 0.5, 0.1, 5.0), pose)


def test_every_reading_gets_a_pose_seen_from_the_first() -> None:
    backend = made()
    for index, pose in enumerate(POSES):
        backend.update(reading(index, pose))
    result = backend.result()
    assert result.trajectory.stamps_ns.tolist() == [0, 10**8, 2 * 10**8, 3 * 10**8]
    known = np.array([p.as_array() for p in POSES if p is not None])
    expected = between(known[0], known)
    assert np.allclose(result.trajectory.poses[[0, 1, 3]], expected)
    assert np.allclose(result.trajectory.poses[2], expected[1])
    assert np.allclose(backend.map_from_robot().as_array(), expected[2])
    assert result.notices == ("1 scan without odometry given the last pose before",)


def test_needs_odometry_and_says_so() -> None:
    backend = made()
    backend.update(reading(0, None))
    with pytest.raises(BadInput, match="backend odometry needs odometry"):
        backend.result()


def test_needs_a_scan() -> None:
    with pytest.raises(RunFailed, match="no scan"):
        made().result()
