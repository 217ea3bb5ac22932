# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Maps out of scans and a trajectory: at once, or kept in line while the trajectory changes."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence

import numpy as np

from slarm_graph.config import MappingConfig
from slarm_graph.geometry import Floats
from slarm_graph.grid import OccupancyGrid
from slarm_graph.mapping.beams import end_points_m, pose_rates
from slarm_graph.mapping.mapper import GridMapper
from slarm_graph.readings import LaserScan
from slarm_graph.trajectory import Trajectory

_log = logging.getLogger(__name__)

_DIGITS = 9
"""Of a side in metres: 3 x 0.05 m is 0.15, and not 0.15000000000000002."""
_SLACK_CELLS = 4.0
"""A box covers a cell more than its length says, and the mapper keeps one free on either side."""


def render(
    scans: Sequence[LaserScan], trajectory: Trajectory, config: MappingConfig
) -> OccupancyGrid:
    """Render scans at known poses into an occupancy grid.

    Parameters
    ----------
    scans : sequence of N LaserScan
    trajectory : Trajectory of N poses
        `map_from_robot` at each scan's first beam.
    config : MappingConfig
        Cells are coarser where there would be more than `max_cells`.
    """
    mapper = GridMapper(_drawable(scans, trajectory, config))
    motions = list(zip(scans, trajectory.poses, pose_rates(trajectory), strict=True))
    # Moving the counts of a clinic to ever larger grids takes as long as drawing them.
    for motion in motions:
        mapper.make_room(*motion)
    for motion in motions:
        mapper.add(*motion)
    return mapper.grid()


def _drawable(
    scans: Sequence[LaserScan], trajectory: Trajectory, config: MappingConfig
) -> MappingConfig:
    """Make cells so coarse that no more than `max_cells` lie in the box around all beams."""
    reach_m = min(config.max_range_m, max((scan.range_max_m for scan in scans), default=0.0))
    places = trajectory.poses[:, :2]
    if len(scans) == 0 or _cells(places, config, 2.0 * reach_m) <= config.max_cells:
        return config
    ends = np.concatenate([places, end_points_m(scans, trajectory, config)])
    cells = _cells(ends, config, 0.0)
    if cells <= config.max_cells:
        return config
    times = math.ceil(math.sqrt(cells / config.max_cells))
    coarser_m = round(config.resolution_m * times, _DIGITS)
    wide, high = np.ptp(ends, axis=0)
    _log.warning(
        f"the map is {wide:.0f} x {high:.0f} m, more than mapping.max_cells of"
        f" {config.resolution_m:g} m; it is drawn in cells of {coarser_m:g} m. Where the site is"
        " smaller, the trajectory is wrong"
    )
    return config.model_copy(update={"resolution_m": coarser_m})


def _cells(points: Floats, config: MappingConfig, beyond_m: float) -> float:
    """Cells of the box around points (N, 2) [m], wider and higher by so much."""
    sides = np.ptp(points, axis=0) + beyond_m
    return float(np.prod(np.floor(sides / config.resolution_m) + _SLACK_CELLS))


class Rendering:
    """A map kept in line with a path that grows and is corrected now and then.

    Counts of beams add up, so a scan whose pose has changed is taken back and drawn anew; the map
    is always the one that drawing all of them at their latest poses would give.

    Parameters
    ----------
    mapper : GridMapper
        Still empty.
    """

    def __init__(self, mapper: GridMapper) -> None:
        self.mapper = mapper
        self._drawn: list[Floats | None] = []

    def add(self, scan: LaserScan, pose: Floats, pose_rate: Floats) -> None:
        """Draw the next scan at a pose (3,) that changes at a rate (3,)."""
        self._drawn.append(_drawing(scan, pose, pose_rate))
        self._draw(scan, self._drawn[-1])

    def follow(self, scans: Sequence[LaserScan], trajectory: Trajectory, every: int = 1) -> None:
        """Bring everything drawn in line with the poses of all N scans.

        Parameters
        ----------
        scans : sequence of N LaserScan
        trajectory : Trajectory of N poses
        every : int
            How many scans to leave all but one out of.
        """
        wanted: list[Floats | None] = [None] * len(scans)
        motions = zip(scans, trajectory.poses, pose_rates(trajectory), strict=True)
        wanted[::every] = [_drawing(*motion) for motion in motions][::every]
        drawn = self._drawn + [None] * (len(scans) - len(self._drawn))
        changed = [i for i in range(len(scans)) if not _same(drawn[i], wanted[i])]
        if 2 * every * len(changed) > len(scans):
            self.mapper.clear()
            drawn, changed = [None] * len(scans), list(range(0, len(scans), every))
        for i in changed:
            self._draw(scans[i], drawn[i], times=-1)
            self._draw(scans[i], wanted[i])
        self._drawn = wanted

    def _draw(self, scan: LaserScan, drawing: Floats | None, times: int = 1) -> None:
        if drawing is not None:
            self.mapper.add(scan, drawing[:3], drawing[3:], times=times)


def _drawing(scan: LaserScan, pose: Floats, pose_rate: Floats) -> Floats:
    """Pose and rate (6,) to draw a scan with; the rate is no matter in one without time."""
    return np.concatenate([pose, pose_rate if scan.time_increment_s else np.zeros(3)])


def _same(one: Floats | None, other: Floats | None) -> bool:
    if one is None or other is None:
        return one is other
    return bool((one == other).all())
