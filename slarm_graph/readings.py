# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""What a sensor said: one laser scan, and the odometry at the same instant."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from slarm_graph.geometry import Floats, Pose2, transform_points
from slarm_graph.trajectory import Trajectory


@dataclass(frozen=True, slots=True)
class LaserScan:
    """One sweep of a planar laser, with REP-117 ranges.

    Parameters
    ----------
    ranges_m : (B,) float32 or float64 [m]
        +inf: no return within range; -inf: too close; nan: invalid, says nothing.
    angle_min_rad, angle_increment_rad : float
        Beam i points along `angle_min_rad + i * angle_increment_rad` in the laser's frame. The
        increment is negative for a laser that turns clockwise seen from above, which is also how
        a laser mounted upside down appears.
    range_min_m, range_max_m : float
        A range is a return when it lies between the two.
    robot_from_laser : Pose2
        The laser's pose in the robot's frame [m, m, rad].
    time_increment_s : float
        Time between neighbouring beams [s]; 0 when unknown. The reading's stamp is beam 0's.
    """

    ranges_m: NDArray[np.floating]
    angle_min_rad: float
    angle_increment_rad: float
    range_min_m: float
    range_max_m: float
    robot_from_laser: Pose2 = field(default_factory=Pose2)
    time_increment_s: float = 0.0

    def angles_rad(self) -> Floats:
        """Direction of every beam in the laser's frame, (B,) [rad]."""
        beams = np.arange(len(self.ranges_m), dtype=np.float64)
        return np.asarray(self.angle_min_rad + self.angle_increment_rad * beams)

    def is_return(self) -> NDArray[np.bool_]:
        """Which beams came back from something, (B,)."""
        return (self.ranges_m >= self.range_min_m) & (self.ranges_m <= self.range_max_m)

    def is_clear(self) -> NDArray[np.bool_]:
        """Which beams found nothing within range (+inf, REP-117), (B,)."""
        return np.isposinf(self.ranges_m)

    def points_m(self) -> Floats:
        """End points of the returns in the robot's frame, (M, 2) [m]."""
        returns = self.is_return()
        ranges, angles = self.ranges_m[returns].astype(np.float64), self.angles_rad()[returns]
        in_laser = np.stack([ranges * np.cos(angles), ranges * np.sin(angles)], axis=-1)
        return transform_points(self.robot_from_laser.as_array(), in_laser)


@dataclass(frozen=True, slots=True)
class Signal:
    """How strong an access point was heard; nan: listened for and not heard [dBm]."""

    access_point: str
    rss_dbm: float


@dataclass(frozen=True, slots=True)
class Reading:
    """A scan and the odometry pose at its stamp.

    Parameters
    ----------
    stamp_ns : int
        Acquisition time of the scan's first beam [ns since the epoch].
    scan : LaserScan
    odom_from_robot : Pose2 or None
        Wheel odometry interpolated at the stamp; None where there is none.
    signals : tuple of Signal
        Signal strength at the stamp, where the source hears access points.
    """

    stamp_ns: int
    scan: LaserScan
    odom_from_robot: Pose2 | None = None
    signals: tuple[Signal, ...] = ()


@dataclass(frozen=True, slots=True)
class ScanStatus:
    """What became of one recorded scan: `reason` is empty when it was used."""

    stamp_ns: int
    reason: str = ""


@dataclass(frozen=True, slots=True)
class SourceInfo:
    """What a source knows of itself before and after it is read.

    Parameters
    ----------
    description : str
        Where it comes from, in words for people.
    scan_count : int or None
        Number of scans, where known in advance (for progress).
    notices : tuple of str
        What a user should know: choices made, defects found and mended.
    truth : Trajectory or None
        `map_from_robot` at every reading so far, where it is known: in a world, whose frame the
        map then takes.
    """

    description: str
    scan_count: int | None = None
    notices: tuple[str, ...] = ()
    truth: Trajectory | None = None


class Source(Protocol):
    """Anything that yields readings in time order."""

    def info(self) -> SourceInfo:
        """Describe the source; complete once it has been iterated."""
        ...

    def scan_statuses(self) -> tuple[ScanStatus, ...]:
        """Return every scan met so far with its status; complete once iterated."""
        ...

    def __iter__(self) -> Iterator[Reading]:
        """Yield readings, strictly increasing in stamp."""
        ...
