# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Open tour over lanes of little travel time: nearest neighbour, 2-opt and Or-opt.

A lane has two ends, 2 i and 2 i + 1; entered at one it is left at the other. A tour is the sequence
of ends at which lanes are entered. The time between two ends is symmetric, so that reversing a
stretch of the tour changes its time at its two borders only.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from slarm_graph.geometry import Floats
from slarm_graph.kernels import kernel

Ends = NDArray[np.int64]

_MOST_MOVED: Final = 8
"""Longest stretch that Or-opt moves: more than twice the usual three (Or 1976), as rows of lanes
belong together."""
_LEAST_GAIN_S: Final = 1e-6
"""Above rounding, so that the search does not cycle between tours of equal time."""


def short_tour(between_s: Floats, from_start_s: Floats) -> Ends:
    """Short tour over all lanes: nearest neighbour, then 2-opt and Or-opt until neither helps.

    Parameters
    ----------
    between_s : (2 n, 2 n) float64
        Time from leaving at one end to entering at another [s]; symmetric.
    from_start_s : (2 n,) float64
        Time from the robot to entering at an end [s].
    """
    tour = _nearest_neighbour(between_s, from_start_s)
    _improve(tour, between_s, from_start_s)
    return tour


def worthwhile(tour: Ends, between_s: Floats, from_start_s: Floats, worth_s: Floats) -> Ends:
    """Leave out the stretches of a tour that cost more time than they are worth.

    Parameters
    ----------
    worth_s : (n,) float64
        Profit of a lane: its worth less the time of driving along it [s].
    """
    while len(tour):
        first, last = _worst_stretch(tour, between_s, from_start_s, worth_s)
        if last < first:
            break
        tour = np.delete(tour, slice(first, last + 1))
    return tour


@kernel
def _nearest_neighbour(between_s: Floats, from_start_s: Floats) -> Ends:
    count = len(from_start_s) // 2
    tour = np.empty(count, dtype=np.int64)
    is_done = np.zeros(count, dtype=np.bool_)
    cost = from_start_s
    for k in range(count):
        best, best_s = -1, np.inf
        for end in range(2 * count):
            if not is_done[end // 2] and (best < 0 or cost[end] < best_s):
                best, best_s = end, cost[end]
        tour[k] = best
        is_done[best // 2] = True
        cost = between_s[best ^ 1]
    return tour


@kernel
def _link(tour: Ends, k: int, enter: int, between_s: Floats, from_start_s: Floats) -> float:
    """Time from the lane at position k (-1: the robot) to an end entered; 0 for no lane (-1)."""
    if enter < 0:
        return 0.0
    return float(from_start_s[enter] if k < 0 else between_s[tour[k] ^ 1, enter])


@kernel
def _improve(tour: Ends, between_s: Floats, from_start_s: Floats) -> None:
    helps = True
    while helps:
        helps = _two_opt(tour, between_s, from_start_s)
        helps |= _or_opt(tour, between_s, from_start_s)


@kernel
def _two_opt(tour: Ends, between_s: Floats, from_start_s: Floats) -> bool:
    """2-opt: reverse stretches; return whether any reversal helped."""
    count, helped = len(tour), False
    for i in range(count):
        before_s = _link(tour, i - 1, tour[i], between_s, from_start_s)
        for j in range(i, count):
            after = tour[j + 1] if j + 1 < count else -1
            old_s = before_s + _link(tour, j, after, between_s, from_start_s)
            new_s = _link(tour, i - 1, tour[j] ^ 1, between_s, from_start_s)
            new_s += between_s[tour[i], after] if after >= 0 else 0.0
            if new_s < old_s - _LEAST_GAIN_S:
                tour[i : j + 1] = tour[i : j + 1][::-1].copy() ^ 1
                before_s = _link(tour, i - 1, tour[i], between_s, from_start_s)
                helped = True
    return helped


@kernel
def _or_opt(tour: Ends, between_s: Floats, from_start_s: Floats) -> bool:
    """Or-opt: move short stretches, reversed or not; return whether any move helped."""
    count, helped = len(tour), False
    for length in range(1, min(_MOST_MOVED, count - 1) + 1):
        i = 0
        while i + length <= count:
            place, is_turned = _best_place(tour, i, length, between_s, from_start_s)
            if place >= -1:
                _move(tour, i, length, place, is_turned)
                helped = True
            i += 1
    return helped


@kernel
def _best_place(
    tour: Ends, i: int, length: int, between_s: Floats, from_start_s: Floats
) -> tuple[int, bool]:
    """Best position to insert a stretch after, -2 for its present one; and whether reversed."""
    count = len(tour)
    first, last = tour[i], tour[i + length - 1]
    after = tour[i + length] if i + length < count else -1
    out_s = _link(tour, i - 1, first, between_s, from_start_s)
    out_s += _link(tour, i + length - 1, after, between_s, from_start_s)
    out_s -= _link(tour, i - 1, after, between_s, from_start_s)
    best, best_s, is_turned = -2, out_s - _LEAST_GAIN_S, False
    for k in range(-1, count):
        if i - 1 <= k < i + length:
            continue
        follow = tour[k + 1] if k + 1 < count else -1
        gap_s = _link(tour, k, follow, between_s, from_start_s)
        for turned in (False, True):
            enter, leave = (last ^ 1, first) if turned else (first, last ^ 1)
            into_s = _link(tour, k, enter, between_s, from_start_s) - gap_s
            into_s += between_s[leave, follow] if follow >= 0 else 0.0
            if into_s < best_s:
                best, best_s, is_turned = k, into_s, turned
    return best, is_turned


@kernel
def _move(tour: Ends, i: int, length: int, place: int, is_turned: bool) -> None:
    stretch = tour[i : i + length].copy()
    if is_turned:
        stretch = stretch[::-1].copy() ^ 1
    if place < i:
        tour[place + 1 + length : i + length] = tour[place + 1 : i].copy()
        tour[place + 1 : place + 1 + length] = stretch
    else:
        tour[i : place + 1 - length] = tour[i + length : place + 1].copy()
        tour[place + 1 - length : place + 1] = stretch


@kernel
def _worst_stretch(
    tour: Ends, between_s: Floats, from_start_s: Floats, worth_s: Floats
) -> tuple[int, int]:
    """First and last position of the stretch whose removal gains most; (0, -1) for none."""
    count = len(tour)
    worst, first, last = _LEAST_GAIN_S, 0, -1
    for i in range(count):
        loss_s = 0.0
        for j in range(i, count):
            loss_s += _link(tour, j - 1, tour[j], between_s, from_start_s) - worth_s[tour[j] // 2]
            after = tour[j + 1] if j + 1 < count else -1
            gain_s = loss_s + _link(tour, j, after, between_s, from_start_s)
            gain_s -= _link(tour, i - 1, after, between_s, from_start_s)
            if gain_s > worst:
                worst, first, last = gain_s, i, j
    return first, last
