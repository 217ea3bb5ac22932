# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Scan fit (mean likelihood at a pose), and its distribution at true and at false matches."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slarm_graph.frontends.scans.gauss_newton import refine
from slarm_graph.frontends.scans.likelihood_grid import Lattice, interpolate
from slarm_graph.frontends.scans.local_map import LocalMap
from slarm_graph.frontends.scans.small_pose import SEARCH_REACH, compose3, log_student_t
from slarm_graph.frontends.scans.wall_tangents import wall_tangents
from slarm_graph.geometry import Floats, between
from slarm_graph.kernels import kernel, kernel_with

UNKNOWN_FIT = 0.5
"""Fit of a return in unknown space over the mean fit of true matches: neither for nor against."""
_PATCH_M = 1.0
"""Correlation length of the returns' fit: a passer-by, a door, a cupboard."""
_MEMORY = 0.05
"""Learning rate per scan of the fit of true matches: surroundings change within some 20 scans."""
_MIN_SIGMA = 0.08
"""Of the fit of matches, true or false, at least: that of 30 independent patches."""
_SUBSAMPLE = 60
"""Returns used for the fit at false matches: the mean needs no more."""
_LEAST_SHARE = 0.01
"""Bound of the share of agreeing patches away from 0 and 1, where the logarithm diverges."""
_WINDOW = np.random.default_rng(1).uniform(-SEARCH_REACH, SEARCH_REACH, (64, 3))
"""Random poses relative to the expected one, all over the search window [m, m, rad]."""
_STARTS = 32
"""Of them, those that local optima are refined from. With half as many, or twice, edmonton stays
within the scatter of its draws (0.60 to 0.77 m) and seattle has 0.042 or 0.043."""
_START_ITERATIONS = 15
"""Iterations of that refinement: six long steps reach a metre, the others converge."""
_EXCLUDED_M, _EXCLUDED_RAD = 0.3, 0.05
"""Optima nearer than this are the candidate itself: the longest steps at which refinement still
goes on, and what moves a return 6 m away as far."""


@dataclass(frozen=True, slots=True)
class FalseMatchFit:
    """Distribution of a scan's fit at false matches, by chance or by similar surroundings.

    Parameters
    ----------
    mean, sigma : float
        Of the fit at wrong poses all over the search window.
    count : float
        Independent patches that the scan shows.
    """

    mean: float
    sigma: float
    count: float = math.inf

    def log_density(self, fit: float) -> float:
        """Log density of a fit at a false match, relative to the mode.

        Bounded below by the Chernoff bound of so many independent patches agreeing by chance: where
        a crowd leaves three or four patches visible, they fit somewhere.
        """
        if fit <= self.mean:
            return 0.0
        agree_false = min(max(self.mean, _LEAST_SHARE), 1.0 - _LEAST_SHARE)
        agree = min(max(fit, _LEAST_SHARE), 1.0 - _LEAST_SHARE)
        against = (1.0 - agree) * math.log((1.0 - agree) / (1.0 - agree_false))
        bound = -self.count * (agree * math.log(agree / agree_false) + against)
        return max(-0.5 * ((fit - self.mean) / self.sigma) ** 2, min(bound, 0.0))


def false_match_fit(
    points: Floats, local_map: LocalMap, center: Floats, mean_fit: float
) -> FalseMatchFit:
    """Estimate the fit at false matches from random poses around one (3,) for a scan (K, 2)."""
    subsample = points[:: max(1, len(points) // _SUBSAMPLE)]
    fits = _scan_fits(np.ascontiguousarray(subsample), _around(center), local_map, mean_fit)
    sigma = max(float(fits.std()), _MIN_SIGMA)
    return FalseMatchFit(float(fits.mean()), sigma, patch_count(points))


@dataclass(frozen=True, slots=True)
class LocalOptima:
    """Local optima of a scan match over the search window, and the fit there.

    Parameters
    ----------
    poses : (N, 3) float64
        In the local map [m, m, rad].
    fits, start_fits : (N,) float64
        At the optima, and at the initial guesses.
    count : float
        Independent patches that the scan shows.
    """

    poses: Floats
    fits: Floats
    start_fits: Floats
    count: float

    def false_fit_excluding(self, pose: Floats) -> FalseMatchFit:
        """Return the fit at false matches: at all optima but those at a pose (3,)."""
        offset = between(pose, self.poses)
        is_same = (np.hypot(offset[:, 0], offset[:, 1]) < _EXCLUDED_M) & (
            np.abs(offset[:, 2]) < _EXCLUDED_RAD
        )
        fits = self.start_fits if is_same.all() else self.fits[~is_same]
        return FalseMatchFit(float(fits.mean()), max(float(fits.std()), _MIN_SIGMA), self.count)


def local_optima(
    points: Floats, local_map: LocalMap, center: Floats, mean_fit: float
) -> LocalOptima:
    """Find the local optima of a scan (K, 2) in the search window around a pose (3,)."""
    assert local_map.grid is not None
    subsample = np.ascontiguousarray(points[:: max(1, len(points) // _SUBSAMPLE)])
    starts = _around(center)[:_STARTS]
    poses = _refined_from(starts, local_map.grid.lattice, subsample)
    fits, start_fits = (_scan_fits(subsample, at, local_map, mean_fit) for at in (poses, starts))
    return LocalOptima(poses, fits, start_fits, patch_count(points))


@kernel
def _refined_from(poses: Floats, lattice: Lattice, points: Floats) -> Floats:
    """Refine points (K, 2) from poses (N, 3) without a prior; returns the optima (N, 3)."""
    refined, no_prior, tangents = np.empty_like(poses), np.zeros((3, 3)), wall_tangents(points)
    for k in range(len(poses)):
        start = poses[k].copy()
        refined[k] = refine(
            lattice, points, tangents, start, start, no_prior, 1.0, _START_ITERATIONS
        )[0]
    return refined


@kernel
def _around(center: Floats) -> Floats:
    """Random poses (N, 3) all over the search window around one (3,)."""
    poses = np.empty_like(_WINDOW)
    for k in range(len(poses)):
        pose = compose3(center, _WINDOW[k])
        for i in range(3):
            poses[k, i] = pose[i]
    return poses


def scan_fit(points: Floats, pose: Floats, local_map: LocalMap, mean_fit: float) -> float:
    """Mean likelihood of a scan (K, 2) at a pose (3,); returns in unknown space are neutral."""
    if local_map.grid is None or not len(points):
        return 0.0
    observed = local_map.observed, local_map.observed_step
    return agreement_at(
        local_map.grid.lattice, *observed, points, pose, UNKNOWN_FIT * mean_fit
    ) / len(points)


def _scan_fits(points: Floats, poses: Floats, local_map: LocalMap, mean_fit: float) -> Floats:
    """Return `scan_fit` at many poses (N, 3)."""
    assert local_map.grid is not None
    observed = local_map.observed, local_map.observed_step
    agreement = _agreement(local_map.grid.lattice, *observed, points, poses, UNKNOWN_FIT * mean_fit)
    return np.asarray(agreement / len(points))


@dataclass(slots=True)
class TrueMatchFit:
    """Distribution of the scan fit at true matches, learned from unambiguous ones.

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

    def learn(self, fit: float) -> None:
        """Update mean and variance (exponential averages) by the fit of one more scan."""
        rate = max(_MEMORY, 1.0 / (self.count + 1.0))
        self.count += 1.0
        if self.count > 1.0:
            self.variance += _MEMORY * ((fit - self.mean) ** 2 - self.variance)
        self.mean += rate * (fit - self.mean)

    def sigmas_below(self, fit: float, count: float) -> float:
        """Standard deviations that a fit of so many patches lies below the mean; at least 0."""
        return max(0.0, self.mean - fit) / self.sigma(count)

    def sigma(self, count: float) -> float:
        """Standard deviation of the fit of so many patches."""
        sampling_variance = self.mean * (1.0 - self.mean) / max(count, 1.0)
        return math.sqrt(max(self.variance, sampling_variance, _MIN_SIGMA**2))

    def log_density(self, fit: float, count: float) -> float:
        """Log density of a fit at a true match, relative to the mode: one-sided Student's t."""
        return log_student_t(self.sigmas_below(fit, count) ** 2, 1.0)


@kernel
def patch_count(points: Floats) -> float:
    """Effective number of independent patches, 1 m each, of a scan (K, 2) in beam order."""
    count = 0.0
    for i in range(len(points)):
        step = _PATCH_M
        if i > 0:
            step = math.hypot(points[i, 0] - points[i - 1, 0], points[i, 1] - points[i - 1, 1])
        count += min(step, _PATCH_M) / _PATCH_M
    return count


@kernel
def _agreement(
    lattice: Lattice,
    observed: NDArray[np.bool_],
    observed_step: int,
    points: Floats,
    poses: Floats,
    neutral: float,
) -> Floats:
    """Sum (N,) of the likelihood of points (K, 2) at poses (N, 3); `neutral` in unknown space."""
    sums = np.empty(len(poses))
    for k in range(len(poses)):
        sums[k] = agreement_at(lattice, observed, observed_step, points, poses[k], neutral)
    return sums


@kernel
def agreement_at(
    lattice: Lattice,
    observed: NDArray[np.bool_],
    observed_step: int,
    points: Floats,
    pose: Floats,
    neutral: float,
) -> float:
    """Sum of the likelihood of points (K, 2) at one pose (3,); `neutral` in unknown space."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    total, unknown = 0.0, 0
    for i in range(len(points)):
        x = pose[0] + c * points[i, 0] - s * points[i, 1]
        y = pose[1] + s * points[i, 0] + c * points[i, 1]
        value, _, _ = interpolate(lattice, x, y)
        if value > 0.01:
            total += value
        elif not is_observed(lattice, observed, observed_step, x, y):
            unknown += 1
    return total + neutral * unknown


@kernel_with(inline=True)
def is_observed(
    lattice: Lattice, observed: NDArray[np.bool_], observed_step: int, x: float, y: float
) -> bool:
    """Whether a beam has passed the block of cells around a point [m]."""
    col = math.floor((x - lattice.origin_x) / lattice.resolution) // observed_step
    row = math.floor((y - lattice.origin_y) / lattice.resolution) // observed_step
    is_inside = row >= 0 and col >= 0 and row < observed.shape[0] and col < observed.shape[1]
    return bool(is_inside and observed[row, col])
