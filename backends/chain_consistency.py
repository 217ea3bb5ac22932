# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Chi-square test of loop closures against the chains of scan matches and of odometry alone."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from slarm_graph.constraint import Constraint, ConstraintKind
from slarm_graph.frontends.scans.closures import GATE_CHI2
from slarm_graph.frontends.scans.small_pose import squared_mahalanobis
from slarm_graph.geometry import Pose2, transform_covariances

_CHAINS = (ConstraintKind.SCAN_MATCH, ConstraintKind.ODOMETRY)


def contradict_both_chains(
    closures: Iterable[Constraint], steps: Sequence[Constraint]
) -> list[bool]:
    """Whether both the chain of matches and that of odometry reject closures between two nodes.

    Their errors are independent. What one allows may be true, the other being wrong; where both
    reject it, both must have failed on the same path for it to be true.

    Parameters
    ----------
    closures : iterable of Constraint
        Each from an older node to a later one.
    steps : sequence of Constraint
        From every node to the next; a chain with gaps allows anything.
    """
    chains = [{step.j: step for step in steps if step.kind is kind} for kind in _CHAINS]
    return [all(_is_rejected(closure, chain) for chain in chains) for closure in closures]


def _is_rejected(closure: Constraint, step_to: Mapping[int, Constraint]) -> bool:
    """Whether a chain of steps, each by the node it leads to, rejects a closure."""
    pose, covariance = Pose2(), np.zeros((3, 3))
    for node in range(closure.i + 1, closure.j + 1):
        if node not in step_to:
            return False
        step = step_to[node]
        pose, back = pose @ step.i_from_j, step.i_from_j.inverse().as_array()
        covariance = transform_covariances(back, covariance) + step.covariance
    residual = pose.between(closure.i_from_j).as_array()
    return squared_mahalanobis(residual, covariance + closure.covariance) > GATE_CHI2
