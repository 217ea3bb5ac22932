# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""What outlines may show of obstacles: islands, and runs of sides before what stands at a wall."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
import shapely

from slarm_graph.geometry import Floats
from slarm_graph.polygons import counter_clockwise, next_corners, signed_area_m2
from slarm_graph.recovery.known_sizes import MeasuredPlan
from slarm_graph.recovery.returns import Returns
from slarm_graph.recovery.walls import Outline

_LEAST_TURN = math.sin(math.radians(20.0))
"""Corners of outlines of cells bend by rounding; what bends by 20 degrees and more is a corner of
an obstacle."""
_MOST_SIDES = 12
"""Of a run that may be an obstacle: a round one at cells of 0.05 m has eight to twelve."""
_BAND_M = 0.1
"""Returns this near to an island are its own: two cells of 0.05 m."""
_SAME_SHAPE = 0.9
"""A convex hull less than a ninth larger has the shape of the island; else the island is not
convex."""
_LEAST_SEEN = 0.5
"""Returns of less than half of the plan show one side only."""
_FRONT_SHARE = 0.25
"""Corners of the rectangle in the front quarter of its depth were seen into."""
_ROUNDING_M = 1e-9
"""Corners of the rectangle that are the run's own end are no farther behind it: coordinates of a
hundred kilometres are rounded by a hundredth of this."""


@dataclass(frozen=True, slots=True)
class ObstacleCandidate:
    """What may be one obstacle.

    Parameters
    ----------
    sides : tuple of int
        Of the outline, in its order.
    shown_m : float
        Their length [m].
    ring_m, box_m : (K, 2), (4, 2) float64
        Plan, what is hidden filled, and rectangle around it, both counter-clockwise [m].
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
    """Yield what may be an obstacle on an outline of the free region and is not too long.

    An island may be one, and so may be every run of sides between two corners that point into
    what is not free: there the outline leaves a wall, or another obstacle, and comes back.
    """
    corners = outline.corners_m
    count = len(corners)
    if signed_area_m2(corners) < 0.0 and np.ptp(corners, axis=0).max() <= longest_m:
        yield _island(outline, returns)
    inward = _turns(corners) > _LEAST_TURN
    most = min(_MOST_SIDES, count - 1)
    around, ends = (np.concatenate([one, one[:most]]) for one in (corners, inward))
    for first in np.flatnonzero(inward).tolist():
        ahead = around[first : first + most + 1]
        extent_m = np.maximum.accumulate(ahead) - np.minimum.accumulate(ahead)
        fits = ends[first : first + most + 1] & (extent_m.max(axis=1) <= longest_m)
        for length in (np.flatnonzero(fits[2:]) + 2).tolist():
            sides = tuple((first + k) % count for k in range(length))
            run = ahead[: length + 1]
            box = _box(outline, sides, run) if signed_area_m2(run) < 0.0 else None
            if box is not None:
                yield _before_a_wall(sides, run, box)


def convex_hull(points: Floats) -> Floats:
    """Corners (K, 2) of the convex hull of points (N, 2), counter-clockwise."""
    hull = shapely.MultiPoint(points).convex_hull
    if not isinstance(hull, shapely.Polygon):
        return points
    return counter_clockwise(np.asarray(hull.exterior.coords)[:-1])


def _turns(corners: Floats) -> Floats:
    """Sine (K,) of the turn at every corner of an outline, positive to the left."""
    step = next_corners(corners) - corners
    step /= np.maximum(np.linalg.norm(step, axis=1, keepdims=True), 1e-12)
    before = np.roll(step, 1, axis=0)
    return np.asarray(before[:, 0] * step[:, 1] - before[:, 1] * step[:, 0])


def _island(outline: Outline, returns: Returns) -> ObstacleCandidate:
    """The obstacle inside a clockwise outline."""
    ring = outline.corners_m[::-1].copy()
    if not outline.fitted.all():
        ring = _around_returns(ring, returns)
    rectangle = cv2.minAreaRect(ring.astype(np.float32))
    box = counter_clockwise(np.asarray(cv2.boxPoints(rectangle), dtype=np.float64))
    plan = MeasuredPlan(np.array(rectangle[1]), signed_area_m2(ring), 4, np.zeros(2))
    sides = tuple(range(len(outline.corners_m)))
    return ObstacleCandidate(
        sides, _length_m(outline.corners_m), ring, ring if len(ring) == 4 else box, plan
    )


def _around_returns(ring: Floats, returns: Returns) -> Floats:
    """The convex ring around an island's returns; the island's own when that is another shape.

    Cells only tell the plan of a small or round obstacle to half a cell on every side.
    """
    center = 0.5 * (ring.min(axis=0) + ring.max(axis=0))
    radius_m = float(np.linalg.norm(ring - center, axis=1).max()) + _BAND_M
    points = returns.points[returns.near(center, radius_m)]
    # What is farther from the box around the ring is not asked for: most of a long one's circle.
    off_m = np.maximum(ring.min(axis=0) - points, points - ring.max(axis=0)).max(axis=1)
    points = points[off_m < 2.0 * _BAND_M]
    area = shapely.Polygon(ring)
    shapely.prepare(area)
    points = points[shapely.dwithin(area, shapely.points(points), _BAND_M)]
    if len(points) < 3:
        return ring
    hull = convex_hull(points)
    own_m2, hull_m2 = signed_area_m2(ring), signed_area_m2(hull)
    return hull if _LEAST_SEEN * own_m2 < hull_m2 < own_m2 / _SAME_SHAPE else ring


def _box(outline: Outline, sides: tuple[int, ...], run: Floats) -> Floats | None:
    """The smallest rectangle around a run along a fitted line, its own or one that it meets."""
    corners, count = outline.corners_m, len(outline.corners_m)
    boxes = []
    for side in ((sides[0] - 1) % count, *sides, (sides[-1] + 1) % count):
        if not outline.fitted[side]:
            continue
        step = corners[(side + 1) % count] - corners[side]
        length = float(np.linalg.norm(step))
        if length > 1e-9:
            boxes.append(_box_around(run, step / length))
    if not boxes or np.linalg.norm(run[0] - run[-1]) < 1e-9:
        return None
    return np.asarray(min(boxes, key=signed_area_m2))


def _before_a_wall(sides: tuple[int, ...], run: Floats, box: Floats) -> ObstacleCandidate:
    """The obstacle behind a run of sides, filled up to its rectangle behind the run's two ends."""
    chord = run[0] - run[-1]
    behind_m = _left_m(run[-1], chord, box)
    hidden = box[behind_m > _ROUNDING_M]
    hidden = hidden[np.argsort((hidden - run[-1]) @ chord)]
    ring = np.concatenate([hidden, run])[::-1].copy()
    seen = int(np.sum(behind_m < _FRONT_SHARE * behind_m.min()))
    sides_m = np.array([np.linalg.norm(box[1] - box[0]), np.linalg.norm(box[2] - box[1])])
    plan = MeasuredPlan(sides_m, signed_area_m2(ring), min(seen, 3), np.zeros(2))
    return ObstacleCandidate(sides, _length_m(run) - float(np.linalg.norm(chord)), ring, box, plan)


def _length_m(ring: Floats) -> float:
    """Length of a closed outline [m]."""
    return float(np.linalg.norm(next_corners(ring) - ring, axis=1).sum())


def _box_around(points: Floats, along: Floats) -> Floats:
    """Rectangle (4, 2) around points with a side along a direction, counter-clockwise."""
    axes = np.array([along, [-along[1], along[0]]])
    low, high = (points @ axes.T).min(axis=0), (points @ axes.T).max(axis=0)
    return np.asarray(np.array([low, [high[0], low[1]], high, [low[0], high[1]]]) @ axes)


def _left_m(start: Floats, step: Floats, points: Floats) -> Floats:
    """How far points (N, 2) lie to the left of a line [m]."""
    rel = points - start
    return np.asarray((step[0] * rel[:, 1] - step[1] * rel[:, 0]) / np.linalg.norm(step))
