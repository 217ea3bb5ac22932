# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Graph SLAM: lidar odometry, submaps, loop closures, and a graph that ties them together."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.random import Generator

from slarm_graph.backend import Heartbeat, SlamResult, Table, silent
from slarm_graph.backends.final_closures import close_finally
from slarm_graph.backends.submap_graph import SubmapGraph
from slarm_graph.config import FrontendConfig, PoseGraphConfig, Stage
from slarm_graph.errors import RunFailed
from slarm_graph.frontends.scans.closures import Closure
from slarm_graph.frontends.scans.loop_closure import LoopCloser
from slarm_graph.frontends.scans.submap_matching import SubmapMatcher
from slarm_graph.frontends.scans.submaps import Keyframe, view_center
from slarm_graph.frontends.scans.tracker import ScanTracker, TrackedScan
from slarm_graph.geometry import Floats, Pose2
from slarm_graph.readings import Reading
from slarm_graph.snapshots import State, restore_state, state_of
from slarm_graph.trajectory import Trajectory

_CLOSURE_COLUMNS = (
    "stamp_s",
    "submap",
    "node",
    "x_m",
    "y_m",
    "theta_rad",
    "score",
    "gnc_weight",
    "searched",
    "verdict",
)


class PoseGraphBackend:
    """Graph SLAM on GTSAM: every scan matched, loops closed.

    Parameters
    ----------
    settings : PoseGraphConfig
    frontend : FrontendConfig
    rng : numpy.random.Generator
        Not used: nothing here is drawn.
    heartbeat : Heartbeat
        Told what long steps are doing.
    """

    settings: ClassVar[type[Stage]] = PoseGraphConfig

    def __init__(
        self,
        settings: PoseGraphConfig,
        frontend: FrontendConfig,
        rng: Generator,
        heartbeat: Heartbeat = silent,
    ) -> None:
        del rng
        self._heartbeat = heartbeat
        self._tracker = ScanTracker(frontend)
        self._settings, self._frontend = settings, frontend
        self._closer = LoopCloser(settings.loops, frontend.matching)
        self._graph = SubmapGraph(settings)
        self._stamps_ns: list[int] = []
        self._local: list[Pose2] = []
        self._unmatched = np.zeros((3, 3))

    def update(self, reading: Reading) -> None:
        """Track the scan; when it is a keyframe, extend the graph and look for old places."""
        tracked = self._tracker.track(reading)
        self._stamps_ns.append(tracked.stamp_ns)
        self._local.append(tracked.local_from_robot)
        if not tracked.match:
            self._unmatched = self._unmatched + tracked.motion_covariance
        if tracked.is_keyframe:
            self._add_keyframe(tracked)

    def map_from_robot(self) -> Pose2:
        """Return the present pose by the graph as last optimised."""
        if not self._local:
            return Pose2()
        return self._graph.map_from_local() @ self._local[-1]

    def result(self) -> SlamResult:
        """Weigh all closures together and correct every scan's pose.

        Raises
        ------
        RunFailed
            When no scan could become a keyframe.
        """
        if not self._graph.keyframes:
            raise RunFailed("no scan had enough returns to be matched; see scans.csv")
        graph, frontend = self._graph, self._frontend
        matcher = SubmapMatcher(
            self._settings.loops, frontend.matching, graph.keyframes, graph.submaps
        )
        close_finally(graph, matcher, self._heartbeat)
        settled, weights = graph.settle(self._heartbeat)
        poses = graph.corrected(np.array([pose.as_array() for pose in self._local]))
        trajectory = Trajectory(np.array(self._stamps_ns, dtype=np.int64), poses)
        return SlamResult(trajectory, pose_graph=settled, tables=(self._closure_table(weights),))

    def snapshot(self) -> State:
        """Return the state; GTSAM objects live only within calls."""
        return state_of(self)

    def restore(self, state: State) -> None:
        """Continue from a snapshot of a backend with the same configuration."""
        restore_state(state, self)

    def _add_keyframe(self, tracked: TrackedScan) -> None:
        matched = tracked.match.covariance if tracked.match else np.zeros((3, 3))
        keyframe = Keyframe(
            len(self._stamps_ns) - 1,
            tracked.points_m,
            tracked.local_from_robot,
            self._unmatched + matched,
            view_center(tracked.points_m),
        )
        self._unmatched = np.zeros((3, 3))
        self._graph.add(keyframe)
        keyframes, submaps = self._graph.keyframes, self._graph.submaps
        closures = self._closer.confirm(keyframes, submaps)
        if self._closer.is_due(len(keyframes) - 1):
            closures += self._closer.examine(keyframes, submaps, self._graph.expectations())
        self._graph.close(closures, self._heartbeat)

    def _closure_table(self, weights: Floats) -> Table:
        """Every closure met, accepted or not, with the weight it ended with."""
        rows = [
            self._row(closure, float(weight))
            for closure, weight in zip(self._graph.closures, weights, strict=True)
        ]
        return Table("loop_closures", _CLOSURE_COLUMNS, tuple(rows))

    def _row(self, closure: Closure, weight: float) -> tuple[float | int | str, ...]:
        stamp_s = self._stamps_ns[self._graph.keyframes[closure.keyframe].scan] * 1e-9
        x, y, theta = (float(v) for v in closure.submap_from_keyframe)
        verdict = closure.reason or ("accepted" if weight >= 0.5 else "outvoted by the graph")
        return (
            stamp_s,
            closure.submap,
            self._graph.node_of(closure.keyframe),
            x,
            y,
            theta,
            closure.score,
            weight,
            int(closure.searched),
            verdict,
        )
