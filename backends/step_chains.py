# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""What the way driven says of a find on its own: by matches alone, and by odometry alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from slarm_graph.constraint import Constraint, ConstraintKind
from slarm_graph.frontends.scans.closures import GATE_CHI2
from slarm_graph.frontends.scans.small_pose import squared_mahalanobis
from slarm_graph.geometry import Pose2

_WITNESSES = (ConstraintKind.ODOMETRY, ConstraintKind.WHEELS)


def is_contradicted_twice(closure: Constraint, steps: Sequence[Constraint]) -> bool:
    """Whether both matches and odometry have the way between a closure's nodes lead elsewhere.

    Each errs for reasons of its own. What one of the two allows may be true, and the other wrong;
    for what neither allows both must have failed on the same way.

    Parameters
    ----------
    closure : Constraint
        From an older node to a later one.
    steps : sequence of Constraint
        From every node to the next; where odometry is not known throughout it allows anything.
    """
    return all(_is_contradicted(closure, steps, kind) for kind in _WITNESSES)


def _is_contradicted(
    closure: Constraint, steps: Sequence[Constraint], kind: ConstraintKind
) -> bool:
    step_to = {step.j: step for step in steps if step.kind is kind}
    way, drift = Pose2(), np.zeros((3, 3))
    for node in range(closure.i + 1, closure.j + 1):
        if node not in step_to:
            return False
        step = step_to[node]
        way, carry = way @ step.i_from_j, step.i_from_j.inverse().adjoint()
        drift = carry @ drift @ carry.T + step.covariance
    miss = way.between(closure.i_from_j).as_array()
    return squared_mahalanobis(miss, drift + closure.covariance) > GATE_CHI2
