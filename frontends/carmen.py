# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""CARMEN log files, plain or gzipped: FLASER, RLASER, ROBOTLASER, RAWLASER and ODOM lines.

Form of a line: `NAME contents... ipc_timestamp ipc_hostname logger_timestamp`
(http://carmen.sourceforge.net/logger_playback.html). Old FLASER lines carry no angles; those
follow from the number of readings by convention of the SICK lasers they were made with.
"""

from __future__ import annotations

import gzip
import math
import zlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from slarm_graph.errors import BadInput
from slarm_graph.frontends.messages import ScanBlock
from slarm_graph.frontends.packed import Ints
from slarm_graph.geometry import Floats, between

GZIP_MAGIC = b"\x1f\x8b"

_OLD_LASERS = ("FLASER", "RLASER")
_NEW_LASERS = tuple(f"ROBOTLASER{k}" for k in range(1, 6))
_RAW_LASERS = tuple(f"RAWLASER{k}" for k in range(1, 6))
LASERS = (*_OLD_LASERS, *_NEW_LASERS, *_RAW_LASERS)
"""Message names with scans, the one to prefer first."""

WORDS = frozenset((*LASERS, "ODOM", "PARAM", "SYNC", "TRUEPOS", "NMEA-GGA", "IMU", "MARKER"))

_NO_RETURN_M = 80.0
"""Old logs write 81.83 or 81.91 m where nothing came back."""
_NEAREST_M = 0.1
_TAIL = 3
_LATEST_S = 9e9
"""What fits into 64-bit nanoseconds."""


@dataclass(slots=True)
class _Scan:
    """One laser line."""

    stamps_s: tuple[str, str]
    ranges_m: NDArray[np.float32]
    limits: tuple[float, ...]
    laser: list[str] = field(default_factory=list)
    robot: list[str] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class CarmenLog:
    """What a log holds.

    Parameters
    ----------
    scans : dict of str to list of ScanBlock
        Per message name; the frame of a block is that name.
    odom_stamp_ns : (N,) int64
    odom_poses : (N, 3) float64
        From ODOM lines [m, m, rad].
    notices : tuple of str
    """

    scans: dict[str, list[ScanBlock]]
    robot_from_laser: dict[str, Floats]
    odom_stamp_ns: Ints
    odom_poses: Floats
    notices: tuple[str, ...]


def looks_like_carmen(path: Path) -> bool:
    """Whether the first lines are those of a CARMEN log."""
    try:
        for _, line in zip(range(200), _lines(path), strict=False):
            word = line.split(" ", 1)[0].strip()
            if word and not word.startswith("#"):
                return word in WORDS
    except BadInput:
        return False
    return False


def read_carmen(path: Path) -> CarmenLog:
    """Read a log.

    Raises
    ------
    BadInput
        When no laser line can be read; the message names the first one that could not.
    """
    scans: dict[str, list[_Scan]] = {}
    odom: list[tuple[tuple[str, str], list[str]]] = []
    unknown: Counter[str] = Counter()
    faults: list[str] = []
    try:
        for number, line in enumerate(_lines(path), start=1):
            words = line.split()
            if not words or words[0].startswith("#"):
                continue
            try:
                if words[0] in LASERS:
                    scan = _parse_laser(words)
                    scans.setdefault(words[0], []).append(scan)
                elif words[0] == "ODOM":
                    odom.append((_stamps(words), _numbers(words[1:4])))
                elif words[0] not in WORDS:
                    unknown[words[0]] += 1
            except (ValueError, IndexError, OverflowError) as error:
                faults.append(f"{path.name}:{number}: {words[0]} line skipped: {error}")
    except (EOFError, zlib.error, OSError) as error:
        faults.append(f"{path.name} ends early ({error}); what came before is used")
    if not scans:
        raise BadInput(
            faults[0] if faults else f"{path} holds no FLASER, ROBOTLASER or RAWLASER line"
        )
    notices = _notices(faults, unknown)
    by_logger = _ipc_unusable([scan.stamps_s for some in scans.values() for scan in some])
    if by_logger:
        notices.append("ipc timestamps do not tell the time; the logger's are used")
    return CarmenLog(
        {name: _blocks(name, some, by_logger) for name, some in scans.items()},
        {name: _offset(some) for name, some in scans.items()},
        _nanoseconds([stamps[by_logger] for stamps, _ in odom]),
        np.array([pose for _, pose in odom], np.float64).reshape(-1, 3),
        tuple(notices),
    )


def _lines(path: Path) -> Iterator[str]:
    with path.open("rb") as file:
        zipped = file.read(2) == GZIP_MAGIC
    opener = gzip.open if zipped else open
    with opener(path, "rt", encoding="utf-8", errors="replace") as text:
        yield from text


def _parse_laser(words: list[str]) -> _Scan:
    if words[0] in _OLD_LASERS:
        count = int(words[1])
        rest = _rest(words, 2 + count, 6)
        scan = _Scan(_stamps(words), _ranges(words, 2, count), _old_limits(count))
        scan.laser, scan.robot = _numbers(rest[:3]), _numbers(rest[3:6])
        return scan
    _, start, view, step, farthest, *_ = (float(word) for word in words[1:8])
    count = int(words[8])
    remissions = int(words[9 + count])
    after = 10 + count + remissions
    step = step if step > 0 else view / max(count - 1, 1)
    limits = (start, start + step * (count - 1), step, 0.0, 0.0, 0.02, farthest)
    scan = _Scan(_stamps(words), _ranges(words, 9, count), limits)
    if words[0] in _NEW_LASERS:
        rest = _rest(words, after, 6)
        scan.laser, scan.robot = _numbers(rest[:3]), _numbers(rest[3:6])
    return scan


def _rest(words: list[str], at: int, least: int) -> list[str]:
    rest = words[at:-_TAIL]
    if len(rest) < least:
        raise ValueError(f"{len(words)} words are too few")
    return rest


def _ranges(words: list[str], at: int, count: int) -> NDArray[np.float32]:
    found = np.array(words[at : max(at, len(words) - _TAIL)][:count], np.float32)
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


def _numbers(words: list[str]) -> list[str]:
    for word in words:
        if not math.isfinite(float(word)):
            raise ValueError(f"{word} is not a number")
    return words


def _stamps(words: list[str]) -> tuple[str, str]:
    """Ipc and logger timestamps, checked to be numbers."""
    ipc, logger = words[-3], words[-1]
    for stamp in (ipc, logger):
        if not abs(float(stamp)) < _LATEST_S:
            raise ValueError(f"{stamp} is not a time")
    return ipc, logger


def _ipc_unusable(stamps: list[tuple[str, str]]) -> bool:
    """Some loggers left the ipc timestamp at one value while their own went on."""
    ipc, logger = ({pair[which] for pair in stamps} for which in (0, 1))
    return len(ipc) == 1 and len(logger) > 1


def _nanoseconds(stamps: list[str]) -> Ints:
    """Decimal seconds to integer nanoseconds, without a detour over floats."""
    out = np.zeros(len(stamps), np.int64)
    for row, text in enumerate(stamps):
        whole, _, part = text.partition(".")
        digits = (part + "000000000")[:9]
        if "e" in text or "E" in text or not digits.isdigit():
            out[row] = round(float(text) * 1e9)
        else:
            sign = -1 if whole.startswith("-") else 1
            out[row] = sign * (abs(int(whole or "0")) * 1_000_000_000 + int(digits))
    return out


def _blocks(name: str, scans: list[_Scan], by_logger: bool) -> list[ScanBlock]:
    counts = np.array([len(scan.ranges_m) for scan in scans])
    blocks = []
    for count in np.unique(counts).tolist():
        rows = np.flatnonzero(counts == count)
        some = [scans[row] for row in rows.tolist()]
        stamps = _nanoseconds([scan.stamps_s[by_logger] for scan in some])
        ranges = np.stack([scan.ranges_m for scan in some])
        limits = np.array([scan.limits for scan in some])
        poses = None
        if all(scan.robot for scan in some):
            poses = np.array([scan.robot for scan in some], np.float64)
        blocks.append(ScanBlock(stamps, stamps, rows, limits, ranges, name, poses))
    return blocks


def _offset(scans: list[_Scan]) -> Floats:
    """The laser's pose on the robot (3,), where the logged poses of both agree on one; else zero.

    Corrected logs write the map pose in place of the laser's, which is no fixed offset.
    """
    pairs = [(scan.robot, scan.laser) for scan in scans if scan.robot]
    if not pairs:
        return np.zeros(3)
    robot, laser = (np.array(poses, np.float64) for poses in zip(*pairs, strict=True))
    offsets = between(robot, laser)
    middle = np.median(offsets, axis=0)
    agree = np.abs(between(middle, offsets)).max() < 2e-3
    return np.round(middle, 4) if agree else np.zeros(3)


def _notices(faults: list[str], unknown: Counter[str]) -> list[str]:
    told = faults[:3]
    if len(faults) > 3:
        told.append(f"{len(faults) - 3} more lines could not be read")
    if unknown:
        names = ", ".join(f"{count} {name}" for name, count in unknown.most_common(5))
        told.append(f"messages of other kinds ignored: {names}")
    return told
