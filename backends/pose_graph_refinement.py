# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The last word of graph SLAM: match every keyframe against its surroundings, optimise, repeat."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from slarm_graph.backend import Heartbeat
from slarm_graph.backends import pose_graph_optimizer as optimizer
from slarm_graph.config import RunConfig
from slarm_graph.constraint import Constraint, ConstraintKind, PoseGraph
from slarm_graph.frontends.rematching import Rematch, plan, rematch
from slarm_graph.geometry import Floats, Pose2, between

_ODOMETRY_FLOOR = np.diag([0.003, 0.003, 0.001]) ** 2
_MATCH_FLOOR = np.diag([0.003, 0.003, 0.001]) ** 2
_INFORMATION_FLOOR = np.diag([1.0, 1.0, 10.0])
_MIN_SCORE = 0.4
_GROUP_STRIDE = 5
_GROUP_LENGTH = 10


@dataclass(frozen=True, slots=True)
class Refined:
    """Keyframe poses after the last round, with the constraints that held them."""

    graph: PoseGraph


def refine_keyframes(
    points: Sequence[Floats],
    poses: Floats,
    local: Floats,
    covariances: Floats,
    config: RunConfig,
    heartbeat: Heartbeat,
) -> Refined:
    """Improve keyframe poses (K, 3) in rounds.

    Parameters
    ----------
    points : sequence of K (P, 2) float64
    poses : (K, 3) float64
        First estimate `map_from_robot`.
    local : (K, 3) float64
        Lidar odometry `local_from_robot`.
    covariances : (K, 3, 3) float64
        Of the lidar odometry since the keyframe before.
    """
    odometry = _odometry(local, covariances)
    graph = PoseGraph(poses, odometry)
    settings = config.pose_graph
    for number in range(settings.rematch_rounds):
        heartbeat(f"matching everything again, round {number + 1}")
        jobs = plan(
            graph.poses,
            stride=_GROUP_STRIDE,
            length=_GROUP_LENGTH,
            radius_m=settings.rematch_radius_m,
            visits=settings.rematch_visits,
        )
        if not jobs:
            break
        matches = rematch(points, graph.poses, jobs, config.frontend.matching)
        graph = PoseGraph(graph.poses, odometry + _constraints(matches))
        found = optimizer.optimize(graph, kernel=optimizer.Kernel.CAUCHY, heartbeat=heartbeat)
        graph = PoseGraph(found.poses, graph.constraints)
    return Refined(graph)


def _odometry(local: Floats, covariances: Floats) -> tuple[Constraint, ...]:
    steps = between(local[:-1], local[1:])
    return tuple(
        Constraint(
            k, k + 1, Pose2.from_array(step), _symmetric(c) + _ODOMETRY_FLOOR,
            ConstraintKind.ODOMETRY,
        )
        for k, (step, c) in enumerate(zip(steps, covariances[1:], strict=True))
    )  # fmt: skip


def _constraints(matches: Rematch) -> tuple[Constraint, ...]:
    covariances = np.linalg.inv(matches.information + _INFORMATION_FLOOR) + _MATCH_FLOOR
    good = np.flatnonzero(matches.score >= _MIN_SCORE)
    return tuple(
        Constraint(
            int(matches.i[r]),
            int(matches.j[r]),
            Pose2.from_array(matches.i_from_j[r]),
            _symmetric(covariances[r]),
            ConstraintKind.LOOP_CLOSURE,
        )
        for r in good
    )


def _symmetric(matrix: Floats) -> Floats:
    return 0.5 * (matrix + matrix.T)
