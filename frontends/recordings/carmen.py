# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""CARMEN log files, plain or gzipped: FLASER, RLASER, ROBOTLASER, RAWLASER and ODOM lines."""

from __future__ import annotations

import gzip
import zlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from slarm_graph.errors import BadInput, brief
from slarm_graph.frontends.recordings.carmen_lines import (
    LASERS,
    WORDS,
    LaserLine,
    finite_numbers,
    nanoseconds,
    parse_laser,
    stamps_of,
)
from slarm_graph.frontends.recordings.messages import ScanBlock
from slarm_graph.frontends.recordings.packed import Ints
from slarm_graph.geometry import Floats, between

GZIP_MAGIC = b"\x1f\x8b"
CARMEN_ENDINGS = (".clf", ".log", ".carmen", ".clf.gz", ".log.gz", ".carmen.gz")
MAX_RATIO = 200
"""Largest compression ratio of a gzipped log; digits are packed to a fifth or so."""
MAX_LINE = 1 << 21
"""Most characters of a line: 100,000 beams of some 20; longer ones are split and are no log."""
_FIRST_LINES = 200
"""Lines by which a log is recognised; headers have some dozens of comments."""
_DAMAGE = (EOFError, zlib.error, OSError, BadInput)


@dataclass(frozen=True, slots=True)
class CarmenLog:
    """The content of a log.

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
    """Whether the first lines are those of a CARMEN log; for a damaged gzip file, by its name."""
    try:
        for _, line in zip(range(_FIRST_LINES), _lines(path), strict=False):
            word = line.split(" ", 1)[0].strip()
            if word and not word.startswith("#"):
                return word in WORDS
    except _DAMAGE:
        return path.name.endswith(CARMEN_ENDINGS)
    return False


def read_carmen(path: Path) -> CarmenLog:
    """Read a log.

    Raises
    ------
    BadInput
        When no laser line can be read; the message names the first one that could not.
    """
    scans: dict[str, list[LaserLine]] = {}
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
                    scan = parse_laser(words)
                    scans.setdefault(words[0], []).append(scan)
                elif words[0] == "ODOM":
                    odom.append((stamps_of(words), finite_numbers(words[1:4])))
                elif words[0] not in WORDS:
                    unknown[words[0]] += 1
            except (ValueError, IndexError, OverflowError) as error:
                faults.append(f"{path.name}:{number}: {words[0]} line skipped: {error}")
    except _DAMAGE as error:
        faults.append(f"{path.name} ends early ({brief(str(error))}); what came before is used")
    if not scans:
        raise BadInput(
            f"{path} has no laser line that can be read ({faults[0]})"
            if faults
            else f"{path} holds no FLASER, ROBOTLASER or RAWLASER line"
        )
    notices = _notices(faults, unknown)
    by_logger = _ipc_unusable([scan.stamps_s for some in scans.values() for scan in some])
    if by_logger:
        notices.append("ipc timestamps do not tell the time; the logger's are used")
    return CarmenLog(
        {name: _blocks(name, some, by_logger) for name, some in scans.items()},
        {name: _offset(some) for name, some in scans.items()},
        nanoseconds([stamps[by_logger] for stamps, _ in odom]),
        np.array([pose for _, pose in odom], np.float64).reshape(-1, 3),
        tuple(notices),
    )


def _lines(path: Path) -> Iterator[str]:
    with path.open("rb") as file:
        zipped = file.read(2) == GZIP_MAGIC
    opener = gzip.open if zipped else open
    left = MAX_RATIO * path.stat().st_size if zipped else path.stat().st_size
    with opener(path, "rt", encoding="utf-8", errors="replace") as text:
        while line := text.readline(MAX_LINE):
            left -= len(line)
            if left < -MAX_LINE:
                raise OSError(f"unpacks to more than {MAX_RATIO} times its size")
            yield line


def _ipc_unusable(stamps: list[tuple[str, str]]) -> bool:
    """Some loggers left the ipc timestamp at one value while their own went on."""
    ipc, logger = ({pair[which] for pair in stamps} for which in (0, 1))
    return len(ipc) == 1 and len(logger) > 1


def _blocks(name: str, scans: list[LaserLine], by_logger: bool) -> list[ScanBlock]:
    counts = np.array([len(scan.ranges_m) for scan in scans])
    blocks = []
    for count in np.unique(counts).tolist():
        rows = np.flatnonzero(counts == count)
        some = [scans[row] for row in rows.tolist()]
        stamps = nanoseconds([scan.stamps_s[by_logger] for scan in some])
        ranges = np.stack([scan.ranges_m for scan in some])
        limits = np.array([scan.limits for scan in some])
        poses = None
        if all(scan.robot for scan in some):
            poses = np.array([scan.robot for scan in some], np.float64)
        blocks.append(ScanBlock(stamps, stamps, rows, limits, ranges, name, poses))
    return blocks


def _offset(scans: list[LaserLine]) -> Floats:
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
