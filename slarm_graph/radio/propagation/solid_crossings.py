# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Number of walls that links cross, and their clearance, from the plans of solids."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from slarm_graph.convex import convex_plans
from slarm_graph.geometry import Floats
from slarm_graph.polygons import counter_clockwise
from slarm_graph.radio.propagation.link_traversal import Counts
from slarm_graph.world import Solid

_TOUCH_M = 1e-3
"""Solids this near touch: worlds are written to the millimetre."""


def solid_crossings(
    solids: Sequence[Solid],
    access_point_m: ArrayLike,
    points_m: ArrayLike,
    antenna_height_m: float,
    *,
    mount_radius_m: float = 0.0,
) -> Counts:
    """Count the walls and obstacles that the straight segment to each antenna passes.

    Solids that touch along it count once, as a wall's pieces at a corner, however many they are;
    lower ones do not count.

    Parameters
    ----------
    solids : sequence of Solid
    access_point_m : (3,)
        x, y in the world, z above the floor [m].
    points_m : (N, 2)
        Antennas in plan [m].
    antenna_height_m : float
        Of all antennas.
    mount_radius_m : float
        Solids that the segment has left this near to the access point, in plan, are its mount and
        do not count.

    Returns
    -------
    (N,) int16
    """
    start = np.asarray(access_point_m, dtype=np.float64)
    ends = np.asarray(points_m, dtype=np.float64).reshape(-1, 2)
    length_m = np.hypot(*(ends - start[:2]).T)
    plans = convex_plans([counter_clockwise(solid.corners_m) for solid in solids])
    runs_m = []
    for solid, pieces in zip(solids, plans, strict=True):
        for piece in pieces:
            enter, leave, lowest_m = _clearance(start, ends, piece, antenna_height_m)
            passed = (lowest_m < solid.height_m) & (leave * length_m > mount_radius_m)
            if passed.any():
                runs_m.append(np.where(passed, [enter * length_m, leave * length_m], np.inf))
    return _count_merged(np.array(runs_m)) if runs_m else np.zeros(len(ends), dtype=np.int16)


def lowest_link_heights(
    solids: Sequence[Solid],
    access_point_m: ArrayLike,
    points_m: ArrayLike,
    antenna_height_m: float,
    *,
    mount_radius_m: float = 0.0,
) -> Floats:
    """Return the lowest height (N,) of each link over the plans of solids [m]; inf over none.

    A solid higher than that blocks the link. Parameters are those of `solid_crossings`; the heights
    of the solids are not used.
    """
    start = np.asarray(access_point_m, dtype=np.float64)
    ends = np.asarray(points_m, dtype=np.float64).reshape(-1, 2)
    length_m = np.hypot(*(ends - start[:2]).T)
    found_m = np.full(len(ends), np.inf)
    plans = convex_plans([counter_clockwise(solid.corners_m) for solid in solids])
    for piece in (piece for pieces in plans for piece in pieces):
        _, leave, lowest_m = _clearance(start, ends, piece, antenna_height_m)
        away = leave * length_m > mount_radius_m
        found_m[away] = np.minimum(found_m[away], lowest_m[away])
    return found_m


def _clearance(
    start: Floats, ends: Floats, corners: Floats, antenna_height_m: float
) -> tuple[Floats, Floats, Floats]:
    """Fractions (N,) at which links enter and leave a plan; lowest height over it [m], or inf."""
    enter, leave = _clip(start[:2], ends, corners)
    z_m = start[2]
    lowest_m = z_m + (antenna_height_m - z_m) * (leave if antenna_height_m < z_m else enter)
    return enter, leave, np.where(leave > enter, lowest_m, np.inf)


def _count_merged(runs_m: Floats) -> Counts:
    """Count (N,) intervals (K, 2, N) after merging those that touch; inf: no interval."""
    runs_m = np.take_along_axis(runs_m, runs_m[:, :1].argsort(axis=0), axis=0)
    reached_m = np.maximum.accumulate(np.where(np.isinf(runs_m[:, 1]), -np.inf, runs_m[:, 1]))
    begins = np.isfinite(runs_m[:, 0])
    begins[1:] &= runs_m[1:, 0] > reached_m[:-1] + _TOUCH_M
    return np.asarray(begins.sum(axis=0), dtype=np.int16)


def _clip(start: Floats, ends: Floats, corners: Floats) -> tuple[Floats, Floats]:
    """Fractions (N,) at which segments enter and leave a convex polygon (Cyrus and Beck)."""
    direction = ends - start
    enter, leave = np.zeros(len(ends)), np.ones(len(ends))
    for corner, edge in zip(corners, np.roll(corners, -1, axis=0) - corners, strict=True):
        inward = np.array([-edge[1], edge[0]])
        depth, rate = (start - corner) @ inward, direction @ inward
        with np.errstate(divide="ignore", invalid="ignore"):
            at = -depth / rate
        enter = np.where(rate > 0.0, np.maximum(enter, at), enter)
        leave = np.where(rate < 0.0, np.minimum(leave, at), leave)
        leave = np.where((rate == 0.0) & (depth <= 0.0), -1.0, leave)
    return enter, leave
