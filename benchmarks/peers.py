# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Side by side with what a user could install instead, on the Freiburg relations.

    python benchmarks/peers.py RECORDING... [--only NAME,NAME] [--timeout 900]

Each RECORDING is read once per contestant in a process of its own; `<stem>.relations` beside it is
the truth. Peers come from PyPI (`pip install kiss-icp yag-slam`); one that is missing or fails is
shown so. Time is the contestant's alone, without reading the recording; poses between the scans a
peer processed are filled with odometry, its residual spread in time.
"""

from __future__ import annotations

import argparse
import multiprocessing as mp
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from slarm_graph import backends
from slarm_graph.config import RunConfig, SourceConfig
from slarm_graph.eval.relations import read_relations, relation_errors
from slarm_graph.frontends.recordings.sources import open_source
from slarm_graph.geometry import between, compose
from slarm_graph.readings import Reading
from slarm_graph.trajectory import Trajectory

Contestant = Callable[[list[Reading]], Trajectory]


@dataclass(frozen=True)
class Score:
    """What one contestant did on one recording."""

    contestant: str
    recording: str
    scans: int = 0
    wall_s: float = float("nan")
    translation_m: float = float("nan")
    median_m: float = float("nan")
    rotation_deg: float = float("nan")
    failure: str = ""

    def row(self) -> str:
        """Return the score as a row of a Markdown table."""
        if self.failure:
            return f"| {self.recording} | {self.contestant} | failed: {self.failure} | | | | |"
        return (
            f"| {self.recording} | {self.contestant} | {self.translation_m:.4f}"
            f" | {self.median_m:.4f} | {self.rotation_deg:.3f} | {self.wall_s:.1f}"
            f" | {1e3 * self.wall_s / self.scans:.2f} |"
        )


HEADER = (
    "| recording | system | mean [m] | median [m] | rotation [deg] | wall [s] | ms/scan |\n"
    "|---|---|---|---|---|---|---|"
)


def ours(name: str) -> Contestant:
    """Run one of this project's backends with its default configuration."""

    def run(readings: list[Reading]) -> Trajectory:
        config = RunConfig(backend=name)
        backend = backends.make(name, config, np.random.default_rng(config.seed), lambda _: None)
        for reading in readings:
            backend.update(reading)
        return backend.result().trajectory

    return run


def kiss_icp(readings: list[Reading]) -> Trajectory:
    """KISS-ICP on flat clouds, without odometry, its voxel size for indoor ranges."""
    from kiss_icp.config import KISSConfig
    from kiss_icp.kiss_icp import KissICP

    config = KISSConfig()
    config.data.max_range = 30.0
    config.data.deskew = False
    config.mapping.voxel_size = 0.3
    odometry = KissICP(config)
    poses = []
    for reading in readings:
        points = reading.scan.points_m()
        # Copies at other heights keep the tilt observable.
        cloud = [np.column_stack([points, np.full(len(points), z)]) for z in (-0.5, 0.0, 0.5)]
        odometry.register_frame(np.concatenate(cloud), np.zeros(3 * len(points)))
        pose = odometry.last_pose
        poses.append([pose[0, 3], pose[1, 3], np.arctan2(pose[1, 0], pose[0, 0])])
    return Trajectory(stamps_of(readings), np.array(poses))


def yag_slam(readings: list[Reading]) -> Trajectory:
    """yag-slam (Karto's scan matcher and loop closing) at every 0.2 m or 0.2 rad."""
    from yag_slam.graph_slam import GraphSlam
    from yag_slam.models import LocalizedRangeScan
    from yag_slam.scan_matching import Scan2DMatcherCpp

    readings = with_odometry(readings)
    slam = GraphSlam(Scan2DMatcherCpp({}), Scan2DMatcherCpp({}, loop=True))
    odometry = odometry_of(readings)
    kept = moved_enough(odometry, 0.2, 0.2)
    for k in kept:
        scan = readings[k].scan
        laser = compose(odometry[k], scan.robot_from_laser.as_array())
        last = scan.angle_min_rad + scan.angle_increment_rad * (len(scan.ranges_m) - 1)
        ranges = np.where(scan.is_return(), scan.ranges_m, 1e3)
        slam.process_scan(
            LocalizedRangeScan(
                ranges.tolist(), scan.angle_min_rad, last, scan.angle_increment_rad,
                scan.range_min_m, scan.range_max_m, 20.0, *laser,
            )
        )  # fmt: skip
    corrected = [vertex.obj.corrected_pose for vertex in slam.graph.vertices]
    lasers = np.array([[p.x, p.y, p.euler[-1]] for p in corrected])
    laser_from_robot = readings[0].scan.robot_from_laser.inverse().as_array()
    return filled(readings, kept, compose(lasers, laser_from_robot))


def stamps_of(readings: list[Reading]) -> np.ndarray:
    """Return the stamps (N,) [ns]."""
    return np.array([reading.stamp_ns for reading in readings], dtype=np.int64)


def with_odometry(readings: list[Reading]) -> list[Reading]:
    """Return the readings that a peer which needs odometry can use; none at all is an error."""
    known = [reading for reading in readings if reading.odom_from_robot is not None]
    if not known:
        raise ValueError("the recording has no odometry")
    return known


def odometry_of(readings: list[Reading]) -> np.ndarray:
    """Return the odometry (N, 3) of readings that all have it."""
    return np.array([r.odom_from_robot.as_array() for r in readings if r.odom_from_robot])


def moved_enough(poses: np.ndarray, step_m: float, step_rad: float) -> list[int]:
    """Return the indices at which the robot has moved on since the last one kept."""
    kept = [0]
    for k in range(1, len(poses)):
        x, y, turn = between(poses[kept[-1]], poses[k])
        if np.hypot(x, y) >= step_m or abs(turn) >= step_rad:
            kept.append(k)
    return kept


def filled(readings: list[Reading], kept: list[int], poses: np.ndarray) -> Trajectory:
    """Fill the scans between processed ones with odometry, its residual spread in time."""
    odometry, stamps = odometry_of(readings), stamps_of(readings)
    # The correction map_from_odom moves smoothly from one processed scan to the next.
    correction = compose(poses, inverse_rows(odometry[kept]))
    corrections = Trajectory(stamps[kept], correction).at(stamps)
    return Trajectory(stamps, compose(corrections, odometry))


def inverse_rows(poses: np.ndarray) -> np.ndarray:
    """Return the inverse of every pose (N, 3)."""
    return between(poses, np.zeros(3))


CONTESTANTS: dict[str, Contestant] = {
    "pose_graph": ours("pose_graph"),
    "gmapping": ours("gmapping"),
    "odometry": ours("odometry"),
    "kiss-icp": kiss_icp,
    "yag-slam": yag_slam,
}


def score(contestant: str, recording: Path) -> Score:
    """Run one contestant on one recording in this process."""
    readings = list(open_source([recording], SourceConfig()))
    warm_up = readings[:200]
    CONTESTANTS[contestant](warm_up)
    start = time.perf_counter()
    trajectory = CONTESTANTS[contestant](readings)
    wall_s = time.perf_counter() - start
    relations = read_relations(recording.with_suffix(".relations"))
    errors = relation_errors(relations, trajectory, readings[0].scan.robot_from_laser)
    return Score(
        contestant,
        recording.stem,
        len(readings),
        wall_s,
        float(errors.translation_m.mean()),
        float(np.median(errors.translation_m)),
        float(np.degrees(errors.rotation_rad).mean()),
    )


def _report(contestant: str, recording: Path, queue: mp.Queue[Score]) -> None:
    try:
        queue.put(score(contestant, recording))
    except Exception as error:
        message = str(error).splitlines()[0][:80] if str(error) else type(error).__name__
        queue.put(Score(contestant, recording.stem, failure=message))


def guarded(contestant: str, recording: Path, timeout_s: float) -> Score:
    """Run one contestant in a child process; whatever it does ends as a score."""
    context = mp.get_context("spawn")
    queue: mp.Queue[Score] = context.Queue()
    child = context.Process(target=_report, args=(contestant, recording, queue))
    child.start()
    try:
        return queue.get(timeout=timeout_s)
    except Exception:
        return Score(contestant, recording.stem, failure=f"no result within {timeout_s:.0f} s")
    finally:
        child.kill()
        child.join()


def main() -> None:
    """Print a Markdown table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("recordings", nargs="+", type=Path)
    parser.add_argument("--only", default=",".join(CONTESTANTS))
    parser.add_argument("--timeout", type=float, default=900.0)
    arguments = parser.parse_args()
    print(HEADER)
    for recording in arguments.recordings:
        for contestant in arguments.only.split(","):
            print(guarded(contestant, recording, arguments.timeout).row())
            sys.stdout.flush()


if __name__ == "__main__":
    main()
