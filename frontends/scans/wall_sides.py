# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Sides of walls: the two faces of a thin wall look alike, but belong to different places.

A scan of a wall's far side fits the near side's likelihood as well as one of the near side, off by
the wall's thickness. Surface normals, towards the viewer, distinguish them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slarm_graph.frontends.scans.wall_tangents import BACK, ON
from slarm_graph.geometry import Floats
from slarm_graph.kernels import kernel

_CELL_M, _REACH_CELLS = 0.05, 2
"""Normals are stored within 0.1 m of a return: the noise of two returns and the error of a pose,
less than a partition's thickness."""
_CHORD_M = 0.1
"""Least length of a chord for a normal: five times a laser's noise of 0.02 m."""
_MAX_GAP_M = 0.3
"""Returns farther apart are of two surfaces: half a degree at 10 m and 15 degrees to the wall."""
_LEAST_SLANT = 0.1
"""Sine of the least angle between beam and wall at which the side is sure."""
_OCTANTS = 8
"""As many as a byte has bits."""
_ACROSS = 2
"""Surfaces this many octants apart may still be one, seen with noise or round a corner."""


@dataclass(frozen=True, slots=True)
class WallSides:
    """Grid of the surface normals in and beside each cell, by octant.

    Parameters
    ----------
    origin_x_m, origin_y_m : float
        Lower corner of cell (0, 0) [m].
    octants : (rows = y, cols = x) uint8
        Bit k for a surface whose normal, towards the viewer, lies in octant k; 0 for none.
    """

    origin_x_m: float
    origin_y_m: float
    octants: NDArray[np.uint8]


def wall_sides(scans: Sequence[Floats], poses: Floats) -> WallSides:
    """Build the grid of normals seen by scans (each (K, 2) [m], own frame) at poses (M, 3)."""
    seen = np.concatenate([_surfaces(s, p) for s, p in zip(scans, poses, strict=True)])
    margin_m = (_REACH_CELLS + 1) * _CELL_M
    if not len(seen):
        return WallSides(0.0, 0.0, np.zeros((1, 1), dtype=np.uint8))
    low = seen[:, :2].min(axis=0) - margin_m
    cols, rows = np.ceil((seen[:, :2].max(axis=0) + margin_m - low) / _CELL_M).astype(int)
    octants = np.zeros((rows, cols), dtype=np.uint8)
    _mark(octants, low, seen)
    return WallSides(float(low[0]), float(low[1]), octants)


def share_from_behind(sides: WallSides, surfaces: Floats, pose: Floats) -> float:
    """Share of a scan's surfaces on known walls that are seen from their unknown side.

    Parameters
    ----------
    sides : WallSides
    surfaces : (S, 4) float64
        Of the scan, by `own_surfaces`.
    pose : (3,) float64
        Of the scan in the frame of the sides.

    Returns
    -------
    float
        0 where it sees no known wall.
    """
    same, behind = _compare(sides.octants, _origin(sides), surfaces, pose)
    return behind / max(same + behind, 1)


def facing(sides: WallSides, points: Floats, surfaces: Floats, pose: Floats) -> Floats:
    """Return a scan's points (L, 2) without those on walls known from their other side only.

    Parameters
    ----------
    sides, surfaces, pose
        As of `share_from_behind`.
    points : (K, 2) float64
        Of the scan [m].
    """
    return np.asarray(_facing(sides.octants, _origin(sides), points, surfaces, pose))


def _origin(sides: WallSides) -> Floats:
    return np.array([sides.origin_x_m, sides.origin_y_m])


@kernel
def _surfaces(points: Floats, pose: Floats) -> Floats:
    """Surfaces (S, 4) of a scan at a pose (3,), in the pose's parent frame."""
    return _placed(own_surfaces(points), pose)


@kernel
def _placed(surfaces: Floats, pose: Floats) -> Floats:
    """Transform surfaces (S, 4) of a scan by its pose (3,)."""
    out = np.empty_like(surfaces)
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for k in range(len(surfaces)):
        x, y = surfaces[k, 0], surfaces[k, 1]
        out[k, 0] = pose[0] + c * x - s * y
        out[k, 1] = pose[1] + s * x + c * y
        out[k, 2] = surfaces[k, 2] + pose[2]
        out[k, 3] = surfaces[k, 3]
    return out


@kernel
def own_surfaces(points: Floats) -> Floats:
    """Surfaces (S, 4) of a scan (K, 2): position [m, m], direction of normal [rad], point index.

    Those seen at a grazing angle are left out; in the scan's own frame.
    """
    out = np.empty((len(points), 4))
    count = 0
    for i in range(len(points)):
        x, y = points[i, 0], points[i, 1]
        a, b = _end(points, i, BACK), _end(points, i, ON)
        dx, dy = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1]
        # Twice the area of viewer, a, b: its sign says on which side of the chord the viewer is.
        area = points[a, 0] * points[b, 1] - points[a, 1] * points[b, 0]
        if abs(area) <= _LEAST_SLANT * math.hypot(dx, dy) * math.hypot(x, y):
            continue
        turn = 0.5 * math.pi if area > 0.0 else -0.5 * math.pi
        out[count, 0], out[count, 1] = x, y
        out[count, 2] = math.atan2(dy, dx) + turn
        out[count, 3] = i
        count += 1
    return out[:count].copy()


@kernel
def _end(points: Floats, i: int, step: int) -> int:
    """Point along the surface, before or after point i, at which a chord from i is long enough."""
    k = i
    while 0 <= k + step < len(points):
        gap = math.hypot(points[k + step, 0] - points[k, 0], points[k + step, 1] - points[k, 1])
        if gap > _MAX_GAP_M:
            break
        k += step
        if math.hypot(points[k, 0] - points[i, 0], points[k, 1] - points[i, 1]) >= _CHORD_M:
            break
    return k


@kernel
def _octant(direction: float) -> int:
    return math.floor(direction / (2.0 * math.pi) * _OCTANTS) % _OCTANTS


@kernel
def _mark(octants: NDArray[np.uint8], origin: Floats, surfaces: Floats) -> None:
    for k in range(len(surfaces)):
        bit = 1 << _octant(surfaces[k, 2])
        col = math.floor((surfaces[k, 0] - origin[0]) / _CELL_M)
        row = math.floor((surfaces[k, 1] - origin[1]) / _CELL_M)
        for r in range(row - _REACH_CELLS, row + _REACH_CELLS + 1):
            for q in range(col - _REACH_CELLS, col + _REACH_CELLS + 1):
                octants[r, q] |= bit


@kernel
def _compare(
    octants: NDArray[np.uint8], origin: Floats, surfaces: Floats, pose: Floats
) -> tuple[int, int]:
    """Count the surfaces with a known normal of like direction, and those with others only."""
    same = behind = 0
    placed = _placed(surfaces, pose)
    for k in range(len(placed)):
        side = _side(octants, origin, placed[k])
        same += side > 0
        behind += side < 0
    return same, behind


@kernel
def _facing(
    octants: NDArray[np.uint8], origin: Floats, points: Floats, surfaces: Floats, pose: Floats
) -> Floats:
    """Leave out the points (K, 2) whose surfaces are known from their other side only."""
    placed = _placed(surfaces, pose)
    kept = np.empty((len(points), 2))
    count, k = 0, 0
    for i in range(len(points)):
        is_surface = k < len(placed) and placed[k, 3] == i
        if not (is_surface and _side(octants, origin, placed[k]) < 0):
            kept[count, 0], kept[count, 1] = points[i, 0], points[i, 1]
            count += 1
        k += is_surface
    return kept[:count]


@kernel
def _side(octants: NDArray[np.uint8], origin: Floats, surface: Floats) -> int:
    """1 where a known normal beside a surface is like its own, -1 where only others, 0 for none."""
    col = math.floor((surface[0] - origin[0]) / _CELL_M)
    row = math.floor((surface[1] - origin[1]) / _CELL_M)
    if not (0 <= row < octants.shape[0] and 0 <= col < octants.shape[1]):
        return 0
    known, own = octants[row, col], _octant(surface[2])
    if known == 0:
        return 0
    for d in range(-_ACROSS, _ACROSS + 1):
        if (known >> ((own + d) % _OCTANTS)) & 1 == 1:
            return 1
    return -1
