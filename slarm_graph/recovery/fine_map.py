# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The map that a geographic map is recovered from, whatever the settings of recovery."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from slarm_graph.config import MappingConfig
from slarm_graph.grid import OccupancyGrid
from slarm_graph.mapping import end_points_m, render
from slarm_graph.readings import LaserScan
from slarm_graph.recovery.returns import Returns, gather_returns
from slarm_graph.trajectory import Trajectory

_COARSEST_M = 0.05
"""Maps are recovered at this or finer: the resolution of nearly all maps of indoor robots."""


@dataclass(frozen=True, slots=True)
class FineMap:
    """A drive's map at 0.05 m or finer: what is recovered from, whatever the settings.

    Parameters
    ----------
    grid : OccupancyGrid
    returns : Returns
        Of the laser in the map, averaged per cell of the grid.
    """

    grid: OccupancyGrid
    returns: Returns


def fine_map(
    scans: Sequence[LaserScan],
    trajectory: Trajectory,
    mapping: MappingConfig,
    resolution_m: float,
    grid: OccupancyGrid | None = None,
) -> FineMap:
    """Draw the map that cells of a resolution are recovered from; `grid` is used if fine enough."""
    fine_m = min(_COARSEST_M, resolution_m)
    fine = mapping.model_copy(update={"resolution_m": fine_m})
    if grid is None or grid.geometry.resolution_m != fine_m:
        grid = render(scans, trajectory, fine)
    return FineMap(grid, gather_returns(end_points_m(scans, trajectory, fine), fine_m))
