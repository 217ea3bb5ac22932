# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Scan matchers side by side: pairs of scans with known relation, and every scan of a recording.

    python benchmarks/bench_matching.py RECORDING [--pairs 400] [--scans 4000]

`<stem>.relations` beside RECORDING is the truth. The pairs lie 0.2 to 1.2 m apart and start from
odometry. Peers come from PyPI (`pip install small_gicp kiss-icp open3d`); one that is missing or
fails is shown so. The baseline of both tables is point-to-point ICP on a SciPy tree, written here.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from slarm_graph.config import FrontendConfig, SourceConfig
from slarm_graph.eval.relations import read_relations
from slarm_graph.frontends.recordings.sources import open_source
from slarm_graph.frontends.scans.matcher import (
    CorrelativeMatcher,
    IcpConfig,
    IcpMatcher,
    LikelihoodMatcher,
    ScanMatcher,
)
from slarm_graph.frontends.scans.scan_filter import points_for_matching
from slarm_graph.frontends.scans.tracker import ScanTracker
from slarm_graph.geometry import Pose2, transform_points
from slarm_graph.readings import Reading

Points = np.ndarray
Match = Callable[[Points, Points, Pose2], Pose2]

_MAX_DISTANCE_M = IcpConfig().max_distance_m
_HEIGHTS_M = (0.0, 0.1, 0.2)
"""A plane needs points at more than one height, and a scan has one: it is copied to the one above
and below, too, about as far apart as its returns are at 10 m from a laser of half a degree."""


def scipy_icp(source: Points, target: Points, guess: Pose2) -> Pose2:
    """Point-to-point ICP with a SciPy tree and a closed-form fit: the baseline."""
    tree, pose = cKDTree(target), guess.as_array()
    for _ in range(50):
        moved = transform_points(pose, source)
        distance, nearest = tree.query(moved, distance_upper_bound=_MAX_DISTANCE_M)
        paired = np.isfinite(distance)
        p, q = moved[paired], target[nearest[paired]]
        p0, q0 = p.mean(axis=0), q.mean(axis=0)
        (px, py), (qx, qy) = (p - p0).T, (q - q0).T
        turn = np.arctan2(np.sum(px * qy - py * qx), np.sum(px * qx + py * qy))
        c, s = np.cos(turn), np.sin(turn)
        shift = q0 - np.array([c * p0[0] - s * p0[1], s * p0[0] + c * p0[1]])
        step = Pose2(shift[0], shift[1], turn)
        pose = (step @ Pose2.from_array(pose)).as_array()
        if np.hypot(*shift) < 1e-4 and abs(turn) < 1e-4:
            break
    return Pose2.from_array(pose)


def ours(matcher: ScanMatcher) -> Match:
    """Return one of this project's matchers."""

    def match(source: Points, target: Points, guess: Pose2) -> Pose2:
        return matcher.match(source, target, target_from_source=guess).target_from_source

    return match


def small_gicp(kind: str) -> Match:
    """small_gicp, one thread, no downsampling; planes need points at several heights."""
    import small_gicp as peer

    heights = (0.0,) if kind == "ICP" else _HEIGHTS_M

    def match(source: Points, target: Points, guess: Pose2) -> Pose2:
        result = peer.align(
            lifted(target, heights),
            lifted(source, heights),
            init_T_target_source=matrix_of(guess),
            registration_type=kind,
            downsampling_resolution=0.005,
            max_correspondence_distance=_MAX_DISTANCE_M,
            max_iterations=50,
        )
        return pose_of(result.T_target_source)

    return match


def kiss_icp() -> Match:
    """KISS-ICP's registration on flat clouds."""
    from kiss_icp.mapping import VoxelHashMap
    from kiss_icp.registration import Registration

    registration = Registration(500, 1e-4, 1)

    def match(source: Points, target: Points, guess: Pose2) -> Pose2:
        grid = VoxelHashMap(0.3, 100.0, 20)
        grid.add_points(lifted(target))
        found = registration.align_points_to_map(
            lifted(source), grid, matrix_of(guess), _MAX_DISTANCE_M, 0.1
        )
        return pose_of(found)

    return match


def open3d_icp() -> Match:
    """Open3D's point-to-point ICP."""
    import open3d

    registration = open3d.pipelines.registration

    def cloud(points: Points) -> object:
        return open3d.geometry.PointCloud(open3d.utility.Vector3dVector(lifted(points)))

    def match(source: Points, target: Points, guess: Pose2) -> Pose2:
        found = registration.registration_icp(
            cloud(source), cloud(target), _MAX_DISTANCE_M, matrix_of(guess)
        )
        return pose_of(found.transformation)

    return match


CONTESTANTS: dict[str, Callable[[], Match]] = {
    "baseline: scipy point-to-point ICP": lambda: scipy_icp,
    "slarm-graph likelihood": lambda: ours(LikelihoodMatcher()),
    "slarm-graph correlative": lambda: ours(CorrelativeMatcher()),
    "slarm-graph point-to-line ICP": lambda: ours(IcpMatcher()),
    "small_gicp ICP": lambda: small_gicp("ICP"),
    "small_gicp PLANE_ICP, three heights": lambda: small_gicp("PLANE_ICP"),
    "kiss-icp registration": kiss_icp,
    "open3d ICP": open3d_icp,
}


def lifted(points: Points, heights: tuple[float, ...] = (0.0,)) -> Points:
    """Copy points (K, 2) to heights, (K * H, 3)."""
    return np.vstack([np.column_stack([points, np.full(len(points), z)]) for z in heights])


def matrix_of(pose: Pose2) -> np.ndarray:
    """Return a pose as a (4, 4) matrix."""
    matrix = np.eye(4)
    c, s = np.cos(pose.theta), np.sin(pose.theta)
    matrix[:2, :2] = [[c, -s], [s, c]]
    matrix[:2, 3] = [pose.x, pose.y]
    return matrix


def pose_of(matrix: np.ndarray) -> Pose2:
    """Return the planar pose of a (4, 4) matrix."""
    return Pose2(matrix[0, 3], matrix[1, 3], np.arctan2(matrix[1, 0], matrix[0, 0]))


def pairs_of(
    readings: list[Reading], relations_path: Path, count: int
) -> list[tuple[Reading, Reading, Pose2]]:
    """Pick relations between two recorded scans of one pass, 0.2 to 1.2 m apart."""
    stamps = np.array([r.stamp_ns for r in readings])
    relations = read_relations(relations_path)
    pairs = []
    for (first_ns, second_ns), truth in zip(
        relations.stamps_ns, relations.first_from_second, strict=True
    ):
        a, b = (int(np.argmin(np.abs(stamps - s))) for s in (first_ns, second_ns))
        off_ns = max(abs(stamps[a] - first_ns), abs(stamps[b] - second_ns))
        is_near = 0.2 < np.hypot(truth[0], truth[1]) < 1.2 and abs(first_ns - second_ns) < 20e9
        has_odometry = None not in (readings[a].odom_from_robot, readings[b].odom_from_robot)
        if is_near and has_odometry and off_ns < 5e6:
            pairs.append((readings[a], readings[b], Pose2.from_array(truth)))
    order = np.random.default_rng(0).permutation(len(pairs))[:count]
    return [pairs[k] for k in order]


def laser_motion(target: Reading, source: Reading) -> Pose2:
    """Return the odometry between two readings, for the laser."""
    assert target.odom_from_robot is not None
    assert source.odom_from_robot is not None
    motion = target.odom_from_robot.between(source.odom_from_robot)
    mount = target.scan.robot_from_laser
    return mount.inverse() @ motion @ mount


def compare_pairs(pairs: list[tuple[Reading, Reading, Pose2]]) -> None:
    """Print the table of pairs."""
    print("| matcher | mean [m] | rotation [deg] | 95 % [m] | ms per pair | speed |")
    print("|---|---|---|---|---|---|")
    baseline_s = float("nan")
    config = FrontendConfig()
    for name, make in CONTESTANTS.items():
        try:
            match = make()
            errors, times = [], []
            for target, source, truth in pairs:
                mount = target.scan.robot_from_laser.inverse().as_array()
                scans = [points_for_matching(r.scan, config) for r in (source, target)]
                flat = [transform_points(mount, points) for points in scans]
                started = time.process_time()
                found = match(flat[0], flat[1], laser_motion(target, source))
                times.append(time.process_time() - started)
                errors.append(truth.between(found).as_array())
        except Exception as problem:
            print(f"| {name} | failed: {type(problem).__name__}: {problem} | | | | |")
            continue
        error, cost_s = np.array(errors), float(np.median(times))
        baseline_s = cost_s if name.startswith("baseline") else baseline_s
        away = np.hypot(error[:, 0], error[:, 1])
        print(
            f"| {name} | {away.mean():.4f} | {np.degrees(np.abs(error[:, 2]).mean()):.3f}"
            f" | {np.percentile(away, 95):.3f} | {1e3 * cost_s:.2f} | {baseline_s / cost_s:.1f} x |"
        )


def compare_following(readings: list[Reading]) -> None:
    """Print what following every scan costs, beside the baseline on the same scans."""
    started = time.process_time()
    tracker = ScanTracker(FrontendConfig())
    for reading in readings[:50]:
        tracker.track(reading)
    costs_s = []
    for reading in readings[50:]:
        started = time.process_time()
        tracker.track(reading)
        costs_s.append(time.process_time() - started)
    baseline_s = []
    for before, now in list(pairwise(readings[50:]))[::10]:
        scans = [points_for_matching(r.scan, FrontendConfig()) for r in (now, before)]
        started = time.process_time()
        scipy_icp(scans[0], scans[1], Pose2())
        baseline_s.append(time.process_time() - started)
    mean_ms, base_ms = 1e3 * float(np.mean(costs_s)), 1e3 * float(np.mean(baseline_s))
    worst_ms = 1e3 * max(costs_s)
    print("\n| every scan | mean ms | worst ms | against the baseline |\n|---|---|---|---|")
    print(f"| slarm-graph tracker | {mean_ms:.3f} | {worst_ms:.1f} | {base_ms / mean_ms:.1f} x |")
    print(f"| baseline: scan to scan | {base_ms:.3f} | | 1.0 x |")


def main() -> None:
    """Run the comparison."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("recording", type=Path)
    parser.add_argument("--pairs", type=int, default=400)
    parser.add_argument("--scans", type=int, default=4000)
    arguments = parser.parse_args()
    readings = list(open_source(arguments.recording, SourceConfig()))
    stem = arguments.recording.name.split(".")[0]
    relations = arguments.recording.parent / f"{stem}.relations"
    compare_pairs(pairs_of(readings, relations, arguments.pairs))
    compare_following(readings[: arguments.scans])


if __name__ == "__main__":
    main()
