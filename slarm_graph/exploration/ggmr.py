# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The explorer `ggmr`: the paper's Algorithm 1 in closed loop."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from slarm_graph.config import DrivingConfig, Stage
from slarm_graph.exploration.algorithm_1 import GgmrPath, ggmr_path
from slarm_graph.exploration.coverage_grid import (
    OPEN,
    VISITED,
    CoverageGrid,
    start_cell,
)
from slarm_graph.exploration.explorer import Finished, Leg
from slarm_graph.exploration.paths import leg_along
from slarm_graph.geometry import Pose2

_HORIZON_CELLS: Final = 400
"""Planning horizon, 100 m at 0.25 m: the map has changed long before the robot comes to its end."""
_MAX_ATTEMPTS: Final = 4
"""Times a cell is targeted before it is given up: open on the map, but the robot finds it is
not."""


class Ggmr:
    """Algorithm 1 of the paper in closed loop: every step is decided on the map so far.

    A cell that was next several times without the robot reaching it is skipped, so that a map that
    keeps changing cannot hold the robot forever.
    """

    def __init__(self, settings: Stage, driving: DrivingConfig) -> None:
        del settings, driving
        self._last: GgmrPath | None = None
        self._attempts: NDArray[np.uint8] | None = None

    def next_goal(self, coverage: CoverageGrid, pose: Pose2) -> Leg | Finished:
        """Run Algorithm 1 from the robot's cell for some metres."""
        coverage = self._without_hopeless(coverage)
        start = start_cell(coverage, pose)
        if start is None:
            return Finished("no free cell near the robot")
        path = ggmr_path(coverage, start, facing=self._facing(start), max_cells=_HORIZON_CELLS)
        if path.complete and len(path.cells) == 1:
            return Finished("no reachable cell is left")
        self._remember(path, coverage)
        return leg_along(coverage, pose, path.cells.astype(np.int64), more=not path.complete)

    def _facing(self, start: tuple[int, int]) -> int:
        """Direction of travel of the last leg at the robot's present cell."""
        if self._last is None:
            return 0
        here = np.flatnonzero((self._last.cells == start).all(axis=1))
        return int(self._last.facing[here[-1]]) if len(here) else 0

    def _remember(self, path: GgmrPath, coverage: CoverageGrid) -> None:
        self._last = path
        assert self._attempts is not None
        is_open = coverage.codes[path.cells[:, 0], path.cells[:, 1]] == OPEN
        if is_open.any():
            row, col = path.cells[np.argmax(is_open)]
            self._attempts[row, col] += 1

    def _without_hopeless(self, coverage: CoverageGrid) -> CoverageGrid:
        if self._attempts is None or self._attempts.shape != coverage.codes.shape:
            self._attempts = np.zeros(coverage.codes.shape, dtype=np.uint8)
        hopeless = (self._attempts >= _MAX_ATTEMPTS) & (coverage.codes == OPEN)
        if not hopeless.any():
            return coverage
        return replace(coverage, codes=np.where(hopeless, VISITED, coverage.codes).astype(np.uint8))
