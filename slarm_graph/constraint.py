# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Relative measurements between poses: what a matcher returns and what a graph is made of."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from slarm_graph.geometry import Floats, Pose2


@dataclass(frozen=True, slots=True)
class MatchResult:
    """Outcome of aligning a source scan onto a target; falsy with a reason when it failed.

    Parameters
    ----------
    target_from_source : Pose2
        Best alignment [m, m, rad].
    covariance : (3, 3) float64
        Of (x, y, theta) in the source's own (body) frame, as GTSAM's Pose2 tangent.
    score : float
        Mean agreement of the used points, 0 (none) to 1 (all on the target).
    inliers : int
        Points that lie on the target.
    iterations : int
    reason : str
        Why the match failed; empty when it succeeded.
    """

    target_from_source: Pose2
    covariance: Floats = field(default_factory=lambda: np.full((3, 3), np.nan))
    score: float = 0.0
    inliers: int = 0
    iterations: int = 0
    reason: str = ""

    def __bool__(self) -> bool:
        return not self.reason


class ConstraintKind(StrEnum):
    """Where a constraint comes from: wheels, matches along the path, or an old place."""

    ODOMETRY = "odometry"
    SCAN_MATCH = "scan_match"
    LOOP_CLOSURE = "loop_closure"


@dataclass(frozen=True, slots=True)
class Constraint:
    """A measured relative pose between two graph poses.

    Parameters
    ----------
    i, j : int
        Indices of the poses.
    i_from_j : Pose2
        Pose of j in the frame of i [m, m, rad].
    covariance : (3, 3) float64
        Of (x, y, theta) in the body frame of j [m^2, m rad, rad^2].
    kind : ConstraintKind
    shared : (3, 3) float64, optional
        The part of `covariance` that errors make which neighbouring constraints share, so that no
        residual tells of them; None for none.
    unfailed : (3, 3) float64, optional
        What `covariance` would be had nothing failed that may; None where that is the same.
    """

    i: int
    j: int
    i_from_j: Pose2
    covariance: Floats
    kind: ConstraintKind
    shared: Floats | None = None
    unfailed: Floats | None = None


@dataclass(frozen=True, slots=True)
class PoseGraph:
    """Poses and the constraints between them.

    Parameters
    ----------
    poses : (N, 3) float64
        `map_from_pose` [m, m, rad].
    constraints : tuple of Constraint
    """

    poses: Floats
    constraints: tuple[Constraint, ...] = ()
