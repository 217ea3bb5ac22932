# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Incremental submap pose graph: one node per few keyframes, few enough to optimise often."""

from __future__ import annotations

import bisect
import copy
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from slarm_graph.backend import Heartbeat, silent
from slarm_graph.backends import pose_graph_optimizer as optimizer
from slarm_graph.backends.graph_constraints import closure_constraint, matched_step, wheels_step
from slarm_graph.backends.path_interpolation import interpolate_corrections
from slarm_graph.backends.relative_covariance import RelativeCovariances
from slarm_graph.backends.robust_optimization import (
    INLIER_WEIGHT,
    RobustSolution,
    fused_step,
    optimize_robustly,
    step_notices,
)
from slarm_graph.backends.sliding_window import sliding_window
from slarm_graph.backends.variance_components import reoptimized
from slarm_graph.config import PoseGraphConfig
from slarm_graph.constraint import Constraint, ConstraintKind, PoseGraph
from slarm_graph.frontends.scans.closures import (
    GATE_CHI2,
    GATE_SIGMAS,
    Closure,
    ClosureCandidates,
    covisible_submaps,
)
from slarm_graph.frontends.scans.small_pose import squared_mahalanobis
from slarm_graph.frontends.scans.submaps import Keyframe, Submap, make_submap
from slarm_graph.geometry import (
    Floats,
    Pose2,
    between,
    compose,
    invert,
    transform_covariances,
    transform_points,
)

_SLIP_SIGMAS = 3.0
"""Wider than for the finished graph: while driving few closures contradict odometry."""
_LOCAL_NODES, _FULL_GROWTH = 200, 1.25
"""Up to so many nodes, and whenever their number has grown by the factor, all are optimised, else
the newest: half and double change nothing (edmonton, mit-csail plain, hard_1_of_2; so below)."""
GATED = "farther from the graph than the covariances allow"
_URGENT_M, _URGENT_RAD = 0.0125, 0.0025
"""Residual of a closure from which the graph is optimised at once, else it waits for the next: a
quarter of a cell of 0.05 m, here and 5 m ahead. With it a robot drives 684 m along such cells, with
double 763, with eight times 1004: it believed to have been there. Recordings move by 0.1 %."""


class SubmapGraph:
    """Keyframes, submaps, and the pose graph of nodes, steps and loop closures between them.

    Parameters
    ----------
    config : PoseGraphConfig
    """

    def __init__(self, config: PoseGraphConfig) -> None:
        self._config = config
        self.keyframes: list[Keyframe] = []
        self.submaps: list[Submap] = []
        self._nodes: list[Floats] = []
        self._edges: list[Constraint] = []
        self.closures: list[Closure] = []
        self._steps: list[Constraint] = []
        self._relative = RelativeCovariances()
        self._drift_covariances: list[Floats] = []
        self._last_full = 0
        self._old = 0
        self._centers: Floats = np.zeros((0, 3))
        self._starts: list[int] = []
        self._node_m = 0.0
        self._path_lengths_m: list[float] = []
        self._solution: RobustSolution | None = None

    def with_closures(self, closures: Sequence[Closure]) -> SubmapGraph:
        """Return a graph of the same keyframes with other closures, or others of them accepted."""
        other = copy.copy(self)
        other.closures, other._nodes, other._solution = list(closures), list(self._nodes), None
        other._edges = [e for e in self._edges if e.kind is not ConstraintKind.LOOP_CLOSURE]
        other._edges += [self.edge(c) for c in closures if not c.reason]
        other._relative = RelativeCovariances((*self._steps, *other._accepted_closures()))
        return other

    def add(self, keyframe: Keyframe) -> None:
        """Append a keyframe; begin a node and finish a submap when they are due."""
        if self.keyframes:
            step = self.keyframes[-1].local_from_robot.between(keyframe.local_from_robot)
            self._node_m += math.hypot(step.x, step.y)
            self._path_lengths_m.append(self._path_lengths_m[-1] + math.hypot(step.x, step.y))
        else:
            self._path_lengths_m.append(0.0)
        self.keyframes.append(keyframe)
        k, size = len(self.keyframes) - 1, self._config.node_keyframes
        if not self._starts or k - self._starts[-1] >= size or self._node_m >= self._config.node_m:
            self._begin_node(k)
        self._finish_submap()

    def _finish_submap(self) -> None:
        """Build the submap of a full node; it overlaps half a node's keyframes on either side."""
        node = len(self.submaps)
        if node + 1 >= len(self._starts):
            return
        first, last = self._starts[node], self._starts[node + 1]
        margin = max(1, (last - first) // 2)
        if len(self.keyframes) >= last + margin:
            begin = max(0, first - margin)
            self.submaps.append(make_submap(self.keyframes, begin, last + margin, first))

    def poses(self) -> Floats:
        """Return the current `map_from_node` (N, 3)."""
        return np.array(self._nodes)

    def path_length_at(self, keyframe: int) -> float:
        """Return the path length up to a keyframe [m]."""
        return self._path_lengths_m[keyframe]

    def path_length_at_submap(self, submap: int) -> float:
        """Return the path length up to a submap [m]."""
        return self._path_lengths_m[self.submaps[submap].anchor]

    def path_lengths_m(self) -> Floats:
        """Return the path lengths up to every node (N,) [m]."""
        return np.array([self._path_lengths_m[k] for k in self._starts])

    def nodes_with_closure(self) -> set[int]:
        """Return the nodes that an accepted closure ties to an older one."""
        return {e.j for e in self._accepted_closures()}

    def _accepted_closures(self) -> list[Constraint]:
        """Return the closures that robust optimisation has not rejected."""
        weights = np.ones(len(self._edges)) if self._solution is None else self._solution.weights
        return [
            e
            for e, weight in zip(self._edges, weights.tolist(), strict=True)
            if e.kind is ConstraintKind.LOOP_CLOSURE and weight >= INLIER_WEIGHT
        ]

    def sigmas_between(self, i: int, j: int) -> tuple[float, float]:
        """Standard deviations of the pose of node j relative to node i [m, rad]."""
        sigma_m, sigma_rad = self.sigmas_from(j)
        return float(sigma_m[i]), float(sigma_rad[i])

    def sigmas_from(self, j: int) -> tuple[Floats, Floats]:
        """Standard deviations (N,) of the pose of node j relative to every node [m, rad]."""
        variances = np.diagonal(self._relative.covariances(self.poses(), j), axis1=1, axis2=2)
        return np.sqrt(variances[:, 0] + variances[:, 1]), np.sqrt(variances[:, 2])

    def dead_reckoning_covariances(self, i: NDArray[np.int64], j: NDArray[np.int64]) -> Floats:
        """Covariances (P, 3, 3) of nodes j (P,) relative to nodes i (P,) without any closure.

        In the body frames of j, whichever of the two is the older one [m^2, m rad, rad^2].
        """
        anchors = [self._anchor(k).local_from_robot.as_array() for k in range(len(self._nodes))]
        total = np.array(self._drift_covariances)
        covariances = total[np.maximum(i, j)] - total[np.minimum(i, j)]
        return transform_covariances(invert(anchors)[j], covariances)

    def apply_gate(self, closures: Sequence[Closure]) -> list[Closure]:
        """Reject closures beyond the chi-square gate of their own and the graph's covariance."""
        return [c if c.reason or self._in_gate(c) else replace(c, reason=GATED) for c in closures]

    def _in_gate(self, closure: Closure) -> bool:
        return squared_mahalanobis(*self.residual(closure)) <= GATE_CHI2

    def residual(self, closure: Closure) -> tuple[Floats, Floats]:
        """Residual (3,) of a closure at the graph's estimate, and its innovation covariance."""
        edge = self.edge(closure)
        error = between(between(self._nodes[edge.i], self._nodes[edge.j]), edge.i_from_j.as_array())
        covariance = self._relative.covariances(self.poses(), edge.j)[edge.i]
        return error, covariance + edge.covariance

    def map_from_local(self) -> Pose2:
        """Return the pose of the tracker's frame in the map, by the newest node."""
        if not self._nodes:
            return Pose2()
        anchor = self._anchor(len(self._nodes) - 1)
        return Pose2.from_array(self._nodes[-1]) @ anchor.local_from_robot.inverse()

    def node_of(self, keyframe: int) -> int:
        """Return the node a keyframe belongs to."""
        return bisect.bisect_right(self._starts, keyframe) - 1

    def pose_graph(self) -> PoseGraph:
        """Return the current poses and all constraints."""
        return PoseGraph(np.array(self._nodes), tuple(self._edges))

    def node_scans(self) -> NDArray[np.int64]:
        """Return the scan (N,) of every node."""
        return np.array([self.keyframes[k].scan for k in self._starts], dtype=np.int64)

    def correct_trajectory(self, local: Floats, variances: Floats) -> Floats:
        """Poses (N, 3) in the map of all scans of the tracker's frame (N, 3), by interpolation."""
        return interpolate_corrections(local, self.node_scans(), np.array(self._nodes), variances)

    def expectations(self) -> ClosureCandidates:
        """Predict the newest keyframe in the old submaps it may see, nearest first."""
        count = self._old_submaps()
        if not count:
            return ClosureCandidates.none()
        here = (self.map_from_local() @ self.keyframes[-1].local_from_robot).as_array()
        view = transform_points(here, self.keyframes[-1].view_center_m)
        nodes = np.array(self._nodes[:count])
        sigma_m, sigma_rad = (s[:count] for s in self.sigmas_from(len(self._nodes) - 1))
        centers_m = compose(nodes, self._centers[:count])[:, :2]
        bounds_m = np.minimum(GATE_SIGMAS * sigma_m, self._config.loops.window_m)
        near = covisible_submaps(centers_m, view, bounds_m)
        return ClosureCandidates(near, between(nodes[near], here), sigma_m[near], sigma_rad[near])

    def _old_submaps(self) -> int:
        """Count the submaps whose keyframes are all older than the recent ones."""
        oldest_recent = len(self.keyframes) - self._config.recent_keyframes
        while self._old < len(self.submaps) and self.submaps[self._old].last <= oldest_recent:
            self._old += 1
        fresh = [(*s.center_m, 0.0) for s in self.submaps[len(self._centers) : self._old]]
        if fresh:
            self._centers = np.concatenate([self._centers, fresh])
        return self._old

    def add_closures(self, closures: Sequence[Closure], heartbeat: Heartbeat = silent) -> None:
        """Add closures; optimise when a residual is large."""
        is_urgent = False
        for closure in closures:
            self.closures.append(closure)
            self._solution = None
            if closure.reason:
                continue
            edge = self.edge(closure)
            self._edges.append(edge)
            self._relative.add(edge)
            predicted = between(self._nodes[edge.i], self._nodes[edge.j])
            residual = between(predicted, edge.i_from_j.as_array())
            if math.hypot(residual[0], residual[1]) > _URGENT_M or abs(residual[2]) > _URGENT_RAD:
                is_urgent = True
        if is_urgent:
            self._optimize(heartbeat)

    def optimize_with(self, accepted: Sequence[Closure], heartbeat: Heartbeat = silent) -> None:
        """Move the nodes to the optimum with these closures only, with a Cauchy kernel on steps."""
        steps = [e for e in self._edges if e.kind is not ConstraintKind.LOOP_CLOSURE]
        optimized = optimizer.optimize(
            PoseGraph(np.array(self._nodes), (*steps, *map(self.edge, accepted))),
            kernel=optimizer.Kernel.HUBER,
            slip_sigmas=_SLIP_SIGMAS,
            heartbeat=heartbeat,
        )
        self._solution = None
        self._set_poses(0, optimized.poses)

    def gated(self) -> list[Closure]:
        """Return the closures that the chi-square gate rejected."""
        return [c for c in self.closures if c.reason == GATED]

    def optimize_robustly(self, heartbeat: Heartbeat = silent) -> tuple[PoseGraph, Floats]:
        """Reject outlier closures by graduated non-convexity, and optimise with the inliers.

        Returns
        -------
        graph : PoseGraph
            The optimum, with the constraints that were accepted.
        weights : (C,) float64
            Of every closure; 0 for those rejected before.
        """
        if self._solution is None:
            self._solution = optimize_robustly(self.pose_graph(), heartbeat)
            self._set_poses(0, self._solution.graph.poses)
            self._relative = RelativeCovariances((*self._steps, *self._accepted_closures()))
        is_closure = [e.kind is ConstraintKind.LOOP_CLOSURE for e in self._edges]
        weights = np.zeros(len(self.closures))
        weights[[not c.reason for c in self.closures]] = self._solution.weights[is_closure]
        return self._solution.graph, weights

    def reoptimized(self, heartbeat: Heartbeat = silent) -> tuple[PoseGraph, Floats]:
        """Return the same as `optimize_robustly`, re-optimised with estimated variances."""
        solution, weights = self.optimize_robustly(heartbeat)
        self._set_poses(0, reoptimized(solution, heartbeat).poses)
        return replace(solution, poses=self.poses()), weights

    def notices(self) -> tuple[str, ...]:
        """Report the steps on which matches and odometry contradict each other."""
        return step_notices(self._edges, self._solution.weights) if self._solution else ()

    def _begin_node(self, k: int) -> None:
        self._solution = None
        self._starts.append(k)
        self._node_m = 0.0
        if not self._nodes:
            self._nodes.append(self.keyframes[0].local_from_robot.as_array())
            self._drift_covariances.append(np.zeros((3, 3)))
            return
        node, members = len(self._nodes), self.keyframes[self._starts[-2] : k + 1]
        edge, wheels = matched_step(node, members), wheels_step(node, members)
        step = edge
        if wheels is not None:
            self._edges.append(wheels)
            step = fused_step(edge, wheels)
        self._edges.append(edge)
        self._nodes.append(compose(self._nodes[-1], step.i_from_j.as_array()))
        self._steps.append(step)
        self._relative.add(step)
        here = self.keyframes[k].local_from_robot.as_array()
        drift = transform_covariances(here, step.covariance)
        self._drift_covariances.append(self._drift_covariances[-1] + drift)

    def _anchor(self, node: int) -> Keyframe:
        return self.keyframes[self._starts[node]]

    def edge(self, closure: Closure) -> Constraint:
        """Return a closure as a constraint between two nodes."""
        node, keyframe = self.node_of(closure.keyframe), self.keyframes[closure.keyframe]
        return closure_constraint(closure, node, keyframe, self._anchor(node))

    def _optimize(self, heartbeat: Heartbeat) -> None:
        """Optimise all nodes when the graph is small or has grown by a quarter, else the newest.

        So the amortised cost per node does not grow with the length of the recording.
        """
        count = len(self._nodes)
        if count < _LOCAL_NODES or count > _FULL_GROWTH * self._last_full:
            graph, first = self.pose_graph(), 0
            self._last_full = count
        else:
            first = count - _LOCAL_NODES // 2
            graph = sliding_window(self._nodes, self._edges, first)
        optimized = optimizer.optimize(
            graph,
            kernel=optimizer.Kernel.CAUCHY,
            slip_sigmas=_SLIP_SIGMAS,
            tolerance=1e-4,
            heartbeat=heartbeat,
        )
        self._set_poses(first, optimized.poses[1:] if first else optimized.poses)

    def _set_poses(self, first: int, poses: Floats) -> None:
        """Set the poses of the nodes from `first` on, and invalidate relative covariances."""
        self._nodes[first:] = list(poses)
        self._relative.invalidate()
