# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Segmentation of a scan into objects, and which of them are small enough to be dynamic."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from slarm_graph.frontends.scans.quantiles import median
from slarm_graph.geometry import Floats
from slarm_graph.kernels import kernel, kernel_with

SMALL_M = 0.8
"""Objects no wider may be dynamic: a person is 0.5 m wide, and a stride is long."""
DYNAMIC_SHARE = 0.05
"""Prior share of small objects that move: people among table legs, door frames, pillars. With 0.02
three simulated buildings are 0.20, 0.03 and 0.10 m in place of 0.42, 0.03 and 0.04, but a bare
corridor without anybody is 7 % too short in place of 3: there the last returns of its walls move
along."""
DYNAMIC_STEP_M = 0.56
"""Displacement of a person since the last keyframe: 1.4 m/s for the 0.4 s in which a robot of
0.6 m/s drives to the next."""
_APART_M = 0.3
"""Neighbouring returns farther from each other are of two objects: half a person's width."""
_GRAZING_RAD = math.radians(10.0)
"""But not where a wall met at this angle would show no more returns in between (Borges and Aldon,
"Line Extraction in 2D Range Images for Mobile Robotics", J. Intell. Robot. Syst. 40, 2004)."""
_COARSE_RAD = 0.5 / 3.0 / 3.0
"""Beams farther apart do not separate objects: of a person, 0.5 m wide and 3 m away, fewer than
three return."""


@kernel
def gap_per_range(points: Floats) -> float:
    """Largest gap between neighbouring returns of one wall, over their range.

    Infinite where the beams of points (K, 2), in beam order, are too sparse to separate small
    objects.
    """
    beams_rad = _beams_rad(points)
    if not beams_rad < _COARSE_RAD:
        return math.inf
    return math.sin(beams_rad) / math.sin(_GRAZING_RAD - beams_rad)


@kernel
def is_breakpoint(points: Floats, i: int, k: int, gap_ratio: float) -> bool:
    """Whether a gap between two of the points (K, 2) separates objects (adaptive breakpoint)."""
    near_m = min(_length(points[i, 0], points[i, 1]), _length(points[k, 0], points[k, 1]))
    return distance_m(points, i, k) > max(_APART_M, gap_ratio * near_m)


@kernel_with(inline=True)
def distance_m(points: Floats, i: int, k: int) -> float:
    """Distance of two of the points (K, 2)."""
    return _length(points[k, 0] - points[i, 0], points[k, 1] - points[i, 1])


@kernel
def is_wide(points: Floats) -> NDArray[np.bool_]:
    """Which of the points (K, 2), in beam order, belong to an object that is not small."""
    wide = np.zeros(len(points), dtype=np.bool_)
    gap_ratio, first, width_m = gap_per_range(points), 0, 0.0
    for i in range(1, len(points) + 1):
        if i == len(points) or is_breakpoint(points, i - 1, i, gap_ratio):
            for k in range(first, i):
                wide[k] = width_m > SMALL_M
            first, width_m = i, 0.0
        else:
            width_m = max(width_m, distance_m(points, first, i))
    return wide


@kernel
def _beams_rad(points: Floats) -> float:
    """Median angle between neighbouring returns (K, 2) [rad]; nan where there is but one."""
    steps_rad = np.empty(max(len(points) - 1, 0))
    bearing = math.nan
    for i in range(len(points)):
        before, bearing = bearing, math.atan2(points[i, 1], points[i, 0])
        if i > 0:
            step = abs(bearing - before)
            steps_rad[i - 1] = min(step, 2.0 * math.pi - step)
    return median(steps_rad) if len(steps_rad) else math.nan


@kernel_with(inline=True)
def _length(x: float, y: float) -> float:
    """Length of a vector: `math.hypot` takes three times as long to be safe from overflow."""
    return math.sqrt(x * x + y * y)
