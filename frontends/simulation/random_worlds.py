# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Random worlds, so that nothing works only in the hand-made ones."""

from __future__ import annotations

import math

import numpy as np

from slarm_graph.access_points import AccessPoint
from slarm_graph.geometry import Floats, Pose2, transform_points
from slarm_graph.grid import GridGeometry
from slarm_graph.raster.distance import clearance
from slarm_graph.raster.patches import patches
from slarm_graph.truth_map import solid_heights_m
from slarm_graph.world import Solid, WorldMap

_RESOLUTION_M = 0.1
"""Cell of the grid for free space: half of the smallest gap a robot of 0.18 m passes."""
_CEILING_M = 3.0
"""Of an ordinary room; antennas above all obstacles have links over them."""
_HEIGHTS_M = (0.4, 2.4)
"""From a low bench to a full-height rack: above and below any antenna of a robot."""


def random_world(
    rng: np.random.Generator,
    *,
    size_m: tuple[float, float] = (12.0, 9.0),
    obstacles: int = 10,
    start_room_m: float = 0.5,
) -> WorldMap:
    """Scatter boxes and polygons of all headings in a rectangle, with one access point.

    Parameters
    ----------
    rng : numpy.random.Generator
    size_m : (width, depth) [m]
    obstacles : int
        Number of solids; they may overlap one another.
    start_room_m : float
        The start is drawn among places at least this far from everything [m].
    """
    half = 0.5 * np.array(size_m)
    boundary = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half
    while True:
        solids = tuple(_obstacle(rng, half, n + 1) for n in range(obstacles))
        x, y = rng.uniform(-half, half)
        z = rng.uniform(_HEIGHTS_M[1], _CEILING_M)
        ap = AccessPoint("ap", float(x), float(y), float(z))
        empty = WorldMap("random", solids, boundary, _CEILING_M, (ap,), Pose2())
        start = _start(rng, empty, start_room_m)
        if start is not None:
            return WorldMap("random", solids, boundary, _CEILING_M, (ap,), start)


def _obstacle(rng: np.random.Generator, half_m: Floats, number: int) -> Solid:
    """One box, or a polygon with 3 to 8 corners around a centre."""
    if rng.random() < 0.5:
        a, b = 0.5 * rng.uniform(0.2, 2.5, 2)
        corners = np.array([[-a, -b], [a, -b], [a, b], [-a, b]])
    else:
        count = int(rng.integers(3, 9))
        angles = (np.arange(count) + rng.uniform(0.1, 0.9, count)) * 2.0 * math.pi / count
        reach = rng.uniform(0.3, 1.2, count)
        corners = reach[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    x, y = rng.uniform(-half_m, half_m)
    turned = transform_points([x, y, rng.uniform(-math.pi, math.pi)], corners)
    return Solid(f"obstacle {number}", _pulled_in(turned, half_m), float(rng.uniform(*_HEIGHTS_M)))


def _pulled_in(corners_m: Floats, half_m: Floats) -> Floats:
    """Move a polygon inwards until the boundary holds it."""
    low, high = corners_m.min(axis=0), corners_m.max(axis=0)
    return np.asarray(corners_m + np.maximum(-half_m - low, 0.0) + np.minimum(half_m - high, 0.0))


def _start(rng: np.random.Generator, world: WorldMap, room_m: float) -> Pose2 | None:
    """Draw a pose in the largest connected free area; None where there is none."""
    geometry = GridGeometry.covering(*world.extent_m(), _RESOLUTION_M)
    blocked = solid_heights_m(world, geometry, "touched") > 0.0
    room = clearance(~blocked).astype(np.float64) * _RESOLUTION_M
    labels, sizes = patches(room > room_m + _RESOLUTION_M, over_corners=False)
    if not sizes.any():
        return None
    row, col = rng.choice(np.argwhere(labels == sizes.argmax()))
    x, y = geometry.center_of([row, col])
    return Pose2(float(x), float(y), float(rng.uniform(-math.pi, math.pi)))
