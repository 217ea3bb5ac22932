# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Scans as beams in the map: where each begins and ends, motion within a scan undone."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from slarm_graph.config import MappingConfig
from slarm_graph.geometry import Floats, wrap_angles
from slarm_graph.kernels import kernel
from slarm_graph.readings import LaserScan
from slarm_graph.trajectory import Trajectory

_MAX_SCAN_GAP_S: Final = 1.0
"""Across a longer gap nobody knows the speed within a scan: it is ten scans of a slow laser of 10
Hz."""


def end_points_m(
    scans: Sequence[LaserScan], trajectory: Trajectory, config: MappingConfig
) -> Floats:
    """Return the end points (N, 2) [m] in the map of all returns, motion within scans undone."""
    ends = [
        beams[beams[:, 4] > 0.0, 2:4]
        for beams in (
            beams_in_map(scan, pose, rate, config.max_range_m)
            for scan, pose, rate in zip(
                scans, trajectory.poses, pose_rates(trajectory), strict=True
            )
        )
    ]
    return np.concatenate(ends) if ends else np.zeros((0, 2))


def thinned(points: Floats, at_most: int) -> Floats:
    """Leave points out evenly so that at most so many (N, 2) are left."""
    return points[:: max(1, math.ceil(len(points) / at_most))]


def pose_rates(trajectory: Trajectory) -> Floats:
    """Rate of change (N, 3) [m/s, m/s, rad/s] from each pose to the next, 0 across gaps."""
    rates = np.zeros((len(trajectory), 3))
    if len(trajectory) < 2:
        return rates
    span_s = np.diff(trajectory.stamps_ns) * 1e-9
    step = np.diff(trajectory.poses, axis=0)
    step[:, 2] = wrap_angles(step[:, 2])
    rates[:-1] = np.where((span_s < _MAX_SCAN_GAP_S)[:, None], step / span_s[:, None], 0.0)
    rates[-1] = rates[-2]
    return rates


def beams_in_map(
    scan: LaserScan, pose: Floats, pose_rate: Floats | None, max_range_m: float
) -> Floats:
    """Return usable beams (K, 5): start x, y, end x, y in the map [m], 1 where it is a hit."""
    per_beam = np.zeros(3) if pose_rate is None else pose_rate * scan.time_increment_s
    return np.asarray(
        _trace(
            scan.ranges_m.astype(np.float64),
            scan.angle_min_rad,
            scan.angle_increment_rad,
            scan.range_min_m,
            scan.range_max_m,
            min(max_range_m, scan.range_max_m),
            scan.robot_from_laser.as_array(),
            np.asarray(pose, dtype=np.float64),
            per_beam,
        )
    )


@kernel
def _trace(
    ranges: Floats,
    angle_min: float,
    angle_increment: float,
    range_min: float,
    range_max: float,
    usable_range: float,
    robot_from_laser: Floats,
    pose: Floats,
    pose_per_beam: Floats,
) -> Floats:
    """Turn ranges into segments in the map, the robot moving on between the beams."""
    beams = np.empty((len(ranges), 5))
    count = 0
    for i in range(len(ranges)):
        r = ranges[i]
        if math.isnan(r) or r < range_min or (r > range_max and r != math.inf):
            continue
        theta = pose[2] + i * pose_per_beam[2]
        c, s = math.cos(theta), math.sin(theta)
        x = pose[0] + i * pose_per_beam[0] + c * robot_from_laser[0] - s * robot_from_laser[1]
        y = pose[1] + i * pose_per_beam[1] + s * robot_from_laser[0] + c * robot_from_laser[1]
        direction = theta + robot_from_laser[2] + angle_min + i * angle_increment
        length = min(r, usable_range)
        beams[count, 0] = x
        beams[count, 1] = y
        beams[count, 2] = x + length * math.cos(direction)
        beams[count, 3] = y + length * math.sin(direction)
        beams[count, 4] = 1.0 if r <= usable_range else 0.0
        count += 1
    return beams[:count]
