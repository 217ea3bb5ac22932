# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Robust optimisation of a finished graph: false loop closures, and slipped or misfit steps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from slarm_graph.backend import Heartbeat, silent
from slarm_graph.backends.graph_constraints import clamping_factors
from slarm_graph.backends.pose_graph_optimizer import Kernel, optimize, optimize_gnc
from slarm_graph.constraint import Constraint, ConstraintKind, PoseGraph
from slarm_graph.counts import count_of
from slarm_graph.frontends.scans.significance import CHI2_1_PERMILLE
from slarm_graph.frontends.scans.small_pose import squared_mahalanobis
from slarm_graph.geometry import Floats, Pose2, between, symmetric, wrap_angles

_SLIP_SIGMAS = 2.0
"""Scale of the Cauchy kernel on steps: half of it makes mit-csail hard_1_of_2 8 % better, double
2 % worse; plain recordings stay, edmonton moves less than by 2 mm of noise in its ranges."""
INLIER_WEIGHT = 0.5
"""Weight from which a constraint is an inlier: truncated least squares ends with 0 or 1."""
_MIN_WEIGHT = 1e-6
"""Keeps an inflated step of (1 m)^2 within the covariances that `check_graph` lets pass."""


@dataclass(frozen=True, slots=True)
class RobustSolution:
    """Outcome of robust optimisation.

    Parameters
    ----------
    graph : PoseGraph
        Optimised poses, with the inlier constraints.
    weights : (M,) float64
        Weight of every input constraint: 1 for all but loop closures and contradictory steps.
    """

    graph: PoseGraph
    weights: Floats


def optimize_robustly(graph: PoseGraph, heartbeat: Heartbeat = silent) -> RobustSolution:
    """Optimise a graph whose loop closures may be false and whose steps may have slipped.

    First a Cauchy kernel on all constraints lets odometry slip where several closures agree against
    it; its covariance is inflated there. Then graduated non-convexity weighs the closures, and the
    steps whose match and odometry contradict each other; all others are known inliers.
    """
    soft = optimize(graph, kernel=Kernel.CAUCHY, slip_sigmas=_SLIP_SIGMAS, heartbeat=heartbeat)
    doubtful = contradictory_steps(graph.constraints)
    weights = soft.weights.copy()
    weights[doubtful] = 1.0
    inflated = _inflated(graph.constraints, weights)
    pairs = zip(doubtful[::2], doubtful[1::2], strict=True)
    mixtures = tuple(_mixture(inflated[k], inflated[other]) for k, other in pairs)
    closures = [k for k, c in enumerate(inflated) if c.kind is ConstraintKind.LOOP_CLOSURE]
    suspects = sorted({*closures, *doubtful})
    hard = optimize_gnc(PoseGraph(soft.poses, inflated + mixtures), suspects, heartbeat=heartbeat)
    is_inlier = hard.weights >= INLIER_WEIGHT
    is_inlier[len(inflated) :] = False
    kept = [c for c, ok in zip(inflated + mixtures, is_inlier.tolist(), strict=True) if ok]
    joined = {(c.i, c.j) for c in kept}
    kept += [c for c in mixtures if (c.i, c.j) not in joined]
    return RobustSolution(PoseGraph(hard.poses, tuple(kept)), hard.weights[: len(inflated)])


def step_notices(constraints: Sequence[Constraint], weights: Floats) -> tuple[str, ...]:
    """Report on how many steps match and odometry contradict each other, and which were inliers.

    Parameters
    ----------
    constraints : sequence of Constraint
        The input of robust optimisation.
    weights : (M,) float64
    """
    doubtful = contradictory_steps(constraints)
    if not doubtful:
        return ()
    is_inlier = (weights[doubtful] >= INLIER_WEIGHT).reshape(-1, 2)
    steps = sum(c.kind is ConstraintKind.SCAN_MATCH for c in constraints)
    counts = {
        "the matches": int((is_inlier[:, 0] & ~is_inlier[:, 1]).sum()),
        "the odometry": int((is_inlier[:, 1] & ~is_inlier[:, 0]).sum()),
        "neither alone": int((~is_inlier).all(axis=1).sum()),
        "both": int(is_inlier.all(axis=1).sum()),
    }
    counted = ", ".join(f"{words} in {count}" for words, count in counts.items() if count)
    return (
        f"scan matching and odometry contradict each other in {len(is_inlier)} of"
        f" {count_of(steps, 'step')} of the graph: accepted {counted}",
    )


def contradictory_steps(constraints: Sequence[Constraint]) -> list[int]:
    """Return the indices, in pairs, of steps whose match and odometry fail a chi-square test."""
    by_wheels = {c.i: k for k, c in enumerate(constraints) if c.kind is ConstraintKind.ODOMETRY}
    indices = []
    for k, c in enumerate(constraints):
        other = by_wheels.get(c.i) if c.kind is ConstraintKind.SCAN_MATCH else None
        if other is None:
            continue
        if _contradict(_difference(c, constraints[other]), c, constraints[other]):
            indices += [k, other]
    return indices


def _contradict(difference: Floats, one: Constraint, other: Constraint) -> bool:
    """Whether a difference (3,) of two measurements of a step fails a chi-square test.

    With nominal covariances: odometry's is inflated where a match contradicts it, so that a false
    match would confirm itself.
    """
    return squared_mahalanobis(difference, _nominal(one) + _nominal(other)) > CHI2_1_PERMILLE


def _difference(one: Constraint, other: Constraint) -> Floats:
    """Relative pose (3,) from the end of one measurement of a step to that of another."""
    difference = between(one.i_from_j.as_array(), other.i_from_j.as_array())
    difference[2] = wrap_angles(difference[2])
    return difference


def _nominal(constraint: Constraint) -> Floats:
    """Covariance (3, 3) that a constraint has as long as nothing failed."""
    return constraint.covariance if constraint.unfailed is None else constraint.unfailed


def fused_step(one: Constraint, other: Constraint) -> Constraint:
    """Fuse two measurements of a step, or inflate the first where they contradict each other.

    Of contradictory ones at least one is overconfident, so that covariances do not tell which: the
    odds are even, and the covariance is the second moment of both about the first.
    """
    difference = _difference(one, other)
    if _contradict(difference, one, other):
        total = _nominal(one) + _nominal(other)
        return replace(one, covariance=np.asarray(0.5 * (total + np.outer(difference, difference))))
    total = one.covariance + other.covariance
    gain = np.linalg.solve(total, one.covariance).T
    fused = one.covariance - gain @ one.covariance
    mean = one.i_from_j @ Pose2.from_array(gain @ difference)
    return replace(one, i_from_j=mean, covariance=symmetric(fused))


def _mixture(one: Constraint, other: Constraint) -> Constraint:
    """Mean and covariance of the Gaussian mixture of two contradictory measurements of a step.

    Weighted by their information along the difference. It keeps the graph connected where closures
    reject both.
    """
    difference = _difference(one, other)
    squared, other_squared = (
        difference @ np.linalg.solve(_nominal(c), difference) for c in (one, other)
    )
    share = float(other_squared / (squared + other_squared))
    mean = one.i_from_j @ Pose2.from_array(share * difference)
    within = (1.0 - share) * _nominal(one) + share * _nominal(other)
    covariance = within + share * (1.0 - share) * np.outer(difference, difference)
    covariance = covariance * clamping_factors(covariance)
    return replace(one, i_from_j=mean, covariance=covariance, shared=covariance)


def _inflated(constraints: Sequence[Constraint], weights: Floats) -> tuple[Constraint, ...]:
    """Divide the covariances of steps by their robust weights; leave closures alone."""
    limited = np.maximum(weights, _MIN_WEIGHT).tolist()
    return tuple(
        c if c.kind is ConstraintKind.LOOP_CLOSURE else _scaled_by(c, 1.0 / weight)
        for c, weight in zip(constraints, limited, strict=True)
    )


def _scaled_by(constraint: Constraint, factor: float) -> Constraint:
    factors = factor * clamping_factors(factor * constraint.covariance)
    shared = None if constraint.shared is None else constraint.shared * factors
    return replace(constraint, covariance=constraint.covariance * factors, shared=shared)
