# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Moving returns: those where another scan nearby on the path looked through.

A wall stops every beam that is sent its way. Where beams went on, to something farther or to no
return at all, whatever another scan meets there has come or gone in between.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slarm_graph.consistency.evidence import CLEARANCE_M, TOLERANCE_M
from slarm_graph.frontends.scans.odometry_filter import Prediction
from slarm_graph.geometry import Floats
from slarm_graph.kernels import kernel
from slarm_graph.readings import LaserScan

_LEAST_SECTOR_RAD = math.radians(2.0)
"""Least width of a sector: two beams of a usual laser, one a degree."""
_BEAMS_PER_SECTOR = 1.5
"""Least width in beams: between two beams no sector is empty."""
FARTHEST_M = 15.0
"""Farther returns are taken for static [m]: a degree of error moves them by `TOLERANCE_M`."""


@dataclass(frozen=True, slots=True)
class ClearSectors:
    """How far a scan looks, by sectors of bearing.

    Parameters
    ----------
    laser : (2,) float64
        Where the sectors meet, in the robot's frame [m].
    ranges_m : (B,) float64
        Shortest range of the beams in every sector of the robot's frame, from -pi to pi; 0 where
        nothing is known. A beam without a return looks as far as the scan's farthest return.
    returned_m : (B,) float64
        The same, and 0 where a beam has not returned.
    """

    laser: Floats
    ranges_m: Floats
    returned_m: Floats


LOOKS_NOWHERE = ClearSectors(np.zeros(2), np.zeros(1), np.zeros(1))
"""Of a scan of which only the returns are known."""


def clear_sectors(
    scan: LaserScan, max_range_m: float, robot_rate: Floats | None = None
) -> ClearSectors:
    """Measure how far a scan looks: where its beams are no more than `TOLERANCE_M` apart.

    Parameters
    ----------
    scan : LaserScan
    max_range_m : float
        Farther returns say nothing: in old logs they stand for none.
    robot_rate : (3,) float64, optional
        Robot's velocity in its own frame [m/s, m/s, rad/s], to undo the turn within the scan.
    """
    step_rad = scan.angle_increment_rad
    if robot_rate is not None:
        step_rad += float(robot_rate[2]) * scan.time_increment_s
    sector_rad = max(_LEAST_SECTOR_RAD, _BEAMS_PER_SECTOR * abs(step_rad))
    count = max(1, math.floor(2.0 * math.pi / sector_rad))
    mount = scan.robot_from_laser.as_array()
    first_rad = float(mount[2]) + scan.angle_min_rad
    is_used = scan.is_return() & (scan.ranges_m <= max_range_m)
    dense_m = TOLERANCE_M / max(abs(step_rad), TOLERANCE_M / FARTHEST_M) + CLEARANCE_M
    returned_m = np.where(is_used, scan.ranges_m, 0.0)
    ranges_m = np.where(scan.is_clear(), np.max(returned_m, initial=0.0), returned_m)
    return ClearSectors(
        mount[:2],
        _shortest_ranges(np.minimum(ranges_m, dense_m), first_rad, step_rad, count),
        _shortest_ranges(np.minimum(returned_m, dense_m), first_rad, step_rad, count),
    )


def certain_within_m(predictions: Sequence[Prediction]) -> float:
    """Range up to which predictions tell, to `TOLERANCE_M`, where a return is in the map [m].

    Parameters
    ----------
    predictions : sequence of Prediction
        The likeliest first, by whose standard deviation and by the others' distance it is judged.
        Of the former 2.33 in place of 1 leave hall 40 lost (6.2 m): whoever passes by is wrongly
        kept more often than a small thing that stands is wrongly left out.
    """
    first = predictions[0]
    off = np.sqrt(first.covariance.diagonal())
    off += np.max([np.abs(first.motion - p.motion) for p in predictions], axis=0)
    x_m, y_m, turn_rad = off.tolist()
    sure_m = TOLERANCE_M - math.hypot(x_m, y_m)
    reach_m = sure_m / turn_rad if turn_rad > 0.0 else math.copysign(math.inf, sure_m)
    return min(FARTHEST_M, reach_m)


@kernel
def _shortest_ranges(ranges: Floats, first: float, step: float, count: int) -> Floats:
    """Shortest range of the beams in each of so many sectors; 0 where there is none."""
    shortest = np.full(count, np.inf)
    for i in range(len(ranges)):
        sector = _sector_of(first + i * step, count)
        shortest[sector] = min(shortest[sector], ranges[i])
    for sector in range(count):
        if math.isinf(shortest[sector]):
            shortest[sector] = 0.0
    return shortest


@kernel
def _sector_of(bearing: float, count: int) -> int:
    share = (bearing + math.pi) / (2.0 * math.pi)
    return int(count * (share - math.floor(share))) % count


@kernel
def seen_through(
    points: Floats,
    observer_from_robot: Floats,
    laser: Floats,
    clear: Floats,
    within_m: float,
) -> NDArray[np.bool_]:
    """Which points another scan has looked through.

    Every one of its beams that passes within `TOLERANCE_M` must go on for `CLEARANCE_M`.

    Parameters
    ----------
    points : (K, 2) float64
        In a robot's frame [m].
    observer_from_robot : (3,) float64
        Of that robot, in the frame of the robot that looked.
    laser : (2,) float64
    clear : (B,) float64
        The other scan's `ClearSectors`.
    within_m : float
        Range beyond which nothing is said.

    Returns
    -------
    (K,) bool
    """
    c, s = math.cos(observer_from_robot[2]), math.sin(observer_from_robot[2])
    through, count = np.zeros(len(points), dtype=np.bool_), len(clear)
    for k in range(len(points)):
        x = observer_from_robot[0] + c * points[k, 0] - s * points[k, 1] - laser[0]
        y = observer_from_robot[1] + s * points[k, 0] + c * points[k, 1] - laser[1]
        r = math.sqrt(x * x + y * y)
        bearing = math.atan2(y, x)
        if not TOLERANCE_M < r < within_m or clear[_sector_of(bearing, count)] < r + CLEARANCE_M:
            continue
        aside = math.asin(TOLERANCE_M / r)
        first = _sector_of(bearing - aside, count)
        sectors = (_sector_of(bearing + aside, count) - first) % count + 1
        through[k] = True
        for i in range(sectors):
            if clear[(first + i) % count] < r + CLEARANCE_M:
                through[k] = False
    return through
