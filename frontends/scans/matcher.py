# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The scan matcher interface, and three implementations.

All take returns in beam order, each scan in its own robot's frame, and give back where the source
is in the target's frame. A match that failed is falsy and says why.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import replace
from typing import ClassVar, Protocol

import numpy as np
from pydantic import Field

from slarm_graph.config import MatchingConfig, Stage
from slarm_graph.constraint import MatchResult
from slarm_graph.counts import count_of
from slarm_graph.frontends.scans.correlative import search
from slarm_graph.frontends.scans.gauss_newton import refine_near
from slarm_graph.frontends.scans.icp import align, line_normals
from slarm_graph.frontends.scans.likelihood_grid import (
    LikelihoodGrid,
    build_likelihood_grid,
    scan_segments,
)
from slarm_graph.frontends.scans.search_pyramid import build_pyramid
from slarm_graph.frontends.scans.small_matrix import invert3
from slarm_graph.geometry import Floats, Pose2

_START_INFORMATION = np.diag([11.0, 11.0, 11.0])
"""Information of the initial guess as a prior: 0.3 m and 0.3 rad, so that it hardly counts."""
_WEAK_M, _WEAK_RAD = 1.0, 0.3
"""Largest standard deviation of a match [m, rad]: a room's half, and 17 degrees."""
_COARSE = 3.0
"""Coarse over fine fall-off of the likelihood: three times as far to either side."""


class ScanMatcher(Protocol):
    """Aligns one scan with another."""

    def match(self, source: Floats, target: Floats, *, target_from_source: Pose2) -> MatchResult:
        """Align `source` (K, 2) with `target` (M, 2), returns in beam order [m], from a guess."""
        ...


class _Matcher(ABC):
    """Base of the matchers here: checks input and result."""

    def __init__(
        self, settings: Stage | None = None, matching: MatchingConfig | None = None
    ) -> None:
        del settings
        self._config = matching or MatchingConfig()

    def match(self, source: Floats, target: Floats, *, target_from_source: Pose2) -> MatchResult:
        """Align two scans; see `ScanMatcher`."""
        reason = _too_few(source, target, self._config)
        if reason:
            return MatchResult(target_from_source, reason=reason)
        return validated(self._aligned(source, target, target_from_source), self._config)

    @abstractmethod
    def _aligned(self, source: Floats, target: Floats, guess: Pose2) -> MatchResult:
        """Align two scans with enough returns; the result is validated afterwards."""

    def _fine_grid(self, target: Floats) -> LikelihoodGrid:
        return grid_of(target, self._config, self._config.sigma_m)


class LikelihoodMatcher(_Matcher):
    """Gauss-Newton on smooth likelihood grids, a coarse one first: precise, needs a near guess."""

    settings: ClassVar[type[Stage]] = Stage

    def _aligned(self, source: Floats, target: Floats, guess: Pose2) -> MatchResult:
        coarse = grid_of(target, self._config, _COARSE * self._config.sigma_m)
        start = on_grid(coarse, source, guess, self._config).target_from_source
        return on_grid(self._fine_grid(target), source, start, self._config)


class CorrelativeConfig(Stage):
    """The matcher `correlative`."""

    reach_m: float = Field(default=1.0, gt=0)
    """Half the sides of the window that is searched."""
    reach_rad: float = Field(default=0.6, gt=0)
    """Half its angle; pi searches the whole circle."""


class CorrelativeMatcher(_Matcher):
    """Exact correlative search of a window, then Gauss-Newton: converges from far off."""

    settings: ClassVar[type[Stage]] = CorrelativeConfig

    def __init__(
        self, settings: CorrelativeConfig | None = None, matching: MatchingConfig | None = None
    ) -> None:
        super().__init__(matching=matching)
        self._window = settings or CorrelativeConfig()

    def _aligned(self, source: Floats, target: Floats, guess: Pose2) -> MatchResult:
        coarse = self._config.model_copy(update={"resolution_m": 2.0 * self._config.resolution_m})
        hit = search(
            build_pyramid(grid_of(target, coarse, 2.0 * self._config.sigma_m)),
            source,
            guess,
            reach_m=self._window.reach_m,
            reach_rad=self._window.reach_rad,
            min_score=0.5 * self._config.min_score,
        )
        if hit is None:
            return MatchResult(guess, reason="nothing in the window fits")
        return on_grid(self._fine_grid(target), source, hit.grid_from_robot, self._config)


class IcpConfig(Stage):
    """The matcher `icp`."""

    max_distance_m: float = Field(default=0.5, gt=0)
    """Returns farther from their nearest neighbour are left out."""


class IcpMatcher(_Matcher):
    """Point-to-line ICP."""

    settings: ClassVar[type[Stage]] = IcpConfig

    def __init__(
        self, settings: IcpConfig | None = None, matching: MatchingConfig | None = None
    ) -> None:
        super().__init__(matching=matching)
        self._max_distance_m = (settings or IcpConfig()).max_distance_m

    def _aligned(self, source: Floats, target: Floats, guess: Pose2) -> MatchResult:
        match = align(
            np.ascontiguousarray(source, dtype=np.float64),
            np.ascontiguousarray(target, dtype=np.float64),
            line_normals(target, self._config.max_gap_m),
            guess.as_array(),
            self._max_distance_m,
            self._config.point_sigma_m,
            3 * self._config.max_iterations,
        )
        return _result(*match)


def grid_of(points: Floats, config: MatchingConfig, sigma_m: float) -> LikelihoodGrid:
    """Likelihood grid of one scan's returns (K, 2) [m], in their own frame."""
    segments = scan_segments(np.asarray(points, dtype=np.float64), np.zeros(3), config.max_gap_m)
    return build_likelihood_grid(segments, resolution_m=config.resolution_m, sigma_m=sigma_m)


def on_grid(
    grid: LikelihoodGrid, points: Floats, start: Pose2, config: MatchingConfig
) -> MatchResult:
    """Refine a scan on a grid from a nearby pose, which is a weak prior."""
    information = (grid.sigma_m / config.point_sigma_m) ** 2
    match = refine_near(
        grid, points, start.as_array(), _START_INFORMATION, information, 2 * config.max_iterations
    )
    return _result(*match)


def validated(match: MatchResult, config: MatchingConfig) -> MatchResult:
    """Return a match, or its failure with a reason when score or covariance are bad."""
    if not match:
        return match
    if match.score < config.min_score:
        return replace(match, reason=f"score {match.score:.2f} is too low")
    sigma = np.sqrt(np.diag(match.covariance))
    if max(sigma[0], sigma[1]) > _WEAK_M or sigma[2] > _WEAK_RAD:
        return replace(match, reason="the scans do not fix the pose")
    return match


def _result(
    pose: Floats, information: Floats, score: float, inliers: int, iterations: int
) -> MatchResult:
    floor = np.diag([1e-6, 1e-6, 1e-6])
    covariance = np.asarray(invert3(information + floor))
    return MatchResult(Pose2.from_array(pose), covariance, score, inliers, iterations)


def _too_few(source: Floats, target: Floats, config: MatchingConfig) -> str:
    for name, points in (("source", source), ("target", target)):
        if len(points) < config.min_points:
            return f"{name} has only {count_of(len(points), 'return')}"
        if not math.isfinite(float(np.sum(points))):
            return f"{name} has returns that are not finite"
    return ""
