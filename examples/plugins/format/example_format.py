# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""A recording format of one's own: a CSV file with a scan in every line.

slarm convert your.bag your.scans.csv; slarm run your.scans.csv --set csv_scans.range_max_m=12
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import ClassVar

import numpy as np
from pydantic import Field

from slarm_graph import (
    BadInput,
    Finding,
    LaserScan,
    Pose2,
    Reading,
    ScanStatus,
    SourceConfig,
    SourceInfo,
    Stage,
)

HEADER = "# slarm example scans: stamp_ns, x_m, y_m, theta_rad, angle_min_rad, step_rad, ranges_m"


class CsvScansConfig(Stage):
    """The recording format `csv_scans`."""

    range_max_m: float = Field(default=30.0, gt=0)
    """Ranges beyond are no returns."""


class CsvScans:
    """Scans with their odometry as lines of numbers."""

    settings: ClassVar[type[Stage]] = CsvScansConfig
    endings = (".scans.csv",)

    def __init__(self, settings: CsvScansConfig) -> None:
        self._range_max_m = settings.range_max_m

    def sniff(self, paths: Sequence[Path]) -> bool:
        """Look at the first line."""
        if not paths[0].is_file():
            return False
        with paths[0].open("rb") as file:
            return file.readline(len(HEADER) + 2).strip() == HEADER.encode()

    def open(self, paths: Sequence[Path], config: SourceConfig) -> CsvSource:
        """Open one file."""
        if len(paths) > 1:
            raise BadInput(f"{paths[1]}: only one file of scans at a time can be read")
        return CsvSource(paths[0], self._range_max_m)

    def check(self, paths: Sequence[Path], config: SourceConfig) -> Iterable[Finding]:
        """Count what is out of range."""
        scans = [reading.scan for reading in self.open(paths, config)]
        far = sum(int((scan.ranges_m > self._range_max_m).sum()) for scan in scans)
        if far:
            yield Finding("note", "ranges", f"{far} lie beyond {self._range_max_m:g} m")

    def write(self, destination: Path, readings: Iterable[Reading]) -> int:
        """Write a line per reading; the laser is taken to be at the robot's centre."""
        lines = [HEADER]
        for r in readings:
            pose, scan = r.odom_from_robot or Pose2(), r.scan
            head = (pose.x, pose.y, pose.theta, scan.angle_min_rad, scan.angle_increment_rad)
            lines.append(", ".join(map(str, (r.stamp_ns, *head, *scan.ranges_m.tolist()))))
        destination.write_text("\n".join(lines) + "\n")
        return len(lines) - 1


class CsvSource:
    """The readings of one file."""

    def __init__(self, path: Path, range_max_m: float) -> None:
        self._path, self._range_max_m = path, range_max_m
        self._met: list[ScanStatus] = []

    def info(self) -> SourceInfo:
        """Describe the file."""
        return SourceInfo(f"CSV of scans {self._path.name}")

    def scan_statuses(self) -> tuple[ScanStatus, ...]:
        """Return what became of every scan."""
        return tuple(self._met)

    def __iter__(self) -> Iterator[Reading]:
        """Yield the readings of all lines."""
        self._met = []
        for number, line in enumerate(self._path.read_text().splitlines()[1:], start=2):
            stamp_ns, *words = line.split(",")
            try:
                x, y, theta, angle, step, *ranges_m = map(float, words)
            except ValueError:
                raise BadInput(f"{self._path}:{number}: expected numbers with commas") from None
            self._met.append(ScanStatus(int(stamp_ns)))
            scan = LaserScan(np.array(ranges_m), angle, step, 0.01, self._range_max_m)
            yield Reading(int(stamp_ns), scan, Pose2(x, y, theta))
