# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Consistency of a trajectory, of a run or a file, with the recording it was made from."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from slarm_graph.backend import SlamResult, position_sds_m
from slarm_graph.config import SimulationConfig, SourceConfig
from slarm_graph.consistency import Contradictions, contradictions
from slarm_graph.counts import count_of
from slarm_graph.errors import BadInput
from slarm_graph.files.trajectories import read_trajectory, trajectory_file
from slarm_graph.frontends.recordings.sources import existing_paths, open_source
from slarm_graph.reading_log import ReadingLog
from slarm_graph.trajectory import Trajectory

_LEAST_SHARE = 0.5
"""Least share of a recording's time that its trajectory covers; less is another recording's."""

_SAME_NS = 5_000_000
"""Largest difference of the stamps of a scan and its pose [ns]; a scan takes 13 ms and more."""


def check_slam(log: ReadingLog, slam: SlamResult) -> Contradictions:
    """Check the consistency of a SLAM result with the log it was made from.

    Covariances count where they are those of a pose graph, learned from its redundancy. Second
    moments of particles are about one other path, and hold how its first heading differs.
    """
    sds_m = None if slam.pose_graph is None else position_sds_m(slam)
    odometry = log.odometry_poses()
    return contradictions(log.scans, slam.trajectory, odometry, position_sds_m=sds_m)


def check_trajectory(log: ReadingLog, trajectory: Trajectory) -> Contradictions:
    """Check the consistency of a trajectory that has a pose for every reading of a log."""
    return contradictions(log.scans, trajectory, log.odometry_poses())


def check_trajectory_file(
    recording: Sequence[Path], trajectory: Path, config: SourceConfig
) -> tuple[Contradictions, tuple[str, ...]]:
    """Check the consistency of a trajectory file, or a run folder's, with its recording.

    Returns
    -------
    result : Contradictions
    notices : tuple of str
        What was corrected in the recording, and how many scans are without a pose.

    Raises
    ------
    BadInput
        When a file cannot be read, or they are not of the same time.
    """
    path = trajectory_file(trajectory)
    poses = _poses(path)
    source = open_source(existing_paths(recording), config, SimulationConfig())
    readings = list(source)
    stamps_ns = np.array([reading.stamp_ns for reading in readings], dtype=np.int64)
    log = ReadingLog()
    for index in np.flatnonzero(_with_pose(stamps_ns, poses.stamps_ns)):
        log.append(readings[index])
    if not len(log) or np.ptp(log.stamps_ns) < _LEAST_SHARE * np.ptp(stamps_ns):
        raise BadInput(
            f"{path}: only {len(log)} of {count_of(len(readings), 'scan')} of {recording[0]} within"
            " its time; is it of this recording, with the same clock?"
        )
    left_out = len(readings) - len(log)
    note = (f"{left_out} of {count_of(len(readings), 'scan')} without a pose",) if left_out else ()
    result = check_trajectory(log, Trajectory(log.stamps_ns, poses.at(log.stamps_ns)))
    return result, (*source.info().notices, *note)


def _poses(path: Path) -> Trajectory:
    """Read a trajectory; of a recording say that the arguments are in the wrong order."""
    try:
        return read_trajectory(path)
    except BadInput:
        if _is_recording(path):
            problem = f"{path} is a recording; the trajectory comes last: SOURCE... TRAJECTORY"
            raise BadInput(problem) from None
        raise


def _is_recording(path: Path) -> bool:
    try:
        open_source([path])
    except BadInput:
        return False
    return True


def _with_pose(stamps_ns: NDArray[np.int64], known_ns: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return which scans (N,) have a pose: those at keyframes' stamps, else all within the time."""
    within = (stamps_ns >= known_ns[0] - _SAME_NS) & (stamps_ns <= known_ns[-1] + _SAME_NS)
    after = np.clip(np.searchsorted(known_ns, stamps_ns), 1, max(len(known_ns) - 1, 1))
    around = np.stack([known_ns[after - 1], known_ns[np.minimum(after, len(known_ns) - 1)]])
    exact = np.abs(around - stamps_ns).min(axis=0) <= _SAME_NS
    return np.asarray(within & exact if exact.sum() >= 0.5 * len(known_ns) else within)
