# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Nonlinear least squares over pose graphs; the only module that imports GTSAM."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import gtsam
import numpy as np

from slarm_graph.backend import Heartbeat, silent
from slarm_graph.backends.graph_checks import check_graph
from slarm_graph.backends.pose_graph_start import starting_poses
from slarm_graph.constraint import Constraint, ConstraintKind, PoseGraph
from slarm_graph.errors import RunFailed
from slarm_graph.geometry import Floats

_LOG = logging.getLogger(__name__)
_ANCHOR_SIGMA = 1e-6
"""Of the prior on the first pose [m, rad], the map's origin: fixed, at any scale of sensors."""
_HUBER = 1.345
"""With Gaussian errors 95 % as efficient as least squares (Holland and Welsch 1977)."""


class Kernel(StrEnum):
    """Robust kernel (M-estimator) of the loop closures."""

    NONE = "none"
    HUBER = "huber"
    CAUCHY = "cauchy"


@dataclass(frozen=True, slots=True)
class Optimized:
    """The outcome of an optimisation.

    Parameters
    ----------
    poses : (N, 3) float64
        `map_from_pose` [m, m, rad].
    chi2 : float
        Sum of squared whitened residuals, robustified by the kernel or multiplied by `weights`.
    iterations : int
    weights : (M,) float64
        Robust weight of each constraint by kernel or GNC, 0 (rejected) to 1.
    """

    poses: Floats
    chi2: float
    iterations: int
    weights: Floats


def optimize(
    graph: PoseGraph,
    *,
    kernel: Kernel = Kernel.NONE,
    slip_sigmas: float = math.inf,
    max_iterations: int = 100,
    tolerance: float = 1e-8,
    heartbeat: Heartbeat = silent,
) -> Optimized:
    """Minimise from the graph's own poses with Levenberg-Marquardt, pose 0 fixed.

    Parameters
    ----------
    graph : PoseGraph
        Connected; covariances finite, symmetric, eigenvalues within [1e-12, 1e6].
    kernel : Kernel
        Robust kernel of the loop closures.
    slip_sigmas : float
        Width of a Cauchy kernel on everything else, for lidar odometry that may slip; infinite
        for none.
    max_iterations : int
    tolerance : float
        Relative decrease of the error below which it has converged.
    heartbeat : Heartbeat
        Called on every iteration.

    Raises
    ------
    ValueError
        When a covariance or a pose is not usable.
    RunFailed
        When no factorisation succeeds or the result is not finite.
    """
    factors = _factors(graph, kernel, slip_sigmas)
    values, iterations = _minimise(factors, graph.poses, (max_iterations, tolerance), heartbeat)
    poses = np.asarray(gtsam.utilities.extractPose2(values), dtype=np.float64).reshape(-1, 3)
    losses = np.array([factors.at(k).error(values) for k in range(len(graph.constraints))])
    weights = np.where(
        [_is_closure(c) for c in graph.constraints],
        _weight(losses, kernel, 1.0),
        _weight(losses, Kernel.CAUCHY if slip_sigmas < math.inf else Kernel.NONE, slip_sigmas),
    )
    return Optimized(poses, 2.0 * factors.error(values), iterations, weights)


def optimize_from_anywhere(graph: PoseGraph, *, heartbeat: Heartbeat = silent) -> Optimized:
    """Minimise from several initialisations and keep the best: for graphs with poor poses.

    These are the graph's own poses, a spanning tree, and two rotation-first linear solutions
    (see `pose_graph_start`).
    """
    best: Optimized | None = None
    for name, poses in starting_poses(graph):
        heartbeat(f"optimising the pose graph from {name}")
        try:
            optimized = optimize(replace(graph, poses=poses), heartbeat=heartbeat)
        except RunFailed as error:
            _LOG.info("start from %s failed: %s", name, error)
            continue
        if best is None or optimized.chi2 < best.chi2 * (1.0 - 1e-9):
            best = optimized
    if best is None:
        raise RunFailed("the pose graph could not be optimised from any start")
    return best


def optimize_gnc(
    graph: PoseGraph,
    suspects: Sequence[int] | None = None,
    *,
    inlier_probability: float = 0.99,
    heartbeat: Heartbeat = silent,
) -> Optimized:
    """Minimise with graduated non-convexity, with known inliers but for some constraints.

    Truncated least squares of Yang, Antonante, Tzoumas, Carlone, RA-L 2020: a suspect whose
    squared residual exceeds the chi-square quantile of `inlier_probability` ends with weight 0.

    Parameters
    ----------
    graph : PoseGraph
    suspects : sequence of int, optional
        Indices of constraints; by default the loop closures.
    inlier_probability : float
    heartbeat : Heartbeat

    Returns
    -------
    Optimized
        Its weights are 1 for known inliers and those of GNC for suspects.
    """
    if suspects is None:
        suspects = [k for k, c in enumerate(graph.constraints) if _is_closure(c)]
    if not suspects:
        return optimize(graph, heartbeat=heartbeat)
    factors = _factors(graph)
    inliers = np.setdiff1d(np.arange(factors.size()), np.array(suspects, dtype=np.int64))
    lm = _parameters(50)
    lm.iterationHook = lambda *_: heartbeat("weighing loop closures")
    params = gtsam.GncLMParams(lm)
    params.setLossType(gtsam.GncLossType.TLS)
    params.setKnownInliers([int(k) for k in inliers])
    solver = gtsam.GncLMOptimizer(factors, _values(graph.poses), params)
    solver.setInlierCostThresholdsAtProbability(inlier_probability)
    values = solver.optimize()
    weights = np.asarray(solver.getWeights(), dtype=np.float64)[: len(graph.constraints)]
    poses = np.asarray(gtsam.utilities.extractPose2(values), dtype=np.float64).reshape(-1, 3)
    if not np.isfinite(poses).all():
        raise RunFailed("graduated non-convexity returned poses that are not finite")
    return Optimized(poses, _weighted_chi2(factors, values, weights), 0, weights)


def chi2(graph: PoseGraph) -> float:
    """Sum of squared whitened residuals of the graph at its own poses."""
    return 2.0 * float(_factors(graph).error(_values(graph.poses)))


def chi2_each(graph: PoseGraph) -> Floats:
    """Squared whitened residual (M,) of every constraint at the graph's own poses."""
    factors, values = _factors(graph), _values(graph.poses)
    return np.array([2.0 * factors.at(k).error(values) for k in range(len(graph.constraints))])


def marginal_covariances(graph: PoseGraph, indices: Sequence[int]) -> list[Floats]:
    """Covariances (3, 3) of poses in their own body frames, pose 0 being fixed.

    Raises
    ------
    RunFailed
        When the system is indeterminate.
    """
    # ISAM2 with QR handles the long chains on which `gtsam.Marginals` fails.
    params = gtsam.ISAM2Params()
    params.setFactorization("QR")
    smoother = gtsam.ISAM2(params)
    try:
        smoother.update(_factors(graph), _values(graph.poses))
        return [np.array(smoother.marginalCovariance(int(k))) for k in indices]
    except RuntimeError as error:
        raise RunFailed(f"the covariances of the pose graph are indeterminate: {error}") from error


def _is_closure(constraint: Constraint) -> bool:
    return constraint.kind is ConstraintKind.LOOP_CLOSURE


def _factors(
    graph: PoseGraph, kernel: Kernel = Kernel.NONE, slip_sigmas: float = math.inf
) -> gtsam.NonlinearFactorGraph:
    """Constraint k becomes factor k; the prior on pose 0 comes last."""
    check_graph(graph)
    closure_estimator = _estimator(kernel)
    step_estimator = _estimator(Kernel.CAUCHY, slip_sigmas) if slip_sigmas < math.inf else None
    factors = gtsam.NonlinearFactorGraph()
    for c in graph.constraints:
        noise: gtsam.noiseModel.Base = gtsam.noiseModel.Gaussian.Covariance(c.covariance)
        estimator = closure_estimator if _is_closure(c) else step_estimator
        if estimator is not None:
            noise = gtsam.noiseModel.Robust.Create(estimator, noise)
        measured = gtsam.Pose2(c.i_from_j.x, c.i_from_j.y, c.i_from_j.theta)
        factors.add(gtsam.BetweenFactorPose2(c.i, c.j, measured, noise))
    anchor = gtsam.noiseModel.Isotropic.Sigma(3, _ANCHOR_SIGMA)
    factors.add(gtsam.PriorFactorPose2(0, gtsam.Pose2(*graph.poses[0]), anchor))
    return factors


def _estimator(kernel: Kernel, cauchy: float = 1.0) -> gtsam.noiseModel.mEstimator.Base | None:
    if kernel is Kernel.NONE:
        return None
    if kernel is Kernel.HUBER:
        return gtsam.noiseModel.mEstimator.Huber.Create(_HUBER)
    return gtsam.noiseModel.mEstimator.Cauchy.Create(cauchy)


def _weight(losses: Floats, kernel: Kernel, cauchy: float) -> Floats:
    """Robust weights (M,) of a kernel, from its losses (M,)."""
    if kernel is Kernel.NONE:
        return np.ones(len(losses))
    if kernel is Kernel.HUBER:
        return np.minimum(1.0, _HUBER / (losses / _HUBER + 0.5 * _HUBER))
    # The loss is k^2 / 2 log(1 + r^2 / k^2), the weight 1 / (1 + r^2 / k^2).
    return np.asarray(np.exp(-2.0 * losses / cauchy**2))


def _values(poses: Floats) -> gtsam.Values:
    values = gtsam.Values()
    for key, (x, y, theta) in enumerate(poses.tolist()):
        values.insert(key, gtsam.Pose2(x, y, theta))
    return values


def _parameters(
    max_iterations: int, tolerance: float = 1e-8, *, qr: bool = False
) -> gtsam.LevenbergMarquardtParams:
    params = gtsam.LevenbergMarquardtParams()
    params.setMaxIterations(max_iterations)
    params.setRelativeErrorTol(tolerance)
    params.setAbsoluteErrorTol(1e-6)
    params.setlambdaUpperBound(1e10)
    if qr:
        params.setLinearSolverType("MULTIFRONTAL_QR")
    return params


def _minimise(
    factors: gtsam.NonlinearFactorGraph,
    poses: Floats,
    limits: tuple[int, float],
    heartbeat: Heartbeat,
) -> tuple[gtsam.Values, int]:
    """Try Cholesky, which is faster, then QR, which tolerates bad conditioning."""
    for qr in (False, True):
        params = _parameters(*limits, qr=qr)
        # The hook runs Python between iterations, which also lets an interrupt through.
        params.iterationHook = lambda *_: heartbeat("optimising the pose graph")
        optimizer = gtsam.LevenbergMarquardtOptimizer(factors, _values(poses), params)
        try:
            values = optimizer.optimize()
        except RuntimeError as error:
            if "Indetermina" not in str(error):
                raise
            _LOG.info("the pose graph is indeterminate to Cholesky; trying QR")
            continue
        if np.isfinite(factors.error(values)):
            return values, int(optimizer.iterations())
    raise RunFailed("the pose graph could not be optimised: indeterminate or not finite")


def _weighted_chi2(
    factors: gtsam.NonlinearFactorGraph, values: gtsam.Values, weights: Floats
) -> float:
    errors = np.array([factors.at(k).error(values) for k in range(len(weights))])
    return float(2.0 * np.dot(weights, errors))
