# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Rao-Blackwellised particle filter with improved proposal and selective resampling.

The paper's SLAM, eq. (4)-(11), after Grisetti, Stachniss and Burgard, "Improved Techniques for
Grid Mapping With Rao-Blackwellized Particle Filters", IEEE T-RO 23(1), 2007. The original takes
raw odometry from one update to the next and loses its way where that is poor and rotations are
fast. Here the shared frontend's matcher follows every scan, and the improved proposal is really
drawn from; the two are there to prevent just that. Where every particle misses a loop that place
recognition has found, the filter goes over the recording a second time (`second_pass`).
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
from slarm_graph.backends.graph_constraints import limits_of
from slarm_graph.backends.motion_model import motion_covariance
from slarm_graph.backends.particle_filter import normalised
from slarm_graph.backends.particle_matching import point_normals
from slarm_graph.backends.particle_tables import (
    particle_notices,
    second_pass_notice,
    update_table,
)
from slarm_graph.backends.path_covariance import (
    covariance_notices,
    fill_covariances,
    spread_covariances,
)
from slarm_graph.backends.path_filling import spread, step_variance
from slarm_graph.backends.proposal import Measurement
from slarm_graph.backends.rbpf import MappingFilter
from slarm_graph.backends.second_pass import (
    MISSED,
    closure_misses,
    covariances_about,
    filter_along,
)
from slarm_graph.config import FrontendConfig, GmappingConfig, Stage
from slarm_graph.errors import RunFailed
from slarm_graph.frontends.scans.tracker import ScanTracker, TrackedScan
from slarm_graph.frontends.scans.wheel_motion import NO_MOTION, WheelMotion, chained
from slarm_graph.geometry import Floats, Pose2, between, compose
from slarm_graph.readings import Reading
from slarm_graph.snapshots import State, restore_state, state_of
from slarm_graph.trajectory import Trajectory

_SURE_M, _SURE_RAD = 0.1, 0.05
"""A match with a larger standard deviation is as good as none."""


@dataclass
class _State:
    """Everything that changes."""

    tracker: ScanTracker
    filter: MappingFilter
    places: GraphBuilder | None
    first_points: Floats = field(default_factory=lambda: np.zeros((0, 4)))
    measurements: list[Measurement] = field(default_factory=list)
    stamps_ns: list[int] = field(default_factory=list)
    local: list[Floats] = field(default_factory=list)
    lags: list[Floats] = field(default_factory=list)
    variances: list[float] = field(default_factory=list)
    updates: list[int] = field(default_factory=list)
    path_m: float = 0.0
    turned_rad: float = 0.0
    begun: Floats = field(default_factory=lambda: np.zeros((3, 3)))
    doubt: Floats = field(default_factory=lambda: np.zeros((3, 3)))
    doubted: Floats = field(default_factory=lambda: np.zeros((3, 3)))
    unmatched: WheelMotion | None = NO_MOTION
    closed_path: Floats = field(default_factory=lambda: np.zeros((0, 3)))
    brought_back: str = ""

    def revise(self, poses: Sequence[Floats]) -> None:
        """Replace the last poses, each (3,), but for what the particles were moved by already."""
        open_ended = min(len(poses), len(self.local) - 1 - self.updates[-1]) if self.updates else 0
        if open_ended > 0:
            self.local[-open_ended:] = list(poses[-open_ended:])

    def told(self) -> Floats:
        """Poses (S, 3) whose motion the filter was told: a closed path, then the frontend's."""
        local, known = np.array(self.local), len(self.closed_path)
        if not known:
            return local
        since = between(local[known - 1], local[known:])
        return np.concatenate([self.closed_path, compose(self.closed_path[-1], since)])

    def told_at_last(self, closed: ClosedGraph | None) -> Floats:
        """Poses (S, 3), with scans between updates where all that was seen has them."""
        if closed is None or len(self.closed_path):
            return self.told()
        moved = closed.moved.copy()
        moved[self.updates] = 0.0
        return compose(self.told(), moved)


class GmappingBackend:
    """Rao-Blackwellised particle filter (gmapping): the paper's own SLAM.

    The map's origin is the robot's first pose.

    Parameters
    ----------
    settings : GmappingConfig
    frontend : FrontendConfig
    rng : numpy.random.Generator
        The only source of randomness; all draws of an update are made before it is shared out to
        threads, so their number does not matter.
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
        places = GraphBuilder(settings.places, frontend, heartbeat) if settings.places else None
        self._state = _State(ScanTracker(frontend), MappingFilter.empty(settings), places)
        self._step: Future[None] | None = None

    def update(self, reading: Reading) -> None:
        """Take one reading: follow it with the frontend, and update the filter when due.

        The filter works while the frontend follows the next readings.
        """
        state = self._state
        scan = state.tracker.track(reading)
        if state.places:
            state.places.take(scan)
        state.stamps_ns.append(reading.stamp_ns)
        state.revise(scan.revised)
        state.local.append(scan.local_from_robot.as_array())
        state.lags.append(scan.lag_covariance)
        state.variances.append(step_variance(scan))
        if not state.updates:
            state.first_points = self._points(scan, reading.scan.robot_from_laser)
            state.filter.start(state.first_points)
            state.updates.append(0)
            return
        self._travel(scan)
        if self._is_due(scan):
            self._settle()
            measurement = self._measurement(scan, reading.scan.robot_from_laser)
            if state.places:
                state.measurements.append(measurement)
            self._step = _aside().submit(state.filter.step, measurement, self._rng)

    def map_from_robot(self) -> Pose2:
        """Return where the best particle is, moved on by the frontend since its last update."""
        self._settle()
        state = self._state
        if not state.updates:
            return Pose2()
        since = between(state.local[state.updates[-1]], state.local[-1])
        return Pose2.from_array(compose(state.filter.poses[state.filter.best()], since))

    def result(self) -> SlamResult:
        """Return the best particle's path, at every scan.

        Raises
        ------
        RunFailed
            When no scan was usable.
        """
        self._settle()
        state = self._state
        if not state.updates:
            raise RunFailed("no scan was usable")
        if state.places is None or state.places.is_empty:
            return self._told(None)
        closed = state.places.closed()
        missed = self._misses(state.filter, state.told(), closed)
        if np.any(missed > MISSED):
            self._bring_back(closed, missed)
        return self._told(closed)

    def _bring_back(self, closed: ClosedGraph, missed: Floats) -> None:
        """Filter the recording along the closed path, and go on with that where it is better.

        So the poses that are told on the way belong to the same map as the result.
        """
        state = self._state
        along = closed.poses[state.updates]
        again = filter_along(along, state.first_points, state.measurements, self._config, self._rng)
        still = self._misses(again, closed.poses, closed)
        state.brought_back = second_pass_notice(missed, still)
        if still.sum() < missed.sum():
            state.filter, state.closed_path = again, closed.poses

    def _misses(self, particles: MappingFilter, told: Floats, closed: ClosedGraph) -> Floats:
        path = self._filled(told, particles.best_path())
        return closure_misses(closed, path.poses, self._config.maps.delta_m)

    def _told(self, closed: ClosedGraph | None) -> SlamResult:
        state, particles, told = self._state, self._state.filter, self._state.told_at_last(closed)
        path = self._filled(told, particles.best_path())
        mean = self._filled(told, particles.mean_path())
        stamps_ns = np.array(state.stamps_ns)[state.updates]
        tables = update_table(stamps_ns, particles), path_table("weighted_mean", mean)
        closures = (closed.closures,) if closed else ()
        covariances = None if closed is None else covariances_about(path.poses, closed)
        unknown = () if closed is None else covariance_notices(closed.graph, covariances)
        if covariances is None and not unknown:
            covariances = self._covariances(path.poses)
        said = filter(None, (*particle_notices(particles), state.brought_back, *unknown))
        return SlamResult(path, covariances, tables=(*tables, *closures), notices=tuple(said))

    def _covariances(self, poses: Floats) -> Floats:
        """Spread of the particles' paths, and what none of them can know (S, 3, 3).

        Where there is no graph beside them: whatever all of them have wrong, they do not know.
        """
        state, known = self._state, self._state.filter
        paths = known.ancestry.paths(np.arange(len(known.poses)))
        # A pose is drawn no finer than a motion of length zero allows, and matched to cells.
        cell = np.diag([1.0, 1.0, 0.0]) * self._config.maps.delta_m**2 / 12.0
        floor = motion_covariance(self._config.motion, 0.0, 0.0) + cell
        weights = normalised(known.log_weights)
        spreads = spread_covariances(paths, paths[:, known.best()], weights, floor)
        updates, variances = np.array(state.updates), np.array(state.variances)
        return fill_covariances(spreads, updates, poses, variances) + np.array(state.lags)

    def snapshot(self) -> State:
        """Return the whole state once the filter's step is done, random numbers included."""
        self._settle()
        return state_of(self)

    def restore(self, state: State) -> None:
        """Continue from a snapshot."""
        self._settle()
        restore_state(state, self)

    def _settle(self) -> None:
        """Wait for the filter; its errors come up here."""
        step, self._step = self._step, None
        if step is not None:
            step.result()

    def _travel(self, scan: TrackedScan) -> None:
        """Add up the motion since the last update, and note the frontend's doubt.

        A match settles what was unsure before it; where the local map is begun anew, the step to it
        stays as unsure as it was. While nothing is matched odometry is as unsure as it is where it
        holds, as in the graph.
        """
        state = self._state
        state.path_m += math.hypot(scan.motion.x, scan.motion.y)
        state.turned_rad += abs(scan.motion.theta)
        sigma = np.sqrt(np.diag(scan.local_covariance)).tolist()
        is_sure = scan.match and max(sigma[:2]) <= _SURE_M and sigma[2] <= _SURE_RAD
        state.unmatched = NO_MOTION if scan.match else chained(state.unmatched, scan.wheels)
        if scan.match or state.unmatched is None:
            unsure = scan.local_covariance
        else:
            unsure = state.unmatched.total_covariance()
        state.doubt = np.zeros((3, 3)) if is_sure else unsure * limits_of(unsure)
        if scan.is_keyframe and not scan.match:
            state.begun, state.doubt = state.begun + state.doubt, np.zeros((3, 3))
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
        """Sum up what has happened since the last update, and begin anew."""
        state = self._state
        covariance = motion_covariance(self._config.motion, state.path_m, state.turned_rad)
        unsure = state.doubted + state.begun + state.doubt
        measurement = Measurement(
            self._points(scan, robot_from_laser),
            between(state.local[state.updates[-1]], state.local[-1]),
            covariance + unsure,
            bool(unsure.any()),
            state.path_m,
            state.turned_rad,
        )
        state.updates.append(len(state.stamps_ns) - 1)
        state.path_m, state.turned_rad = 0.0, 0.0
        state.begun, state.doubted = np.zeros((3, 3)), state.doubt
        return measurement

    def _points(self, scan: TrackedScan, robot_from_laser: Pose2) -> Floats:
        """Return the beams that count, (K, 4), with normals."""
        likelihood = self._config.likelihood
        origin, points = robot_from_laser.as_array()[:2], scan.points_m
        if likelihood.max_range_m is not None:
            ranges_m = np.hypot(points[:, 0] - origin[0], points[:, 1] - origin[1])
            points = points[ranges_m <= likelihood.max_range_m]
        return np.asarray(point_normals(points, origin)[:: likelihood.lskip + 1])

    def _filled(self, told: Floats, path: Floats) -> Trajectory:
        """Give every scan a pose: the filter's at its updates, the motion told in between."""
        state = self._state
        poses = spread(told, np.array(state.updates), path, np.array(state.variances))
        return Trajectory(np.array(state.stamps_ns), poses)


@cache
def _aside() -> ThreadPoolExecutor:
    """Thread in which filters take their steps, apart from those that share out the particles."""
    return ThreadPoolExecutor(max_workers=1, thread_name_prefix="particle-filter")
