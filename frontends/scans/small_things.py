# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Small things among the returns of a scan: people walk, and of pillars nobody knows it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from slarm_graph.frontends.scans.quantiles import median
from slarm_graph.geometry import Floats
from slarm_graph.kernels import kernel, kernel_with

SMALL_M = 0.8
"""What is no wider may walk: a person is 0.5 m wide, and a stride is long."""
WALKERS = 0.05
"""Share of small things that walk: people among table legs, door frames and pillars. With 0.02
three simulated buildings are 0.20, 0.03 and 0.10 m in place of 0.42, 0.03 and 0.04, but a bare
corridor without anybody is 7 % too short in place of 3: there the last returns of its walls walk
along."""
WALKED_M = 0.56
"""How far one has come since it was seen last: at 1.4 m/s in the 0.4 s in which a robot of 0.6 m/s
drives to the next keyframe."""
_APART_M = 0.3
"""Neighbouring returns farther from each other are of two things: half a person's width."""
_GRAZING_RAD = math.radians(10.0)
"""But not where a wall met at this angle would show no more returns in between (Borges and Aldon,
"Line Extraction in 2D Range Images for Mobile Robotics", J. Intell. Robot. Syst. 40, 2004)."""
_COARSE_RAD = 0.5 / 3.0 / 3.0
"""Beams farther apart do not tell things from each other: of a person, 0.5 m wide and 3 m away,
fewer than three return."""


@kernel
def slant_between(points: Floats) -> float:
    """How far apart neighbouring returns of one wall are at most, over their distance.

    That is infinite where the beams of points (K, 2), in their order, are too far from each other
    to tell small things apart.
    """
    beams_rad = _beams_rad(points)
    if not beams_rad < _COARSE_RAD:
        return math.inf
    return math.sin(beams_rad) / math.sin(_GRAZING_RAD - beams_rad)


@kernel
def are_two(points: Floats, i: int, k: int, slant: float) -> bool:
    """Whether two returns of points (K, 2) are farther apart than neighbours on one thing."""
    near_m = min(_length(points[i, 0], points[i, 1]), _length(points[k, 0], points[k, 1]))
    return apart_m(points, i, k) > max(_APART_M, slant * near_m)


@kernel_with(inline=True)
def apart_m(points: Floats, i: int, k: int) -> float:
    """Distance of two of the points (K, 2)."""
    return _length(points[k, 0] - points[i, 0], points[k, 1] - points[i, 1])


@kernel
def small_among(points: Floats, chosen: NDArray[np.bool_], sure: NDArray[np.bool_]) -> int:
    """Count the small things that the chosen ones of points (K, 2) belong to.

    Parameters
    ----------
    points : (K, 2) float64
        In the order of their beams [m].
    chosen, sure : (K,) bool
        A thing of which no chosen point is sure is passed over.

    Returns
    -------
    int
        0 where some of them belong to something wider, which does not walk, or where none is
        chosen, or things cannot be told apart.
    """
    slant = slant_between(points)
    if math.isinf(slant):
        return 0
    count, first, last, width_m, is_sure = 0, -1, -1, 0.0, False
    for i in range(len(points) + 1):
        is_end = i == len(points)
        if not is_end and not chosen[i]:
            continue
        if first < 0 or is_end or are_two(points, last, i, slant):
            if is_sure and width_m > SMALL_M:
                return 0
            count += is_sure
            first, width_m, is_sure = i, 0.0, False
        if not is_end:
            last, is_sure = i, is_sure or sure[i]
            width_m = max(width_m, apart_m(points, first, i))
    return count


@kernel
def is_wide(points: Floats) -> NDArray[np.bool_]:
    """Which of the points (K, 2), in the order of their beams, are of what is not small."""
    wide = np.zeros(len(points), dtype=np.bool_)
    slant, first, width_m = slant_between(points), 0, 0.0
    for i in range(1, len(points) + 1):
        if i == len(points) or are_two(points, i - 1, i, slant):
            for k in range(first, i):
                wide[k] = width_m > SMALL_M
            first, width_m = i, 0.0
        else:
            width_m = max(width_m, apart_m(points, first, i))
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
