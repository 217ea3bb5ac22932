# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The graph kept up while driving: one node per few keyframes, few enough to optimise often."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import dijkstra

from slarm_graph.backend import Heartbeat, silent
from slarm_graph.backends import pose_graph_optimizer as optimizer
from slarm_graph.config import PoseGraphConfig
from slarm_graph.constraint import Constraint, ConstraintKind, PoseGraph
from slarm_graph.frontends.loop_closure import Closure, Expectation
from slarm_graph.frontends.submaps import Keyframe, Submap, make_submap
from slarm_graph.geometry import Floats, Pose2, between, compose, transform_points, wrap_angles

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
        self.closures: list[Closure] = []
        self._pending = 0
        self._surprising = False
        self._links: dict[tuple[int, int], tuple[float, float, float]] = {}
        self._reach: tuple[Floats, Floats, Floats] | None = None
        self._settled: Floats | None = None

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

    def node_of(self, keyframe: int) -> int:
        """Return the node a keyframe belongs to."""
        return keyframe // self._config.node_keyframes

    def pose_graph(self) -> PoseGraph:
        """Return nodes and constraints as they stand."""
        return PoseGraph(np.array(self._nodes), tuple(self._edges))

    def corrected(self, local: Floats) -> Floats:
        """Move all scans from the tracker's frame (N, 3) into the map (N, 3).

        Between two nodes, what each of them says is blended linearly over the scans.
        """
        anchors = self.keyframes[:: self._config.node_keyframes]
        return spread(local, np.array([a.scan for a in anchors]), np.array(self._nodes))

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
            self.closures.append(closure)
            self._settled = None
            if closure.reason:
                continue
            edge = self._edge(closure)
            self._edges.append(edge)
            self._link(edge)
            if closure.searched:
                self._reach = None
            self._pending += 1
            believed = between(self._nodes[edge.i], self._nodes[edge.j])
            away = between(believed, edge.i_from_j.as_array())
            if math.hypot(away[0], away[1]) > 0.1 or abs(away[2]) > 0.02:
                self._surprising = True
        if self._surprising or self._pending > 10 + len(self._nodes) // 4:
            self._optimize(heartbeat)

    def settle(self, heartbeat: Heartbeat = silent) -> Floats:
        """Optimise with graduated non-convexity; return the weight (C,) of every closure met.

        Odometry is trusted; closures turned down earlier weigh 0.
        """
        if self._settled is None:
            found = optimizer.optimize_gnc(self.pose_graph(), heartbeat=heartbeat)
            self._nodes = list(found.poses)
            is_closure = [e.kind is ConstraintKind.LOOP_CLOSURE for e in self._edges]
            weights = np.zeros(len(self.closures))
            weights[[not c.reason for c in self.closures]] = found.weights[is_closure]
            self._settled = weights
        return self._settled

    def _begin_node(self, k: int) -> None:
        if not self._nodes:
            self._nodes.append(self.keyframes[0].local_from_robot.as_array())
            return
        before = self._anchor(len(self._nodes) - 1)
        step = before.local_from_robot.between(self.keyframes[k].local_from_robot)
        self._nodes.append(compose(self._nodes[-1], step.as_array()))
        covariance = self._accumulated(k)
        node = len(self._nodes) - 1
        edge = Constraint(node - 1, node, step, covariance, ConstraintKind.ODOMETRY)
        self._edges.append(edge)
        self._link(edge)
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
        """Variances of heading and position, and path lengths, from the newest node to all."""
        count, links = len(self._nodes), self._links
        pairs = np.array(list(links), dtype=np.int64).reshape(-1, 2)
        values = np.array(list(links.values())).reshape(-1, 3)
        graph = sparse.csr_matrix((values[:, 0], (pairs[:, 0], pairs[:, 1])), (count, count))
        heading, parents = dijkstra(
            graph, directed=False, indices=count - 1, return_predecessors=True
        )
        table = np.zeros((count, 2))
        for node in np.argsort(heading, kind="stable")[1:].tolist():
            parent = int(parents[node])
            link = links.get((node, parent)) or links[parent, node]
            table[node] = table[parent] + link[1:]
        return heading, table[:, 0], table[:, 1]

    def _link(self, edge: Constraint) -> None:
        """Remember the surest constraint between two nodes for `_paths`."""
        c = edge.covariance
        is_step = edge.kind is ConstraintKind.ODOMETRY
        length = math.hypot(edge.i_from_j.x, edge.i_from_j.y) if is_step else 0.0
        link = (float(c[2, 2]), float(c[0, 0] + c[1, 1]), length)
        known = self._links.get((edge.i, edge.j))
        if known is None or link < known:
            self._links[edge.i, edge.j] = link

    def _optimize(self, heartbeat: Heartbeat) -> None:
        graph = PoseGraph(np.array(self._nodes), tuple(self._edges))
        found = optimizer.optimize(graph, kernel=optimizer.Kernel.CAUCHY, heartbeat=heartbeat)
        self._nodes = list(found.poses)
        self._pending = 0
        self._surprising = False


def spread(local: Floats, at: NDArray[np.int64], anchor_poses: Floats) -> Floats:
    """Give every scan a pose in the map, given the poses of some.

    Parameters
    ----------
    local : (N, 3) float64
        `local_from_robot` of all scans.
    at : (A,) int64
        Scans whose pose is known, ascending.
    anchor_poses : (A, 3) float64
        `map_from_robot` of those.

    Returns
    -------
    (N, 3) float64
        `map_from_robot` of all scans.
    """
    scans = np.arange(len(local))
    before = np.clip(np.searchsorted(at, scans, side="right") - 1, 0, len(at) - 1)
    after = np.minimum(before + 1, len(at) - 1)
    from_before = compose(anchor_poses[before], between(local[at[before]], local))
    from_after = compose(anchor_poses[after], between(local[at[after]], local))
    gap = np.maximum(at[after] - at[before], 1)
    share = np.clip((scans - at[before]) / gap, 0.0, 1.0)[:, None]
    away = from_after - from_before
    away[:, 2] = wrap_angles(away[:, 2])
    poses = from_before + share * away
    poses[:, 2] = wrap_angles(poses[:, 2])
    return np.asarray(poses, dtype=np.float64)
