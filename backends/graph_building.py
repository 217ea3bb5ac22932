# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""From tracked scans to a graph that closes loops: what every backend that needs one shares."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slarm_graph.backend import Heartbeat, Table, silent
from slarm_graph.backends.final_closures import close_finally
from slarm_graph.backends.misfits import MISFITS
from slarm_graph.backends.open_scans import moved_by_all, moved_notice
from slarm_graph.backends.path_filling import bridged, odometry_variance, step_variance
from slarm_graph.backends.submap_graph import OUTVOTED, SubmapGraph
from slarm_graph.config import FrontendConfig, PoseGraphConfig
from slarm_graph.constraint import PoseGraph
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
    """A graph whose loops are closed, and the path that follows from it.

    Parameters
    ----------
    graph : PoseGraph
        Nodes, with the constraints that were believed.
    scans : (N,) int64
        The scan that every node stands at.
    poses : (S, 3) float64
        `map_from_robot` at every scan.
    variances : (S,) float64
        Of the step to every scan [m^2].
    closures : Table
        Every closure met, accepted or not, with the weight it ended with.
    lag_covariances : (S, 3, 3) float64
        Of every scan's pose at its stamp, seen from where the graph has it.
    moved : (S, 3) float64
        Where every scan belongs, seen from where the tracker had it; see `open_scans`.
    notices : tuple of str
        What could not be brought together.
    """

    graph: PoseGraph
    scans: NDArray[np.int64]
    poses: Floats
    variances: Floats
    closures: Table
    lag_covariances: Floats
    moved: Floats
    notices: tuple[str, ...] = ()


class GraphBuilder:
    """Makes keyframes of tracked scans, ties them into a graph and looks for old places.

    Parameters
    ----------
    settings : PoseGraphConfig
    frontend : FrontendConfig
    heartbeat : Heartbeat
        Told what long steps are doing.
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
        self._open: dict[int, Floats] = {}

    def take(self, tracked: TrackedScan) -> None:
        """Take a scan in; when it is a keyframe, extend the graph and look for old places."""
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
        elif tracked.is_open and tracked.match:
            self._open[len(self._local) - 1] = tracked.points_m

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

    def unmatched(self) -> Trajectory:
        """Return the path of a recording of which no scan could be matched: the odometry's.

        Raises
        ------
        RunFailed
            Without odometry there is nothing to go by.
        """
        if not self._has_odometry:
            raise RunFailed(
                "no scan had enough returns to be matched, and there is no odometry; see scans.csv"
            )
        local = self._local_poses()
        return Trajectory(self.stamps_ns(), between(local[0], local))

    def closed(self) -> ClosedGraph:
        """Look for old places over the whole recording, and weigh all closures together."""
        self._closer.forget_prepared()
        graph, frontend = self._graph, self._frontend
        matcher = SubmapMatcher(
            self._settings.loops, frontend.matching, graph.keyframes, graph.submaps
        )
        self._graph, rivals = close_finally(graph, matcher, self._heartbeat)
        graph = self._graph
        settled, weights = graph.adjusted(self._heartbeat)
        local, variances = self._local_poses(), np.array(self._variances)
        moved, unsure = moved_by_all(self._open, graph, matcher, local)
        poses = graph.corrected(compose(local, moved), variances)
        table = self._table(weights)
        told = (*graph.notices(), *_rival_notice(rivals), *_misfit_notice(graph.closures))
        told += moved_notice(moved)
        lags = np.array(self._lags) + unsure
        scans = graph.node_scans()
        return ClosedGraph(settled, scans, poses, variances, table, lags, moved, told)

    def _local_poses(self) -> Floats:
        """Return `local_from_robot` (S, 3) of all scans."""
        return np.array([pose.as_array() for pose in self._local])

    def _bridge(self, wheels: WheelMotion) -> None:
        """Have the scans that odometry placed end where this one was matched."""
        steps = [*self._unmatched, wheels]
        first = len(self._local) - len(steps) - 1
        if first >= 0:
            start, end = (self._local[k].as_array() for k in (first, -1))
            motions = np.array([step.motion for step in steps])
            unsure = [odometry_variance(step) for step in steps]
            path = bridged(start, end, motions, np.array(unsure))
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
        )
        self._wheels = NO_MOTION
        self._graph.add(keyframe)
        keyframes, submaps = self._graph.keyframes, self._graph.submaps
        closures = self._closer.confirm(keyframes, submaps)
        if self._closer.is_due(len(keyframes) - 1):
            closures += self._closer.examine(keyframes, submaps, self._graph.expectations())
        self._graph.close(self._graph.judged(closures), self._heartbeat)

    def _table(self, weights: Floats) -> Table:
        rows = [
            self._row(closure, float(weight))
            for closure, weight in zip(self._graph.closures, weights, strict=True)
        ]
        return Table("loop_closures", _COLUMNS, tuple(rows))

    def _row(self, closure: Closure, weight: float) -> tuple[float | int | str, ...]:
        stamp_s = self._stamps_ns[self._graph.keyframes[closure.keyframe].scan] * 1e-9
        x, y, theta = (float(v) for v in closure.submap_from_keyframe)
        verdict = closure.reason or ("accepted" if weight >= OUTVOTED else "outvoted by the graph")
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


def _rival_notice(rivals: int) -> tuple[str, ...]:
    """Say that finds were turned down which agree with each other."""
    if not rivals:
        return ()
    return (
        f"{rivals} finds of old places agree with each other, but lie farther from where the graph"
        " has them than both may err by, and were turned down: places look alike, or a stretch of"
        " the path is wrong; see loop_closures.csv",
    )


def _misfit_notice(closures: Sequence[Closure]) -> tuple[str, ...]:
    """Say that closures were left out by what the places beside them saw."""
    count = sum(c.reason == MISFITS for c in closures)
    if not count:
        return ()
    return (
        f"{count} loop closures that agree with each other were left out: with them walls stand in"
        " what was looked through from places beside; see loop_closures.csv",
    )
