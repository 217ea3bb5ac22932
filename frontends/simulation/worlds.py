# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Choosing what moves the robot in a world: our simulator, or physics nobody here wrote."""

from __future__ import annotations

import numpy as np

from slarm_graph.config import SimulationConfig
from slarm_graph.world import World, WorldMap


def make_world(world: WorldMap, config: SimulationConfig, rng: np.random.Generator) -> World:
    """Put a robot into a world, moved by `config.engine`.

    Raises
    ------
    ImportError
        When the engine's package is not installed; says how to install it.
    BadInput
        When the robot would start inside a solid.
    """
    if config.engine == "mujoco":
        from slarm_graph.frontends.simulation.mujoco_world import MujocoWorld

        return MujocoWorld(world, config, rng)
    from slarm_graph.frontends.simulation.simulator import SimulatedWorld

    return SimulatedWorld(world, config, rng)
