# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Known sizes of obstacles, and matching of measured plans to them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from shapely import Geometry, MultiPoint, Polygon, dwithin, get_parts, union_all

from slarm_graph.geometry import Floats
from slarm_graph.world import Solid, WorldMap

Size = tuple[float, ...]
"""Length, width and height [m], and the share of its bounding rectangle that the plan fills."""

_GAP_M = 1e-6
"""Solids within a micrometre touch: files state corners to less digits than that."""
_ALIKE_M = 0.01
"""Sizes that agree within this are indistinguishable."""


@dataclass(frozen=True, slots=True)
class MeasuredPlan:
    """Measurements of an obstacle's plan.

    Parameters
    ----------
    sides_m : (2,) float64
        Of the bounding rectangle, in any order [m].
    area_m2 : float
        Of the plan, hidden parts counted as filled [m^2].
    corners_seen : int
        Number of the rectangle's corners that the laser saw into, 4 for a free-standing obstacle.
    unseen_m : (2,) float64
        By how much each side may continue, hidden, into another obstacle [m].
    """

    sides_m: Floats
    area_m2: float
    corners_seen: int
    unseen_m: Floats


@dataclass(frozen=True, slots=True)
class Match:
    """The known size that matches a plan best.

    Parameters
    ----------
    misfit_m : float
        Of the best known size [m].
    height_m, share : float
        Of the highest of the sizes that are indistinguishable from the best.
    """

    misfit_m: float
    height_m: float
    share: float


def known_sizes_of(world: WorldMap) -> tuple[Size, ...]:
    """Return the sizes of all obstacles in a world, solids that touch as one.

    Obstacles that touch are seen as one, whatever their heights: they are listed per height and
    together, with the greatest height. This is what the paper assumes known: the sizes of walls
    and boxes, not their positions.
    """
    groups = [_size_of(g) for same in (True, False) for g in _touching(world.solids, same)]
    return tuple(sorted(set(groups)))


def match_size(plan: MeasuredPlan, sizes: Sequence[Size], tolerance_m: float) -> Match | None:
    """Match a plan to the known sizes; None when none agrees.

    Its sides and the square root of its area have to agree within the tolerance, sides also within
    half of themselves. The part of its rectangle that a size leaves empty is taken to be spread
    evenly over the four corners. Of sizes that agree equally well, such as one plan with two
    heights, the highest is taken: a shadow too many misses a link that exists, one too few
    promises a link that does not.

    Parameters
    ----------
    plan : Plan
    sizes : sequence of (length, width, height, share) [m, 1]
    tolerance_m : float
    """
    if not sizes:
        return None
    known = np.asarray(sizes, dtype=np.float64)
    off_m = np.minimum(_off_m(known[:, :2], plan), _off_m(known[:, 1::-1], plan))
    if not plan.unseen_m.any():
        empty = (1.0 - known[:, 3]) * plan.corners_seen / 4.0
        area_m2 = known[:, 0] * known[:, 1] * (1.0 - empty)
        off_m = np.maximum(off_m, np.abs(np.sqrt(area_m2) - np.sqrt(plan.area_m2)))
    best = float(off_m.min())
    if best > tolerance_m:
        return None
    alike = np.flatnonzero(off_m <= min(best + _ALIKE_M, tolerance_m))
    chosen = max(alike, key=lambda n: (known[n, 2], -off_m[n]))
    return Match(best, float(known[chosen, 2]), float(known[chosen, 3]))


def _off_m(known_m: Floats, plan: MeasuredPlan) -> Floats:
    """Largest disagreement (S,) of the two sides with sizes (S, 2) in this order [m]."""
    off = known_m - plan.sides_m
    off = np.where(off > 0.0, np.maximum(off - plan.unseen_m, 0.0), off)
    agree = (np.abs(off) <= 0.5 * known_m).all(axis=1)
    return np.where(agree, np.abs(off).max(axis=1), np.inf)


def _touching(solids: Sequence[Solid], same_height: bool) -> list[list[Solid]]:
    """Connected components of solids that touch."""
    groups: list[list[Solid]] = []
    for solid in solids:
        mine = [
            group
            for group in groups
            if any(
                dwithin(_hull(solid), _hull(other), _GAP_M)
                for other in group
                if not same_height or other.height_m == solid.height_m
            )
        ]
        groups = [group for group in groups if not any(group is one for one in mine)]
        groups.append([solid, *(other for group in mine for other in group)])
    return groups


def _hull(solid: Solid) -> Geometry:
    return MultiPoint(solid.corners_m).convex_hull


def _size_of(group: Sequence[Solid]) -> Size:
    corners = np.concatenate([solid.corners_m for solid in group]).astype(np.float32)
    _, sides, _ = cv2.minAreaRect(corners)
    length, width = sorted((round(float(side), 4) for side in sides), reverse=True)
    share = min(round(_outer_area_m2(group) / (length * width), 2), 1.0)
    return length, width, max(solid.height_m for solid in group), share


def _outer_area_m2(group: Sequence[Solid]) -> float:
    """Area inside the outer outline of solids that touch [m^2]."""
    # Grown by the gap that still counts as touching, so that they are of one piece.
    plans = [Polygon(solid.corners_m).buffer(_GAP_M, join_style="mitre") for solid in group]
    return float(sum(Polygon(part.exterior).area for part in get_parts(union_all(plans))))
