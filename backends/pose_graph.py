# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Graph SLAM: lidar odometry, submaps, loop closures, and pose graph optimisation."""

from __future__ import annotations

from typing import ClassVar

from numpy.random import Generator

from slarm_graph.backend import Heartbeat, SlamResult, silent
from slarm_graph.backends.graph_building import GraphBuilder
from slarm_graph.backends.path_covariance import path_covariances
from slarm_graph.backends.variance_components import calibrated
from slarm_graph.config import FrontendConfig, PoseGraphConfig, Stage
from slarm_graph.frontends.scans.tracker import ScanTracker
from slarm_graph.geometry import Pose2
from slarm_graph.readings import Reading
from slarm_graph.snapshots import State, restore_state, state_of
from slarm_graph.trajectory import Trajectory

_ODOMETRY_ALONE = "no scan had enough returns to be matched: the trajectory is the odometry's"


class PoseGraphBackend:
    """Graph SLAM on GTSAM: every scan matched, loops closed.

    Parameters
    ----------
    settings : PoseGraphConfig
    frontend : FrontendConfig
    rng : numpy.random.Generator
        Not used: nothing here is drawn.
    heartbeat : Heartbeat
        Called with what long steps are doing.
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
        self._tracker = ScanTracker(frontend)
        self._builder = GraphBuilder(settings, frontend, heartbeat)

    def update(self, reading: Reading) -> None:
        """Track the scan, and extend the graph."""
        self._builder.add_scan(self._tracker.track(reading))

    def map_from_robot(self) -> Pose2:
        """Return the present pose by the graph as last optimised."""
        return self._builder.map_from_robot()

    def result(self) -> SlamResult:
        """Optimise robustly with all closures, and correct every scan's pose.

        Raises
        ------
        RunFailed
            When no scan could become a keyframe and there is no odometry.
        """
        if self._builder.is_empty:
            return SlamResult(self._builder.odometry_trajectory(), notices=(_ODOMETRY_ALONE,))
        closed = self._builder.close_loops()
        graph = calibrated(closed.graph)
        covariances = path_covariances(graph, closed.scans, closed.poses, closed.variances)
        if covariances is not None:
            covariances = covariances + closed.lag_covariances
        trajectory = Trajectory(self._builder.stamps_ns(), closed.poses)
        made = graph, (closed.closures,), closed.notices, self._tracker.moving_share
        return SlamResult(trajectory, covariances, *made)

    def snapshot(self) -> State:
        """Return the state; GTSAM objects live only within calls."""
        return state_of(self)

    def restore(self, state: State) -> None:
        """Continue from a snapshot of a backend with the same configuration."""
        restore_state(state, self)
