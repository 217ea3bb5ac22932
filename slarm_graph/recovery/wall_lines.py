# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Robust line fits of walls to the laser returns beside a stretch of outline."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slarm_graph.geometry import Floats
from slarm_graph.kernels import kernel
from slarm_graph.recovery.returns import Returns

_BAND_CELLS = 2.0
"""A wall's returns lie within a cell of its outline, and its far face beyond two."""
_END_CELLS = 1.5
"""Returns next to a corner may be the other wall's: a cell, and half for the corner's own error."""
SHORTEST_M = 0.3
"""Six cells of 0.05 m, the fewest with a direction; shorter stretches stay as cells have them."""
_INLIER_M = (0.015, 0.04)
"""From the noise of a good laser (0.015 m) to that of a cheap one (0.04 m). In the paper's room
with exact wheels half of it makes gains 0.03 dB wrong, double changes nothing."""
_COVERED_SHARE = 0.5
"""A wall is seen along half of its length at least; else its line may be another's. In the paper's
room with exact wheels half changes nothing, double takes the accuracy from 1 to 0.983."""
_LEAST_CELLS = 3
"""A line has a direction from three cells, or returns, on."""
_NO_LINE = np.full(4, np.nan)
"""Result of `_line` where no line fits."""


@dataclass(frozen=True, slots=True)
class Wall:
    """A stretch of outline with the free region on its left.

    Parameters
    ----------
    start, end : (2,) float64
        Where the outline's corners were [m].
    anchor, direction : (2,) float64
        A point on the line [m], and a unit vector along it.
    fitted : bool
        Whether returns support the line.
    """

    start: Floats
    end: Floats
    anchor: Floats
    direction: Floats
    fitted: bool

    @property
    def length_m(self) -> float:
        """Distance between the corners [m]."""
        return math.dist(self.start, self.end)

    def off_m(self, points: Floats) -> Floats:
        """Signed distance of points (..., 2) to the line, positive on the free side [m]."""
        rel = points - self.anchor
        return np.asarray(self.direction[0] * rel[..., 1] - self.direction[1] * rel[..., 0])


def wall_between(start: Floats, end: Floats, returns: Returns, resolution_m: float) -> Wall:
    """Fit the line of the returns beside a stretch of outline."""
    return next(walls_between(start[None], end[None], returns, resolution_m))


def walls_between(
    starts: Floats, ends: Floats, returns: Returns, resolution_m: float
) -> Iterator[Wall]:
    """Fit lines to the returns beside stretches of outline (N, 2) [m], where there are enough."""
    steps = ends - starts
    lengths_m = np.sqrt(steps[:, None] @ steps[..., None])[:, 0, 0]
    alongs = steps / np.maximum(lengths_m, 1e-12)[:, None]
    is_long = lengths_m >= max(SHORTEST_M, _LEAST_CELLS * resolution_m)
    reach_m = np.hypot(0.5 * lengths_m, _BAND_CELLS * resolution_m)
    near = returns.near_each(0.5 * (starts + ends)[is_long], reach_m[is_long])
    for start, end, along, may_fit in zip(starts, ends, alongs, is_long.tolist(), strict=True):
        line = _NO_LINE
        if may_fit:
            line = _line(start, end, returns.points, returns.weights, next(near), resolution_m)
        if math.isnan(line[0]):
            yield Wall(start, end, start, along, fitted=False)
        else:
            yield Wall(start, end, line[:2], line[2:], fitted=True)


@kernel
def _line(
    start: Floats,
    end: Floats,
    points: Floats,
    weights: Floats,
    near: NDArray[np.int64],
    resolution: float,
) -> Floats:
    """Fit a line (4,) to the near points beside a stretch of outline; nan where too few are."""
    along = end - start
    length = math.hypot(along[0], along[1])
    along /= length
    trim, band = min(_END_CELLS * resolution, 0.25 * length), _BAND_CELLS * resolution
    covered = np.zeros(int(length / resolution) + 1, dtype=np.bool_)
    line = np.array([start[0], start[1], along[0], along[1]])
    count = 0
    for k in near:
        x, y = points[k, 0] - start[0], points[k, 1] - start[1]
        s = x * along[0] + y * along[1]
        if trim < s < length - trim and abs(along[0] * y - along[1] * x) <= band:
            covered[int(s / resolution)] = True
            near[count] = k
            count += 1
    least = max(float(_LEAST_CELLS), _COVERED_SHARE * (length - 2 * trim) / resolution)
    if covered.sum() < least:
        line[0] = math.nan
        return line
    own, mass = np.empty((count, 2)), np.empty(count)
    for k in range(count):
        own[k, 0], own[k, 1] = points[near[k], 0], points[near[k], 1]
        mass[k] = weights[near[k]]
    for _ in range(3):
        inlier = _inliers(_off(line, own), mass)
        if inlier.sum() < _LEAST_CELLS:
            line[0] = math.nan
            break
        line = _least_squares(own[inlier], mass[inlier], along)
    return line


@kernel
def _off(line: Floats, points: Floats) -> Floats:
    """Signed distance of points (N, 2) to a line."""
    off = np.empty(len(points))
    for k in range(len(points)):
        x, y = points[k, 0] - line[0], points[k, 1] - line[1]
        off[k] = line[2] * y - line[3] * x
    return off


@kernel
def _inliers(off: Floats, weights: Floats) -> NDArray[np.bool_]:
    """Points within 2.5 robust standard deviations (weighted MAD) of the weighted median."""
    apart = np.abs(off - _weighted_median(off, weights))
    spread = 1.4826 * _weighted_median(apart, weights)
    return apart <= min(max(2.5 * spread, _INLIER_M[0]), _INLIER_M[1])


@kernel
def _weighted_median(values: Floats, weights: Floats) -> float:
    """Return the lower weighted median, by quickselect."""
    values, weights = values.copy(), weights.copy()
    count, wanted = len(values), 0.5 * weights.sum()
    while True:
        pivot = float(values[count // 2])
        below = at = 0.0
        for k in range(count):
            if values[k] < pivot:
                below += weights[k]
            elif values[k] == pivot:
                at += weights[k]
        if below < wanted <= below + at or below + at == 0.0:
            return pivot
        lower, kept = below >= wanted, 0
        for k in range(count):
            if values[k] != pivot and (values[k] < pivot) == lower:
                values[kept], weights[kept] = values[k], weights[k]
                kept += 1
        if kept == 0:  # sums of weights that are not whole are rounded
            return pivot
        wanted -= 0.0 if lower else below + at
        count = kept


@kernel
def _least_squares(points: Floats, weights: Floats, ahead: Floats) -> Floats:
    """Total least squares line (4,): a point on it, and its direction, oriented ahead."""
    x = y = mass = 0.0
    for k in range(len(points)):
        x += weights[k] * points[k, 0]
        y += weights[k] * points[k, 1]
        mass += weights[k]
    x, y = x / mass, y / mass
    xx = yy = xy = 0.0
    for k in range(len(points)):
        a, b = points[k, 0] - x, points[k, 1] - y
        xx += weights[k] * a * a
        yy += weights[k] * b * b
        xy += weights[k] * a * b
    angle = 0.5 * math.atan2(2 * xy, xx - yy)
    to_x, to_y = math.cos(angle), math.sin(angle)
    if to_x * ahead[0] + to_y * ahead[1] < 0.0:
        to_x, to_y = -to_x, -to_y
    return np.array([x, y, to_x, to_y])
