# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""How much a match says of the pose, beyond what the slopes at its points add up to.

Three things make the sum of squared slopes, which Gauss-Newton takes for the curvature, promise too
much. Along a bare corridor rough walls have slopes too, of both signs: their squares add up, though
the likelihood is the same a step further on. Where a crowd hides the walls, points are matched to
what they do not belong to. And where one small thing alone says how far the robot has come, it may
be somebody walking ahead.
"""

from __future__ import annotations

import math

import numpy as np

from slarm_graph.frontends.scans.gauss_newton import slope
from slarm_graph.frontends.scans.likelihood_grid import Lattice, likelihoods
from slarm_graph.frontends.scans.odometry_filter import Expectation
from slarm_graph.frontends.scans.significance import SIGMAS_1_PERCENT
from slarm_graph.frontends.scans.small_matrix import eigen2, fused, sandwich3
from slarm_graph.frontends.scans.small_pose import between3, compose3
from slarm_graph.frontends.scans.small_things import (
    SMALL_M,
    WALKED_M,
    WALKERS,
    apart_m,
    are_two,
    slant_between,
)
from slarm_graph.geometry import Floats
from slarm_graph.kernels import kernel

_AWAY_M = 0.1
"""How far away the fall-off is looked at: twice that of the likelihood of a wall, beyond its
roughness. Half of it makes intel.bag 6 % better and fr079 the same."""
_AS_STRONGEST = 3.72
"""Standard deviations that the strongest of a hundred things exceeds one time in a hundred."""
_LEAST = 1e-3
"""Share of information that is left at least: 30 times the noise."""
_MISFIT = 10.0
"""Log of the variance per share of the usual fit that is missing. Where odometry is good, matches
of scans that fit 0.95, 0.75, 0.55 and 0.4 of the usual differ from it by 5, 19, 32 and 96 mm beyond
its own noise (fr-clinic) and by 3, 6, 12 and 45 mm (intel with people): 5 in the log of the noise
per whole, with tails that are wider. Half of it makes intel.bag 11 % better and fr-clinic with a
view of 90 degrees lose its way (4.1 m instead of 0.37)."""


@kernel
def along_the_weakest(
    information: Floats,
    lattice: Lattice,
    points: Floats,
    tangents: Floats,
    pose: Floats,
    expected: Expectation,
) -> Floats:
    """Lower an information along the weakest direction to what is sure of it.

    That is no more than what the likelihood falls off by there, where the fall-off along the
    strongest direction says what the information of that direction is worth. Of it, what one small
    thing says counts as little as that thing may have walked, which is the more probable the less
    it agrees with where the robot is expected.

    Parameters
    ----------
    information : (3, 3) float64
        Of a match by its slopes, in the body frame.
    lattice : Lattice
    points, tangents : (K, 2) float64
        In the robot's frame [m], and unit vectors along straight walls there, zero elsewhere.
    pose : (3,) float64
        Of the match on the grid [m, m, rad].
    expected : Expectation
        Before the scan was looked at.

    Returns
    -------
    (3, 3) float64
    """
    strengths, axes = eigen2(information)
    if strengths[0] <= 0.0:
        return information
    here, thing, said = _small_thing(lattice, points, tangents, pose, axes[:, 0])
    rest = (1.0 - said) * strengths[0]
    weak, noise, own = _drop(here, lattice, points, thing, pose, axes[:, 0])
    strong, _, _ = _drop(here, lattice, points, thing, pose, axes[:, 1])
    count = thing[1] - thing[0]
    if strong > 0.0:
        sure = (
            weak
            if weak > SIGMAS_1_PERCENT * noise / math.sqrt(max(len(points) - count, 1))
            else 0.0
        )
        rest = min(rest, sure / strong * strengths[1])
    if said > 0.0 and own <= _AS_STRONGEST * noise / math.sqrt(count):
        said = 0.0
    variance = 1.0 / max(rest + said * strengths[0], _LEAST * strengths[0])
    # What else there is to see does not let it pull the match farther.
    walked = 1.0 / max(rest, 1.0 / WALKED_M**2) if said > 0.0 else 0.0
    variance += walked * _walks(axes[:, 0], variance, walked, pose, expected)
    share = min(1.0, max(_LEAST, 1.0 / (variance * strengths[0])))
    shrunk = np.zeros((3, 3))
    shrunk[2, 2] = 1.0
    for row in range(2):
        for col in range(2):
            along = axes[row, 0] * math.sqrt(share) * axes[col, 0]
            shrunk[row, col] = fused(axes[row, 1], axes[col, 1], along)
    return sandwich3(shrunk, information)


def of_misfit(share: float, per_whole: float = _MISFIT) -> float:
    """Return the share of information left to what fits a share as well as usual.

    Parameters
    ----------
    share : float
    per_whole : float
        Log of the variance per share that is missing; by default that of a scan.
    """
    return math.exp(-per_whole * max(0.0, 1.0 - share))


@kernel
def _walks(
    axis: Floats, variance: float, walked: float, pose: Floats, expected: Expectation
) -> float:
    """Probability that a thing has walked, by how far its match is from what was expected.

    Parameters
    ----------
    axis : (2,) float64
        Along which it speaks, in the body frame.
    variance, walked : float
        Of the match along the axis where the thing stands, and what walking adds [m^2].
    pose : (3,) float64
        Of the match.
    expected : Expectation
    """
    covariances, chances = expected.covariances, expected.probabilities
    motion = between3(expected.base, pose)
    stands = walks = 0.0
    for k in range(len(chances)):
        away = motion - expected.motions[k]
        away2 = (axis[0] * away[0] + axis[1] * away[1]) ** 2
        spread = variance
        for r in range(2):
            for c in range(2):
                spread += axis[r] * covariances[k, r, c] * axis[c]
        stands += (1.0 - WALKERS) * chances[k] * _density(away2, spread)
        walks += WALKERS * chances[k] * _density(away2, spread + walked)
    return walks / max(stands + walks, 1e-300)


@kernel
def _density(squared: float, variance: float) -> float:
    """Normal density of a squared deviation, up to a constant."""
    return math.exp(-0.5 * squared / variance) / math.sqrt(variance)


@kernel
def _drop(
    here: Floats,
    lattice: Lattice,
    points: Floats,
    thing: tuple[int, int],
    pose: Floats,
    axis: Floats,
) -> tuple[float, float, float]:
    """What the mean likelihood falls off by to the nearer side along an axis.

    Returns
    -------
    falls, noise : float
        Of the points that are not the thing's, which are its first to before its last one, and
        what one of them has in noise, by those that fit better there: where nothing falls off, as
        many fit worse.
    of_thing : float
        Of the thing's points; either is 0 where there are none.
    """
    own = thing[1] - thing[0]
    others = len(points) - own
    least, noise = np.inf if others else 0.0, 0.0
    of_thing = np.inf if own else 0.0
    for sign in (1.0, -1.0):
        shift = np.array([sign * _AWAY_M * axis[0], sign * _AWAY_M * axis[1], 0.0])
        there = likelihoods(lattice, points, compose3(pose, shift))
        total, better, of_own = 0.0, 0.0, 0.0
        for i in range(len(points)):
            lost = here[i] - there[i]
            if thing[0] <= i < thing[1]:
                of_own += lost
            else:
                total += lost
                better += min(lost, 0.0) ** 2
        if others and total / others < least:
            least = total / others
            noise = math.sqrt(2.0 * better / others)
        if own:
            of_thing = min(of_thing, of_own / own)
    return least, noise, of_thing


@kernel
def _small_thing(
    lattice: Lattice, points: Floats, tangents: Floats, pose: Floats, axis: Floats
) -> tuple[Floats, tuple[int, int], float]:
    """Of the small things in a scan the one that says most along an axis (2,) of the body frame.

    Things are told apart by returns that say something of that axis: somebody beside a wall is
    joined to it, but the wall is silent of the way along it.

    Returns
    -------
    likelihoods : (K,) float64
        Of all points.
    thing : tuple of int
        Its first point, and the one after its last.
    share : float
        Of the information along the axis.
    """
    here, told = np.empty(len(points)), np.empty(len(points))
    c, s = math.cos(pose[2]), math.sin(pose[2])
    total = 0.0
    for i in range(len(points)):
        jx, jy, here[i], weight = slope(lattice, points, tangents, i, pose, c, s)
        told[i] = weight * (jx * axis[0] + jy * axis[1]) ** 2
        total += told[i]
    slant = slant_between(points)
    if math.isinf(slant):
        return here, (0, 0), 0.0
    most, thing, first, last, own, wide = 0.0, (0, 0), -1, -1, 0.0, 0.0
    for i in range(len(points) + 1):
        is_end = i == len(points)
        if not is_end and told[i] * len(points) <= total:
            continue
        if first >= 0 and (is_end or are_two(points, last, i, slant)):
            if own > most and wide < SMALL_M:
                most, thing = own, (first, last + 1)
            first = -1
        if first < 0:
            first, own, wide = i, 0.0, 0.0
        if not is_end:
            last, own, wide = i, own + told[i], max(wide, apart_m(points, first, i))
    return here, thing, most / max(total, 1e-12)
