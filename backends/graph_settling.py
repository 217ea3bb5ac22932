# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Deciding which constraints of a finished graph to believe."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from slarm_graph.backend import Heartbeat, silent
from slarm_graph.backends.graph_constraints import limits_of
from slarm_graph.backends.pose_graph_optimizer import Kernel, optimize, optimize_gnc
from slarm_graph.constraint import Constraint, ConstraintKind, PoseGraph
from slarm_graph.counts import count_of
from slarm_graph.frontends.scans.significance import CHI2_1_PERMILLE
from slarm_graph.frontends.scans.small_pose import squared_mahalanobis
from slarm_graph.geometry import Floats, Pose2, between, wrap_angles

_SLIP_SIGMAS = 2.0
"""Scale of the Cauchy kernel on steps: half of it makes mit-csail hard_1_of_2 8 % better, double
2 % worse; plain recordings stay, edmonton moves less than by 2 mm of noise in its ranges."""
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
        Weight of every constraint of the graph that was given: 1 for all but loop closures and
        contradictory steps.
    """

    graph: PoseGraph
    weights: Floats


def settle(graph: PoseGraph, heartbeat: Heartbeat = silent) -> Settled:
    """Optimise a graph whose loop closures may be false and whose steps may have slipped.

    First a Cauchy kernel on everything lets odometry give way where several closures agree against
    it; there its covariance is widened. Then graduated non-convexity weighs the closures, and the
    steps of which matches and wheels tell two stories; all others are trusted.
    """
    soft = optimize(graph, kernel=Kernel.CAUCHY, slip_sigmas=_SLIP_SIGMAS, heartbeat=heartbeat)
    doubtful = contradictory_steps(graph.constraints)
    weights = soft.weights.copy()
    weights[doubtful] = 1.0
    eased = _eased(graph.constraints, weights)
    pairs = zip(doubtful[::2], doubtful[1::2], strict=True)
    loose = tuple(_either(eased[k], eased[other]) for k, other in pairs)
    closures = [k for k, c in enumerate(eased) if c.kind is ConstraintKind.LOOP_CLOSURE]
    suspects = sorted({*closures, *doubtful})
    found = optimize_gnc(PoseGraph(soft.poses, eased + loose), suspects, heartbeat=heartbeat)
    believed = found.weights >= _BELIEVED
    believed[len(eased) :] = False
    kept = [c for c, ok in zip(eased + loose, believed.tolist(), strict=True) if ok]
    joined = {(c.i, c.j) for c in kept}
    kept += [c for c in loose if (c.i, c.j) not in joined]
    return Settled(PoseGraph(found.poses, tuple(kept)), found.weights[: len(eased)])


def step_notices(constraints: Sequence[Constraint], weights: Floats) -> tuple[str, ...]:
    """Say in how many steps matches and odometry contradict each other, and which are believed.

    Parameters
    ----------
    constraints : sequence of Constraint
        All that were weighed.
    weights : (M,) float64
    """
    doubtful = contradictory_steps(constraints)
    if not doubtful:
        return ()
    believed = (weights[doubtful] >= _BELIEVED).reshape(-1, 2)
    steps = sum(c.kind is ConstraintKind.ODOMETRY for c in constraints)
    counts = {
        "the matches": int((believed[:, 0] & ~believed[:, 1]).sum()),
        "the odometry": int((believed[:, 1] & ~believed[:, 0]).sum()),
        "neither alone": int((~believed).all(axis=1).sum()),
        "both": int(believed.all(axis=1).sum()),
    }
    told = ", ".join(f"{words} in {count}" for words, count in counts.items() if count)
    return (
        f"matches of scans and odometry contradict each other in {len(believed)} of"
        f" {count_of(steps, 'step')} of the graph: believed are {told}",
    )


def contradictory_steps(constraints: Sequence[Constraint]) -> list[int]:
    """Return the indices of steps that matches and wheels contradict each other about, of both."""
    by_wheels = {c.i: k for k, c in enumerate(constraints) if c.kind is ConstraintKind.WHEELS}
    found = []
    for k, c in enumerate(constraints):
        other = by_wheels.get(c.i) if c.kind is ConstraintKind.ODOMETRY else None
        if other is None:
            continue
        if _contradict(_apart(c, constraints[other]), c, constraints[other]):
            found += [k, other]
    return found


def _contradict(apart: Floats, one: Constraint, other: Constraint) -> bool:
    """Whether two stories of a step, so far (3,) apart, cannot both be true, had nothing failed.

    That odometry failed is what a match says that lies elsewhere: a false one would prove itself.
    """
    return squared_mahalanobis(apart, _unfailed(one) + _unfailed(other)) > CHI2_1_PERMILLE


def _apart(one: Constraint, other: Constraint) -> Floats:
    """Where another story (3,) of a step ends, as seen from the end of the first."""
    apart = between(one.i_from_j.as_array(), other.i_from_j.as_array())
    apart[2] = wrap_angles(apart[2])
    return apart


def _unfailed(constraint: Constraint) -> Floats:
    return constraint.covariance if constraint.unfailed is None else constraint.unfailed


def left_open(one: Constraint, other: Constraint) -> Constraint:
    """A step told twice: what both together say, or the first with room for either.

    Of stories that contradict each other at least one is not as sure as it says, so that their own
    covariances do not tell which: odds are even, and the spread is that around the first.
    """
    apart = _apart(one, other)
    if _contradict(apart, one, other):
        both = _unfailed(one) + _unfailed(other)
        return replace(one, covariance=np.asarray(0.5 * (both + np.outer(apart, apart))))
    both = one.covariance + other.covariance
    gain = np.linalg.solve(both, one.covariance).T
    fused = one.covariance - gain @ one.covariance
    mean = one.i_from_j @ Pose2.from_array(gain @ apart)
    return replace(one, i_from_j=mean, covariance=np.asarray(0.5 * (fused + fused.T)))


def _either(one: Constraint, other: Constraint) -> Constraint:
    """What is sure of a step of which one story or the other is true: mean and spread of both.

    Each counts by how sure it is of what they disagree about. So closures that speak against both
    do not cut the graph there.
    """
    apart = _apart(one, other)
    sure, other_sure = (apart @ np.linalg.solve(_unfailed(c), apart) for c in (one, other))
    share = float(other_sure / (sure + other_sure))
    mean = one.i_from_j @ Pose2.from_array(share * apart)
    within = (1.0 - share) * _unfailed(one) + share * _unfailed(other)
    spread = within + share * (1.0 - share) * np.outer(apart, apart)
    spread = spread * limits_of(spread)
    return replace(one, i_from_j=mean, covariance=spread, shared=spread)


def _eased(constraints: Sequence[Constraint], weights: Floats) -> tuple[Constraint, ...]:
    """Widen the covariances of odometry by the weight it was given; leave closures alone."""
    limited = np.maximum(weights, _MIN_WEIGHT).tolist()
    return tuple(
        c if c.kind is ConstraintKind.LOOP_CLOSURE else _widened(c, 1.0 / weight)
        for c, weight in zip(constraints, limited, strict=True)
    )


def _widened(constraint: Constraint, factor: float) -> Constraint:
    factors = factor * limits_of(factor * constraint.covariance)
    shared = None if constraint.shared is None else constraint.shared * factors
    return replace(constraint, covariance=constraint.covariance * factors, shared=shared)
