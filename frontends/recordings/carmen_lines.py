# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The lines of CARMEN logs: names, fields, stamps.

Form of a line: `NAME contents... ipc_timestamp ipc_hostname logger_timestamp`
(http://carmen.sourceforge.net/logger_playback.html). Old FLASER lines carry no angles; those
follow from the number of readings by convention of the SICK lasers they were made with.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from slarm_graph.frontends.recordings.packed import Ints
from slarm_graph.frontends.recordings.ranges import MOST_RANGE_M
from slarm_graph.stamps import seconds_to_ns

_OLD_LASERS = ("FLASER", "RLASER")
_NEW_LASERS = tuple(f"ROBOTLASER{k}" for k in range(1, 6))
"""Message names of up to five lasers."""
_RAW_LASERS = tuple(f"RAWLASER{k}" for k in range(1, 6))
"""The same, as messages without the robot's pose."""
LASERS = (*_OLD_LASERS, *_NEW_LASERS, *_RAW_LASERS)
"""Message names with scans, the one to prefer first."""

WORDS = frozenset((*LASERS, "ODOM", "PARAM", "SYNC", "TRUEPOS", "NMEA-GGA", "IMU", "MARKER"))

_NO_RETURN_M = 80.0
"""Least range that means no return: old logs write 81.83 or 81.91 m."""
_NEAREST_M = 0.1
"""Least range of old lines, which state none; a choice, within any robot that carries a SICK."""
_TAIL = 3
"""Every line ends with the logger's stamp, host and time (CARMEN's log format)."""
_POSE_WORDS = 11
"""Laser and robot pose, two speeds, three distances."""
_LATEST_S = 9e9
"""Latest stamp that fits into 64-bit nanoseconds."""


@dataclass(slots=True)
class LaserLine:
    """One laser line."""

    stamps_s: tuple[str, str]
    ranges_m: NDArray[np.float32]
    limits: tuple[float, ...]
    laser: list[str] = field(default_factory=list)
    robot: list[str] = field(default_factory=list)


def parse_laser(words: list[str]) -> LaserLine:
    """Read the words of a laser line, old or new; ValueError when they are not one."""
    if words[0] in _OLD_LASERS:
        count = int(words[1])
        rest = _rest(words, 2 + count, 6)
        scan = LaserLine(stamps_of(words), _ranges(words, 2, count), _old_limits(count))
        scan.laser, scan.robot = finite_numbers(rest[:3]), finite_numbers(rest[3:6])
        return scan
    _, start, view, step, farthest, *_ = (float(word) for word in words[1:8])
    count = int(words[8])
    after = _behind_remissions(words, 9 + count)
    step = step if step > 0 else view / max(count - 1, 1)
    limits = (start, start + step * (count - 1), step, 0.0, 0.0, 0.02, farthest)
    scan = LaserLine(stamps_of(words), _ranges(words, 9, count), limits)
    if words[0] in _NEW_LASERS:
        rest = _rest(words, after, 6)
        scan.laser, scan.robot = finite_numbers(rest[:3]), finite_numbers(rest[3:6])
    return scan


def _behind_remissions(words: list[str], at: int) -> int:
    """Pass over `num_remissions [remissions]`, which older logs leave out."""
    poses = _POSE_WORDS if words[0] in _NEW_LASERS else 0
    if len(words) - at == poses + _TAIL:
        return at
    return at + 1 + int(words[at])


def _rest(words: list[str], at: int, least: int) -> list[str]:
    rest = words[at:-_TAIL]
    if len(rest) < least:
        raise ValueError(f"{len(words)} words are too few")
    return rest


def _ranges(words: list[str], at: int, count: int) -> NDArray[np.float32]:
    told = np.array(words[at : max(at, len(words) - _TAIL)][:count], np.float64)
    found = np.where(np.abs(told) > MOST_RANGE_M, np.nan, told).astype(np.float32)
    if count < 1 or len(found) != count:
        raise ValueError(f"{len(found)} readings where {count} are announced")
    return found


def _old_limits(count: int) -> tuple[float, ...]:
    """Angles of a FLASER line: 180 degrees in front, or 270 for the beam counts of newer lasers.

    180 and 360 readings leave out the last direction (-90 ... +89 and -90 ... +89.5 degrees).
    """
    view = math.radians(270.0 if count in (541, 1081) else 180.0)
    intervals = count if count in (90, 180, 360, 720) else max(count - 1, 1)
    step = view / intervals
    last = -view / 2 + step * (count - 1)
    return (-view / 2, last, step, 0.0, 0.0, _NEAREST_M, _NO_RETURN_M)


def finite_numbers(words: list[str]) -> list[str]:
    """Return words that all are finite numbers; ValueError otherwise."""
    for word in words:
        if not math.isfinite(float(word)):
            raise ValueError(f"{word} is not a number")
    return words


def stamps_of(words: list[str]) -> tuple[str, str]:
    """Ipc and logger timestamps, checked to be numbers."""
    ipc, logger = words[-3], words[-1]
    for stamp in (ipc, logger):
        if not abs(float(stamp)) < _LATEST_S:
            raise ValueError(f"{stamp} is not a time")
    return ipc, logger


def nanoseconds(stamps: list[str]) -> Ints:
    """Decimal seconds to integer nanoseconds."""
    return np.array([seconds_to_ns(text) for text in stamps], np.int64)
