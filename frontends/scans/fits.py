# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""How well a scan fits at a pose, how well scans usually fit, and how well by chance."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slarm_graph.frontends.scans.gauss_newton import refine
from slarm_graph.frontends.scans.keyframes import LocalMap
from slarm_graph.frontends.scans.likelihood_grid import Lattice, interpolate
from slarm_graph.frontends.scans.small_pose import SEARCHED, compose3
from slarm_graph.frontends.scans.wall_tangents import wall_tangents
from slarm_graph.geometry import Floats, between
from slarm_graph.kernels import kernel, kernel_with

UNSEEN = 0.5
"""What a return counts where nobody looked yet, in usual returns: neither for nor against."""
_PIECE_M = 1.0
"""Length of wall whose returns agree or disagree together: a passer-by, a door, a cupboard."""
_TAILS = 4.0
"""Degrees of freedom of the fit of right places: crowds and new furniture come now and then."""
_MEMORY = 0.05
"""Of the usual fit, per scan: places change within some 20 scans."""
_LEAST_SPREAD = 0.08
"""Of the usual fit: that of 30 independent pieces of surroundings."""
_CHANCE_POINTS = 60
"""Returns looked up at places where a scan does not belong: the mean needs no more."""
_LEAST_CHANCE = 0.08
"""Spread of the fit at such places at least: that of 30 independent pieces."""
_LEAST_SHARE = 0.01
"""Share of pieces, of all or none of which the logarithm would be without end."""
_ELSEWHERE = np.random.default_rng(1).uniform(-SEARCHED, SEARCHED, (64, 3))
"""Poses around the expected one: the window that is searched."""
_DRAWN = 32
"""Of them, from which refinement is begun. With half as many, or twice, edmonton stays within the
scatter of its draws (0.60 to 0.77 m) and seattle has 0.042 or 0.043."""
_DRAWN_STEPS = 15
"""Of refinement: six long ones reach a metre, the others settle."""
_THERE_M, _THERE_RAD = 0.3, 0.05
"""Poses nearer than this are the place in question: the longest steps that refinement goes on for,
and what moves a return 6 m away as far."""


@dataclass(frozen=True, slots=True)
class ChanceFit:
    """How well a scan fits at places where it does not belong, by chance or by alikeness.

    Parameters
    ----------
    mean, sigma : float
        Of the fit at poses all over the window around what is expected.
    count : float
        Independent pieces of surroundings that the scan shows.
    """

    mean: float
    sigma: float
    count: float = math.inf

    def log_density(self, fits: float) -> float:
        """Log density of a fit at such a place, relative to the most frequent one.

        No lower than the Chernoff bound has it for so many pieces, each of which agrees by chance:
        where a crowd leaves three or four things to see, they fit somewhere.
        """
        if fits <= self.mean:
            return 0.0
        by_chance = min(max(self.mean, _LEAST_SHARE), 1.0 - _LEAST_SHARE)
        agree = min(max(fits, _LEAST_SHARE), 1.0 - _LEAST_SHARE)
        against = (1.0 - agree) * math.log((1.0 - agree) / (1.0 - by_chance))
        bound = -self.count * (agree * math.log(agree / by_chance) + against)
        return max(-0.5 * ((fits - self.mean) / self.sigma) ** 2, min(bound, 0.0))


def chance_fit(points: Floats, local_map: LocalMap, center: Floats, usual: float) -> ChanceFit:
    """Measure how well a scan (K, 2) fits elsewhere around a pose (3,)."""
    few = points[:: max(1, len(points) // _CHANCE_POINTS)]
    fits = _fits(np.ascontiguousarray(few), _around(center), local_map, usual)
    sigma = max(float(fits.std()), _LEAST_CHANCE)
    return ChanceFit(float(fits.mean()), sigma, pieces(points))


@dataclass(frozen=True, slots=True)
class Drawn:
    """Where refinement draws a scan to from all over a window, and how well it fits there.

    Parameters
    ----------
    poses : (N, 3) float64
        In the local map [m, m, rad].
    fits, before : (N,) float64
        Where it was drawn to, and where it began.
    count : float
        Independent pieces of surroundings that the scan shows.
    """

    poses: Floats
    fits: Floats
    before: Floats
    count: float

    def chance_of(self, pose: Floats) -> ChanceFit:
        """Return how well the scan fits elsewhere than at a pose (3,)."""
        away = between(pose, self.poses)
        is_there = (np.hypot(away[:, 0], away[:, 1]) < _THERE_M) & (np.abs(away[:, 2]) < _THERE_RAD)
        fits = self.before if is_there.all() else self.fits[~is_there]
        return ChanceFit(float(fits.mean()), max(float(fits.std()), _LEAST_CHANCE), self.count)


def drawn_to(points: Floats, local_map: LocalMap, center: Floats, usual: float) -> Drawn:
    """Find where a scan (K, 2) is drawn to from all over a window around a pose (3,)."""
    assert local_map.grid is not None
    few = np.ascontiguousarray(points[:: max(1, len(points) // _CHANCE_POINTS)])
    around = _around(center)[:_DRAWN]
    poses = _drawn_from(around, local_map.grid.lattice, few)
    fits, before = (_fits(few, at, local_map, usual) for at in (poses, around))
    return Drawn(poses, fits, before, pieces(points))


@kernel
def _drawn_from(poses: Floats, lattice: Lattice, points: Floats) -> Floats:
    """Where refinement leads from poses (N, 3), nothing but the points (K, 2) pulling."""
    drawn, nothing, tangents = np.empty_like(poses), np.zeros((3, 3)), wall_tangents(points)
    for k in range(len(poses)):
        start = poses[k].copy()
        drawn[k] = refine(lattice, points, tangents, start, start, nothing, 1.0, _DRAWN_STEPS)[0]
    return drawn


@kernel
def _around(center: Floats) -> Floats:
    """Poses (N, 3) all over the window around one (3,)."""
    poses = np.empty_like(_ELSEWHERE)
    for k in range(len(poses)):
        pose = compose3(center, _ELSEWHERE[k])
        for i in range(3):
            poses[k, i] = pose[i]
    return poses


def fit(points: Floats, pose: Floats, local_map: LocalMap, usual: float) -> float:
    """Mean agreement of a scan (K, 2) at a pose (3,), what lies in the unseen being neutral."""
    if local_map.grid is None or not len(points):
        return 0.0
    seen = local_map.seen, local_map.seen_step
    return agreement_at(local_map.grid.lattice, *seen, points, pose, UNSEEN * usual) / len(points)


def _fits(points: Floats, poses: Floats, local_map: LocalMap, usual: float) -> Floats:
    """Return `fit` at many poses (N, 3)."""
    assert local_map.grid is not None
    seen = local_map.seen, local_map.seen_step
    agreement = _agreement(local_map.grid.lattice, *seen, points, poses, UNSEEN * usual)
    return np.asarray(agreement / len(points))


@dataclass(slots=True)
class UsualFit:
    """How well scans fit where they belong, learned from those whose place was beyond doubt.

    Parameters
    ----------
    mean, variance : float
        Of the fit.
    count : float
        Scans it was learned from.
    """

    mean: float = 0.0
    variance: float = 0.1**2
    count: float = 0.0

    def learn(self, fits: float) -> None:
        """Take in the fit of one more scan."""
        rate = max(_MEMORY, 1.0 / (self.count + 1.0))
        self.count += 1.0
        if self.count > 1.0:
            self.variance += _MEMORY * ((fits - self.mean) ** 2 - self.variance)
        self.mean += rate * (fits - self.mean)

    def below(self, fits: float, count: float) -> float:
        """Standard deviations that a fit of so many pieces lies below the usual one; at least 0."""
        return max(0.0, self.mean - fits) / self.sigma(count)

    def sigma(self, count: float) -> float:
        """Standard deviation of the fit of so many pieces."""
        of_few = self.mean * (1.0 - self.mean) / max(count, 1.0)
        return math.sqrt(max(self.variance, of_few, _LEAST_SPREAD**2))

    def log_density(self, fits: float, count: float) -> float:
        """Log density of a fit at the right place, relative to the usual one: Student's t."""
        return -0.5 * (_TAILS + 1.0) * math.log1p(self.below(fits, count) ** 2 / _TAILS)


@kernel
def pieces(points: Floats) -> float:
    """How many independent pieces of surroundings a scan (K, 2) in beam order shows."""
    count = 0.0
    for i in range(len(points)):
        step = _PIECE_M
        if i > 0:
            step = math.hypot(points[i, 0] - points[i - 1, 0], points[i, 1] - points[i - 1, 1])
        count += min(step, _PIECE_M) / _PIECE_M
    return count


@kernel
def _agreement(
    lattice: Lattice,
    seen: NDArray[np.bool_],
    seen_step: int,
    points: Floats,
    poses: Floats,
    neutral: float,
) -> Floats:
    """Sum (N,) of the agreement of points (K, 2) at poses (N, 3); `neutral` in the unseen."""
    sums = np.empty(len(poses))
    for k in range(len(poses)):
        sums[k] = agreement_at(lattice, seen, seen_step, points, poses[k], neutral)
    return sums


@kernel
def agreement_at(
    lattice: Lattice,
    seen: NDArray[np.bool_],
    seen_step: int,
    points: Floats,
    pose: Floats,
    neutral: float,
) -> float:
    """Sum of the agreement of points (K, 2) at one pose (3,)."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    total, unseen = 0.0, 0
    for i in range(len(points)):
        x = pose[0] + c * points[i, 0] - s * points[i, 1]
        y = pose[1] + s * points[i, 0] + c * points[i, 1]
        value, _, _ = interpolate(lattice, x, y)
        if value > 0.01:
            total += value
        elif not is_seen(lattice, seen, seen_step, x, y):
            unseen += 1
    return total + neutral * unseen


@kernel_with(inline=True)
def is_seen(lattice: Lattice, seen: NDArray[np.bool_], seen_step: int, x: float, y: float) -> bool:
    """Whether a beam has passed the block of cells around a point [m]."""
    col = math.floor((x - lattice.origin_x) / lattice.resolution) // seen_step
    row = math.floor((y - lattice.origin_y) / lattice.resolution) // seen_step
    is_inside = row >= 0 and col >= 0 and row < seen.shape[0] and col < seen.shape[1]
    return bool(is_inside and seen[row, col])
