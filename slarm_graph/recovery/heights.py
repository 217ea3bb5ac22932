# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Heights of obstacles of unknown size: the obstacle of each side of an outline, and its prior."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import compress

import numpy as np

from slarm_graph.config import RecoveryConfig
from slarm_graph.counts import count_of
from slarm_graph.geographic import HeightGroup
from slarm_graph.polygons import signed_area_m2
from slarm_graph.recovery.height_prior import HeightPrior, PlanKind, height_group, plan_kind
from slarm_graph.recovery.obstacle_candidates import islands_in, runs_on
from slarm_graph.recovery.obstacles import WallStrip
from slarm_graph.recovery.returns import Returns
from slarm_graph.recovery.walls import Outline
from slarm_graph.world import Solid

_LONGEST_M = 10.0
"""Longest obstacle before a wall: ten metres of shelves are one."""

Sides = list[tuple[int, PlanKind]]
"""For every side of an outline the number of its obstacle, and its class."""
_PRIOR = "prior (standards, by class of plan)"


def certain_height_m(config: RecoveryConfig) -> float | None:
    """Height of obstacles of unknown size [m]; None where they have the prior."""
    if config.default_height_m is not None:
        return config.default_height_m
    # Where the sizes of obstacles are known, whatever matches none of them is a wall.
    certain = config.unknown_heights == "infinite" or config.known_sizes
    return math.inf if certain else None


def height_source(blocks: Sequence[Solid], strips: Sequence[Solid], config: RecoveryConfig) -> str:
    """Describe the source of a map's heights, given its blocks of known size and other walls."""
    source = "default"
    if config.default_height_m is None:
        certain = certain_height_m(config) is not None or not strips
        source = "infinite" if certain else _PRIOR
    return (
        f"matched sizes ({count_of(len(blocks), 'obstacle')}), else {source}" if blocks else source
    )


def uncertain_heights(
    outlines: Sequence[Outline],
    strips: Sequence[WallStrip],
    returns: Returns,
    config: RecoveryConfig,
    first: int,
) -> tuple[HeightGroup, ...]:
    """Return the height prior of the obstacles along every outline.

    Parameters
    ----------
    outlines : sequence of Outline
    strips : sequence of WallStrip
    returns : Returns
    config : RecoveryConfig
    first : int
        Number of the first strip among the map's solids.
    """
    prior = HeightPrior(config.ceiling_m, config.laser_height_m)
    of_outline: dict[int, list[int]] = {}
    for k, strip in enumerate(strips):
        of_outline.setdefault(strip.outline, []).append(k)
    numbers = sorted(of_outline)
    groups = []
    sides_of = side_obstacles([outlines[n] for n in numbers], returns)
    for n, sides in zip(numbers, sides_of, strict=True):
        of_obstacle: dict[int, list[int]] = {}
        for k in of_outline[n]:
            of_obstacle.setdefault(sides[strips[k].side][0], []).append(k)
        for _, own in sorted(of_obstacle.items()):
            kinds = [sides[strips[k].side][1] for k in own]
            groups.append(height_group(prior, [first + k for k in own], kinds))
    return tuple(groups)


def side_obstacles(outlines: Sequence[Outline], returns: Returns) -> Iterator[Sides]:
    """Assign every side of outlines of the free region to an obstacle, and classify that.

    Obstacles are numbered along the outline. An island is one. Elsewhere the outline is a wall,
    number 0, except obstacles before it, of which those with fewest sides are taken first.
    """
    is_island = [signed_area_m2(outline.corners_m) < 0.0 for outline in outlines]
    islands = iter(islands_in(list(compress(outlines, is_island)), returns))
    for outline, is_one in zip(outlines, is_island, strict=True):
        if is_one:
            plan = next(islands).plan
            kind = plan_kind(plan.sides_m, plan.area_m2, at_wall=False)
            yield [(0, kind)] * len(outline.corners_m)
        else:
            yield _sides_before_walls(outline)


def _sides_before_walls(outline: Outline) -> Sides:
    sides: Sides = [(0, "wall")] * len(outline.corners_m)
    taken: set[int] = set()
    for found in sorted(runs_on(outline, _LONGEST_M), key=lambda c: len(c.sides)):
        kind = plan_kind(found.plan.sides_m, found.plan.area_m2, at_wall=True)
        if kind == "wall" or taken.intersection(found.sides):
            continue
        taken.update(found.sides)
        for side in found.sides:
            sides[side] = found.sides[0] + 1, kind
    return sides


def with_medians(
    strips: Sequence[WallStrip], groups: Sequence[HeightGroup], first: int
) -> list[WallStrip]:
    """Return the strips, each with the median of its height prior."""
    found = list(strips)
    if not groups:
        return found
    numbers = [number for group in groups for number in group.solids]
    medians_m = np.median(np.concatenate([group.levels_m for group in groups], axis=1), axis=0)
    for number, median_m in zip(numbers, medians_m.tolist(), strict=True):
        strip = found[number - first]
        solid = Solid(strip.solid.name, strip.solid.corners_m, median_m)
        found[number - first] = WallStrip(solid, strip.outline, strip.side)
    return found
