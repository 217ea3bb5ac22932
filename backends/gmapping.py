# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Rao-Blackwellised particle filter with improved proposal and selective resampling.

The paper's SLAM, eq. (4)-(11), after Grisetti, Stachniss and Burgard, "Improved Techniques for
Grid Mapping With Rao-Blackwellized Particle Filters", IEEE T-RO 23(1), 2007. The original takes
raw odometry from one update to the next and diverges where that is poor and rotations are fast.
Here the shared frontend matches every scan, and the improved proposal is really drawn from, to
prevent just that. Where every particle misses a loop that place recognition has found, the filter
processes the recording a second time (`second_pass`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cache
from typing import ClassVar

import numpy as np
from numpy.random import Generator

from slarm_graph.backend import Heartbeat, SlamResult, path_table, silent
from slarm_graph.backends.graph_building import ClosedGraph, GraphBuilder
from slarm_graph.backends.graph_constraints import clamping_factors
from slarm_graph.backends.motion_model import motion_covariance
from slarm_graph.backends.particle_filter import normalised
from slarm_graph.backends.particle_matching import point_normals
from slarm_graph.backends.particle_tables import (
    particle_notices,
    second_pass_notice,
    update_table,
)
from slarm_graph.backends.path_covariance import (
    interpolate_covariances,
    sample_covariances,
)
from slarm_graph.backends.path_interpolation import interpolate_corrections, step_variance
from slarm_graph.backends.proposal import Measurement
from slarm_graph.backends.rbpf import MappingFilter
from slarm_graph.backends.second_pass import (
    MISSED_SIGMAS,
    closure_mahalanobis,
    filter_along,
    second_moments,
)
from slarm_graph.config import FrontendConfig, GmappingConfig, Stage
from slarm_graph.errors import RunFailed
from slarm_graph.frontends.scans.tracker import ScanTracker, TrackedScan
from slarm_graph.frontends.scans.wheel_motion import NO_MOTION, WheelMotion, chained
from slarm_graph.geometry import Floats, Pose2, between, compose
from slarm_graph.readings import Reading
from slarm_graph.snapshots import State, restore_state, state_of
from slarm_graph.trajectory import Trajectory

_MAX_SIGMA_M, _MAX_SIGMA_RAD = 0.1, 0.05
"""A match with a larger standard deviation is as good as none."""


@dataclass
class _State:
    """All mutable state of the backend.

    `step_covariance` is the uncertainty of the motion since the last good match,
    `restart_covariance` that of steps to restarted local maps since the last update, and
    `previous_covariance` the first of these as of the last update.
    """

    tracker: ScanTracker
    filter: MappingFilter
    graph_builder: GraphBuilder | None
    measurements: list[Measurement] = field(default_factory=list)
    stamps_ns: list[int] = field(default_factory=list)
    local: list[Floats] = field(default_factory=list)
    lags: list[Floats] = field(default_factory=list)
    variances: list[float] = field(default_factory=list)
    updates: list[int] = field(default_factory=list)
    path_m: float = 0.0
    turned_rad: float = 0.0
    restart_covariance: Floats = field(default_factory=lambda: np.zeros((3, 3)))
    step_covariance: Floats = field(default_factory=lambda: np.zeros((3, 3)))
    previous_covariance: Floats = field(default_factory=lambda: np.zeros((3, 3)))
    unmatched: WheelMotion | None = NO_MOTION
    closed_path: Floats = field(default_factory=lambda: np.zeros((0, 3)))
    second_pass: str = ""

    def revise(self, poses: Sequence[Floats]) -> None:
        """Replace the last poses, each (3,), of those after the last filter update."""
        count = min(len(poses), len(self.local) - 1 - self.updates[-1]) if self.updates else 0
        if count > 0:
            self.local[-count:] = list(poses[-count:])

    def motion_path(self) -> Floats:
        """Poses (S, 3) whose motion the filter proposes: the closed path, then the frontend's."""
        local, closed = np.array(self.local), len(self.closed_path)
        if not closed:
            return local
        since = between(local[closed - 1], local[closed:])
        return np.concatenate([self.closed_path, compose(self.closed_path[-1], since)])

    def relocated(self, closed: ClosedGraph | None) -> Floats:
        """The same with the ambiguous scans between updates relocated (S, 3)."""
        if closed is None or len(self.closed_path):
            return self.motion_path()
        relocations = closed.relocations.copy()
        relocations[self.updates] = 0.0
        return compose(self.motion_path(), relocations)


class GmappingBackend:
    """Rao-Blackwellised particle filter (gmapping): the paper's own SLAM.

    The map's origin is the robot's first pose.

    Parameters
    ----------
    settings : GmappingConfig
    frontend : FrontendConfig
    rng : numpy.random.Generator
        The only source of randomness; all draws of an update are made before it is distributed to
        threads, so the result does not depend on their number.
    heartbeat : callable
    """

    settings: ClassVar[type[Stage]] = GmappingConfig

    def __init__(
        self,
        settings: GmappingConfig,
        frontend: FrontendConfig,
        rng: Generator,
        heartbeat: Heartbeat = silent,
    ) -> None:
        self._config = settings
        self._rng = rng
        builder = GraphBuilder(settings.places, frontend, heartbeat) if settings.places else None
        self._state = _State(ScanTracker(frontend), MappingFilter.empty(settings), builder)
        self._step: Future[None] | None = None

    def update(self, reading: Reading) -> None:
        """Process one reading: track it with the frontend, and update the filter when due.

        The filter runs in its own thread while the frontend tracks the next readings.
        """
        state = self._state
        scan = state.tracker.track(reading)
        if state.graph_builder:
            state.graph_builder.add_scan(scan)
        state.stamps_ns.append(reading.stamp_ns)
        state.revise(scan.revised)
        state.local.append(scan.local_from_robot.as_array())
        state.lags.append(scan.lag_covariance)
        state.variances.append(step_variance(scan))
        if not state.updates:
            state.filter.start(self._points(scan, reading.scan.robot_from_laser))
            state.updates.append(0)
            return
        self._accumulate(scan)
        if self._is_due(scan):
            self._wait_for_filter()
            measurement = self._measurement(scan, reading.scan.robot_from_laser)
            if state.graph_builder:
                state.measurements.append(measurement)
            self._step = _filter_thread().submit(state.filter.step, measurement, self._rng)

    def map_from_robot(self) -> Pose2:
        """Return the best particle's pose, propagated by the frontend since the last update."""
        self._wait_for_filter()
        state = self._state
        if not state.updates:
            return Pose2()
        since = between(state.local[state.updates[-1]], state.local[-1])
        return Pose2.from_array(compose(state.filter.best_pose(), since))

    def result(self) -> SlamResult:
        """Return the best particle's path, at every scan.

        Raises
        ------
        RunFailed
            When no scan was usable.
        """
        self._wait_for_filter()
        state = self._state
        if not state.updates:
            raise RunFailed("no scan was usable")
        state.filter.find_origin()
        if state.graph_builder is None or state.graph_builder.is_empty:
            return self._assemble_result(None)
        closed = state.graph_builder.close_loops()
        distances = self._closure_distances(state.filter, state.motion_path(), closed)
        if np.any(distances > MISSED_SIGMAS):
            self._run_again(closed, distances)
        return self._assemble_result(closed)

    def _run_again(self, closed: ClosedGraph, distances: Floats) -> None:
        """Filter the recording along the closed path; keep that where it closes loops better.

        So that poses while driving and the result belong to the same map.
        """
        state = self._state
        along = closed.poses[state.updates]
        again = filter_along(
            along, state.filter.first_points, state.measurements, self._config, self._rng
        )
        again.find_origin()
        distances_again = self._closure_distances(again, closed.poses, closed)
        state.second_pass = second_pass_notice(distances, distances_again)
        if distances_again.sum() < distances.sum():
            state.filter, state.closed_path = again, closed.poses

    def _closure_distances(
        self, particles: MappingFilter, motion: Floats, closed: ClosedGraph
    ) -> Floats:
        path = self._interpolated(motion, particles.best_path())
        return closure_mahalanobis(closed, path.poses, self._config.maps.delta_m)

    def _assemble_result(self, closed: ClosedGraph | None) -> SlamResult:
        state, particles, motion = self._state, self._state.filter, self._state.relocated(closed)
        path = self._interpolated(motion, particles.best_path())
        mean = self._interpolated(motion, particles.mean_path())
        stamps_ns = np.array(state.stamps_ns)[state.updates]
        tables = update_table(stamps_ns, particles), path_table("weighted_mean", mean)
        closures = (closed.closures,) if closed else ()
        covariances = None if closed is None else second_moments(path.poses, closed)
        if covariances is None:
            covariances = self._covariances(path.poses)
        notices = tuple(filter(None, (*particle_notices(particles), state.second_pass)))
        made = None, (*tables, *closures), notices, state.tracker.moving_share
        return SlamResult(path, covariances, *made)

    def _covariances(self, poses: Floats) -> Floats:
        """Second moments of the particles' paths, plus a floor (S, 3, 3).

        For runs without a graph: errors that all particles share are not in it.
        """
        state, particles = self._state, self._state.filter
        paths = particles.ancestry.paths(np.arange(len(particles.poses)))
        # The floor: the noise of a motion of length zero, and the quantisation of the cells.
        cell = np.diag([1.0, 1.0, 0.0]) * self._config.maps.delta_m**2 / 12.0
        floor = motion_covariance(self._config.motion, 0.0, 0.0) + cell
        weights = normalised(particles.log_weights)
        moments = sample_covariances(paths, paths[:, particles.best()], weights, floor)
        updates, variances = np.array(state.updates), np.array(state.variances)
        return interpolate_covariances(moments, updates, poses, variances) + np.array(state.lags)

    def snapshot(self) -> State:
        """Return the whole state once the filter's step is done, the random generator included."""
        self._wait_for_filter()
        return state_of(self)

    def restore(self, state: State) -> None:
        """Continue from a snapshot."""
        self._wait_for_filter()
        restore_state(state, self)

    def _wait_for_filter(self) -> None:
        """Wait for the filter's step; its errors are raised here."""
        step, self._step = self._step, None
        if step is not None:
            step.result()

    def _accumulate(self, scan: TrackedScan) -> None:
        """Accumulate the motion since the last update, and the frontend's uncertainty of it.

        A good match ends the uncertainty before it, but that of the step to a restarted local map
        remains. Without a match odometry has its nominal covariance, as in the graph.
        """
        state = self._state
        state.path_m += math.hypot(scan.motion.x, scan.motion.y)
        state.turned_rad += abs(scan.motion.theta)
        sigma = np.sqrt(np.diag(scan.local_covariance)).tolist()
        is_good = scan.match and max(sigma[:2]) <= _MAX_SIGMA_M and sigma[2] <= _MAX_SIGMA_RAD
        state.unmatched = NO_MOTION if scan.match else chained(state.unmatched, scan.wheels)
        if scan.match or state.unmatched is None:
            covariance = scan.local_covariance
        else:
            covariance = state.unmatched.total_covariance()
        state.step_covariance = (
            np.zeros((3, 3)) if is_good else covariance * clamping_factors(covariance)
        )
        if scan.is_keyframe and not scan.match:
            state.restart_covariance, state.step_covariance = (
                state.restart_covariance + state.step_covariance,
                np.zeros((3, 3)),
            )
            state.unmatched = NO_MOTION

    def _is_due(self, scan: TrackedScan) -> bool:
        state = self._state
        if len(scan.points_m) < self._config.likelihood.min_points:
            return False
        then, now = state.local[state.updates[-1]].tolist(), state.local[-1].tolist()
        return (
            math.hypot(now[0] - then[0], now[1] - then[1]) >= self._config.linear_update_m
            or abs(math.remainder(now[2] - then[2], math.tau)) >= self._config.angular_update_rad
        )

    def _measurement(self, scan: TrackedScan, robot_from_laser: Pose2) -> Measurement:
        """Return the accumulated motion and the scan, and reset the accumulators."""
        state = self._state
        covariance = motion_covariance(self._config.motion, state.path_m, state.turned_rad)
        uncertainty = state.previous_covariance + state.restart_covariance + state.step_covariance
        measurement = Measurement(
            self._points(scan, robot_from_laser),
            between(state.local[state.updates[-1]], state.local[-1]),
            covariance + uncertainty,
            bool(uncertainty.any()),
            state.path_m,
            state.turned_rad,
        )
        state.updates.append(len(state.stamps_ns) - 1)
        state.path_m, state.turned_rad = 0.0, 0.0
        state.restart_covariance, state.previous_covariance = (
            np.zeros((3, 3)),
            state.step_covariance,
        )
        return measurement

    def _points(self, scan: TrackedScan, robot_from_laser: Pose2) -> Floats:
        """Return the end points of the beams used, (K, 4), with normals."""
        likelihood = self._config.likelihood
        origin, points = robot_from_laser.as_array()[:2], scan.points_m
        if likelihood.max_range_m is not None:
            ranges_m = np.hypot(points[:, 0] - origin[0], points[:, 1] - origin[1])
            points = points[ranges_m <= likelihood.max_range_m]
        return np.asarray(point_normals(points, origin)[:: likelihood.lskip + 1])

    def _interpolated(self, motion: Floats, path: Floats) -> Trajectory:
        """Trajectory of all scans: the filter's poses at its updates, the motion in between."""
        state = self._state
        poses = interpolate_corrections(
            motion, np.array(state.updates), path, np.array(state.variances)
        )
        return Trajectory(np.array(state.stamps_ns), poses)


@cache
def _filter_thread() -> ThreadPoolExecutor:
    """Executor of the filter's steps, apart from the threads that share the particles."""
    return ThreadPoolExecutor(max_workers=1, thread_name_prefix="particle-filter")
