# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The graph kept up while driving: one node per few keyframes, few enough to optimise often."""

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
from slarm_graph.backends.graph_reach import GraphReach
from slarm_graph.backends.graph_settling import Settled, left_open, settle, step_notices
from slarm_graph.backends.graph_window import newest
from slarm_graph.backends.path_filling import spread
from slarm_graph.backends.variance_components import adjusted
from slarm_graph.config import PoseGraphConfig
from slarm_graph.constraint import Constraint, ConstraintKind, PoseGraph
from slarm_graph.frontends.scans.closures import GATE_CHI2, GATE_SIGMAS, Closure, ClosureCandidates
from slarm_graph.frontends.scans.small_pose import squared_mahalanobis
from slarm_graph.frontends.scans.submaps import Keyframe, Submap, make_submap
from slarm_graph.geometry import (
    Floats,
    Pose2,
    adjoints,
    between,
    compose,
    invert,
    transform_points,
)

_SLIP_SIGMAS = 3.0
"""Wider than for the finished graph: on the way few closures speak against odometry."""
_LOCAL_NODES, _FULL_GROWTH = 200, 1.25
"""Up to so many nodes, and whenever they have grown so much, everything is optimised, else their
end: half and double change nothing (edmonton, mit-csail plain and with hard_1_of_2; so below)."""
OUTVOTED = 0.5
"""Weight below which graduated non-convexity has turned a closure down: it ends at 0 or 1."""
FAR_OFF = "farther from where the graph has it than both may err by"
_VIEW_REACH_M, _AS_NEAR_M = 3.0, 1.0
"""How far from an old submap's middle a keyframe's may be to share a view, and what counts as
equally near. Half and double move edmonton by 3 % at most; with either, mit-csail hard_1_of_2 falls
from one outcome (0.041 m) to another (0.033), plain it stays."""
_SURPRISE_M, _SURPRISE_RAD = 0.1, 0.02
"""What a closure must move its node by to have the graph optimised at once, else some are waited
for: half and double move nothing by more than 0.1 %."""


class SubmapGraph:
    """Keyframes, submaps and their graph.

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
        self._pending = 0
        self._surprising = False
        self._steps: list[Constraint] = []
        self._reach = GraphReach()
        self._drift: list[Floats] = []
        self._last_full = 0
        self._old = 0
        self._centers: Floats = np.zeros((0, 3))
        self._firsts: list[int] = []
        self._way_m = 0.0
        self._ways_m: list[float] = []
        self._settled: Settled | None = None

    def with_closures(self, closures: Sequence[Closure]) -> SubmapGraph:
        """Return a graph of the same keyframes with other closures, or others of them believed."""
        other = copy.copy(self)
        other.closures, other._nodes, other._settled = list(closures), list(self._nodes), None
        other._edges = [e for e in self._edges if e.kind is not ConstraintKind.LOOP_CLOSURE]
        other._edges += [self.edge(c) for c in closures if not c.reason]
        other._reach = GraphReach((*self._steps, *other._believed()))
        return other

    def add(self, keyframe: Keyframe) -> None:
        """Append a keyframe; begin a node and finish a submap when they are due."""
        if self.keyframes:
            step = self.keyframes[-1].local_from_robot.between(keyframe.local_from_robot)
            self._way_m += math.hypot(step.x, step.y)
            self._ways_m.append(self._ways_m[-1] + math.hypot(step.x, step.y))
        else:
            self._ways_m.append(0.0)
        self.keyframes.append(keyframe)
        k, size = len(self.keyframes) - 1, self._config.node_keyframes
        if not self._firsts or k - self._firsts[-1] >= size or self._way_m >= self._config.node_m:
            self._begin_node(k)
        self._finish_submap()

    def _finish_submap(self) -> None:
        """A submap reaches half a node's keyframes beyond its node to either side."""
        node = len(self.submaps)
        if node + 1 >= len(self._firsts):
            return
        first, last = self._firsts[node], self._firsts[node + 1]
        margin = max(1, (last - first) // 2)
        if len(self.keyframes) >= last + margin:
            begin = max(0, first - margin)
            self.submaps.append(make_submap(self.keyframes, begin, last + margin, first))

    def poses(self) -> Floats:
        """Return `map_from_node` (N, 3) as they stand."""
        return np.array(self._nodes)

    def way_of(self, keyframe: int) -> float:
        """Return the way driven up to a keyframe [m]."""
        return self._ways_m[keyframe]

    def way_of_submap(self, submap: int) -> float:
        """Return the way driven up to a submap [m]."""
        return self._ways_m[self.submaps[submap].anchor]

    def ways_m(self) -> Floats:
        """Return the way driven up to every node (N,) [m]."""
        return np.array([self._ways_m[k] for k in self._firsts])

    def linked(self) -> set[int]:
        """Return the nodes that a believed closure ties to an older one."""
        return {e.j for e in self._believed()}

    def _believed(self) -> list[Constraint]:
        """Return the closures that count: what the settled graph has outvoted says nothing."""
        weights = np.ones(len(self._edges)) if self._settled is None else self._settled.weights
        return [
            e
            for e, weight in zip(self._edges, weights.tolist(), strict=True)
            if e.kind is ConstraintKind.LOOP_CLOSURE and weight >= OUTVOTED
        ]

    def sigmas_between(self, i: int, j: int) -> tuple[float, float]:
        """Standard deviations of where node j is as seen from node i [m, rad]."""
        sigma_m, sigma_rad = self.sigmas_from(j)
        return float(sigma_m[i]), float(sigma_rad[i])

    def sigmas_from(self, j: int) -> tuple[Floats, Floats]:
        """Standard deviations (N,) of where node j is as seen from all nodes [m, rad]."""
        variances = np.diagonal(self._reach.covariances(self.poses(), j), axis1=1, axis2=2)
        return np.sqrt(variances[:, 0] + variances[:, 1]), np.sqrt(variances[:, 2])

    def drifts(self, i: NDArray[np.int64], j: NDArray[np.int64]) -> Floats:
        """Covariances (P, 3, 3) of where nodes j are as seen from nodes i by the way driven alone.

        In the body frames of j (P,), whichever of the two is the older one [m^2, m rad, rad^2].
        """
        anchors = [self._anchor(k).local_from_robot for k in range(len(self._nodes))]
        carry = adjoints(invert([pose.as_array() for pose in anchors]))[j]
        drift = np.array(self._drift)
        between_them = drift[np.maximum(i, j)] - drift[np.minimum(i, j)]
        return np.asarray(carry @ between_them @ carry.transpose(0, 2, 1))

    def judged(self, closures: Sequence[Closure]) -> list[Closure]:
        """Turn those down that are farther from what the graph has than both may err."""
        return [c if c.reason or self._is_near(c) else replace(c, reason=FAR_OFF) for c in closures]

    def _is_near(self, closure: Closure) -> bool:
        return squared_mahalanobis(*self.miss(closure)) <= GATE_CHI2

    def miss(self, closure: Closure) -> tuple[Floats, Floats]:
        """How far (3,) a closure is from what the graph has, and the covariance (3, 3) of that."""
        edge = self.edge(closure)
        miss = between(between(self._nodes[edge.i], self._nodes[edge.j]), edge.i_from_j.as_array())
        reach = self._reach.covariances(self.poses(), edge.j)[edge.i]
        return miss, reach + edge.covariance

    def map_from_local(self) -> Pose2:
        """Return where the newest node puts the tracker's frame."""
        if not self._nodes:
            return Pose2()
        anchor = self._anchor(len(self._nodes) - 1)
        return Pose2.from_array(self._nodes[-1]) @ anchor.local_from_robot.inverse()

    def node_of(self, keyframe: int) -> int:
        """Return the node a keyframe belongs to."""
        return bisect.bisect_right(self._firsts, keyframe) - 1

    def pose_graph(self) -> PoseGraph:
        """Return nodes and constraints as they stand."""
        return PoseGraph(np.array(self._nodes), tuple(self._edges))

    def node_scans(self) -> NDArray[np.int64]:
        """Return the scan (N,) that every node stands at."""
        return np.array([self.keyframes[k].scan for k in self._firsts], dtype=np.int64)

    def corrected(self, local: Floats, variances: Floats) -> Floats:
        """Move all scans from the tracker's frame (N, 3) into the map (N, 3); see `spread`."""
        return spread(local, self.node_scans(), np.array(self._nodes), variances)

    def expectations(self) -> ClosureCandidates:
        """Where the newest keyframe should be in old submaps within reach, nearest first."""
        count = self._old_submaps()
        if not count:
            return ClosureCandidates.none()
        here = (self.map_from_local() @ self.keyframes[-1].local_from_robot).as_array()
        view = transform_points(here, self.keyframes[-1].view_center_m)
        nodes = np.array(self._nodes[:count])
        sigma_m, sigma_rad = (s[:count] for s in self.sigmas_from(len(self._nodes) - 1))
        centers = compose(nodes, self._centers[:count])
        distance = np.hypot(centers[:, 0] - view[0], centers[:, 1] - view[1])
        reach = np.minimum(GATE_SIGMAS * sigma_m, self._config.loops.window_m)
        near = np.flatnonzero(distance < _VIEW_REACH_M + reach)
        # Among submaps about as near, the oldest: later visits then all hang on the first.
        near = near[np.lexsort((near, np.floor(distance[near] / _AS_NEAR_M)))]
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

    def close(self, closures: Sequence[Closure], heartbeat: Heartbeat = silent) -> None:
        """Take closures in; optimise when they surprise, or when enough have come together."""
        for closure in closures:
            self.closures.append(closure)
            self._settled = None
            if closure.reason:
                continue
            edge = self.edge(closure)
            self._edges.append(edge)
            self._reach.add(edge)
            self._pending += 1
            believed = between(self._nodes[edge.i], self._nodes[edge.j])
            away = between(believed, edge.i_from_j.as_array())
            if math.hypot(away[0], away[1]) > _SURPRISE_M or abs(away[2]) > _SURPRISE_RAD:
                self._surprising = True
        if self._surprising or self._pending > 10 + len(self._nodes) // 4:
            self._optimize(heartbeat)

    def leaning_on(self, believed: Sequence[Closure], heartbeat: Heartbeat = silent) -> None:
        """Move the nodes to where these closures have them, whichever steps give way to that."""
        steps = [e for e in self._edges if e.kind is not ConstraintKind.LOOP_CLOSURE]
        found = optimizer.optimize(
            PoseGraph(np.array(self._nodes), (*steps, *map(self.edge, believed))),
            kernel=optimizer.Kernel.HUBER,
            slip_sigmas=_SLIP_SIGMAS,
            heartbeat=heartbeat,
        )
        self._settled = None
        self._moved_to(0, found.poses)

    def far_off(self) -> list[Closure]:
        """Return the finds that were turned down as farther off than both may err by."""
        return [c for c in self.closures if c.reason == FAR_OFF]

    def settle(self, heartbeat: Heartbeat = silent) -> tuple[PoseGraph, Floats]:
        """Decide which closures to believe, and optimise with those.

        Returns
        -------
        graph : PoseGraph
            What the result rests on.
        weights : (C,) float64
            Of every closure met; 0 for those turned down before.
        """
        if self._settled is None:
            self._settled = settle(self.pose_graph(), heartbeat)
            self._moved_to(0, self._settled.graph.poses)
            self._reach = GraphReach((*self._steps, *self._believed()))
        is_closure = [e.kind is ConstraintKind.LOOP_CLOSURE for e in self._edges]
        weights = np.zeros(len(self.closures))
        weights[[not c.reason for c in self.closures]] = self._settled.weights[is_closure]
        return self._settled.graph, weights

    def adjusted(self, heartbeat: Heartbeat = silent) -> tuple[PoseGraph, Floats]:
        """Return the same as `settle`, its poses by what the constraints turned out to be worth."""
        settled, weights = self.settle(heartbeat)
        self._moved_to(0, adjusted(settled, heartbeat).poses)
        return replace(settled, poses=self.poses()), weights

    def notices(self) -> tuple[str, ...]:
        """Say what the settled graph could not bring together."""
        return step_notices(self._edges, self._settled.weights) if self._settled else ()

    def _begin_node(self, k: int) -> None:
        self._settled = None
        self._firsts.append(k)
        self._way_m = 0.0
        if not self._nodes:
            self._nodes.append(self.keyframes[0].local_from_robot.as_array())
            self._drift.append(np.zeros((3, 3)))
            return
        node, way = len(self._nodes), self.keyframes[self._firsts[-2] : k + 1]
        edge, wheels = matched_step(node, way), wheels_step(node, way)
        known = edge
        if wheels is not None:
            self._edges.append(wheels)
            known = left_open(edge, wheels)
        self._edges.append(edge)
        self._nodes.append(compose(self._nodes[-1], known.i_from_j.as_array()))
        self._steps.append(known)
        self._reach.add(known)
        carry = self.keyframes[k].local_from_robot.adjoint()
        self._drift.append(self._drift[-1] + carry @ known.covariance @ carry.T)

    def _anchor(self, node: int) -> Keyframe:
        return self.keyframes[self._firsts[node]]

    def edge(self, closure: Closure) -> Constraint:
        """Return a closure as a constraint between two nodes."""
        node, keyframe = self.node_of(closure.keyframe), self.keyframes[closure.keyframe]
        return closure_constraint(closure, node, keyframe, self._anchor(node))

    def _optimize(self, heartbeat: Heartbeat) -> None:
        """Optimise everything when the graph is small or has grown by a tenth, else its end.

        So the effort per node stays the same however long the log is.
        """
        count = len(self._nodes)
        if count < _LOCAL_NODES or count > _FULL_GROWTH * self._last_full:
            graph, first = self.pose_graph(), 0
            self._last_full = count
        else:
            first = count - _LOCAL_NODES // 2
            graph = newest(self._nodes, self._edges, first)
        found = optimizer.optimize(
            graph,
            kernel=optimizer.Kernel.CAUCHY,
            slip_sigmas=_SLIP_SIGMAS,
            tolerance=1e-4,
            heartbeat=heartbeat,
        )
        self._moved_to(first, found.poses[1:] if first else found.poses)
        self._pending = 0
        self._surprising = False

    def _moved_to(self, first: int, poses: Floats) -> None:
        """Put the nodes from one on where an optimiser has them."""
        self._nodes[first:] = list(poses)
        self._reach.outdate()
