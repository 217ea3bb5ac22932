# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Convexity of polygons, and the nearest point on an outline."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from slarm_graph.geometry import Floats
from slarm_graph.grid import Mask
from slarm_graph.polygons import contains, counter_clockwise, next_corners


def nearest_on_outline(corners_m: ArrayLike, point: ArrayLike) -> tuple[Floats, Floats]:
    """Return the outline's nearest point (2,) and the outward unit normal (2,) there.

    Parameters
    ----------
    corners_m : (K, 2), counter-clockwise
    point : (2,)
    """
    a = np.asarray(corners_m, dtype=np.float64)
    edge = next_corners(a) - a
    length_sq = np.maximum(np.sum(edge * edge, axis=1), 1e-300)
    share = np.clip(np.sum((np.asarray(point) - a) * edge, axis=1) / length_sq, 0.0, 1.0)
    feet = a + share[:, None] * edge
    best = int(np.argmin(np.sum((feet - point) ** 2, axis=1)))
    normal = np.array([edge[best, 1], -edge[best, 0]]) / np.sqrt(length_sq[best])
    return feet[best], normal


def is_convex(corners_m: ArrayLike) -> bool:
    """Tell whether a counter-clockwise polygon (K, 2) never turns right."""
    return bool(_are_convex(np.asarray(corners_m, dtype=np.float64)))


def _are_convex(corners: Floats) -> Mask:
    """Which polygons (..., K, 2) never turn right."""
    edge = next_corners(corners) - corners
    ahead = next_corners(edge)
    turn = edge[..., 0] * ahead[..., 1] - edge[..., 1] * ahead[..., 0]
    scale = np.linalg.norm(edge, axis=-1) * np.linalg.norm(ahead, axis=-1)
    return np.asarray((turn >= -1e-12 * scale).all(axis=-1))


def convex_plans(polygons_m: Sequence[Floats]) -> list[list[Floats]]:
    """Cut many simple polygons (K, 2) into convex ones each; those of four corners all at once."""
    quads = [n for n, polygon in enumerate(polygons_m) if len(polygon) == 4]
    whole = np.zeros(len(polygons_m), dtype=np.bool_)
    if quads:
        whole[quads] = _are_convex(np.stack([polygons_m[n] for n in quads]))
    return [
        [polygon] if is_whole else convex_pieces(polygon)
        for polygon, is_whole in zip(polygons_m, whole.tolist(), strict=True)
    ]


def convex_pieces(corners_m: ArrayLike) -> list[Floats]:
    """Cut a simple polygon (K, 2) into convex ones: itself, or triangles by clipping ears."""
    ring = counter_clockwise(np.asarray(corners_m, dtype=np.float64))
    if is_convex(ring):
        return [ring]
    pieces = []
    while len(ring) > 3:
        ear = next((i for i in range(len(ring)) if _is_ear(ring, i)), 0)
        pieces.append(ring[[ear - 1, ear, (ear + 1) % len(ring)]])
        ring = np.delete(ring, ear, axis=0)
    return [*pieces, ring]


def _is_ear(ring: Floats, i: int) -> bool:
    a, b, c = ring[i - 1], ring[i], ring[(i + 1) % len(ring)]
    if (b[0] - a[0]) * (c[1] - b[1]) - (b[1] - a[1]) * (c[0] - b[0]) <= 0.0:
        return False
    others = np.array([q for q in ring if not any(np.array_equal(q, v) for v in (a, b, c))])
    return not len(others) or not contains(np.array([a, b, c]), others).any()
