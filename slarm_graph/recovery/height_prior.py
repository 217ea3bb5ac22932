# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Prior distribution of obstacle heights per class of plan.

A 2D laser measures a plan and that the obstacle reaches the laser's height, no more. The prior
follows from the laser's height, the ceiling, and what is usual in rooms. The figures are those of
standards, not of any world that comes with the package:

* surfaces to work at or over begin at 0.70 m and end at 1.10 m: desks 0.72 m (EN 527-1), kitchen
  worktops 0.85 to 0.90 m (EN 1116), workbenches and drums of 200 l 0.88 m (ISO 15750), counters;
* what is brought into a room passes its door, 2.1 m high (DIN 18101: 2.0 to 2.1 m): cupboards and
  shelves (EN 14073), machines, crates that are stacked; which of the two an obstacle is is not
  known, so each has half;
* screens that part an office are 1.2 to 1.8 m high (EN 1023-1), walls reach the ceiling;
* columns carry the ceiling, but half of what is as thin are drums, bins and stools;
* pallet racks reach from one storey of 2.1 m up to the ceiling (EN 15620).

Within these bounds heights are uniform; how often an obstacle is beyond them is a judgement, one in
ten or twenty.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Final, Literal

import numpy as np

from slarm_graph.geographic import HeightGroup
from slarm_graph.geometry import Floats

PlanKind = Literal["wall", "screen", "column", "rack", "furniture"]

LEVELS: Final = 10
"""Equally likely heights per obstacle; half as many halves the time and leaves probabilities in
steps of a fifth."""
_SURFACE_M: Final = (0.70, 1.10)
"""Surfaces to work at or over: desks (EN 527-1) to counters."""
_DOOR_M: Final = 2.10
"""Height of a door, which furniture has to pass (DIN 18101)."""
_SCREEN_M: Final = (1.2, 1.8)
"""Heights of office screens (EN 1023-1)."""
_THIN_M: Final = 0.35
"""Walls between rooms are thinner (masonry up to 0.30 m and plaster), furniture is deeper (0.37 m
for folders, EN 14073)."""
_COLUMN_M: Final = 0.5
"""Columns of a frame are 0.3 to 0.5 m thick (EN 1992-1-2: 0.35 m for two hours of fire)."""
_RACK_M: Final = 4.0
"""Longer obstacles that are not rooms are rows of racks, shelves or lockers."""
_ROOM_M: Final = 2.8
"""Depth of two pallets of 1.2 m with the gap between them; an obstacle larger in both directions
encloses something: a shaft, a cabin, a room."""
_SOLID: Final = 0.7
"""A plan that fills less of its rectangle is walls at angles; a disc fills 0.785."""


@dataclass(frozen=True, slots=True)
class HeightPrior:
    """Prior of obstacle heights in a building.

    Parameters
    ----------
    ceiling_m : float
    laser_height_m : float
        Lower bound of the height of obstacles that the laser sees.
    """

    ceiling_m: float
    laser_height_m: float

    def levels_m(self, kind: PlanKind) -> Floats:
        """Return LEVELS equally likely heights (LEVELS,) of a class, ascending [m]."""
        quantiles, heights_m = self._distribution(kind)
        middle = (np.arange(LEVELS) + 0.5) / LEVELS
        found = np.interp(middle, quantiles, heights_m)
        return np.clip(found, self.laser_height_m, max(self.ceiling_m, self.laser_height_m))

    def _distribution(self, kind: PlanKind) -> tuple[Sequence[float], Sequence[float]]:
        """Return the quantile function: probabilities, ascending, and their heights [m]."""
        low_m, top_m = self.laser_height_m, self.ceiling_m
        if kind == "furniture":
            return (0.0, 0.1, 0.5, 0.9, 1.0), (low_m, *_SURFACE_M, _DOOR_M, top_m)
        if kind == "column":
            return (0.0, 0.05, 0.25, 0.45, 0.45, 1.0), (low_m, *_SURFACE_M, _DOOR_M, top_m, top_m)
        if kind == "rack":
            return (0.0, 0.1, 1.0), (_SURFACE_M[0], _DOOR_M, top_m)
        if kind == "screen":
            return (0.0, 0.5, 0.5, 1.0), (*_SCREEN_M, top_m, top_m)
        return (0.0, 1.0), (top_m, top_m)


def plan_kind(sides_m: Floats, area_m2: float, *, at_wall: bool) -> PlanKind:
    """Classify an obstacle by its plan.

    Parameters
    ----------
    sides_m : (2,)
        Of its bounding rectangle [m].
    area_m2 : float
    at_wall : bool
        Whether it is joined to the walls around the room.
    """
    short, long = sorted(float(side) for side in sides_m)
    if short < _THIN_M and long > _COLUMN_M:
        return "wall" if at_wall else "screen"
    if short > _ROOM_M or area_m2 < _SOLID * short * long:
        return "wall"
    if long > _RACK_M:
        return "rack"
    return "column" if long <= _COLUMN_M else "furniture"


def height_group(
    prior: HeightPrior, numbers: Sequence[int], kinds: Sequence[PlanKind]
) -> HeightGroup:
    """Return the joint distribution of the heights of solids that are low or high together.

    Parameters
    ----------
    prior : HeightPrior
    numbers : sequence of int
        Of the map's solids.
    kinds : sequence of PlanKind, as many
    """
    return HeightGroup(tuple(numbers), np.stack([_levels_m(prior, k) for k in kinds], axis=1))


@cache
def _levels_m(prior: HeightPrior, kind: PlanKind) -> Floats:
    return prior.levels_m(kind)
