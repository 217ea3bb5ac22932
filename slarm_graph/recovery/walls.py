# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Straighten walls: move the outline of the free region onto lines fitted to laser returns.

A stretch of outline with enough returns beside it is replaced by their line, parallel to one of the
building's two main directions where the returns allow it; the others stay on the cells' outline.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from slarm_graph.geometry import Floats
from slarm_graph.grid import Mask
from slarm_graph.polygons import next_corners
from slarm_graph.raster.outlines import simplified_m
from slarm_graph.recovery.returns import Returns
from slarm_graph.recovery.wall_lines import SHORTEST_M, Wall, wall_between, walls_between

_SIMPLIFY_CELLS = 1.5
"""Outlines of cells have stairs of one cell; this is the least tolerance that removes all of
them."""
_MAIN_RAD = math.radians(4.0)
"""Walls that differ by less from the building's direction are meant to be parallel to it: cells of
0.05 m cannot tell over a metre."""
_SNAP_CELLS = 0.3
"""A wall is turned parallel where that moves its end by less than a third of a cell."""
_SAME_RAD = math.radians(3.0)
"""Two stretches of a wall differ by less: half a cell over half a metre."""
_SAME_CELLS = 0.6
"""And lie apart by little more than half a cell, which is what rounding to cells makes of one
line."""
_PARALLEL_RAD = math.radians(15.0)
"""Lines that meet at less have no corner that is known: 1 cm across is 4 cm along."""
_CORNER_CELLS = 4.0
"""A corner farther from where cells have it is another's."""
_JUT_CELLS = 2.5
"""A protrusion smaller than this between two stretches of a wall is a frame or noise: merged."""
_MOST_TAKEN_IN = 5
"""Stretches between two of the same wall: a frame has three, and both sides of it one each."""
_LEAST_MAIN_M = 1.0
"""Less fitted wall than this does not determine the building's direction."""


@dataclass(frozen=True, slots=True)
class Outline:
    """A closed outline of the free region, which lies on its left.

    Parameters
    ----------
    corners_m : (K, 2) float64
    fitted : (K,) bool
        Whether the side from corner k to k + 1 lies on a fitted line.
    """

    corners_m: Floats
    fitted: Mask


def straighten_outlines(
    outlines_m: Sequence[Floats], returns: Returns, resolution_m: float
) -> list[Outline]:
    """Straighten all outlines (K, 2) of a free region [m]."""
    corners = [simplified_m(outline, _SIMPLIFY_CELLS * resolution_m) for outline in outlines_m]
    rings = [_walls(ring, returns, resolution_m) for ring in corners]
    main_rad = main_direction_rad([wall for ring in rings for wall in ring])
    return [
        _closed(_joined(walls, returns, resolution_m), main_rad, resolution_m)
        if walls
        else Outline(ring, np.zeros(len(ring), dtype=np.bool_))
        for ring, walls in zip(corners, rings, strict=True)
    ]


def _walls(corners: Floats, returns: Returns, resolution_m: float) -> list[Wall]:
    """Fit lines to the sides of an outline; none where it is small, or no side has one."""
    if np.ptp(corners, axis=0).max() < SHORTEST_M:
        return []
    walls = list(walls_between(corners, next_corners(corners), returns, resolution_m))
    return walls if any(wall.fitted for wall in walls) else []


def main_direction_rad(walls: Sequence[Wall]) -> float | None:
    """Angle in [0, pi/2) to which most fitted length is parallel or perpendicular; else None."""
    fitted = [wall for wall in walls if wall.fitted]
    lengths = np.array([wall.length_m for wall in fitted])
    if lengths.sum() < _LEAST_MAIN_M:
        return None
    fourfold = 4.0 * np.array([math.atan2(w.direction[1], w.direction[0]) for w in fitted])
    bins = np.round(np.mod(fourfold, 2 * np.pi) / (2 * np.pi) * 90).astype(int) % 90
    votes = np.bincount(bins, weights=lengths, minlength=90)
    votes += np.roll(votes, 1) + np.roll(votes, -1)
    peak = votes.argmax() * 2 * np.pi / 90
    near = np.cos(fourfold - peak) > math.cos(4 * _MAIN_RAD)
    weights = lengths[near]
    mean = np.sum(weights * np.exp(1j * fourfold[near]))
    return float(np.mod(np.angle(mean) / 4.0, np.pi / 2))


def _joined(ring: list[Wall], returns: Returns, resolution_m: float) -> list[Wall]:
    """Merge every fitted wall with its neighbours on the same line and protrusions between them."""
    for step in (1, -1):
        at = 0
        while at < len(ring):
            taken = _taken_in(ring, at, step, returns, resolution_m) if ring[at].fitted else None
            if taken is None:
                at += 1
                continue
            wall, count = taken
            gone = sorted(((at + step * k) % len(ring) for k in range(1, count + 1)), reverse=True)
            ring[at] = wall
            at -= sum(index < at for index in gone)
            for index in gone:
                del ring[index]
    return ring


def _taken_in(
    ring: list[Wall], at: int, step: int, returns: Returns, resolution_m: float
) -> tuple[Wall, int] | None:
    """Return the wall merged with neighbours on one side, and their number; None without any."""
    wall = ring[at]
    for count in range(1, min(_MOST_TAKEN_IN, len(ring) - 3) + 1):
        other = ring[(at + step * count) % len(ring)]
        far = other.end if step > 0 else other.start
        if abs(wall.off_m(far)) > _JUT_CELLS * resolution_m:
            return None
        if other.fitted and not _same_line(wall, other, resolution_m):
            continue
        start, end = (wall.start, far) if step > 0 else (far, wall.end)
        if np.linalg.norm(end - start) < wall.length_m + 0.5 * resolution_m:
            continue
        both = wall_between(start, end, returns, resolution_m)
        if both.fitted and _same_line(wall, both, resolution_m):
            return both, count
    return None


def _same_line(a: Wall, b: Wall, resolution_m: float) -> bool:
    if not (a.fitted and b.fitted) or a.direction @ b.direction < math.cos(_SAME_RAD):
        return False
    reach = _SAME_CELLS * resolution_m
    return bool(abs(a.off_m(_foot(b, 0.5 * (b.start + b.end)))) <= reach)


def _closed(ring: list[Wall], main_rad: float | None, resolution_m: float) -> Outline:
    """Snap walls to the main directions, and intersect neighbours in corners."""
    walls = [_snapped(wall, main_rad, resolution_m) for wall in ring]
    corners: list[Floats] = []
    fitted: list[bool] = []
    for before, wall in zip([walls[-1], *walls[:-1]], walls, strict=True):
        meet = _corner(before, wall, resolution_m)
        if meet is None:
            # A jog: the side between the two feet belongs to neither line.
            corners += [_foot(before, wall.start), _foot(wall, wall.start)]
            fitted += [False, wall.fitted]
        else:
            corners.append(meet)
            fitted.append(wall.fitted)
    return Outline(np.array(corners), np.array(fitted))


def _snapped(wall: Wall, main_rad: float | None, resolution_m: float) -> Wall:
    if main_rad is None or not wall.fitted:
        return wall
    angle = math.atan2(wall.direction[1], wall.direction[0])
    square = main_rad + round((angle - main_rad) / (np.pi / 2)) * np.pi / 2
    turn = abs(angle - square)
    sway_m = 0.5 * wall.length_m * math.sin(turn)
    if turn > _MAIN_RAD or sway_m > max(0.015, _SNAP_CELLS * resolution_m):
        return wall
    direction = np.array([math.cos(square), math.sin(square)])
    return Wall(wall.start, wall.end, wall.anchor, direction, fitted=True)


def _foot(wall: Wall, point: Floats) -> Floats:
    return np.asarray(wall.anchor + (point - wall.anchor) @ wall.direction * wall.direction)


def _corner(a: Wall, b: Wall, resolution_m: float) -> Floats | None:
    """Intersection of two walls; None when nearly parallel or far from the cells' corner."""
    # Of single numbers Python's own are several times as fast as numpy's.
    (ax, ay), (bx, by) = a.direction.tolist(), b.direction.tolist()
    cross = ax * by - ay * bx
    if abs(cross) < math.sin(_PARALLEL_RAD):
        near = np.linalg.norm(_foot(a, b.start) - _foot(b, b.start)) < 1e-9
        return _foot(b, b.start) if near else None
    (x, y), (off_x, off_y) = a.anchor.tolist(), (a.anchor - b.anchor).tolist()
    along = (bx * off_y - by * off_x) / cross
    meet = x + ax * along, y + ay * along
    if math.dist(meet, b.start.tolist()) > _CORNER_CELLS * resolution_m:
        return None
    return np.array(meet)
