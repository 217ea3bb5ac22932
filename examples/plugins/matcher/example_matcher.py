# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""A scan matcher of one's own: `match_scans(source, target, matcher="point_icp")`."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy.spatial import cKDTree

from slarm_graph import MatchingConfig, MatchResult, Pose2, Stage


class PointIcpConfig(Stage):
    """The matcher `point_icp`."""

    iterations: int = Field(default=30, ge=1)
    """Rounds of pairing and fitting."""
    max_distance_m: float = Field(default=0.5, gt=0)
    """Returns farther from their nearest neighbour are left out."""


class PointIcp:
    """Point-to-point ICP in its plainest form."""

    settings: ClassVar[type[Stage]] = PointIcpConfig

    def __init__(self, settings: PointIcpConfig, matching: MatchingConfig) -> None:
        self._settings, self._matching = settings, matching

    def match(
        self,
        source: NDArray[np.float64],
        target: NDArray[np.float64],
        *,
        target_from_source: Pose2,
    ) -> MatchResult:
        """Pair every return with the nearest one of the target and fit, again and again."""
        tree, pose = cKDTree(target), target_from_source
        for _ in range(self._settings.iterations):
            moved = pose.transform(source)
            distance_m, nearest = tree.query(moved)
            paired = distance_m < self._settings.max_distance_m
            if paired.sum() < self._matching.min_points:
                return MatchResult(pose, reason="too few returns have a neighbour")
            pose = _fitted(source[paired], target[nearest[paired]])
        sigma_m = self._matching.point_sigma_m / np.sqrt(paired.sum())
        covariance = np.diag([sigma_m, sigma_m, sigma_m]) ** 2
        return MatchResult(pose, covariance, float(paired.mean()), int(paired.sum()))


def _fitted(source: NDArray[np.float64], target: NDArray[np.float64]) -> Pose2:
    """Rigid motion that lays points (N, 2) onto points (N, 2) with least squares."""
    a, b = source - source.mean(axis=0), target - target.mean(axis=0)
    theta = np.arctan2(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]), np.sum(a * b))
    turned = Pose2(0.0, 0.0, float(theta)).transform(source.mean(axis=0)[None])[0]
    x, y = target.mean(axis=0) - turned
    return Pose2(float(x), float(y), float(theta))
