# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""From tracked scans to a pose graph with loop closures: shared by the backends that need one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slarm_graph.backend import Heartbeat, Table, silent
from slarm_graph.backends.ambiguous_scans import relocated_scans, relocation_notice
from slarm_graph.backends.closure_verification import CONTRADICTED
from slarm_graph.backends.final_closures import close_loops_offline
from slarm_graph.backends.path_interpolation import (
    bridged_by_odometry,
    odometry_variance,
    step_variance,
)
from slarm_graph.backends.robust_optimization import INLIER_WEIGHT
from slarm_graph.backends.submap_graph import SubmapGraph
from slarm_graph.config import FrontendConfig, PoseGraphConfig
from slarm_graph.constraint import PoseGraph
from slarm_graph.counts import count_of
from slarm_graph.errors import RunFailed
from slarm_graph.frontends.scans.closures import Closure
from slarm_graph.frontends.scans.loop_closure import LoopCloser
from slarm_graph.frontends.scans.submap_matching import SubmapMatcher
from slarm_graph.frontends.scans.submaps import Keyframe, view_center
from slarm_graph.frontends.scans.tracker import TrackedScan
from slarm_graph.frontends.scans.wheel_motion import NO_MOTION, WheelMotion, chained
from slarm_graph.geometry import Floats, Pose2, between, compose
from slarm_graph.trajectory import Trajectory

_COLUMNS = (
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


@dataclass(frozen=True, slots=True)
class ClosedGraph:
    """The optimised graph of a recording, and the trajectory interpolated from it.

    Parameters
    ----------
    graph : PoseGraph
        Nodes, with the constraints that were accepted.
    scans : (N,) int64
        Scan of every node.
    poses : (S, 3) float64
        `map_from_robot` at every scan.
    variances : (S,) float64
        Position variance of the step to every scan [m^2].
    closures : Table
        Every closure candidate, accepted or not, with its final weight.
    lag_covariances : (S, 3, 3) float64
        Of every scan's pose at its stamp, relative to the graph's estimate.
    relocations : (S, 3) float64
        Pose of every scan relative to the tracker's estimate; see `ambiguous_scans`.
    notices : tuple of str
        Contradictions that are left.
    """

    graph: PoseGraph
    scans: NDArray[np.int64]
    poses: Floats
    variances: Floats
    closures: Table
    lag_covariances: Floats
    relocations: Floats
    notices: tuple[str, ...] = ()


class GraphBuilder:
    """Incremental frontend of the graph: keyframes, constraints and loop closures of tracked scans.

    Parameters
    ----------
    settings : PoseGraphConfig
    frontend : FrontendConfig
    heartbeat : Heartbeat
        Called with what long steps are doing.
    """

    def __init__(
        self, settings: PoseGraphConfig, frontend: FrontendConfig, heartbeat: Heartbeat = silent
    ) -> None:
        self._settings, self._frontend, self._heartbeat = settings, frontend, heartbeat
        self._closer = LoopCloser(settings.loops, frontend.matching)
        self._graph = SubmapGraph(settings)
        self._stamps_ns: list[int] = []
        self._local: list[Pose2] = []
        self._lags: list[Floats] = []
        self._variances: list[float] = []
        self._has_odometry = False
        self._wheels: WheelMotion | None = None
        self._unmatched: list[WheelMotion] = []
        self._ambiguous: dict[int, Floats] = {}
        self._matcher: SubmapMatcher | None = None

    def kept_state(self) -> dict[str, object]:
        """Leave out what can be built again."""
        return {**vars(self), "_matcher": None}

    def add_scan(self, tracked: TrackedScan) -> None:
        """Add a scan; when it is a keyframe, extend the graph and search for loop closures."""
        self._stamps_ns.append(tracked.stamp_ns)
        if tracked.revised:
            self._local[-len(tracked.revised) :] = map(Pose2.from_array, tracked.revised)
        self._local.append(tracked.local_from_robot)
        self._lags.append(tracked.lag_covariance)
        self._variances.append(step_variance(tracked))
        if tracked.match or tracked.is_keyframe or tracked.wheels is None:
            if tracked.match and self._unmatched and tracked.wheels is not None:
                self._bridge(tracked.wheels)
            self._unmatched = []
        else:
            self._unmatched.append(tracked.wheels)
        self._has_odometry |= tracked.odom_from_robot is not None
        self._wheels = chained(self._wheels, tracked.wheels)
        if tracked.is_keyframe:
            self._add_keyframe(tracked)
        elif tracked.is_ambiguous and tracked.match:
            self._ambiguous[len(self._local) - 1] = tracked.points_m

    @property
    def is_empty(self) -> bool:
        """Whether no scan could become a keyframe."""
        return not self._graph.keyframes

    def stamps_ns(self) -> NDArray[np.int64]:
        """Return the stamps (S,) of all scans."""
        return np.array(self._stamps_ns, dtype=np.int64)

    def map_from_robot(self) -> Pose2:
        """Return the present pose by the graph as last optimised."""
        return self._graph.map_from_local() @ self._local[-1] if self._local else Pose2()

    def odometry_trajectory(self) -> Trajectory:
        """Return the odometry as the trajectory of a recording of which no scan could be matched.

        Raises
        ------
        RunFailed
            When there is no odometry, either.
        """
        if not self._has_odometry:
            raise RunFailed(
                "no scan had enough returns to be matched, and there is no odometry; see scans.csv"
            )
        local = self._local_poses()
        return Trajectory(self.stamps_ns(), between(local[0], local))

    def close_loops(self) -> ClosedGraph:
        """Search for loop closures over the whole recording, and optimise with all of them."""
        self._closer.forget_prepared()
        graph, frontend = self._graph, self._frontend
        settings = (self._settings.loops, frontend.matching)
        matcher = SubmapMatcher(*settings, graph.keyframes, graph.submaps, self._matcher)
        self._matcher = matcher
        self._graph, gated = close_loops_offline(graph, matcher, self._heartbeat)
        graph = self._graph
        solution, weights = graph.reoptimized(self._heartbeat)
        local, variances = self._local_poses(), np.array(self._variances)
        relocations, relocation_covariances = relocated_scans(
            self._ambiguous, graph, matcher, local
        )
        poses = graph.correct_trajectory(compose(local, relocations), variances)
        table = self._table(weights)
        notices = (
            *graph.notices(),
            *_gated_notice(gated),
            *_contradicted_notice(graph.closures),
        )
        notices += relocation_notice(relocations)
        lags = np.array(self._lags) + relocation_covariances
        scans = graph.node_scans()
        return ClosedGraph(solution, scans, poses, variances, table, lags, relocations, notices)

    def _local_poses(self) -> Floats:
        """Return `local_from_robot` (S, 3) of all scans."""
        return np.array([pose.as_array() for pose in self._local])

    def _bridge(self, wheels: WheelMotion) -> None:
        """Distribute the residual of a match over the unmatched scans before it."""
        steps = [*self._unmatched, wheels]
        first = len(self._local) - len(steps) - 1
        if first >= 0:
            start, end = (self._local[k].as_array() for k in (first, -1))
            motions = np.array([step.motion for step in steps])
            variances = [odometry_variance(step) for step in steps]
            path = bridged_by_odometry(start, end, motions, np.array(variances))
            self._local[first + 1 : -1] = map(Pose2.from_array, path)

    def _add_keyframe(self, tracked: TrackedScan) -> None:
        keyframe = Keyframe(
            len(self._stamps_ns) - 1,
            tracked.points_m,
            tracked.local_from_robot,
            tracked.local_covariance,
            view_center(tracked.points_m),
            self._wheels,
            tracked.lag_covariance,
            bool(tracked.match),
            tracked.clear_ends_m,
        )
        self._wheels = NO_MOTION
        self._graph.add(keyframe)
        keyframes, submaps = self._graph.keyframes, self._graph.submaps
        closures = self._closer.confirm(keyframes, submaps)
        if self._closer.is_due(len(keyframes) - 1):
            closures += self._closer.examine(keyframes, submaps, self._graph.expectations())
        self._graph.add_closures(self._graph.apply_gate(closures), self._heartbeat)

    def _table(self, weights: Floats) -> Table:
        rows = [
            self._row(closure, float(weight))
            for closure, weight in zip(self._graph.closures, weights, strict=True)
        ]
        return Table("loop_closures", _COLUMNS, tuple(rows))

    def _row(self, closure: Closure, weight: float) -> tuple[float | int | str, ...]:
        stamp_s = self._stamps_ns[self._graph.keyframes[closure.keyframe].scan] * 1e-9
        x, y, theta = (float(v) for v in closure.submap_from_keyframe)
        verdict = closure.reason or (
            "accepted" if weight >= INLIER_WEIGHT else "outlier of the optimised graph"
        )
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


def _gated_notice(gated: int) -> tuple[str, ...]:
    """Report pairwise-consistent closures that the chi-square gate rejected."""
    if not gated:
        return ()
    return (
        f"{count_of(gated, 'loop closure')} that agree with each other were rejected, being"
        " farther from the graph than their covariances allow: either different places look alike,"
        " or part of the path is wrong; see loop_closures.csv",
    )


def _contradicted_notice(closures: Sequence[Closure]) -> tuple[str, ...]:
    """Report closures rejected because the submaps that they overlay contradict each other."""
    count = sum(c.reason == CONTRADICTED for c in closures)
    if not count:
        return ()
    return (
        f"{count_of(count, 'loop closure')} that agree with each other were rejected: with them"
        " walls would stand in the free space of neighbouring places; see loop_closures.csv",
    )
