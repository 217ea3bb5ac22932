# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Checks of a world before it is used."""

from __future__ import annotations

from collections import Counter

import numpy as np

from slarm_graph.access_points import AccessPoint
from slarm_graph.errors import brief
from slarm_graph.geometry import Floats
from slarm_graph.polygons import contains, is_simple
from slarm_graph.world import Solid, WorldMap


def world_problems(world: WorldMap) -> tuple[str, ...]:
    """Return all errors of a world, one line each; it cannot be used with any.

    Polygons that cross themselves, access points of equal name, and a start outside the boundary
    or inside a solid.
    """
    problems = []
    if not is_simple(world.boundary_m):
        problems.append("boundary_m: the polygon crosses itself or has no area")
    problems += [
        f"{brief(solid.name)}: the polygon crosses itself or has no area"
        for solid in world.solids
        if not is_simple(solid.corners_m)
    ]
    counts = Counter(ap.name for ap in world.access_points)
    problems += [
        f"access_points: the name {brief(name)!r} is used {'twice' if n == 2 else f'{n} times'}"
        for name, n in counts.items()
        if n > 1
    ]
    if not problems:  # a place cannot be looked up in polygons that are none
        problems += _start_problems(world)
    return tuple(problems)


def _start_problems(world: WorldMap) -> list[str]:
    start = np.array([world.start.x, world.start.y])
    at = f"start: ({start[0]:g}, {start[1]:g}) m lies"
    if not contains(world.boundary_m, start):
        return [f"{at} outside the boundary"]
    return [f"{at} inside {brief(s.name)}" for s in world.solids if contains(s.corners_m, start)]


def world_warnings(world: WorldMap) -> tuple[str, ...]:
    """Return probable mistakes in a world, one line each; it can be used all the same."""
    warnings = [] if world.access_points else ["no access points: there will be no radio map"]
    for ap in world.access_points:
        warnings += misplaced(ap, world)
    return tuple(warnings)


def misplaced(ap: AccessPoint, world: WorldMap) -> list[str]:
    """Return why an access point cannot be there (in a solid, too high, outside); else empty."""
    place = np.array([ap.x_m, ap.y_m])
    name = f"access point {brief(ap.name, 30)}"
    told = []
    if ap.z_m > world.ceiling_m:
        told.append(f"{name} hangs above the ceiling ({ap.z_m:g} m, {world.ceiling_m:g} m)")
    if ap.z_m < 0.0:
        told.append(f"{name} lies below the floor ({ap.z_m:g} m)")
    x_min, x_max, y_min, y_max = world.extent_m()
    if not (x_min <= ap.x_m <= x_max and y_min <= ap.y_m <= y_max):
        told.append(f"{name} is outside the boundary at ({ap.x_m:g}, {ap.y_m:g}) m")
    solid = _solid_around(place, ap.z_m, world.solids)
    if solid is not None:
        told.append(f"{name} is inside {brief(solid.name)}, which is {solid.height_m:g} m high")
    return told


def _solid_around(place: Floats, z_m: float, solids: tuple[Solid, ...]) -> Solid | None:
    """Return the solid that contains a point below its top, if any."""
    return next(
        (s for s in solids if s.height_m > z_m and bool(contains(s.corners_m, place))), None
    )
