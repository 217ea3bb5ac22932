# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Obstacle candidates on outlines: islands, and runs of sides around an obstacle at a wall."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import shapely
from numpy.typing import NDArray

from slarm_graph.geometry import Floats
from slarm_graph.polygons import counter_clockwise, next_corners, signed_area_m2
from slarm_graph.recovery.known_sizes import MeasuredPlan
from slarm_graph.recovery.obstacle_runs import runs_before_walls
from slarm_graph.recovery.returns import Returns
from slarm_graph.recovery.walls import Outline

_BAND_M = 0.1
"""Returns this near to an island belong to it: two cells of 0.05 m."""
_AT_ONCE = 256
"""Islands whose returns are searched together. All at once, 2,422 of a clinic, it takes as long
and 40 MB more; one at a time takes twice as long."""
_SAME_SHAPE = 0.9
"""A convex hull less than a ninth larger has the shape of the island; else the island is not
convex."""
_LEAST_SEEN = 0.5
"""A hull of returns smaller than half of the plan shows one side only."""


@dataclass(frozen=True, slots=True)
class ObstacleCandidate:
    """A part of an outline that may be one obstacle.

    Parameters
    ----------
    sides : tuple of int
        Of the outline, in its order.
    shown_m : float
        Their length [m].
    ring_m, box_m : (K, 2), (4, 2) float64
        Plan, hidden parts filled, and rectangle around it, both counter-clockwise [m].
    plan : Plan
    """

    sides: tuple[int, ...]
    shown_m: float
    ring_m: Floats
    box_m: Floats
    plan: MeasuredPlan


def candidates_on(
    outline: Outline, returns: Returns, longest_m: float
) -> Iterator[ObstacleCandidate]:
    """Yield the obstacle candidates up to a length on an outline of the free region.

    Candidates are an island, and every run of sides between two corners that point away from the
    free region: there the outline leaves a wall, or another obstacle, and returns to it.
    """
    corners = outline.corners_m
    if signed_area_m2(corners) < 0.0 and np.ptp(corners, axis=0).max() <= longest_m:
        yield from islands_in([outline], returns)
    yield from runs_on(outline, longest_m)


def runs_on(outline: Outline, longest_m: float) -> Iterator[ObstacleCandidate]:
    """Yield the runs of sides of an outline that may be an obstacle before a wall."""
    count = len(outline.corners_m)
    for run in runs_before_walls(outline.corners_m, outline.fitted, longest_m):
        sides = tuple((run.first + k) % count for k in range(run.length))
        plan = MeasuredPlan(run.plan[:2], float(run.plan[2]), int(run.plan[3]), np.zeros(2))
        yield ObstacleCandidate(sides, float(run.plan[4]), run.ring_m, run.box_m, plan)


def islands_in(outlines: Sequence[Outline], returns: Returns) -> list[ObstacleCandidate]:
    """Return the obstacles inside clockwise outlines."""
    rings = [outline.corners_m[::-1].copy() for outline in outlines]
    loose = [k for k, outline in enumerate(outlines) if not outline.fitted.all()]
    for k, ring in zip(loose, _around_returns([rings[k] for k in loose], returns), strict=True):
        rings[k] = ring
    return [_island(outline, ring) for outline, ring in zip(outlines, rings, strict=True)]


def convex_hull(points: Floats) -> Floats:
    """Corners (K, 2) of the convex hull of points (N, 2), counter-clockwise."""
    hull = shapely.MultiPoint(points).convex_hull
    if not isinstance(hull, shapely.Polygon):
        return points
    return counter_clockwise(np.asarray(hull.exterior.coords)[:-1])


def _island(outline: Outline, ring: Floats) -> ObstacleCandidate:
    """The obstacle inside a clockwise outline, with its measured ring."""
    rectangle = cv2.minAreaRect(ring.astype(np.float32))
    box = counter_clockwise(np.asarray(cv2.boxPoints(rectangle), dtype=np.float64))
    plan = MeasuredPlan(np.array(rectangle[1]), signed_area_m2(ring), 4, np.zeros(2))
    corners = outline.corners_m
    length_m = float(np.linalg.norm(next_corners(corners) - corners, axis=1).sum())
    return ObstacleCandidate(
        tuple(range(len(corners))), length_m, ring, ring if len(ring) == 4 else box, plan
    )


def _around_returns(rings: Sequence[Floats], returns: Returns) -> Iterator[Floats]:
    """Yield the convex hulls of islands' returns, or the island's ring where shapes differ.

    On cells the plan of a small or round obstacle is only known to half a cell on every side.
    """
    for begin in range(0, len(rings), _AT_ONCE):
        yield from _some_around_returns(rings[begin : begin + _AT_ONCE], returns)


def _some_around_returns(rings: Sequence[Floats], returns: Returns) -> Iterator[Floats]:
    points, owner = _beside(rings, returns)
    firsts = np.searchsorted(owner, np.arange(len(rings) + 1))
    for ring, first, past in zip(rings, firsts[:-1], firsts[1:], strict=True):
        hull = convex_hull(points[first:past]) if past - first >= 3 else ring
        own_m2, hull_m2 = signed_area_m2(ring), signed_area_m2(hull)
        yield hull if _LEAST_SEEN * own_m2 < hull_m2 < own_m2 / _SAME_SHAPE else ring


def _beside(rings: Sequence[Floats], returns: Returns) -> tuple[Floats, NDArray[np.int64]]:
    """Returns (N, 2) near rings, and the index of the ring of each (N,), ascending."""
    low, high = (np.array([end(ring, axis=0) for ring in rings]) for end in (np.min, np.max))
    reach_m = 0.5 * np.hypot(*(high - low).T) + 2.0 * _BAND_M
    near = list(returns.near_each(0.5 * (low + high), reach_m))
    owner = np.repeat(np.arange(len(rings)), [len(one) for one in near])
    points = returns.points[np.concatenate(near)]
    # Exclude returns far from the bounding box of the ring: most of the circle of a long one.
    off_m = np.maximum(low[owner] - points, points - high[owner]).max(axis=1)
    points, owner = points[off_m < 2.0 * _BAND_M], owner[off_m < 2.0 * _BAND_M]
    areas = np.array([shapely.Polygon(ring) for ring in rings])
    shapely.prepare(areas)
    own = shapely.dwithin(areas[owner], shapely.points(points), _BAND_M)
    return points[own], owner[own]
