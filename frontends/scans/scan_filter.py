# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""From a raw scan to the points worth matching: range filter, deskew, thinning."""

from __future__ import annotations

import math

import numpy as np

from slarm_graph.config import FrontendConfig
from slarm_graph.geometry import Floats
from slarm_graph.kernels import kernel
from slarm_graph.readings import LaserScan


def points_for_matching(
    scan: LaserScan,
    config: FrontendConfig,
    robot_rate: Floats | None = None,
    at_beam: float = 0.0,
) -> Floats:
    """Returns of a scan in the robot's frame at one beam's instant, in beam order.

    Parameters
    ----------
    scan : LaserScan
    config : FrontendConfig
    robot_rate : (3,) float64, optional
        Robot's velocity in its own frame [m/s, m/s, rad/s], to undo the motion within the scan.
        Used only when `config.deskew` is set and the scan knows its `time_increment_s`.
    at_beam : float
        Beam in whose frame the points are wanted; by default the first.

    Returns
    -------
    (K, 2) float64 [m]
        Thinned so that neighbours are `config.point_spacing_m` apart where beams are denser.
    """
    per_beam = np.zeros(3)
    if robot_rate is not None and config.deskew:
        per_beam = np.asarray(robot_rate, dtype=np.float64) * scan.time_increment_s
    return np.asarray(
        _points(
            np.asarray(scan.ranges_m, dtype=np.float64),
            scan.angle_min_rad,
            scan.angle_increment_rad,
            scan.range_min_m,
            min(scan.range_max_m, config.max_range_m),
            scan.robot_from_laser.as_array(),
            per_beam,
            at_beam,
            config.point_spacing_m,
        )
    )


@kernel
def _points(
    ranges: Floats,
    angle_min: float,
    angle_increment: float,
    range_min: float,
    range_max: float,
    robot_from_laser: Floats,
    motion_per_beam: Floats,
    at_beam: float,
    spacing: float,
) -> Floats:
    """Project, deskew and thin; NaN and infinite ranges fail both comparisons."""
    points = np.empty((len(ranges), 2))
    count = 0
    for i in range(len(ranges)):
        r = ranges[i]
        if not (r >= range_min and r <= range_max):
            continue
        later = i - at_beam
        turn = later * motion_per_beam[2]
        c, s = math.cos(turn), math.sin(turn)
        direction = turn + robot_from_laser[2] + angle_min + i * angle_increment
        x = later * motion_per_beam[0] + c * robot_from_laser[0] - s * robot_from_laser[1]
        y = later * motion_per_beam[1] + s * robot_from_laser[0] + c * robot_from_laser[1]
        x += r * math.cos(direction)
        y += r * math.sin(direction)
        if count > 0:
            dx, dy = x - points[count - 1, 0], y - points[count - 1, 1]
            if dx * dx + dy * dy < spacing * spacing:
                continue
        points[count, 0] = x
        points[count, 1] = y
        count += 1
    return points[:count].copy()
