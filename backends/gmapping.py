# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Rao-Blackwellised particle filter with improved proposal and selective resampling.

The paper's SLAM, eq. (4)-(11), after Grisetti, Stachniss and Burgard, "Improved Techniques for
Grid Mapping With Rao-Blackwellized Particle Filters", IEEE T-RO 23(1), 2007. Every particle is a
path with the map that belongs to it: eq. (4), p(x, m | o, l) = p(m | x, o) p(x | o, l).
"""

from __future__ import annotations

import itertools
import os
import pickle
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np
from numpy.random import Generator

from slarm_graph.backend import Heartbeat, SlamResult, Table, silent
from slarm_graph.backends.motion_model import draw_motion, motion_covariance
from slarm_graph.backends.particle_filter import (
    Ancestry,
    effective_sample_size,
    normalised,
    resample,
    weighted_mean,
)
from slarm_graph.backends.particle_maps import ParticleMaps, memory_notice, most_tiles
from slarm_graph.backends.particle_matching import point_normals
from slarm_graph.backends.path_filling import SettledMap, fill_path
from slarm_graph.backends.proposal import Measurement, propose, weigh
from slarm_graph.config import GmappingConfig, RunConfig
from slarm_graph.errors import RunFailed
from slarm_graph.frontends.tracker import ScanTracker, TrackedScan
from slarm_graph.geometry import Floats, Pose2, between, compose
from slarm_graph.readings import LaserScan, Reading
from slarm_graph.trajectory import Trajectory

_COLUMNS = (
    "stamp_ns",
    "n_eff",
    "resampled",
    "distinct_ancestors",
    "common_update",
    "mean_x_m",
    "mean_y_m",
    "mean_theta_rad",
)


@dataclass
class _State:
    """Everything that changes, plain enough to be pickled."""

    tracker: ScanTracker
    maps: ParticleMaps
    poses: Floats
    log_weights: Floats
    log_evidence: Floats
    ancestry: Ancestry
    updates: list[int] = field(default_factory=list)
    rows: list[tuple[float | int | str, ...]] = field(default_factory=list)
    stamps_ns: list[int] = field(default_factory=list)
    scans: list[LaserScan] = field(default_factory=list)
    local: list[Floats] = field(default_factory=list)
    path_m: float = 0.0
    turned_rad: float = 0.0
    unmatched: Floats = field(default_factory=lambda: np.zeros((3, 3)))


class GmappingBackend:
    """Rao-Blackwellised particle filter (gmapping): the paper's own SLAM.

    The map's origin is the robot's first pose.

    Parameters
    ----------
    config : RunConfig
    rng : numpy.random.Generator
        The only source of randomness; all draws of an update are made before it is shared out to
        threads, so their number does not matter.
    heartbeat : callable
    """

    def __init__(self, config: RunConfig, rng: Generator, heartbeat: Heartbeat = silent) -> None:
        self._config: GmappingConfig = config.gmapping
        self._run_config = config
        self._rng = rng
        self._heartbeat = heartbeat
        count = config.gmapping.particles
        self._state = _State(
            ScanTracker(config.frontend),
            ParticleMaps.empty(count, self._config.maps.delta_m, most_tiles(self._config.maps)),
            np.zeros((count, 3)),
            np.zeros(count),
            np.zeros(count),
            Ancestry(count),
        )
        self._map = SettledMap(config.mapping)

    def update(self, reading: Reading) -> None:
        """Take one reading: follow it with the frontend, and update the filter when due."""
        state = self._state
        scan = state.tracker.track(reading)
        state.stamps_ns.append(reading.stamp_ns)
        state.scans.append(reading.scan)
        state.local.append(scan.local_from_robot.as_array())
        self._travel(scan)
        if not state.updates:
            self._start(scan, reading.scan.robot_from_laser)
        elif self._is_due(scan):
            self._advance(scan, reading.scan.robot_from_laser)

    def map_from_robot(self) -> Pose2:
        """Return where the best particle is, moved on by the frontend since its last update."""
        state = self._state
        if not state.updates:
            return Pose2()
        since = between(state.local[state.updates[-1]], state.local[-1])
        return Pose2.from_array(compose(state.poses[self._best()], since))

    def result(self) -> SlamResult:
        """Return the best particle's path and the map it makes, eq. (4): p(m | x, o)."""
        state = self._state
        if not state.updates:
            raise RunFailed("no scan was usable")
        path = state.ancestry.path(self._best())
        trajectory = self._filled(path)
        common = state.ancestry.common_update()
        settled = state.updates[common] if common >= 0 else 0
        self._heartbeat(f"rendering {len(state.scans)} scans")
        grid = self._map.render(state.scans, trajectory, settled)
        table = Table("particles", _COLUMNS, tuple(state.rows))
        return SlamResult(trajectory, grid, tables=(table,), notices=self._notices())

    def weighted_mean_trajectory(self) -> Trajectory:
        """Mean of all particles' paths, eq. (11) with weights, at every scan."""
        state = self._state
        everybody = np.arange(len(state.poses))
        paths = state.ancestry.paths(everybody)
        return self._filled(weighted_mean(paths, normalised(state.log_weights)))

    def snapshot(self) -> bytes:
        """Return the whole state, that of the random numbers included."""
        return pickle.dumps((self._state, self._rng.bit_generator.state))

    def restore(self, state: bytes) -> None:
        """Continue from a snapshot."""
        self._state, self._rng.bit_generator.state = pickle.loads(state)
        self._map = SettledMap(self._run_config.mapping)

    def _travel(self, scan: TrackedScan) -> None:
        """Add up the motion since the last update, and the doubt where a scan was not matched."""
        state = self._state
        state.path_m += float(np.hypot(scan.motion.x, scan.motion.y))
        state.turned_rad += abs(scan.motion.theta)
        if not scan.match and len(state.stamps_ns) > 1:
            state.unmatched = state.unmatched + scan.motion_covariance

    def _is_due(self, scan: TrackedScan) -> bool:
        state = self._state
        if len(scan.points_m) < self._config.likelihood.min_points:
            return False
        moved = between(state.local[state.updates[-1]], state.local[-1])
        return bool(
            np.hypot(moved[0], moved[1]) >= self._config.linear_update_m
            or abs(moved[2]) >= self._config.angular_update_rad
        )

    def _start(self, scan: TrackedScan, robot_from_laser: Pose2) -> None:
        points = self._points(scan, robot_from_laser)
        self._state.maps.insert(points, self._state.poses)
        self._select()

    def _advance(self, scan: TrackedScan, robot_from_laser: Pose2) -> None:
        """One step of the filter: propose, weigh, resample when due, map."""
        state = self._state
        measurement = self._measurement(scan, robot_from_laser)
        state.poses, gained = self._propose(measurement)
        state.log_evidence = state.log_evidence + gained
        # eq. (8), tempered: the errors of a map are common to all scans matched to it
        state.log_weights = state.log_weights + gained / self._config.likelihood.ogain
        self._select()
        state.maps.insert(measurement.points, state.poses)

    def _measurement(self, scan: TrackedScan, robot_from_laser: Pose2) -> Measurement:
        state = self._state
        covariance = motion_covariance(self._config.motion, state.path_m, state.turned_rad)
        return Measurement(
            self._points(scan, robot_from_laser),
            between(state.local[state.updates[-1]], state.local[-1]),
            covariance + state.unmatched,
            bool(state.unmatched.any()),
        )

    def _points(self, scan: TrackedScan, robot_from_laser: Pose2) -> Floats:
        """Return the beams that count, (K, 4), with normals."""
        likelihood = self._config.likelihood
        origin = robot_from_laser.as_array()[:2]
        points = scan.points_m
        if likelihood.max_range_m is not None:
            ranges_m = np.hypot(*(points - origin).T)
            points = points[ranges_m <= likelihood.max_range_m]
        return np.asarray(point_normals(points, origin)[:: likelihood.lskip + 1])

    def _propose(self, measurement: Measurement) -> tuple[Floats, Floats]:
        """Draw poses and gains in log weight, particles shared out to threads."""
        state, config = self._state, self._config
        normals = self._rng.standard_normal((len(state.poses), 6))
        if not config.proposal.improved:
            poses = draw_motion(
                state.poses, measurement.motion, measurement.motion_covariance, normals[:, :3]
            )
            return poses, weigh(state.maps, measurement.points, config, poses)
        jobs = [
            _threads().submit(
                propose,
                replace(state.maps, tables=state.maps.tables[part]),
                measurement,
                config,
                state.poses[part],
                normals[part],
            )
            for part in _parts(len(state.poses))
        ]
        done = [job.result() for job in jobs]
        return np.concatenate([d[0] for d in done]), np.concatenate([d[1] for d in done])

    def _select(self) -> None:
        """Resample where N_eff has fallen below the threshold, and keep the books."""
        state, rule = self._state, self._config.resampling
        count = len(state.poses)
        weights = normalised(state.log_weights)
        mean = weighted_mean(state.poses, weights)  # eq. (11)
        n_eff = effective_sample_size(weights)
        ancestors = np.arange(count)
        resampled = n_eff < rule.resample_threshold * count
        if resampled:
            ancestors = resample(weights, rule.method, self._rng)
            state.maps.resample(ancestors)
            state.poses = state.poses[ancestors]
            state.log_evidence = state.log_evidence[ancestors]
            state.log_weights = np.zeros(count)
        state.ancestry.append(ancestors, state.poses)
        state.updates.append(len(state.stamps_ns) - 1)
        state.path_m, state.turned_rad, state.unmatched = 0.0, 0.0, np.zeros((3, 3))
        distinct, common = len(np.unique(ancestors)), state.ancestry.common_update()
        state.rows.append(
            (state.stamps_ns[-1], n_eff, int(resampled), distinct, common, *mean.tolist())
        )

    def _best(self) -> int:
        """Return the particle whose whole path explains the scans best."""
        return int(np.argmax(self._state.log_evidence))

    def _filled(self, path: Floats) -> Trajectory:
        """Give every scan a pose: the filter's at its updates, the frontend's in between."""
        state = self._state
        stamps_ns = np.array(state.stamps_ns)
        poses = fill_path(stamps_ns, np.array(state.local), np.array(state.updates), path)
        return Trajectory(stamps_ns, poses)

    def _notices(self) -> tuple[str, ...]:
        state = self._state
        resampled = sum(int(row[_COLUMNS.index("resampled")]) for row in state.rows)
        used_mb = state.maps.memory_bytes / 1e6
        return (
            *memory_notice(len(state.poses), self._config.maps),
            f"{len(state.poses)} particles, {len(state.updates)} updates,"
            f" {resampled} resamplings, {used_mb:.0f} MB of particle maps",
        )


def _parts(count: int) -> list[slice]:
    """Cut particles into one slice per thread; what comes out does not depend on how many."""
    bounds = np.linspace(0, count, min(count, _cores()) + 1).astype(int)
    return [slice(a, b) for a, b in itertools.pairwise(bounds)]


@cache
def _threads() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(max_workers=_cores(), thread_name_prefix="particles")


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
