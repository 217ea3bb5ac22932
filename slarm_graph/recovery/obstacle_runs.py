# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Runs of outline sides around obstacles at a wall, and the rectangle behind each of them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slarm_graph.geometry import Floats
from slarm_graph.grid import Mask
from slarm_graph.kernels import kernel
from slarm_graph.polygons import next_corners

Numbers = NDArray[np.int64]

_LEAST_TURN = math.sin(math.radians(20.0))
"""Corners of outlines of cells bend by rounding; what bends by 20 degrees and more is a corner of
an obstacle."""
_MOST_SIDES = 12
"""Of a run that may be an obstacle: a round one at cells of 0.05 m has eight to twelve."""
_FRONT_SHARE = 0.25
"""Corners of the rectangle in the front quarter of its depth were seen into."""
_ROUNDING_M = 1e-9
"""Corners of the rectangle that are the run's own end are no farther behind it: coordinates of a
hundred kilometres are rounded by a hundredth of this."""

_MOST_CORNERS = _MOST_SIDES + 5
"""Of a ring: those of a run, and of a rectangle."""


class SideRun(NamedTuple):
    """A run of sides of an outline: the visible front of a rectangular obstacle.

    Parameters
    ----------
    first, length : int
        First side, and how many sides.
    box_m : (4, 2) float64
        Smallest rectangle around it that has a side along a fitted line, its own or one that it
        meets; counter-clockwise [m].
    ring_m : (K, 2) float64
        The run, filled up to the rectangle behind its two ends, counter-clockwise [m].
    plan : (5,) float64
        Sides of the rectangle [m], area of the ring [m^2], corners of the rectangle that were seen
        into, and length of the run [m].
    """

    first: int
    length: int
    box_m: Floats
    ring_m: Floats
    plan: Floats


def runs_before_walls(corners: Floats, fitted: Mask, longest_m: float) -> Iterator[SideRun]:
    """Yield the runs between two corners of an outline (K, 2) that point away from the free region.

    Only runs within the longest extent along x and y, that have or meet a fitted line.
    """
    numbers, runs, sides = _runs(corners, fitted, longest_m)
    if not len(runs):
        return
    boxes = _boxes(corners, runs, sides)
    rings, plans = np.empty((len(runs), _MOST_CORNERS, 2)), np.empty((len(runs), 5))
    sizes = _put_rings(rings, plans, boxes, runs, numbers[:, 1])
    for (first, length), box, ring, size, plan in zip(
        numbers.tolist(), boxes, rings, sizes.tolist(), plans, strict=True
    ):
        yield SideRun(first, length, box, ring[:size], plan)


def _boxes(corners: Floats, runs: Floats, sides: Numbers) -> Floats:
    """Smallest rectangles (N, 4, 2) around runs (N, K, 2) that are parallel to any of sides (N, M).

    Around a triangle all are as large: then rounding decides.
    """
    of, own = np.nonzero(sides >= 0)[0], sides[sides >= 0]
    step = next_corners(corners)[own] - corners[own]
    along = step / np.sqrt(step[:, None] @ step[..., None])[..., 0]
    axes = np.stack([along, np.stack([-along[:, 1], along[:, 0]], axis=1)], axis=1)
    within = runs[of] @ axes.transpose(0, 2, 1)
    (left, low), (right, high) = within.min(axis=1).T, within.max(axis=1).T
    frames = np.array([[left, low], [right, low], [right, high], [left, high]])
    boxes = np.ascontiguousarray(frames.transpose(2, 0, 1)) @ axes
    after = next_corners(boxes)
    areas_m2 = (boxes[..., 0] * after[..., 1] - after[..., 0] * boxes[..., 1]).sum(axis=1)
    order = np.lexsort((areas_m2, of))
    return boxes[order[np.searchsorted(of, np.arange(len(runs)))]]


@kernel
def _runs(corners: Floats, fitted: Mask, longest: float) -> tuple[Numbers, Floats, Numbers]:
    """Find runs: first side and length (N, 2), corners (N, 13, 2), fitted sides (N, 14) and -1."""
    count = len(corners)
    inward, most = _inward(corners), min(_MOST_SIDES, count - 1)
    room = np.count_nonzero(inward) * max(0, most - 1) + 1
    numbers, runs = np.empty((room, 2), dtype=np.int64), np.empty((room, _MOST_SIDES + 1, 2))
    sides, found = np.full((room, _MOST_SIDES + 2), -1), 0
    for first in range(count):
        if not inward[first]:
            continue
        for length in range(2, most + 1):
            run = runs[found]
            _put_run(run, corners, first, length)
            if max(np.ptp(run[:, 0]), np.ptp(run[:, 1])) > longest:
                break
            if not inward[(first + length) % count] or _area(run) >= 0.0:
                continue
            if _put_sides(sides[found], corners, fitted, first, length):
                numbers[found, 0], numbers[found, 1] = first, length
                found += 1
    return numbers[:found], runs[:found], sides[:found]


@kernel
def _put_run(run: Floats, corners: Floats, first: int, length: int) -> None:
    """Copy the corners of a run; its last one pads the array."""
    for k in range(len(run)):
        at = (first + min(k, length)) % len(corners)
        run[k, 0], run[k, 1] = corners[at, 0], corners[at, 1]


@kernel
def _put_sides(sides: Numbers, corners: Floats, fitted: Mask, first: int, length: int) -> bool:
    """Write the fitted sides of a run and of its two neighbours; return whether there are any."""
    count, size = len(corners), 0
    if _apart(corners, first, (first + length) % count) < _ROUNDING_M:
        return False
    for k in range(first - 1, first + length + 1):
        side = k % count
        if fitted[side] and _apart(corners, side, (side + 1) % count) > _ROUNDING_M:
            sides[size] = side
            size += 1
    return size > 0


@kernel
def _inward(corners: Floats) -> Mask:
    """Which corners of an outline turn left by more than rounding."""
    count = len(corners)
    inward = np.zeros(count, dtype=np.bool_)
    for k in range(count):
        before, after = corners[k - 1], corners[(k + 1) % count]
        ax, ay = corners[k, 0] - before[0], corners[k, 1] - before[1]
        bx, by = after[0] - corners[k, 0], after[1] - corners[k, 1]
        turn = ax * by - ay * bx
        inward[k] = turn > _LEAST_TURN * math.hypot(ax, ay) * math.hypot(bx, by)
    return inward


@kernel
def _area(ring: Floats) -> float:
    """Area of a polygon, positive when counter-clockwise."""
    double = 0.0
    for k in range(len(ring)):
        double += ring[k - 1, 0] * ring[k, 1] - ring[k, 0] * ring[k - 1, 1]
    return 0.5 * double


@kernel
def _apart(corners: Floats, one: int, other: int) -> float:
    """Distance between two corners."""
    return math.hypot(corners[one, 0] - corners[other, 0], corners[one, 1] - corners[other, 1])


@kernel
def _put_rings(
    rings: Floats, plans: Floats, boxes: Floats, runs: Floats, length: Numbers
) -> Numbers:
    """Extend runs by the corners of their rectangles; return the corners each ring then has."""
    sizes = np.empty(len(runs), dtype=np.int64)
    for k in range(len(runs)):
        sizes[k] = _put_ring(rings[k], plans[k], boxes[k], runs[k, : length[k] + 1])
    return sizes


@kernel
def _put_ring(ring: Floats, plan: Floats, box: Floats, run: Floats) -> int:
    """Extend a run by the rectangle's corners behind its ends; return the ring's corners."""
    last = len(run) - 1
    x, y = run[0, 0] - run[last, 0], run[0, 1] - run[last, 1]
    chord = math.hypot(x, y)
    rel_x, rel_y = box[:, 0] - run[last, 0], box[:, 1] - run[last, 1]
    behind, along = (x * rel_y - y * rel_x) / chord, x * rel_x + y * rel_y
    for k in range(last + 1):
        ring[k, 0], ring[k, 1] = run[last - k, 0], run[last - k, 1]
    size = last + 1
    for _ in range(4):
        # From the run's begin back to its end.
        far, k = -math.inf, -1
        for corner in range(4):
            if behind[corner] > _ROUNDING_M and along[corner] > far:
                far, k = along[corner], corner
        if k >= 0:
            ring[size, 0], ring[size, 1] = box[k, 0], box[k, 1]
            along[k] = -math.inf
            size += 1
    plan[0] = math.hypot(box[1, 0] - box[0, 0], box[1, 1] - box[0, 1])
    plan[1] = math.hypot(box[2, 0] - box[1, 0], box[2, 1] - box[1, 1])
    plan[2] = _area(ring[:size])
    plan[3] = min(3, int(np.count_nonzero(behind < _FRONT_SHARE * behind.min())))
    plan[4] = 0.0
    for k in range(last):
        plan[4] += math.hypot(run[k + 1, 0] - run[k, 0], run[k + 1, 1] - run[k, 1])
    return size
