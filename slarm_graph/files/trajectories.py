# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Trajectories as files: TUM in and out; KITTI, EuRoC and tables with named columns in."""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from slarm_graph.counts import count_of
from slarm_graph.errors import BadInput, brief
from slarm_graph.files.run_files import of_run
from slarm_graph.files.texts import read_text
from slarm_graph.files.trajectory_columns import (
    Columns,
    Row,
    columns_by_custom,
    columns_by_header,
)
from slarm_graph.spatial import SpatialTrajectory
from slarm_graph.stamps import ns_to_seconds
from slarm_graph.trajectory import Trajectory

_log = logging.getLogger(__name__)

MOST = 1e9
"""Largest plausible coordinate, a million kilometres; its squares still fit into float64."""
_HEADER = "# timestamp tx ty tz qx qy qz qw"
_ESTIMATE, _TRUTH = "trajectory.tum", "ground_truth.tum"
_Line = tuple[int, list[str], bool]
"""Line number, words, and whether they are separated by commas."""


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


def write_trajectory(path: Path, trajectory: Trajectory) -> None:
    """Write as TUM; see `tum_text`."""
    path.write_text(tum_text(trajectory), encoding="ascii", newline="\n")


def _fixed(value: float, decimals: int) -> str:
    """Format with fixed decimals and no minus sign before a zero."""
    return f"{round(value, decimals) + 0.0:.{decimals}f}"


def trajectory_file(place: Path, *, truth: bool = False) -> Path:
    """Return the path of a run folder's trajectory, with `truth` the true one if there is one.

    Raises
    ------
    BadInput
        When the folder has none.
    """
    return of_run(place, *((_TRUTH, _ESTIMATE) if truth else (_ESTIMATE,)))


def read_trajectory(path: Path) -> Trajectory:
    """Read a trajectory as `read_spatial` does, projected to x, y and yaw about z."""
    return read_spatial(path).in_xy()


def read_spatial(path: Path) -> SpatialTrajectory:
    """Read a TUM, KITTI or EuRoC file, or a table whose header names its columns.

    The format is told by the header or the first line of numbers. KITTI files carry no time; their
    poses are stamped one second apart from zero. Poses out of order are sorted, of equal stamps
    the first is kept, and rows with a number that is not finite are dropped, each with a warning.

    Raises
    ------
    BadInput
        Naming file and line of what cannot be read.
    """
    rows: list[Row] = []
    columns, first_bad, bad = None, 0, 0
    named, lines = _header_and_lines(path)
    for number, words, commas in lines:
        columns = columns or _columns(path, number, words, commas, named)
        try:
            row = columns.read(words, len(rows) + bad)
        except ValueError as error:
            told = f"{brief(str(error), 120)}: {brief(' '.join(words))!r}"
            problem = f"{told}; expected lines `{brief(columns.words, 200)}`"
            raise BadInput(f"{path}:{number}: {problem}") from None
        if all(abs(value) <= MOST for value in row[1]):
            rows.append(row)
        else:
            first_bad, bad = first_bad or number, bad + 1
    if bad:
        rows_left_out = count_of(bad, "row")
        _log.warning("%s: %s without finite numbers left out, the first in line %d",
                     path, rows_left_out, first_bad)  # fmt: skip
    if not rows or columns is None:
        raise BadInput(f"{path}: no poses in it; expected lines `{_HEADER[2:]}`")
    return _in_order(path, rows, timed=bool(columns.stamp))


def _header_and_lines(path: Path) -> tuple[Columns | None, Iterator[_Line]]:
    """Return the columns that a header line names, and the lines of numbers below."""
    named = None
    lines: list[_Line] = []
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        is_comment = line.lstrip().startswith(("#", "%"))
        words, commas = _words(line.lstrip().lstrip("#%") if is_comment else line)
        if not lines and words and (is_comment or not is_number(words[0])):
            named = columns_by_header(words) or named
            is_comment = is_comment or named is not None
        if words and not is_comment:
            lines.append((number, words, commas))
    return named, iter(lines)


def _words(line: str) -> tuple[list[str], bool]:
    for separator in (",", ";"):
        if separator in line:
            parts = line.strip().rstrip(separator).split(separator)
            return [word.strip().strip('"') for word in parts], True
    return line.split(), False


def is_number(word: str) -> bool:
    """Whether a word can be read as a number."""
    try:
        float(word)
    except ValueError:
        return False
    return True


def _columns(
    path: Path, number: int, words: list[str], commas: bool, named: Columns | None
) -> Columns:
    if named is not None and named.count == len(words):
        return named
    try:
        return columns_by_custom(words, commas=commas)
    except ValueError as error:
        raise BadInput(f"{path}:{number}: {error}: {brief(' '.join(words))!r}") from None


def _in_order(path: Path, rows: list[Row], *, timed: bool) -> SpatialTrajectory:
    stamps = np.array([row[0] for row in rows], dtype=np.int64)
    poses = np.array([row[1] for row in rows], dtype=np.float64)
    unique, first = np.unique(stamps, return_index=True)
    if len(unique) != len(stamps) or np.any(np.diff(stamps) < 0):
        repeated = len(stamps) - len(unique)
        besides = f", and {count_of(repeated, 'repeated stamp')} left out" if repeated else ""
        _log.warning("%s: stamps do not increase strictly; sorted%s", path, besides)
    return SpatialTrajectory(unique, poses[first], timed)
