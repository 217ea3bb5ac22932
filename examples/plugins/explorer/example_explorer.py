# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""An explorer of one's own: `slarm explore --explorer nearest_open --set nearest_open.legs=50`."""

from __future__ import annotations

from typing import ClassVar

from pydantic import Field

from slarm_graph import CoverageGrid, DrivingConfig, Finished, Leg, Pose2, Stage
from slarm_graph.exploration.coverage_grid import OPEN, start_cell
from slarm_graph.exploration.paths import leg_along
from slarm_graph.exploration.searches import path_to_nearest


class NearestOpenConfig(Stage):
    """The explorer `nearest_open`."""

    legs: int = Field(default=500, ge=1)
    """Legs after which it has had enough."""


class NearestOpen:
    """Drive to the nearest cell that has not been visited, again and again."""

    settings: ClassVar[type[Stage]] = NearestOpenConfig

    def __init__(self, settings: NearestOpenConfig, driving: DrivingConfig) -> None:
        self._legs_left = settings.legs

    def next_goal(self, coverage: CoverageGrid, pose: Pose2) -> Leg | Finished:
        """Return the way to the nearest open cell."""
        if self._legs_left == 0:
            return Finished("it has had enough")
        self._legs_left -= 1
        start, wanted = start_cell(coverage, pose), coverage.codes == OPEN
        if start is None:
            return Finished("no free cell near the robot")
        wanted[start] = False
        cells = path_to_nearest(coverage.moves, wanted, start)
        if cells is None:
            return Finished("every cell has been visited")
        return leg_along(coverage, pose, cells, more=True)
