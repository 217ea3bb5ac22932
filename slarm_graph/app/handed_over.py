# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""What a robot is told of a world before it starts: all of it stands in the configuration."""

from __future__ import annotations

from slarm_graph.config import RecoveryConfig, RunConfig
from slarm_graph.recovery.recover import with_sizes_of
from slarm_graph.world import WorldMap


def with_prior(world: WorldMap, config: RunConfig) -> RunConfig:
    """Fill in what `explore.prior` hands over: ceiling and laser height, and maybe sizes.

    Sizes that are given in the configuration are kept as they are.
    """
    recovery = config.recovery.model_copy(
        update={
            "ceiling_m": world.ceiling_m,
            "laser_height_m": config.simulation.lidar.height_m,
        }
    )
    if config.explore.prior == "extent+sizes":
        recovery = with_sizes_of(world, recovery)
    return config.model_copy(update={"recovery": recovery})


def with_and_without_sizes(
    world: WorldMap, recovery: RecoveryConfig
) -> tuple[RecoveryConfig, RecoveryConfig]:
    """Return the settings of recovery with all sizes known and with none."""
    return with_sizes_of(world, recovery), recovery.model_copy(update={"known_sizes": ()})
