# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Tables and notices of the particle filter."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slarm_graph.backend import Table
from slarm_graph.backends.particle_maps import memory_notice
from slarm_graph.backends.rbpf import MappingFilter
from slarm_graph.backends.second_pass import MISSED_SIGMAS
from slarm_graph.counts import count_of
from slarm_graph.geometry import Floats

_UPDATE_COLUMNS = (
    "stamp_ns",
    "n_eff",
    "resampled",
    "distinct_ancestors",
    "common_update",
    "mean_x_m",
    "mean_y_m",
    "mean_theta_rad",
)


def update_table(stamps_ns: NDArray[np.int64], particles: MappingFilter) -> Table:
    """N_eff, resampling, ancestors and mean pose of every update.

    Parameters
    ----------
    stamps_ns : (U,) int64
        Of the first scan and of every update.
    particles : MappingFilter
    """
    rows = tuple(
        (
            stamp_ns,
            chosen.n_eff,
            int(chosen.resampled),
            chosen.distinct_ancestors,
            chosen.common_update,
            *chosen.mean.tolist(),
        )
        for stamp_ns, chosen in zip(stamps_ns[1:].tolist(), particles.selections, strict=True)
    )
    return Table("particles", _UPDATE_COLUMNS, rows)


def particle_notices(particles: MappingFilter) -> tuple[str, ...]:
    """Report the numbers of particles, updates and resamplings, and their memory."""
    config, updates = particles.config, len(particles.selections) + 1
    resamplings = sum(chosen.resampled for chosen in particles.selections)
    return (
        *memory_notice(config.particles, config.maps),
        f"{count_of(config.particles, 'particle')}, {count_of(updates, 'update')},"
        f" {count_of(resamplings, 'resampling')},"
        f" {particles.maps.memory_bytes / 1e6:.0f} MB of particle maps",
    )


def second_pass_notice(first: Floats, second: Floats) -> str:
    """Report how many loop closures the particles missed, before and after a second pass.

    Parameters
    ----------
    first, second : (C,) float64
        Mahalanobis distances of the closures after the first and after the second pass.
    """
    before, after = int((first > MISSED_SIGMAS).sum()), int((second > MISSED_SIGMAS).sum())
    if second.sum() < first.sum():
        end = f"the filter went over the recording again, and misses {after}"
    else:
        end = "a second pass missed them further; the first is kept, and its map may be torn there"
    return f"the particles missed {before} of {len(first)} loop closures: {end}"
