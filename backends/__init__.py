# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Readings to poses: the interchangeable SLAM backends, by name.

A backend is a class with the methods of `slarm_graph.backend.SlamBackend`, the attribute `settings`
(a `slarm_graph.config.Stage`) and the constructor `(settings, frontend: FrontendConfig,
rng: numpy.random.Generator, heartbeat: Heartbeat)`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from slarm_graph import parts

if TYPE_CHECKING:
    from numpy.random import Generator

    from slarm_graph.backend import Heartbeat, SlamBackend
    from slarm_graph.config import RunConfig

BUILT_IN = {
    "odometry": "slarm_graph.backends.odometry:OdometryBackend",
    "gmapping": "slarm_graph.backends.gmapping:GmappingBackend",
    "pose_graph": "slarm_graph.backends.pose_graph:PoseGraphBackend",
}


def make(name: str, config: RunConfig, rng: Generator, heartbeat: Heartbeat) -> SlamBackend:
    """Build a backend by name.

    Raises
    ------
    BadInput
        When there is no such backend, or something it needs is not installed.
    """
    frontend = config.frontend.with_matcher(config.section(config.frontend.matcher))
    backend: SlamBackend = parts.make("backend", name, config, frontend, rng, heartbeat)
    return backend
