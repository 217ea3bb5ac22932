# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Tangents of the straight walls in a scan."""

from __future__ import annotations

import math
from typing import cast

import numpy as np

from slarm_graph.geometry import Floats
from slarm_graph.kernels import kernel

_REACH_M = 0.2
"""Least length of a chord for a tangent: ten times a laser's noise of 0.02 m, 6 degrees."""
BACK, ON = cast(int, np.int64(-1)), cast(int, np.int64(1))
"""Directions, as values: for a literal numba compiles a kernel anew."""
_NEAR_GAP_M = 0.5
"""Farther neighbours are of two walls, or of one seen at a grazing angle."""
_STRAIGHT, _VERY_STRAIGHT = 0.8, 0.97
"""Cosines of the largest bend of a straight wall: 37 degrees by noise of short chords, 14 of long
ones."""


@kernel
def wall_tangents(points: Floats) -> Floats:
    """Unit vectors (K, 2) along straight walls at points (K, 2) in beam order; elsewhere zero.

    A point is on a straight wall when the chords to it and from it are parallel: roughly for near
    neighbours, as noise turns short chords, closely for far ones (seen at a grazing angle).
    """
    tangents = np.zeros_like(points)
    for i in range(len(points)):
        before = _along(points, i, BACK)
        after = _along(points, i, ON)
        if before == i and after == i:
            continue
        if before == i:
            before, middle, after = i, after, _along(points, after, ON)
        elif after == i:
            before, middle, after = _along(points, before, BACK), before, i
        else:
            middle = i
        ux, uy = points[middle, 0] - points[before, 0], points[middle, 1] - points[before, 1]
        vx, vy = points[after, 0] - points[middle, 0], points[after, 1] - points[middle, 1]
        # `math.hypot` takes three times as long to be safe from overflow.
        u, v = math.sqrt(ux * ux + uy * uy), math.sqrt(vx * vx + vy * vy)
        if u == 0.0 or v == 0.0:
            continue
        agreement = (ux * vx + uy * vy) / (u * v)
        if agreement > (_STRAIGHT if max(u, v) < _NEAR_GAP_M else _VERY_STRAIGHT):
            dx, dy = ux + vx, uy + vy
            length = math.sqrt(dx * dx + dy * dy)
            tangents[i, 0] = dx / length
            tangents[i, 1] = dy / length
    return tangents


@kernel
def _along(points: Floats, i: int, direction: int) -> int:
    """Walk along the beam order until far enough away for a direction; stop before a gap."""
    k = i
    while 0 <= k + direction < len(points):
        n = k + direction
        dx, dy = points[n, 0] - points[k, 0], points[n, 1] - points[k, 1]
        if k != i and dx * dx + dy * dy > _NEAR_GAP_M**2:
            break
        k = n
        dx, dy = points[k, 0] - points[i, 0], points[k, 1] - points[i, 1]
        if dx * dx + dy * dy > _REACH_M**2:
            break
    return k
