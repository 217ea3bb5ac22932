# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Obstacles as prisms: outlines become solids, and known sizes tell their heights."""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np

from slarm_graph.geometry import Floats
from slarm_graph.grid import GridGeometry, Mask
from slarm_graph.polygons import signed_area_m2
from slarm_graph.recovery.walls import Outline
from slarm_graph.world import Solid, WorldMap

Size = tuple[float, float, float]

_SQUARE = math.cos(math.radians(80.0))
_FULL_SHARE = 0.9
_ON_SIDE_M = 0.03


def known_sizes_of(world: WorldMap) -> tuple[Size, ...]:
    """Return length, width and height of every free-standing thing, solids that touch as one.

    This is what the paper takes for known: how large walls and boxes are, not where they stand.
    """
    groups: list[list[Solid]] = []
    for solid in world.solids:
        touching = [g for g in groups if any(_touch(solid, other) for other in g)]
        groups = [g for g in groups if not any(g is t for t in touching)]
        groups.append([solid, *(other for g in touching for other in g)])
    sizes = set()
    for group in groups:
        corners = np.concatenate([solid.corners_m for solid in group]).astype(np.float32)
        _, sides, _ = cv2.minAreaRect(corners)
        length, width = sorted((round(float(side), 4) for side in sides), reverse=True)
        sizes.add((length, width, max(solid.height_m for solid in group)))
    return tuple(sorted(sizes))


def _touch(a: Solid, b: Solid) -> bool:
    """Whether two solids of one height overlap or share an edge, by their bounding boxes."""
    low = np.maximum(a.corners_m.min(axis=0), b.corners_m.min(axis=0))
    high = np.minimum(a.corners_m.max(axis=0), b.corners_m.max(axis=0))
    return a.height_m == b.height_m and bool(np.all(low <= high + 1e-6))


def matched_blocks(
    outlines: Sequence[Outline], sizes: Sequence[Size], tolerance_m: float
) -> list[Solid]:
    """Find blocks of known size: islands, and blocks that stand at a wall or in a corner.

    Parameters
    ----------
    outlines : sequence of Outline
        Of the free region.
    sizes : sequence of (length, width, height) [m]
    tolerance_m : float

    Returns
    -------
    list of Solid
        Counter-clockwise, with the height of the size they match.
    """
    blocks: list[Solid] = []
    for outline in outlines:
        corners = outline.corners_m
        if signed_area_m2(corners) < 0.0:
            found = [_island(corners)]
        else:
            found = [_at_wall(corners, k) for k in range(len(corners))]
            found += [_in_corner(corners, k) for k in range(len(corners))]
        for block in found:
            height = None if block is None else _height_of(block, sizes, tolerance_m)
            if block is not None and height is not None:
                blocks.append(Solid(f"block {len(blocks) + 1}", block, height))
    return blocks


def wall_strips(
    outlines: Sequence[Outline],
    blocks: Sequence[Solid],
    geometry: GridGeometry,
    occupied: Mask,
    height_m: float,
) -> list[Solid]:
    """Return a thin solid behind every side of the outlines that is a wall and in no block."""
    behind_m = geometry.resolution_m
    strips: list[Solid] = []
    for outline in outlines:
        starts, ends = outline.corners_m, np.roll(outline.corners_m, -1, axis=0)
        for start, end, fitted in zip(starts, ends, outline.fitted, strict=True):
            length = float(np.linalg.norm(end - start))
            if length < 1e-9 or any(_on_side(block, start, end) for block in blocks):
                continue
            back = np.array([end[1] - start[1], start[0] - end[0]]) / length * behind_m
            if not fitted and not _is_wall(geometry, occupied, start, end, back):
                continue
            corners = np.array([start, start + back, end + back, end])
            strips.append(Solid(f"wall {len(strips) + 1}", corners, height_m))
    return strips


def _island(corners: Floats) -> Floats | None:
    """The rectangle around a clockwise outline that nearly fills it, counter-clockwise."""
    ring = corners[::-1].copy()
    if len(ring) == 4:
        return ring
    rectangle = cv2.minAreaRect(ring.astype(np.float32))
    width, height = rectangle[1]
    if signed_area_m2(ring) < _FULL_SHARE * width * height:
        return None
    box = np.asarray(cv2.boxPoints(rectangle), dtype=np.float64)
    return box if signed_area_m2(box) > 0.0 else box[::-1].copy()


def _at_wall(corners: Floats, k: int) -> Floats | None:
    """The block whose front is side k, with a side of equal depth at both of its ends."""
    a, b, c, d = (corners[(k + i) % len(corners)] for i in (-1, 0, 1, 2))
    if not (_turns_right(a, b, c) and _turns_right(b, c, d)):
        return None
    left, right = np.linalg.norm(a - b), np.linalg.norm(d - c)
    if min(left, right) < _FULL_SHARE * max(left, right):
        return None
    back = 0.5 * (left + right) * _right_of(b, c)
    return np.array([c, b, b + back, c + back])


def _in_corner(corners: Floats, k: int) -> Floats | None:
    """The block that shows one edge, corner k, and two sides, and hides the rest."""
    before, a, b, c, after = (corners[(k + i) % len(corners)] for i in (-2, -1, 0, 1, 2))
    if not _turns_right(a, b, c) or _turns_right(before, a, b) or _turns_right(b, c, after):
        return None
    return np.array([c, b, a, a + c - b])


def _turns_right(a: Floats, b: Floats, c: Floats) -> bool:
    """Whether a corner is nearly square and turns right, as around a block."""
    u, v = b - a, c - b
    lengths = float(np.linalg.norm(u) * np.linalg.norm(v))
    cross = float(u[0] * v[1] - u[1] * v[0])
    return lengths > 0.0 and cross < 0.0 and abs(float(u @ v)) <= _SQUARE * lengths


def _right_of(start: Floats, end: Floats) -> Floats:
    step = (end - start) / np.linalg.norm(end - start)
    return np.array([step[1], -step[0]])


def _height_of(block: Floats, sizes: Sequence[Size], tolerance_m: float) -> float | None:
    sides = np.sort([np.linalg.norm(block[1] - block[0]), np.linalg.norm(block[2] - block[1])])
    misfits = [float(np.abs(np.sort(size[:2]) - sides).max()) for size in sizes]
    if not misfits or min(misfits) > tolerance_m:
        return None
    return sizes[int(np.argmin(misfits))][2]


def _on_side(block: Solid, start: Floats, end: Floats) -> bool:
    """Whether a side of an outline is one of a block's."""
    ring, points = block.corners_m, np.array([start, end])
    for a, b in zip(ring, np.roll(ring, -1, axis=0), strict=True):
        length = float(np.linalg.norm(b - a))
        step = (b - a) / length
        along, across = (points - a) @ step, (points - a) @ np.array([-step[1], step[0]])
        is_between = along.min() > -_ON_SIDE_M and along.max() < length + _ON_SIDE_M
        if is_between and np.abs(across).max() < _ON_SIDE_M:
            return True
    return False


def _is_wall(
    geometry: GridGeometry, occupied: Mask, start: Floats, end: Floats, back: Floats
) -> bool:
    """Whether most of what lies just behind a side is occupied."""
    count = max(2, int(np.linalg.norm(end - start) / geometry.resolution_m) + 1)
    along = start + np.linspace(0.05, 0.95, count)[:, None] * (end - start)
    behind = np.stack([along + 0.5 * back, along + 1.5 * back])
    hits = geometry.sample(occupied, behind, outside=False).any(axis=0)
    return bool(hits.mean() >= 0.5)
