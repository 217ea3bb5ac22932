# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Trajectories as files: TUM in and out, KITTI and EuRoC in."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from slarm_graph.errors import BadInput
from slarm_graph.stamps import NS_PER_S, ns_to_seconds, seconds_to_ns
from slarm_graph.trajectory import Trajectory

_log = logging.getLogger(__name__)

_HEADER = "# timestamp tx ty tz qx qy qz qw"
_TUM_COLUMNS = 8
_KITTI_COLUMNS = 12
_UNIT_TOLERANCE = 0.1
_Row = tuple[int, float, float, float]
_Parser = Callable[[list[str], int], _Row]


def tum_text(trajectory: Trajectory) -> str:
    """Format as TUM: seconds to nine decimals, z = 0, quaternion with w last.

    Parameters
    ----------
    trajectory : Trajectory
        Any frame; TUM files do not name it.
    """
    lines = [_HEADER]
    for stamp_ns, (x, y, theta) in zip(
        trajectory.stamps_ns.tolist(), trajectory.poses.tolist(), strict=True
    ):
        lines.append(
            f"{ns_to_seconds(stamp_ns)} {_fixed(x, 9)} {_fixed(y, 9)} 0.000000000"
            f" 0.000000000000 0.000000000000"
            f" {_fixed(math.sin(theta / 2), 12)} {_fixed(math.cos(theta / 2), 12)}"
        )
    return "\n".join(lines) + "\n"


def _fixed(value: float, decimals: int) -> str:
    """Write with fixed decimals and no minus sign before a zero."""
    return f"{round(value, decimals) + 0.0:.{decimals}f}"


def read_trajectory(path: Path) -> Trajectory:
    """Read a TUM, KITTI or EuRoC file, told apart by its first line of numbers.

    The pose is projected onto the plane: x, y and the yaw of the rotation. KITTI files carry no
    time; their poses are stamped one second apart from zero. Poses out of order are sorted and of
    equal stamps the first is kept, with a warning.

    Raises
    ------
    BadInput
        Naming file and line of what cannot be read.
    """
    rows: list[_Row] = []
    parse: _Parser | None = None
    for number, words in _number_lines(path):
        parse = parse or _parser_for(path, number, words)
        try:
            rows.append(_finite(parse(words, len(rows))))
        except ValueError as error:
            raise BadInput(f"{path}:{number}: {error}: {' '.join(words)!r}") from None
    if not rows:
        raise BadInput(f"{path}: no poses in it; expected lines `{_HEADER[2:]}`")
    return _in_order(path, rows)


def _number_lines(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Yield line number and words of every line that is neither blank nor a comment."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise BadInput(f"no such file: {path}") from None
    except (OSError, UnicodeDecodeError) as error:
        raise BadInput(f"{path}: cannot be read as text ({error})") from None
    for number, line in enumerate(text.splitlines(), start=1):
        stripped = line.strip()
        if stripped and not stripped.startswith("#"):
            comma = "," in stripped
            words = [w.strip() for w in stripped.split(",")] if comma else stripped.split()
            yield number, words


def _parser_for(path: Path, number: int, words: list[str]) -> _Parser:
    if len(words) == _KITTI_COLUMNS:
        return _kitti_row
    if words[0].isdigit() and len(words[0]) > 14 and len(words) >= _TUM_COLUMNS:
        return _euroc_row
    if len(words) == _TUM_COLUMNS:
        return _tum_row
    raise BadInput(
        f"{path}:{number}: expected {_TUM_COLUMNS} numbers (TUM), {_KITTI_COLUMNS} (KITTI) or a"
        f" EuRoC line, got {len(words)}: {' '.join(words)!r}"
    )


def _tum_row(words: list[str], _index: int) -> _Row:
    if len(words) != _TUM_COLUMNS:
        raise ValueError(f"expected {_TUM_COLUMNS} numbers, got {len(words)}")
    x, y, _z, qx, qy, qz, qw = (float(word) for word in words[1:])
    return seconds_to_ns(words[0]), x, y, _yaw(qx, qy, qz, qw)


def _euroc_row(words: list[str], _index: int) -> _Row:
    if len(words) < _TUM_COLUMNS:
        raise ValueError(f"expected at least {_TUM_COLUMNS} numbers, got {len(words)}")
    x, y, _z, qw, qx, qy, qz = (float(word) for word in words[1:_TUM_COLUMNS])
    return int(words[0]), x, y, _yaw(qx, qy, qz, qw)


def _kitti_row(words: list[str], index: int) -> _Row:
    if len(words) != _KITTI_COLUMNS:
        raise ValueError(f"expected {_KITTI_COLUMNS} numbers, got {len(words)}")
    m = [float(word) for word in words]
    return index * NS_PER_S, m[3], m[7], math.atan2(m[4], m[0])


def _yaw(qx: float, qy: float, qz: float, qw: float) -> float:
    norm = math.sqrt(qx * qx + qy * qy + qz * qz + qw * qw)
    if not abs(norm - 1.0) < _UNIT_TOLERANCE:
        raise ValueError(f"quaternion of length {norm:g} instead of 1")
    return math.atan2(2.0 * (qw * qz + qx * qy), qw * qw + qx * qx - qy * qy - qz * qz)


def _finite(row: _Row) -> _Row:
    if not all(math.isfinite(value) for value in row):
        raise ValueError("not a finite number")
    return row


def _in_order(path: Path, rows: list[_Row]) -> Trajectory:
    stamps = np.array([row[0] for row in rows], dtype=np.int64)
    poses = np.array([row[1:] for row in rows], dtype=np.float64)
    unique, first = np.unique(stamps, return_index=True)
    if len(unique) != len(stamps) or np.any(np.diff(stamps) < 0):
        _log.warning(
            "%s: stamps do not increase strictly; sorted, and %d repeated stamps left out",
            path,
            len(stamps) - len(unique),
        )
    return Trajectory(unique, poses[first])
