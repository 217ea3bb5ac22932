# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Scans of a spinning lidar as text: a time, angles [mdeg] and ranges [cm] in brackets.

As written by Kolakowski's robot (Sensors 21:6270): every scan has its own angles with gaps
where nothing came back; it becomes a scan of even beams. `NAME_motion.txt` beside `NAME_scan.txt`
holds the commands that the robot was given, which make an odometry of sorts.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from slarm_graph.config import SourceConfig, Stage
from slarm_graph.errors import BadInput
from slarm_graph.frontends.recordings.findings import Finding
from slarm_graph.frontends.recordings.messages import ScanBlock
from slarm_graph.frontends.recordings.mounting import Mounting
from slarm_graph.frontends.recordings.odometry import OdometryPath, sorted_path
from slarm_graph.frontends.recordings.packed import Ints
from slarm_graph.frontends.recordings.recorded_source import RecordedSource, fixed
from slarm_graph.frontends.recordings.scan_table import ScanTable
from slarm_graph.geometry import Floats
from slarm_graph.readings import Reading
from slarm_graph.stamps import seconds_to_ns

_SCAN = re.compile(r"(\d+\.\d+)\s*\[([\d\s]*)\]\s*\[([\d\s]*)\]")
_START = re.compile(r"\s*\d+\.\d+\s*\[\s*\d+\s+\d+")

BEAMS = 720
"""Half a degree each, finer than the 0.85 degrees between two returns: none meets another."""

RANGE_MIN_M, RANGE_MAX_M = 0.15, 6.0
"""Of the RPLIDAR A1 (data sheet); it writes 1 cm, or more than 6 m, for what it did not see."""

SPEED_M_S, TURN_RATE_RAD_S = 0.287, 0.96
"""Of this robot on command, by the medians over its calibration drive (poses in
`calibration_df.csv`); 20 % off is made good by scan matching."""

COMMAND_DELAY_S = 0.22
"""From a command to its motion in the scans: where turning on command and turning from scan to
scan correlate best over the calibration drive (0.90; 0.62 without)."""

_RATES = {
    "forward": (SPEED_M_S, 0.0),
    "reverse": (-SPEED_M_S, 0.0),
    "left": (0.0, TURN_RATE_RAD_S),
    "right": (0.0, -TURN_RATE_RAD_S),
    "stop": (0.0, 0.0),
}
"""Speed and turn rate that each command means [m/s, rad/s]."""

SWEEP_S = 0.21
"""420 returns at the lidar's 2000 samples a second (RPLIDAR A1 data sheet)."""

_CM, _MDEG = 0.01, np.pi / 180_000.0
"""Units of the file in metres and radians: centimetres and thousandths of a degree."""


class LidarText:
    """Scans of a spinning lidar as text, with the robot's motion commands beside them."""

    settings = Stage
    endings: tuple[str, ...] = ()

    def __init__(self, settings: Stage) -> None:
        del settings

    def sniff(self, paths: Sequence[Path]) -> bool:
        """Whether it is one file that begins with such a scan."""
        return len(paths) == 1 and looks_like_lidar_text(paths[0])

    def open(self, paths: Sequence[Path], config: SourceConfig) -> RecordedSource:
        """Open the log."""
        return open_lidar_text(paths[0], config)

    def check(self, paths: Sequence[Path], config: SourceConfig) -> Iterable[Finding]:
        """Return no findings besides errors of `open`."""
        return ()

    def write(self, destination: Path, readings: Iterable[Reading]) -> int:
        """Refuse: nothing is written in this format."""
        raise BadInput(f"{destination}: logs of lidar text are read, not written")


def looks_like_lidar_text(path: Path) -> bool:
    """Whether a file begins with such a scan."""
    try:
        with path.open("rb") as file:
            return _START.match(file.read(200).decode("ascii")) is not None
    except (OSError, UnicodeDecodeError):
        return False


def open_lidar_text(path: Path, config: SourceConfig) -> RecordedSource:
    """Open a log of scans, with the motion commands beside it where there are any.

    Raises
    ------
    BadInput
        When no scan can be read.
    """
    found = _SCAN.findall(path.read_text("ascii", errors="replace"))
    if not found:
        raise BadInput(f"{path} holds no scan: a time, then [angles] and [ranges]")
    ranges = np.full((len(found), BEAMS), np.nan, dtype=np.float32)
    stamps = np.empty(len(found), dtype=np.int64)
    for row, (stamp, angles, distances) in enumerate(found):
        # It is written when the sweep is complete; a reading's stamp is that of its first beam.
        stamps[row] = seconds_to_ns(stamp) - round(SWEEP_S * 1e9)
        _fill(ranges[row], np.array(angles.split(), float), np.array(distances.split(), float))
    limits = np.zeros((len(found), 7))
    step = 2.0 * np.pi / BEAMS
    limits[:, :5] = 0.0, 2.0 * np.pi - step, step, SWEEP_S / BEAMS, SWEEP_S
    limits[:, 5:] = RANGE_MIN_M, RANGE_MAX_M
    order = np.arange(len(found))
    table = ScanTable([ScanBlock(stamps, stamps, order, limits, ranges, "laser")])

    motion = path.with_name(path.name.replace("_scan", "_motion"))
    odometry, notices = None, ["no motion commands beside the scans: motion comes from these alone"]
    if config.odom != "none" and motion != path and motion.is_file():
        odometry = commanded_path(motion, stamps)
        notices = [f"odometry is dead reckoning of the commands in {motion.name}"]

    return RecordedSource(
        table,
        odometry,
        fixed(Mounting()),
        config=config,
        topic=path.name,
        description=f"lidar text log {path.name}",
        notices=notices,
    )


def commanded_path(path: Path, stamps_ns: Ints) -> OdometryPath:
    """Dead reckoning of commands `time,word,...`, at the times of scans.

    Raises
    ------
    BadInput
        Naming the line that cannot be read.
    """
    times, rates = [], []
    for number, line in enumerate(path.read_text("ascii", errors="replace").splitlines(), 1):
        words = line.split(",")
        try:
            times.append(float(words[0]) + COMMAND_DELAY_S)
            rates.append(_RATES[words[1]])
        except (ValueError, IndexError, KeyError) as error:
            raise BadInput(f"{path}:{number}: not a motion command ({error})") from None
    at = np.unique(np.concatenate([stamps_ns * 1e-9, times]))
    now = np.searchsorted(times, at[:-1], side="right") - 1
    rate = np.where(now[:, None] >= 0, np.array(rates)[now], 0.0)
    turned = np.concatenate([[0.0], np.cumsum(rate[:, 1] * np.diff(at))])
    gone = rate[:, :1] * np.diff(at)[:, None]
    steps = gone * np.column_stack([np.cos(turned[:-1]), np.sin(turned[:-1])])
    plan = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    poses = np.column_stack([plan, turned])
    return sorted_path(stamps_ns, poses[np.searchsorted(at, stamps_ns * 1e-9)])


def _fill(row: NDArray[np.float32], angles_mdeg: Floats, ranges_cm: Floats) -> None:
    """Put a scan's returns into even beams, counter-clockwise from 0."""
    count = min(len(angles_mdeg), len(ranges_cm))
    turns = _MDEG * angles_mdeg[:count] / (2.0 * np.pi)
    beam = np.round(turns * BEAMS).astype(int) % BEAMS
    range_m = ranges_cm[:count] * _CM
    seen = (range_m >= RANGE_MIN_M) & (range_m <= RANGE_MAX_M)
    row[beam[seen]] = range_m[seen]
