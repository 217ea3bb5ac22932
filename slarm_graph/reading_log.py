# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The one log of what a run has read: backends, maps, closed loop, report and resume look here."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from slarm_graph.counts import count_of
from slarm_graph.geometry import Floats, Pose2
from slarm_graph.readings import LaserScan, Reading, ScanStatus, Signal, Source
from slarm_graph.stamps import ns_to_seconds
from slarm_graph.trajectory import Trajectory

_NO_POSE = (np.nan, np.nan, np.nan)


class ReadingLog:
    """Every reading that a backend has taken; it only ever grows.

    `problem` says why it ended before the source did, and is empty when it did not; `interrupted`
    is whether that was the user's wish.
    """

    def __init__(self) -> None:
        self._stamps_ns: list[int] = []
        self._scans: list[LaserScan] = []
        self._odometry: list[tuple[float, float, float]] = []
        self._signals: list[tuple[int, Signal]] = []
        self._statuses: tuple[ScanStatus, ...] | None = None
        self.problem = ""
        self.interrupted = False

    def __len__(self) -> int:
        return len(self._stamps_ns)

    def append(self, reading: Reading) -> None:
        """Note a reading that a backend has taken."""
        pose = reading.odom_from_robot
        self._stamps_ns.append(reading.stamp_ns)
        self._scans.append(reading.scan)
        self._odometry.append((pose.x, pose.y, pose.theta) if pose else _NO_POSE)
        self._signals += [(reading.stamp_ns, signal) for signal in reading.signals]

    @property
    def scans(self) -> Sequence[LaserScan]:
        """The scan of every reading, N of them."""
        return self._scans

    @property
    def stamps_ns(self) -> NDArray[np.int64]:
        """Of every reading, (N,) [ns]."""
        return np.array(self._stamps_ns, dtype=np.int64)

    def latest_stamps_ns(self, count: int) -> NDArray[np.int64]:
        """Return the stamps of the latest readings, at most `count` of them [ns]."""
        return np.array(self._stamps_ns[-count:], dtype=np.int64)

    @property
    def signals(self) -> Sequence[tuple[int, Signal]]:
        """Signal strengths that came with readings, with their stamps [ns]."""
        return self._signals

    @property
    def robot_from_laser(self) -> Pose2:
        """Of the latest scan [m, m, rad]."""
        return self._scans[-1].robot_from_laser if self._scans else Pose2()

    @property
    def driven_s(self) -> float:
        """Time from the first reading to the latest [s]."""
        return (self._stamps_ns[-1] - self._stamps_ns[0]) * 1e-9 if self._stamps_ns else 0.0

    def odometry_poses(self) -> Floats:
        """Return `odom_from_robot` of all readings (N, 3) [m, m, rad]; nan where there was none."""
        return np.array(self._odometry, dtype=np.float64).reshape(-1, 3)

    def odometry(self) -> Trajectory | None:
        """Return `odom_from_robot` of the readings that had one."""
        poses = self.odometry_poses()
        known = np.isfinite(poses).all(axis=1)
        return Trajectory(self.stamps_ns[known], poses[known]) if known.any() else None

    def statuses(self) -> tuple[ScanStatus, ...]:
        """Return every scan there was, used or not; without a source's word all were used."""
        if self._statuses is not None:
            return self._statuses
        return tuple(ScanStatus(stamp_ns) for stamp_ns in self._stamps_ns)

    def take_statuses(self, source: Source) -> None:
        """Note what became of every scan that a source met."""
        self._statuses = source.scan_statuses()

    def stop(self, how: str, why: str = "", *, by_user: bool = False) -> None:
        """Note that it ended here, before the source did."""
        at = f" (t = {ns_to_seconds(self._stamps_ns[-1])} s)" if self._stamps_ns else ""
        self.problem = f"{how} after {count_of(len(self), 'scan')}{at}" + (
            f": {why}" if why else ""
        )
        self.interrupted = by_user
