# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""What fits elsewhere since it has walked: small things move, and then it is not the robot."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from slarm_graph.frontends.scans.fits import UNSEEN, is_seen
from slarm_graph.frontends.scans.keyframes import LocalMap
from slarm_graph.frontends.scans.likelihood_grid import Lattice, likelihoods
from slarm_graph.frontends.scans.places import Place
from slarm_graph.frontends.scans.small_pose import BASIN
from slarm_graph.frontends.scans.small_things import (
    WALKED_M,
    WALKERS,
    is_wide,
    small_among,
)
from slarm_graph.geometry import Floats
from slarm_graph.kernels import kernel

_ANOTHER = math.log(WALKERS) + 2.0 * math.log(math.sqrt(float(BASIN[0, 0])) / WALKED_M)
"""Log of the probability that another thing walks, and to where it seems to stand, too."""


def with_walkers(
    found: Sequence[Sequence[Place]],
    points: Floats,
    local_map: LocalMap,
    usual: float,
    walking: Sequence[tuple[float, int]],
) -> list[list[Place]]:
    """Explain at every place by things that walk what fits better at another.

    Where only small things fit there and not here, the scan is seen from here as it is from there
    if all of them have walked. What is wider than a person stands; and where the robot may be
    anywhere about, what fits at another place contradicts nothing.

    Parameters
    ----------
    found : sequence of sequences of Place
        By every story, with what speaks for each.
    points : (K, 2) float64
        The scan, in the robot's frame [m].
    local_map : LocalMap
    usual : float
        How well scans fit where they belong.
    walking : sequence of tuple of float, int
        Probability that small things walk as they did a scan ago, and how many, by every story.

    Returns
    -------
    list of lists of Place
        As given, the likeliest first.
    """
    if local_map.grid is None or sum(map(len, found)) < 2:
        return [list(places) for places in found]
    look = local_map.grid.lattice, local_map.seen, local_map.seen_step, points
    others = [p for places in found for p in places if p.inliers]
    explained = []
    for places, known in zip(found, walking, strict=True):
        told = [
            p if p.is_vague else _explained(p, others, look, UNSEEN * usual, known) for p in places
        ]
        explained.append(sorted(told, key=lambda p: -p.log_posterior))
    return explained


def _explained(
    place: Place,
    others: Sequence[Place],
    look: tuple[Lattice, NDArray[np.bool_], int, Floats],
    least: float,
    walking: tuple[float, int],
) -> Place:
    """Let a place be explained by what fits at another, if that has walked."""
    best, count = -math.inf, 0
    for other in others:
        if _log_chance(1, walking) + other.evidence <= max(place.evidence, best):
            continue
        things = _walked(*look, place.pose, other.pose, least)
        told = _log_chance(things, walking) + other.evidence if things else -math.inf
        if told > best:
            best, count = told, things
    both = float(np.logaddexp(place.evidence, best))
    return replace(
        place,
        log_posterior=place.log_posterior + both - place.evidence,
        evidence=both,
        walked=(math.exp(best - both), count),
    )


def _log_chance(things: int, walking: tuple[float, int]) -> float:
    """Log of the probability that so many things walk, all in step."""
    anew = math.log(WALKERS) + (things - 1) * _ANOTHER
    probability, known = walking
    if probability <= 0.0:
        return anew
    return max(anew, math.log(probability) + max(things - known, 0) * _ANOTHER)


@kernel
def _walked(
    lattice: Lattice,
    seen: NDArray[np.bool_],
    seen_step: int,
    points: Floats,
    here: Floats,
    there: Floats,
    least: float,
) -> int:
    """Count the small things that fit better by `least` from there (3,) than from here (3,).

    0 where that is something wider, or nothing at all. A wall may go on in what was not seen yet.
    """
    fits = likelihoods(lattice, points, there) - likelihoods(lattice, points, here)
    sure = ~is_wide(points)
    c, s = math.cos(here[2]), math.sin(here[2])
    for i in range(len(points)):
        x = here[0] + c * points[i, 0] - s * points[i, 1]
        y = here[1] + s * points[i, 0] + c * points[i, 1]
        sure[i] = sure[i] or is_seen(lattice, seen, seen_step, x, y)
    return small_among(points, fits > least, sure)
