# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""A pose for every scan out of corrected poses for some, and a map that grows with them."""

from __future__ import annotations

import copy
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from slarm_graph.config import MappingConfig
from slarm_graph.geometry import Floats, between, compose
from slarm_graph.grid import OccupancyGrid
from slarm_graph.mapping import GridMapper, pose_rates
from slarm_graph.readings import LaserScan
from slarm_graph.trajectory import Trajectory


def fill_path(
    stamps_ns: NDArray[np.int64], local: Floats, corrected: NDArray[np.int64], path: Floats
) -> Floats:
    """Carry a smooth path over to corrected poses; what is left of a step is spread over time.

    Parameters
    ----------
    stamps_ns : (N,) int64
    local : (N, 3) float64
        `local_from_robot` at every scan, smooth but drifting.
    corrected : (U,) int64
        Increasing indices of the scans with a corrected pose; the first is 0.
    path : (U, 3) float64
        Their `map_from_robot`.

    Returns
    -------
    (N, 3) float64
        `map_from_robot` at every scan, equal to `path` at the corrected ones.
    """
    scans = np.arange(len(stamps_ns))
    step = np.searchsorted(corrected, scans, side="right") - 1
    filled = compose(path[step], between(local[corrected[step]], local))
    if len(corrected) < 2:
        return filled
    left = compose(path[:-1], between(local[corrected[:-1]], local[corrected[1:]]))
    residual = np.concatenate([between(left, path[1:]), np.zeros((1, 3))])
    span_ns = np.append(np.diff(stamps_ns[corrected]), 1)
    share = (stamps_ns - stamps_ns[corrected[step]]) / span_ns[step]
    return compose(filled, share[:, None] * residual[step])


class GrowingMap:
    """Renders a growing path again and again, starting over only when its past has changed.

    Parameters
    ----------
    config : MappingConfig
    """

    def __init__(self, config: MappingConfig) -> None:
        self._config = config
        self._mapper = GridMapper(config)
        self._rendered: Floats = np.empty((0, 6))

    def render(
        self, scans: Sequence[LaserScan], trajectory: Trajectory, final: int
    ) -> OccupancyGrid:
        """Render all scans; the poses from index `final` on are expected to change."""
        rates = pose_rates(trajectory)
        past = np.hstack([trajectory.poses, rates])[:final]
        done = len(self._rendered)
        if done > final or not np.array_equal(past[:done], self._rendered):
            self._mapper, done = GridMapper(self._config), 0
        for i in range(done, final):
            self._mapper.add(scans[i], trajectory.poses[i], rates[i])
        self._rendered = past
        mapper = copy.deepcopy(self._mapper)
        for i in range(final, len(scans)):
            mapper.add(scans[i], trajectory.poses[i], rates[i])
        return mapper.grid()
