# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The graph kept up while driving: one node per few keyframes, few enough to optimise often."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import dijkstra

from slarm_graph.backend import Heartbeat, silent
from slarm_graph.backends import pose_graph_optimizer as optimizer
from slarm_graph.config import PoseGraphConfig
from slarm_graph.constraint import Constraint, ConstraintKind, PoseGraph
from slarm_graph.frontends.loop_closure import Closure, Expectation
from slarm_graph.frontends.submaps import Keyframe, Submap, make_submap
from slarm_graph.geometry import Floats, Pose2, between, compose, transform_points

_ODOMETRY_FLOOR = np.diag([0.003, 0.003, 0.0015]) ** 2
_CLOSURE_FLOOR = np.diag([0.02, 0.02, 0.005]) ** 2
_INFORMATION_FLOOR = np.diag([1.0, 1.0, 10.0])


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
        self._closures: list[Closure] = []
        self._pending = 0
        self._surprising = False
        self._reach: tuple[Floats, Floats, Floats] | None = None

    def add(self, keyframe: Keyframe) -> None:
        """Append a keyframe; begin a node and finish a submap when they are due."""
        self.keyframes.append(keyframe)
        k = len(self.keyframes) - 1
        size = self._config.node_keyframes
        if k % size == 0:
            self._begin_node(k)
        margin = max(self._config.submap_keyframes - size, 0) // 2
        node = len(self.submaps)
        if k + 1 == (node + 1) * size + margin:
            first = max(0, node * size - margin)
            self.submaps.append(make_submap(self.keyframes, first, k + 1, node * size))

    def map_from_local(self) -> Pose2:
        """Return where the newest node puts the tracker's frame."""
        if not self._nodes:
            return Pose2()
        anchor = self._anchor(len(self._nodes) - 1)
        return Pose2.from_array(self._nodes[-1]) @ anchor.local_from_robot.inverse()

    def keyframe_poses(self) -> Floats:
        """Poses (K, 3) of all keyframes; the correction of the nodes is spread between them."""
        local = np.array([k.local_from_robot.as_array() for k in self.keyframes])
        anchors = np.arange(len(self._nodes)) * self._config.node_keyframes
        from slarm_graph.backends.pose_graph import spread

        return spread(local, anchors, np.array(self._nodes))

    def expectations(self) -> list[Expectation]:
        """Where the newest keyframe should be in old submaps within reach, nearest first."""
        old = len(self.keyframes) - self._config.recent_keyframes
        count = sum(1 for s in self.submaps if s.last <= old) if old > 0 else 0
        if not count:
            return []
        here = (self.map_from_local() @ self.keyframes[-1].local_from_robot).as_array()
        view = transform_points(here, self.keyframes[-1].view_center_m)
        nodes = np.array(self._nodes[:count])
        centers = np.array([s.center_m for s in self.submaps[:count]])
        c, s = np.cos(nodes[:, 2]), np.sin(nodes[:, 2])
        x = nodes[:, 0] + c * centers[:, 0] - s * centers[:, 1]
        y = nodes[:, 1] + s * centers[:, 0] + c * centers[:, 1]
        sigma_m, sigma_rad = self._uncertainty(count)
        distance = np.hypot(x - view[0], y - view[1])
        reach = np.minimum(3.0 * sigma_m, self._config.loops.window_m)
        near = np.flatnonzero(distance < 3.0 + reach)
        near = near[np.argsort(distance[near], kind="stable")]
        return [
            Expectation(int(n), between(nodes[n], here), float(sigma_m[n]), float(sigma_rad[n]))
            for n in near
        ]

    def close(self, closures: Sequence[Closure], heartbeat: Heartbeat = silent) -> None:
        """Take closures in; optimise when they surprise, or when enough have come together."""
        for closure in closures:
            self._closures.append(closure)
            if closure.reason:
                continue
            edge = self._edge(closure)
            self._edges.append(edge)
            self._pending += 1
            believed = between(self._nodes[edge.i], self._nodes[edge.j])
            away = between(believed, edge.i_from_j.as_array())
            if math.hypot(away[0], away[1]) > 0.1 or abs(away[2]) > 0.02:
                self._surprising = True
            self._reach = None
        if self._surprising or self._pending > 10 + len(self._nodes) // 10:
            self._optimize(heartbeat)

    def weighed_closures(self, heartbeat: Heartbeat = silent) -> list[tuple[Closure, float]]:
        """All closures, and the weight graduated non-convexity gives each of the accepted."""
        graph = PoseGraph(np.array(self._nodes), tuple(self._edges))
        weights = iter(())
        accepted = [c for c in self._edges if c.kind is ConstraintKind.LOOP_CLOSURE]
        if accepted:
            found = optimizer.optimize_gnc(graph, heartbeat=heartbeat)
            weights = iter(
                w
                for w, c in zip(found.weights, self._edges, strict=True)
                if c.kind is ConstraintKind.LOOP_CLOSURE
            )
        return [(c, 0.0 if c.reason else float(next(weights))) for c in self._closures]

    def _begin_node(self, k: int) -> None:
        if not self._nodes:
            self._nodes.append(self.keyframes[0].local_from_robot.as_array())
            return
        before = self._anchor(len(self._nodes) - 1)
        step = before.local_from_robot.between(self.keyframes[k].local_from_robot)
        self._nodes.append(compose(self._nodes[-1], step.as_array()))
        covariance = self._accumulated(k)
        node = len(self._nodes) - 1
        self._edges.append(Constraint(node - 1, node, step, covariance, ConstraintKind.ODOMETRY))
        self._reach = None

    def _accumulated(self, k: int) -> Floats:
        """Covariance of keyframe k as seen from the anchor one node earlier, in k's body frame."""
        total = np.zeros((3, 3))
        for m in range(k - self._config.node_keyframes + 1, k + 1):
            away = self.keyframes[m].local_from_robot.between(self.keyframes[k].local_from_robot)
            adjoint = away.inverse().adjoint()
            own = self.keyframes[m].covariance + _ODOMETRY_FLOOR
            total += adjoint @ own @ adjoint.T
        return 0.5 * (total + total.T)

    def _anchor(self, node: int) -> Keyframe:
        return self.keyframes[node * self._config.node_keyframes]

    def _edge(self, closure: Closure) -> Constraint:
        """Turn a keyframe found in a submap into a constraint between two nodes."""
        node = closure.keyframe // self._config.node_keyframes
        keyframe = self.keyframes[closure.keyframe]
        from_anchor = keyframe.local_from_robot.between(self._anchor(node).local_from_robot)
        measured = Pose2.from_array(closure.submap_from_keyframe) @ from_anchor
        own = np.linalg.inv(closure.information + _INFORMATION_FLOOR) + _CLOSURE_FLOOR
        adjoint = from_anchor.inverse().adjoint()
        covariance = adjoint @ own @ adjoint.T
        covariance = 0.5 * (covariance + covariance.T)
        return Constraint(closure.submap, node, measured, covariance, ConstraintKind.LOOP_CLOSURE)

    def _uncertainty(self, count: int) -> tuple[Floats, Floats]:
        """Standard deviations of position [m] and heading [rad] of the newest node from others.

        Variances add along the surest path through the graph; heading errors turn into position
        errors with the length of that path.
        """
        if self._reach is None:
            self._reach = self._paths()
        heading, position, length = (v[:count] for v in self._reach)
        sigma_m = np.sqrt(position + heading * (0.25 * length) ** 2)
        return sigma_m, np.sqrt(heading)

    def _paths(self) -> tuple[Floats, Floats, Floats]:
        count = len(self._nodes)
        i = np.array([c.i for c in self._edges])
        j = np.array([c.j for c in self._edges])
        covariances = np.array([c.covariance for c in self._edges])
        steps = np.array([(c.i_from_j.x, c.i_from_j.y) for c in self._edges])
        odometry = np.array([c.kind is ConstraintKind.ODOMETRY for c in self._edges])
        length_each = np.where(odometry, np.hypot(steps[:, 0], steps[:, 1]), 0.0)
        heading_each = covariances[:, 2, 2]
        position_each = covariances[:, 0, 0] + covariances[:, 1, 1]
        # Parallel constraints: the surest one counts.
        order = np.lexsort((heading_each, j, i))
        key = i[order] * count + j[order]
        order = order[np.unique(key, return_index=True)[1]]
        links = sparse.csr_matrix((heading_each[order], (i[order], j[order])), (count, count))
        heading, parents = dijkstra(
            links, directed=False, indices=count - 1, return_predecessors=True
        )
        lookup = {
            (int(a), int(b)): int(e) for a, b, e in zip(i[order], j[order], order, strict=True)
        }
        position, length = np.zeros(count), np.zeros(count)
        for node in np.argsort(heading, kind="stable")[1:]:
            parent = int(parents[node])
            e = lookup.get((int(node), parent), lookup.get((parent, int(node)), -1))
            position[node] = position[parent] + position_each[e]
            length[node] = length[parent] + length_each[e]
        return heading, position, length

    def _optimize(self, heartbeat: Heartbeat) -> None:
        graph = PoseGraph(np.array(self._nodes), tuple(self._edges))
        found = optimizer.optimize(graph, kernel=optimizer.Kernel.CAUCHY, heartbeat=heartbeat)
        self._nodes = list(found.poses)
        self._pending = 0
        self._surprising = False
