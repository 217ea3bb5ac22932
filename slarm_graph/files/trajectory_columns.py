# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Columns of a trajectory file, by its header or by the format's convention."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

from slarm_graph.stamps import NS_PER_S, seconds_to_ns

_TUM, _MATRIX_3X4, _MATRIX_4X4, _STATE = 8, 12, 16, 17
"""Numbers in a line: stamp, position and quaternion; the rows of a pose's matrix; what EuRoC
estimates of the truth, which has velocity and biases of the sensors besides."""
_NAMED = "timestamp,x,y,z,qx,qy,qz,qw"
"""A header that names the columns."""
_UNIT_TOLERANCE = 0.1
"""Of a quaternion's length; files with few digits stay within a thousandth, 0.1 catches columns
taken for what they are not."""
_NANOSECONDS_FROM = 1e14
"""As seconds this is three million years, as nanoseconds since power-on a day."""
_STAMP = re.compile(r"(^|[^a-z])(time_?stamp|time|stamp|t|secs?|seconds)(_(?P<unit>[mun]?s))?$")
_UNIT = re.compile(r"[\[(]\s*(?P<unit>[mun]?s)\s*[\])]")
_NS_PER = {"s": NS_PER_S, "ms": 1_000_000, "us": 1_000, "ns": 1}
"""Nanoseconds of the units (SI prefixes) that a head may name."""
_NANO_PART = re.compile(r"(^|[^a-z])(nsec|nsecs|nanosec|nanosecs|nanoseconds)$")
_PLACE = re.compile(r"(^|[^a-z])(t|p|pos|position|translation)?[_.]?([xyz])$")
_TURN = re.compile(r"(^|[^a-z])(q|quat|quaternion|orientation|rotation)[a-z_.]*?[_.]?([xyzw])$")
_YAW = re.compile(r"(^|[^a-z])(yaw|theta|heading)$")

Row = tuple[int, tuple[float, ...]]
"""Stamp [ns], and x, y, z [m] with the quaternion x, y, z, w."""


@dataclass(frozen=True, slots=True)
class Columns:
    """The meaning of the columns of a table.

    Parameters
    ----------
    count : int
        Least number of columns.
    stamp : tuple of int
        The stamp, or seconds and nanoseconds; empty where rows carry no time.
    places : tuple of int
        x, y and, where there is one, z.
    turn : tuple of int
        Quaternion x, y, z, w; or the yaw alone; empty for a matrix.
    words : str
        Expected columns, for messages.
    exact : bool
        Whether more columns are an error.
    """

    count: int
    stamp: tuple[int, ...]
    places: tuple[int, ...]
    turn: tuple[int, ...]
    words: str
    exact: bool = True
    unit: str = ""

    def read(self, words: Sequence[str], index: int) -> Row:
        """Read a row; a pose with a number that is not finite comes back as it is.

        Raises
        ------
        ValueError
            When the row is not what was expected.
        """
        if len(words) < self.count or (self.exact and len(words) > self.count):
            few = "" if self.exact else "at least "
            raise ValueError(f"expected {few}{self.count} numbers, got {len(words)}")
        if not self.turn:
            return index * NS_PER_S, _of_matrix([float(word) for word in words])
        x, y, *rest = (float(words[i]) for i in self.places)
        turn = [float(words[i]) for i in self.turn]
        pose = (x, y, rest[0] if rest else 0.0, *_quaternion(turn))
        stamp = [words[i] for i in self.stamp]
        if len(stamp) == 2:
            return int(stamp[0]) * NS_PER_S + int(stamp[1]), pose
        return stamp_ns(stamp[0], self.unit), pose


def stamp_ns(text: str, unit: str = "") -> int:
    """Read a stamp: in a unit, or in seconds and, where it is that large, in nanoseconds."""
    value = float(text)
    if not math.isfinite(value):
        raise ValueError("stamp is not a finite number")
    unit = unit or ("s" if abs(value) < _NANOSECONDS_FROM else "ns")
    if abs(value) * _NS_PER[unit] >= 2**63:
        raise ValueError("stamp is beyond what 64 bits of nanoseconds hold")
    if unit == "s":
        return seconds_to_ns(text)
    whole, _, fraction = text.partition(".")
    exact = whole.lstrip("+-").isdigit() and not fraction.strip("0")
    return int(whole) * _NS_PER[unit] if exact else round(value * _NS_PER[unit])


def _quaternion(turn: Sequence[float]) -> tuple[float, ...]:
    if len(turn) == 1:
        return 0.0, 0.0, math.sin(turn[0] / 2.0), math.cos(turn[0] / 2.0)
    norm = math.sqrt(sum(part * part for part in turn))
    if not math.isfinite(norm):
        return tuple(turn)
    if not abs(norm - 1.0) < _UNIT_TOLERANCE:
        raise ValueError(f"quaternion of length {norm:g} instead of 1")
    return tuple(part / norm for part in turn)


_LARGEST_COSINE = 2.0
"""Entries of a rotation are cosines; rounding and scale of some writers are far below this."""


def _of_matrix(m: Sequence[float]) -> tuple[float, ...]:
    from scipy.spatial.transform import Rotation

    if not all(map(math.isfinite, m)):
        return (math.nan,) * 7
    turn = [[m[0], m[1], m[2]], [m[4], m[5], m[6]], [m[8], m[9], m[10]]]
    if max(abs(part) for row in turn for part in row) > _LARGEST_COSINE:
        raise ValueError("no rotation")
    return m[3], m[7], m[11], *Rotation.from_matrix(turn).as_quat().tolist()


def columns_by_custom(words: Sequence[str], *, commas: bool) -> Columns:
    """Recognise the format by the first line of numbers: KITTI, EuRoC (with commas) or TUM.

    Raises
    ------
    ValueError
        When it is none of them, or may be two.
    """
    if commas and _is_of_euroc(words):
        unit = "ns" if words[0].isdigit() else ""
        told = "timestamp,x,y,z,qw,qx,qy,qz (EuRoC)"
        return Columns(_TUM, (0,), (1, 2, 3), (5, 6, 7, 4), told, exact=False, unit=unit)
    if len(words) in (_MATRIX_3X4, _MATRIX_4X4):
        return Columns(len(words), (), (3, 7, 11), (), f"{len(words)} numbers (KITTI)")
    if len(words) == _TUM and commas:
        raise ValueError(
            "quaternion with w last (TUM), or first (EuRoC)? Name the columns in a line above,"
            f" `{_NAMED}` or `timestamp [ns],x,y,z,qw,qx,qy,qz`"
        )
    if len(words) == _TUM:
        return Columns(_TUM, (0,), (1, 2, 3), (4, 5, 6, 7), "timestamp tx ty tz qx qy qz qw (TUM)")
    raise ValueError(
        "expected 8 numbers (TUM), 12 (KITTI), a EuRoC line or a header that names the columns,"
        f" such as `{_NAMED}`, got {len(words)}"
    )


def _is_of_euroc(words: Sequence[str]) -> bool:
    try:
        nanoseconds = abs(float(words[0])) >= _NANOSECONDS_FROM
    except ValueError:
        return False
    return len(words) == _STATE or (nanoseconds and len(words) >= _TUM)


def columns_by_header(names: Sequence[str]) -> Columns | None:
    """Find the columns by their names; None where they do not name a stamped pose."""
    plain = [re.sub(r"[\[(].*?[\])]", "", name).strip().lower().lstrip("#% ") for name in names]
    stamp, nano, yaw = (_first(plain, pattern) for pattern in (_STAMP, _NANO_PART, _YAW))
    turn = _axes(plain, _TURN)
    places = _axes(["" if _TURN.search(name) else name for name in plain], _PLACE)
    if stamp is None or not {"x", "y"} <= set(places):
        return None
    if set(turn) == set("xyzw"):
        turned = tuple(turn[axis] for axis in "xyzw")
    elif yaw is not None:
        turned = (yaw,)
    else:
        return None
    place = tuple(places[axis] for axis in "xyz" if axis in places)
    stamps = (stamp,) if nano is None else (stamp, nano)
    said = _UNIT.search(names[stamp].lower()) or _STAMP.search(plain[stamp])
    unit = (said.group("unit") if said else "") or ""
    return Columns(len(names), stamps, place, turned, " ".join(names), unit=unit)


def _first(names: Sequence[str], pattern: re.Pattern[str]) -> int | None:
    return next((i for i, name in enumerate(names) if pattern.search(name)), None)


def _axes(names: Sequence[str], pattern: re.Pattern[str]) -> dict[str, int]:
    """Return the first column of every axis."""
    found: dict[str, int] = {}
    for index, name in enumerate(names):
        match = pattern.search(name)
        if match:
            found.setdefault(match.group(3), index)
    return found
