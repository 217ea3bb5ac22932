# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Check the positions of access points: inside obstacles, or in unknown space."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from slarm_graph.access_points import AccessPoint
from slarm_graph.errors import brief
from slarm_graph.geographic import CellState, GeographicMap, is_free


def placement_notices(
    geographic: GeographicMap, access_points: Sequence[AccessPoint], mount_radius_m: float
) -> tuple[str, ...]:
    """Warn of access points inside an obstacle higher than they hang, or in unknown space.

    One with a free cell within `mount_radius_m` is mounted on the wall: no warning.
    """
    return tuple(
        notice
        for ap in access_points
        if (notice := _notice(geographic, ap, mount_radius_m)) is not None
    )


def _notice(geographic: GeographicMap, ap: AccessPoint, mount_radius_m: float) -> str | None:
    geometry = geographic.geometry
    cell = geometry.cell_of([ap.x_m, ap.y_m])
    if not geometry.contains(cell) or _free_nearby(geographic, ap, mount_radius_m):
        return None
    row, col = (int(number) for number in cell)
    state, height_m = geographic.states[row, col], float(geographic.heights_m[row, col])
    name = f"access point {brief(ap.name, 30)} at ({ap.x_m:g}, {ap.y_m:g}, {ap.z_m:g}) m"
    if state == CellState.OBSTACLE and height_m > ap.z_m:
        high = f"{height_m:g} m high" if np.isfinite(height_m) else "of unknown height"
        return (
            f"{name} is inside an obstacle {high}: check its place, or say how high obstacles are"
            " with --set recovery.default_height_m=..."
        )
    if state == CellState.UNKNOWN:
        return f"{name} lies in unknown space, {mount_radius_m:g} m and more from all that is free"
    return None


def _free_nearby(geographic: GeographicMap, ap: AccessPoint, radius_m: float) -> bool:
    """Whether the centre of a cell that is neither obstacle nor unknown is within a radius."""
    geometry = geographic.geometry
    reach_m = radius_m + geometry.resolution_m
    low, high = geometry.cell_of(
        [[ap.x_m - reach_m, ap.y_m - reach_m], [ap.x_m + reach_m, ap.y_m + reach_m]]
    )
    first = np.maximum(low, 0)
    window = geographic.states[first[0] : high[0] + 1, first[1] : high[1] + 1]
    free = np.argwhere(is_free(window))
    away_m = np.linalg.norm(geometry.center_of(free + first) - [ap.x_m, ap.y_m], axis=1)
    return bool(np.any(away_m <= reach_m))
