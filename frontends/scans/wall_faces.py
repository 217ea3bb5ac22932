# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Matching in an old place by the faces of walls that were seen there.

What lies beyond a partition sees its other face, a wall's thickness off: laid on the face that is
known, it drags the match along, by a decimetre in buildings of thin walls.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from slarm_graph.frontends.scans.along_walls import SlidMatch
from slarm_graph.frontends.scans.wall_sides import WallSides, facing
from slarm_graph.geometry import Floats, compose

_ROUNDS = 2
"""Times that faces are told apart: the first time from where the other ones have dragged the match.
With once buildings are 6 % worse (six wards, halls and offices, by geometric mean)."""

Align = Callable[[Sequence[Floats], Floats], SlidMatch]
"""Aligns scans, each (K, 2) [m], from a pose (3,) of theirs on a grid."""


def aligned_by_faces(
    align: Align,
    sides: WallSides,
    scans: Sequence[Floats],
    surfaces: Sequence[Floats],
    poses: Floats,
    start: Floats,
    least: int,
) -> tuple[SlidMatch, Sequence[Floats]]:
    """Align scans by what they see from the side from which it is known, and by what is new.

    Parameters
    ----------
    align : callable
    sides : WallSides
        Of the place.
    scans, surfaces : sequences of M (K, 2) and M (S, 4) float64
        Returns in beam order [m], and what each scan sees, by `own_surfaces`.
    poses : (M, 3) float64
        Where each scan lies in the frame that is aligned.
    start : (3,) float64
        Of that frame in the place's.
    least : int
        Returns that have to be left, or it is aligned by all.

    Returns
    -------
    SlidMatch
    sequence of M (K, 2) float64
        The returns that it was aligned by.
    """
    found, kept = align(scans, start), scans
    for _ in range(_ROUNDS):
        looks = zip(scans, surfaces, compose(found.pose, poses), strict=True)
        seen = [facing(sides, *look) for look in looks]
        counts = [len(scan) for scan in seen]
        if counts == [len(scan) for scan in kept] or sum(counts) < least:
            break
        kept = seen
        found = align(kept, start)
    return found, kept
