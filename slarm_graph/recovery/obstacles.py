# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Obstacles as prisms: solids from outlines, with heights by matching known sizes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from slarm_graph.geometry import Floats
from slarm_graph.grid import GridGeometry, Mask
from slarm_graph.polygons import is_simple, next_corners
from slarm_graph.recovery.known_sizes import Match, Size, match_size
from slarm_graph.recovery.obstacle_candidates import ObstacleCandidate, candidates_on, convex_hull
from slarm_graph.recovery.returns import Returns
from slarm_graph.recovery.walls import Outline
from slarm_graph.world import Solid

_FULL_SHARE = 0.9
"""Plans that fill nine tenths of their rectangle are boxes: a disc fills 0.785."""
_SURE_M = 0.02
"""Two centimetres, the noise of a wall fitted to returns: such a fit is no accident."""
_INSIDE_M = 0.1
"""A box may reach so far into the free region, two cells of 0.05 m, before it cannot be there."""

_Taken = dict[tuple[int, int], Floats]
"""Corners of the block that has a side, by outline and side."""


@dataclass(frozen=True, slots=True)
class Block:
    """An obstacle of known size.

    Parameters
    ----------
    solid : Solid
        Counter-clockwise, with the height of the size it has.
    outline : int
        Which of the outlines it was found on.
    sides : frozenset of int
        The sides of that outline that are its own.
    """

    solid: Solid
    outline: int
    sides: frozenset[int]


def matched_blocks(
    outlines: Sequence[Outline], returns: Returns, sizes: Sequence[Size], tolerance_m: float
) -> list[Block]:
    """Find blocks of known size: islands, and obstacles at walls, in corners, at other obstacles.

    Greedily: candidates with a sure match first, then by misfit per metre of outline; no side is
    used twice. An obstacle that continues behind a block already found may be longer than its
    visible part, by what fits into that block.

    Parameters
    ----------
    outlines : sequence of Outline
        Of the free region.
    returns : Returns
        Of the laser; they give the plan of islands whose sides are too short to be fitted.
    sizes : sequence of (length, width, height, share) [m, 1]
    tolerance_m : float
    """
    blocks: list[Block] = []
    taken: _Taken = {}
    for n, candidate, own in _ranked(outlines, returns, sizes, tolerance_m):
        keys = {(n, side) for side in candidate.sides}
        if keys & taken.keys():
            continue
        unseen_m = _hidden_m(candidate, n, outlines[n].corners_m, taken)
        if unseen_m.any():
            own = match_size(replace(candidate.plan, unseen_m=unseen_m), sizes, tolerance_m)
        corners = None if own is None else _corners_m(candidate, own, outlines)
        if own is not None and corners is not None:
            solid = Solid(f"block {len(blocks) + 1}", corners, own.height_m)
            blocks.append(Block(solid, n, frozenset(candidate.sides)))
            taken.update(dict.fromkeys(keys, corners))
    return blocks


@dataclass(frozen=True, slots=True)
class WallStrip:
    """A thin solid behind a side of an outline, of no known size."""

    solid: Solid
    outline: int
    side: int


def wall_strips(
    outlines: Sequence[Outline],
    blocks: Sequence[Block],
    geometry: GridGeometry,
    occupied: Mask,
    height_m: float,
) -> list[WallStrip]:
    """Return a thin solid behind every side of the outlines that is a wall and in no block."""
    if not outlines:
        return []
    taken = {(block.outline, side) for block in blocks for side in block.sides}
    sides = [(n, k) for n, outline in enumerate(outlines) for k in range(len(outline.corners_m))]
    starts = np.concatenate([outline.corners_m for outline in outlines])
    ends = np.concatenate([next_corners(outline.corners_m) for outline in outlines])
    fitted = np.concatenate([outline.fitted for outline in outlines])
    length = np.linalg.norm(ends - starts, axis=1)
    wanted = (length >= 1e-9) & np.array([side not in taken for side in sides])
    starts, ends, fitted, length = starts[wanted], ends[wanted], fitted[wanted], length[wanted]
    step = ends - starts
    back = np.stack([step[:, 1], -step[:, 0]], axis=1) / length[:, None] * geometry.resolution_m
    wall = fitted.copy()
    wall[~fitted] = _are_walls(geometry, occupied, starts[~fitted], ends[~fitted], back[~fitted])
    plans = np.stack([starts, starts + back, ends + back, ends], axis=1)[wall]
    own = [side for side, is_wanted in zip(sides, wanted, strict=True) if is_wanted]
    own = [side for side, is_wall in zip(own, wall, strict=True) if is_wall]
    return [
        WallStrip(Solid(f"wall {number}", corners, height_m), *side)
        for number, (corners, side) in enumerate(zip(plans, own, strict=True), start=1)
    ]


def _ranked(
    outlines: Sequence[Outline], returns: Returns, sizes: Sequence[Size], tolerance_m: float
) -> list[tuple[int, ObstacleCandidate, Match | None]]:
    """Obstacle candidates with their outline and matching size, in the order to take them."""
    if not sizes:
        return []
    longest_m = max(math.hypot(size[0], size[1]) for size in sizes) + 2.0 * tolerance_m
    found = [
        (n, candidate, match_size(candidate.plan, sizes, tolerance_m))
        for n, outline in enumerate(outlines)
        for candidate in candidates_on(outline, returns, longest_m)
    ]
    return sorted(found, key=lambda item: _rank(item[1], item[2]))


def _rank(candidate: ObstacleCandidate, own: Match | None) -> tuple[int, float, float]:
    """Sort key of candidates: sure ones, fewest sides first; then misfit per metre of outline."""
    if own is None:
        return 2, 0.0, 0.0
    if own.misfit_m <= _SURE_M:
        return 0, float(len(candidate.sides)), own.misfit_m
    return 1, own.misfit_m / candidate.shown_m, 0.0


def _hidden_m(candidate: ObstacleCandidate, n: int, corners: Floats, taken: _Taken) -> Floats:
    """Hidden length (2,) by which a rectangle's sides may continue into blocks found before [m]."""
    unseen = np.zeros(2)
    if candidate.plan.corners_seen == 4:
        return unseen
    count, axes = len(corners), np.diff(candidate.box_m[:3], axis=0)
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    for own, beside in ((candidate.sides[0], -1), (candidate.sides[-1], 1)):
        other = taken.get((n, (own + beside) % count))
        if other is not None:
            side = int(np.abs(axes @ (corners[(own + 1) % count] - corners[own])).argmax())
            unseen[side] += np.ptp(other @ axes[side])
    return unseen


def _corners_m(
    candidate: ObstacleCandidate, own: Match, outlines: Sequence[Outline]
) -> Floats | None:
    """A block's corners; None where it would reach into the free region."""
    if own.share < _FULL_SHARE:
        return candidate.ring_m if is_simple(candidate.ring_m) else None
    if candidate.plan.corners_seen == 4:
        return candidate.box_m
    if any(_depth_m(candidate.box_m, outline.corners_m).max() > _INSIDE_M for outline in outlines):
        return None
    # The visible part stays on the outline, the hidden part fills the rectangle.
    return convex_hull(candidate.ring_m)


def _depth_m(box: Floats, points: Floats) -> Floats:
    """Depth (N,) of points (N, 2) inside a counter-clockwise rectangle [m], negative outside."""
    step = np.roll(box, -1, axis=0) - box
    step /= np.linalg.norm(step, axis=1, keepdims=True)
    rel = points[:, None] - box
    return np.asarray((step[:, 0] * rel[..., 1] - step[:, 1] * rel[..., 0]).min(axis=1))


def _are_walls(
    geometry: GridGeometry, occupied: Mask, starts: Floats, ends: Floats, back: Floats
) -> Mask:
    """Whether most cells just behind sides (N, 2) are occupied (N,)."""
    step = ends - starts
    length = np.linalg.norm(step, axis=1)
    count = np.maximum(2, (length / geometry.resolution_m).astype(np.int64) + 1)
    side = np.repeat(np.arange(len(count)), count)
    rank = np.arange(len(side)) - np.repeat(np.cumsum(count) - count, count)
    # As np.linspace has it, so that a sample on the border of a cell stays on its side.
    share = rank * ((0.95 - 0.05) / (count - 1))[side] + 0.05
    share[np.cumsum(count) - 1] = 0.95
    along = starts[side] + share[:, None] * step[side]
    hits = np.zeros(len(side), dtype=np.bool_)
    for depth in (0.5, 1.5):
        hits |= geometry.sample(occupied, along + depth * back[side], outside=False)
    return np.asarray(np.bincount(side, weights=hits, minlength=len(count)) / count >= 0.5)
