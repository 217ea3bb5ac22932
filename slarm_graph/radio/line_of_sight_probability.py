# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Probability of line of sight past groups of solids of uncertain height.

Only the cells in a group's shadows are visited: a site has ten thousand groups, and a mask of the
whole site for each of them takes hours.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slarm_graph.geographic import HeightGroup
from slarm_graph.geometry import Floats, wrap_angles
from slarm_graph.grid import GridGeometry, Mask
from slarm_graph.kernels import kernel
from slarm_graph.radio.line_of_sight import line_of_sight_to_points, shadow_outlines
from slarm_graph.raster.bands import cells_of, windows
from slarm_graph.raster.fill import row_spans
from slarm_graph.tiles import Where
from slarm_graph.world import Solid

Ints = NDArray[np.int64]

_EDGE_RAD = 1e-6
"""A tenth of a millimetre at a hundred metres: above rounding; points taken in addition are decided
exactly."""


@dataclass(frozen=True, slots=True)
class HeightLevels:
    """The solids of one group at each of its heights that matter to a link.

    Parameters
    ----------
    standing : sequence of sequence of Solid
        Solids of non-zero height at each level.
    counts : sequence of int
        Number of the group's equally likely heights at each level.
    """

    standing: Sequence[Sequence[Solid]]
    counts: Sequence[int]


def multiply_by_group_probabilities(
    probability: NDArray[np.float32],
    geometry: GridGeometry,
    groups: Sequence[HeightLevels],
    on_face: Mask,
    points_m: Floats,
    position_m: Floats,
    antenna_height_m: float,
    where: Where | None = None,
) -> None:
    """Multiply the probability of line of sight (rows, cols) by that past every group, in place.

    Parameters
    ----------
    probability : (rows, cols) float32
        Cells of probability 0 are skipped.
    geometry : GridGeometry
    groups : sequence of HeightLevels
    on_face : (rows, cols) bool
        Cells whose antenna stands on a solid's face rather than at the centre.
    points_m : (N, 2) float64
        Those antennas, in the cells' order [m].
    position_m : (3,)
        Of the access point [m].
    antenna_height_m : float
    where : (rows, cols) or KnownTiles, optional
        Outside of tiles the probability is 0.
    """
    where = where or geometry.shape
    faces = tuple(cells_of(on_face, where).T)
    at_face = probability[faces]
    asked = at_face > 0.0
    at_face[asked] *= _probability_at_points(points_m[asked], groups, position_m, antenna_height_m)
    _multiply_cells(probability, geometry, groups, position_m, antenna_height_m, where)
    probability[faces] = at_face


def split_by_certainty(
    solids: Sequence[Solid], groups: Sequence[HeightGroup], access_point_m: float, antenna_m: float
) -> tuple[list[Solid], list[HeightLevels]]:
    """Split solids into those that certainly obstruct links and groups that may.

    All heights above both ends of a link are equivalent, and so are all below both: solids above
    them at every level are certain, and equal levels of the others are merged.

    Parameters
    ----------
    solids : sequence of Solid
    groups : sequence of HeightGroup
        Of uncertain solids, by their numbers.
    access_point_m, antenna_m : float
        Heights of both ends of the links.

    Returns
    -------
    certain : list of Solid
    uncertain : list of HeightLevels
        Of every group that has any.
    """
    low, high = sorted((access_point_m, antenna_m))
    unsure = {n for group in groups for n in group.solids}
    certain = [s for n, s in enumerate(solids) if n not in unsure]
    uncertain = []
    for group in groups:
        levels_m = np.where(group.levels_m <= low, 0.0, group.levels_m)
        levels_m[levels_m >= high] = np.inf
        above = np.isinf(levels_m).all(axis=0)
        numbers = np.array(group.solids, dtype=np.int64)
        certain += [replace(solids[n], height_m=math.inf) for n in numbers[above].tolist()]
        if levels_m[:, ~above].any():
            mine = [solids[n] for n in numbers[~above].tolist()]
            uncertain.append(_distinct_levels(mine, levels_m[:, ~above]))
    return certain, uncertain


def _distinct_levels(solids: Sequence[Solid], levels_m: Floats) -> HeightLevels:
    """Merge equal levels (K, N) [m] of N solids, and leave out solids of height 0."""
    different, counts = np.unique(levels_m, axis=0, return_counts=True)
    standing = [
        [replace(s, height_m=float(h)) for s, h in zip(solids, level, strict=True) if h]
        for level in different
    ]
    return HeightLevels(standing, counts.tolist())


def _multiply_cells(
    probability: NDArray[np.float32],
    geometry: GridGeometry,
    groups: Sequence[HeightLevels],
    position_m: Floats,
    antenna_height_m: float,
    where: Where,
) -> None:
    """Multiply by the probability of line of sight past every group at the cells' centres."""
    sets = [standing for group in groups for standing in group.standing]
    outlines, starts, slacks, of_set = shadow_outlines(geometry, sets, position_m, antenna_height_m)
    first = np.searchsorted(of_set, np.arange(len(sets) + 1))
    group_starts = np.cumsum([0, *(len(group.counts) for group in groups)])
    counts = np.array([count for group in groups for count in group.counts], dtype=np.int64)
    for part in windows(where, aside=[probability]):
        here, begin = probability[part.cells], (part.cells[0].start, part.cells[1].start)
        _multiply_window(here, begin, outlines, starts, slacks, first, group_starts, counts)


def _probability_at_points(
    points_m: Floats, groups: Sequence[HeightLevels], position_m: Floats, antenna_height_m: float
) -> Floats:
    """Probability (N,) of line of sight past all groups for antennas at points (N, 2) [m]."""
    probability, ways = np.ones(len(points_m)), points_m - position_m[:2]
    angles = np.arctan2(ways[:, 1], ways[:, 0])
    order = np.argsort(angles)
    for group in groups:
        if not any(group.standing):
            continue
        mine = order[
            _directions_meeting(angles[order], max(group.standing, key=len), position_m[:2])
        ]
        if not len(mine):
            continue
        hidden = np.zeros(len(mine), dtype=np.int64)
        for standing, count in zip(group.standing, group.counts, strict=True):
            clear = line_of_sight_to_points(points_m[mine], standing, position_m, antenna_height_m)
            hidden += count * ~clear
        total = sum(group.counts)
        probability[mine] *= (total - hidden) / total
    return probability


def _directions_meeting(angles: Floats, solids: Sequence[Solid], eye: Floats) -> Ints:
    """Which of sorted directions [rad] may meet the solids as seen from `eye` (2,)."""
    corners = np.concatenate([solid.corners_m for solid in solids]) - eye
    seen = np.arctan2(corners[:, 1], corners[:, 0])
    off = wrap_angles(seen - seen[0])
    if np.ptp(off) >= np.pi or not np.hypot(*corners.T).all():
        return np.arange(len(angles))
    low, high = seen[0] + off.min() - _EDGE_RAD, seen[0] + off.max() + _EDGE_RAD
    parts = [
        np.arange(*np.searchsorted(angles, (low + turn, high + turn)))
        for turn in (-2.0 * np.pi, 0.0, 2.0 * np.pi)
    ]
    return np.concatenate(parts)


@kernel
def _multiply_window(
    probability: NDArray[np.float32],
    begin: tuple[int, int],
    outlines: Floats,
    starts: Ints,
    slacks: Floats,
    set_starts: Ints,
    group_starts: Ints,
    counts: Ints,
) -> None:
    """In a window: count the levels of a group at which a cell is hidden, then multiply once."""
    rows, cols = probability.shape
    first_row, first_col = begin
    hidden = np.zeros((rows, cols), dtype=np.int32)
    latest = np.full((rows, cols), -1, dtype=np.int32)
    left, right = np.empty(rows), np.empty(rows)
    spans = np.empty((rows, 2), dtype=np.int64)
    for group in range(len(group_starts) - 1):
        total = counts[group_starts[group] : group_starts[group + 1]].sum()
        for counting in (True, False):
            for level in range(group_starts[group], group_starts[group + 1]):
                for i in range(set_starts[level], set_starts[level + 1]):
                    if starts[i] == starts[i + 1]:
                        continue
                    outline = outlines[starts[i] : starts[i + 1]]
                    low, past = row_spans(
                        spans, first_row, first_col + cols, left, right, outline, slacks[i]
                    )
                    for row in range(low, past):
                        for col in range(
                            max(0, spans[row, 0] - first_col), spans[row, 1] - first_col
                        ):
                            if probability[row, col] == 0.0:
                                continue
                            if counting:
                                if latest[row, col] != level:
                                    latest[row, col] = level
                                    hidden[row, col] += counts[level]
                            elif hidden[row, col] > 0:
                                probability[row, col] *= (total - hidden[row, col]) / total
                                hidden[row, col] = 0
