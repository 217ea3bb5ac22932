# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether true relations are true: those that a trajectory misses, judged by what the scans show.

    python benchmarks/check_relations.py RECORDING RELATIONS [TRAJECTORY.tum] [--off-m 0.3]

Around both instants of a relation the scans of ten seconds are drawn along the trajectory, which is
sure over so short a way. How walls and free space of the two drawings contradict each other is
weighed where the relation puts the one in the other, and where the trajectory does. Without a
trajectory the pose graph makes one.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from slarm_graph.app.calls import run_backend
from slarm_graph.config import RunConfig
from slarm_graph.consistency import View, evidence_against, view_of
from slarm_graph.eval.relations import Relations, read_relations, relation_errors
from slarm_graph.files.trajectories import read_trajectory
from slarm_graph.frontends.recordings.sources import open_source
from slarm_graph.geometry import Floats, Pose2, between, transform_points
from slarm_graph.readings import Reading
from slarm_graph.trajectory import Trajectory

_AROUND_NS = 10_000_000_000
"""Time to either side that is drawn; with 5 s or 20 s the counts of fr-clinic move by under 5 %."""
_SURE_NAT = 5.0
"""Log odds from which the one is called better: 150 to 1, as a closure needs to be believed."""


def drawn(readings: Sequence[Reading], path: Trajectory, base: Floats, at_ns: int) -> View:
    """What was seen around an instant, in a frame (3,) of the map."""
    near = [r for r in readings if abs(r.stamp_ns - at_ns) <= _AROUND_NS]
    lasers = path.moved_to(near[0].scan.robot_from_laser).at(np.array([r.stamp_ns for r in near]))
    poses = between(base, lasers)
    seen = [transform_points(p, r.scan.points_m()) for p, r in zip(poses, near, strict=True)]
    return view_of(seen, poses[:, :2])


def judged(
    readings: Sequence[Reading], told: Relations, path: Trajectory, point: Pose2, off_m: float
) -> str:
    """Say how the scans judge the relations, of a point of the robot, that its path misses."""
    miss_m = relation_errors(told, path, point).translation_m
    points, far = path.moved_to(point), np.flatnonzero(miss_m > off_m)
    better = []
    for k in far:
        a, b = points.at(told.stamps_ns[k])
        ends = zip((a, b), told.stamps_ns[k].tolist(), strict=True)
        one, other = (drawn(readings, path, base, at_ns) for base, at_ns in ends)
        said = evidence_against(other, one, told.first_from_second[k])
        better.append(said - evidence_against(other, one, between(a, b)))
    wrong, right = np.array(better) > _SURE_NAT, np.array(better) < -_SURE_NAT
    kept = np.delete(miss_m, far[wrong])
    return (
        f"{len(miss_m)} relations, {miss_m.mean():.4f} m; {len(far)} off by more than {off_m} m: by"
        f" the scans the trajectory is right in {wrong.sum()}, the relation in {right.sum()}, no"
        f" telling in {len(far) - wrong.sum() - right.sum()}; {kept.mean():.4f} m without the first"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recording", type=Path)
    parser.add_argument("relations", type=Path)
    parser.add_argument("trajectory", type=Path, nargs="?")
    parser.add_argument("--off-m", type=float, default=0.3)
    parser.add_argument("--at-m", type=float, help="point of the robot they are about, ahead of it")
    asked = parser.parse_args()
    readings = tuple(open_source([asked.recording]))
    if asked.trajectory:
        path = read_trajectory(asked.trajectory)
    else:
        path = run_backend(readings, config=RunConfig(backend="pose_graph")).trajectory
    laser = readings[0].scan.robot_from_laser
    point = laser if asked.at_m is None else Pose2(asked.at_m)
    print(judged(readings, read_relations(asked.relations), path, point, asked.off_m))


if __name__ == "__main__":
    main()
