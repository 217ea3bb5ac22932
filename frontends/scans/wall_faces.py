# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Matching in an old submap by those faces of walls that were observed from the same side.

A scan from beyond a partition sees its other face, off by the wall's thickness: matched with the
known face, it biases the match, by a decimetre in buildings of thin walls.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from slarm_graph.frontends.scans.line_search import LineSearchMatch
from slarm_graph.frontends.scans.wall_sides import WallSides, facing
from slarm_graph.geometry import Floats, compose

_ROUNDS = 2
"""Rounds of removing other faces: the first one starts from a match that they have biased. With one
buildings are 6 % worse (six wards, halls and offices, by geometric mean)."""

Align = Callable[[Sequence[Floats], Floats], LineSearchMatch]
"""Aligns scans, each (K, 2) [m], with a grid from an initial pose (3,)."""


def align_by_faces(
    align: Align,
    sides: WallSides,
    scans: Sequence[Floats],
    surfaces: Sequence[Floats],
    poses: Floats,
    start: Floats,
    min_points: int,
) -> tuple[LineSearchMatch, Sequence[Floats]]:
    """Align scans, without returns from walls that are known from their other side only.

    Parameters
    ----------
    align : callable
    sides : WallSides
        Of the target.
    scans, surfaces : sequences of M (K, 2) and M (S, 4) float64
        Returns in beam order [m], and surfaces of each scan, by `own_surfaces`.
    poses : (M, 3) float64
        Of each scan in the source frame, which is aligned.
    start : (3,) float64
        Initial pose of the source in the target frame.
    min_points : int
        Least number of returns that must remain, else the last match stays.

    Returns
    -------
    LineSearchMatch
    sequence of M (K, 2) float64
        The returns used.
    """
    match, used = align(scans, start), scans
    for _ in range(_ROUNDS):
        placed = zip(scans, surfaces, compose(match.pose, poses), strict=True)
        visible = [facing(sides, *scan) for scan in placed]
        counts = [len(scan) for scan in visible]
        if counts == [len(scan) for scan in used] or sum(counts) < min_points:
            break
        used = visible
        match = align(used, start)
    return match, used
