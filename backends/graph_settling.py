# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Deciding which constraints of a finished graph to believe."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from slarm_graph.backend import Heartbeat, silent
from slarm_graph.backends.pose_graph_optimizer import Kernel, optimize, optimize_gnc
from slarm_graph.constraint import Constraint, ConstraintKind, PoseGraph
from slarm_graph.geometry import Floats

_SLIP_SIGMAS = 2.0
_BELIEVED = 0.5
"""Truncated least squares ends with weights of 0 or 1: the middle tells them apart."""
_MIN_WEIGHT = 1e-6
"""Keeps an eased step of (1 m)^2 within the covariances that `check_graph` lets pass."""


@dataclass(frozen=True, slots=True)
class Settled:
    """The graph a result rests on.

    Parameters
    ----------
    graph : PoseGraph
        Optimised poses, with the constraints that were believed.
    weights : (M,) float64
        Weight of every constraint of the graph that was given: 1 for all but loop closures.
    """

    graph: PoseGraph
    weights: Floats


def settle(graph: PoseGraph, heartbeat: Heartbeat = silent) -> Settled:
    """Optimise a graph whose loop closures may be false and whose lidar odometry may have slipped.

    First a Cauchy kernel on everything lets odometry give way where several closures agree against
    it; there its covariance is widened. Then graduated non-convexity weighs the closures, trusting
    the odometry.
    """
    soft = optimize(graph, kernel=Kernel.CAUCHY, slip_sigmas=_SLIP_SIGMAS, heartbeat=heartbeat)
    eased = PoseGraph(soft.poses, _eased(graph.constraints, soft.weights))
    found = optimize_gnc(eased, heartbeat=heartbeat)
    believed = found.weights >= _BELIEVED
    kept = tuple(c for c, ok in zip(eased.constraints, believed, strict=True) if ok)
    return Settled(PoseGraph(found.poses, kept), found.weights)


def _eased(constraints: Sequence[Constraint], weights: Floats) -> tuple[Constraint, ...]:
    """Widen the covariances of odometry by the weight it was given; leave closures alone."""
    limited = np.maximum(weights, _MIN_WEIGHT).tolist()
    return tuple(
        c if c.kind is ConstraintKind.LOOP_CLOSURE else replace(c, covariance=c.covariance / weight)
        for c, weight in zip(constraints, limited, strict=True)
    )
