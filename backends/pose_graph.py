# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Graph SLAM: lidar odometry, submaps, loop closures and a final matching of everything.

While driving, a small graph of submaps is kept: one node per few keyframes, joined by lidar
odometry and loop closures. For the result every keyframe is a node and is matched again against
all it saw, in rounds of matching and optimising.
"""

from __future__ import annotations

import pickle

import numpy as np
from numpy.random import Generator

from slarm_graph.backend import Heartbeat, SlamResult, Table, silent
from slarm_graph.backends.pose_graph_refinement import Refined, refine_keyframes
from slarm_graph.backends.submap_graph import SubmapGraph
from slarm_graph.config import RunConfig
from slarm_graph.errors import RunFailed
from slarm_graph.frontends.loop_closure import Closure, LoopCloser
from slarm_graph.frontends.submaps import Keyframe, view_center
from slarm_graph.frontends.tracker import ScanTracker, TrackedScan
from slarm_graph.geometry import Floats, Pose2, between, compose, wrap_angles
from slarm_graph.mapping import render
from slarm_graph.readings import LaserScan, Reading
from slarm_graph.trajectory import Trajectory


class PoseGraphBackend:
    """Graph SLAM on GTSAM: every scan matched, loops closed, everything matched again at the end.

    Parameters
    ----------
    config : RunConfig
    rng : numpy.random.Generator
        Not used: nothing here is drawn.
    heartbeat : Heartbeat
    """

    def __init__(self, config: RunConfig, rng: Generator, heartbeat: Heartbeat = silent) -> None:
        self._config = config
        self._heartbeat = heartbeat
        self._tracker = ScanTracker(config.frontend)
        self._closer = LoopCloser(config.pose_graph.loops, config.frontend.matching)
        self._graph = SubmapGraph(config.pose_graph)
        self._scans: list[LaserScan] = []
        self._stamps_ns: list[int] = []
        self._local: list[Pose2] = []
        self._covariance = np.zeros((3, 3))

    def update(self, reading: Reading) -> None:
        """Track the scan; when it is a keyframe, extend the graph and look for old places."""
        tracked = self._tracker.track(reading)
        self._scans.append(reading.scan)
        self._stamps_ns.append(tracked.stamp_ns)
        self._local.append(tracked.local_from_robot)
        if not tracked.match:
            self._covariance = self._covariance + tracked.motion_covariance
        if tracked.is_keyframe:
            self._add_keyframe(tracked)

    def map_from_robot(self) -> Pose2:
        """Return the present pose by the submap graph."""
        if not self._local:
            return Pose2()
        return self._graph.map_from_local() @ self._local[-1]

    def result(self) -> SlamResult:
        """Match everything again, spread the correction over all scans and render the map."""
        if not self._scans:
            raise RunFailed("no scan could be used")
        local = np.array([p.as_array() for p in self._local])
        keyframes = self._graph.keyframes
        refined = refine_keyframes(
            [k.points_m for k in keyframes],
            self._graph.keyframe_poses(),
            np.array([k.local_from_robot.as_array() for k in keyframes]),
            np.array([k.covariance for k in keyframes]),
            self._config,
            self._heartbeat,
        )
        stamps = np.array(self._stamps_ns, dtype=np.int64)
        at = np.array([k.scan for k in keyframes])
        poses = spread(local, at, refined.graph.poses)
        trajectory = Trajectory(stamps, poses)
        grid = render(self._scans, trajectory, self._config.mapping)
        return SlamResult(trajectory, grid, refined.graph, (self._closure_table(refined),))

    def snapshot(self) -> bytes:
        """Return the state; GTSAM objects live only within calls, so plain pickling does."""
        state = {k: v for k, v in self.__dict__.items() if k not in ("_heartbeat", "_config")}
        return pickle.dumps(state, protocol=pickle.HIGHEST_PROTOCOL)

    def restore(self, state: bytes) -> None:
        """Continue from a snapshot of a backend with the same configuration."""
        self.__dict__.update(pickle.loads(state))

    def _add_keyframe(self, tracked: TrackedScan) -> None:
        match = tracked.match
        covariance = self._covariance + (match.covariance if match else 0.0)
        self._covariance = np.zeros((3, 3))
        keyframe = Keyframe(
            len(self._scans) - 1,
            tracked.points_m,
            tracked.local_from_robot,
            covariance,
            view_center(tracked.points_m),
        )
        self._graph.add(keyframe)
        expected = self._graph.expectations()
        closures = self._closer.examine(self._graph.keyframes, self._graph.submaps, expected)
        if closures:
            self._graph.close(closures, self._heartbeat)

    def _closure_table(self, refined: Refined) -> Table:
        columns = (
            "scan_stamp_s",
            "submap",
            "keyframe",
            "x_m",
            "y_m",
            "theta_rad",
            "score",
            "weight",
            "searched",
            "verdict",
        )
        rows = tuple(self._row(c, w) for c, w in self._graph.weighed_closures(self._heartbeat))
        return Table("loop_closures", columns, rows)

    def _row(self, c: Closure, weight: float) -> tuple[float | int | str, ...]:
        stamp_s = self._stamps_ns[self._graph.keyframes[c.keyframe].scan] * 1e-9
        x, y, theta = (float(v) for v in c.submap_from_keyframe)
        verdict = c.reason or ("accepted" if weight > 0.5 else "rejected by GNC")
        return (
            f"{stamp_s:.9f}", c.submap, c.keyframe, x, y, theta, c.score, weight,
            int(c.searched), verdict,
        )  # fmt: skip


def spread(local: Floats, at: np.ndarray, keyframe_poses: Floats) -> Floats:
    """Give every scan a pose: between two keyframes, what each says is blended linearly.

    Parameters
    ----------
    local : (N, 3) float64
        `local_from_robot` of all scans.
    at : (K,) int64
        Scans that are keyframes, ascending.
    keyframe_poses : (K, 3) float64
        `map_from_robot` of the keyframes.
    """
    scans = np.arange(len(local))
    before = np.clip(np.searchsorted(at, scans, side="right") - 1, 0, len(at) - 1)
    after = np.minimum(before + 1, len(at) - 1)
    from_before = compose(keyframe_poses[before], between(local[at[before]], local))
    from_after = compose(keyframe_poses[after], between(local[at[after]], local))
    gap = np.maximum(at[after] - at[before], 1)
    share = np.clip((scans - at[before]) / gap, 0.0, 1.0)[:, None]
    away = from_after - from_before
    away[:, 2] = wrap_angles(away[:, 2])
    poses = from_before + share * away
    poses[:, 2] = wrap_angles(poses[:, 2])
    return poses
