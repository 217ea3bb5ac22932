# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Error of relative poses (Kuemmerle et al. 2009, "On measuring the accuracy of SLAM")."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from slarm_graph.counts import count_of
from slarm_graph.errors import BadInput, brief
from slarm_graph.eval.metrics import Metric
from slarm_graph.eval.relation_point import point_advice
from slarm_graph.files.texts import read_text
from slarm_graph.geometry import Floats, Pose2, between
from slarm_graph.stamps import seconds_to_ns
from slarm_graph.trajectory import Trajectory

_COLUMNS = "stamp_1 stamp_2 x y z roll pitch yaw"
_YAW = 7
"""Column of the yaw in a line of the Freiburg benchmark: two stamps, x y z, roll pitch yaw."""
_HALF_A_SECOND_NS = 500_000_000
"""Stamps of the benchmark are rounded to some tenths of a second; up to this beyond the ends of a
trajectory its first or last pose is used."""


@dataclass(frozen=True, slots=True)
class Relations:
    """True relative poses between instants.

    Parameters
    ----------
    stamps_ns : (R, 2) int64
        The two instants of every relation [ns].
    first_from_second : (R, 3) float64
        True pose at the second instant in the frame of the first [m, m, rad].
    """

    stamps_ns: NDArray[np.int64]
    first_from_second: Floats


def read_relations(path: Path) -> Relations:
    """Read a relations file of the Freiburg SLAM benchmark.

    Raises
    ------
    BadInput
        Naming the file and line that cannot be read.
    """
    stamps: list[tuple[int, int]] = []
    poses: list[list[float]] = []
    for number, line in enumerate(_lines(path), start=1):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        try:
            values = [float(word) for word in words]
            if not np.isfinite(values).all():
                raise ValueError("not finite")
            stamps.append((seconds_to_ns(words[0]), seconds_to_ns(words[1])))
            poses.append([values[2], values[3], values[_YAW]])
        except (ValueError, IndexError):
            raise BadInput(f"{path}:{number}: expected `{_COLUMNS}`, got {brief(line)!r}") from None
    if not stamps:
        raise BadInput(f"{path}: no relations in it; expected lines `{_COLUMNS}`")
    return Relations(np.array(stamps, dtype=np.int64), np.array(poses))


def _lines(path: Path) -> list[str]:
    return read_text(path).splitlines()


@dataclass(frozen=True, slots=True)
class RelationErrors:
    """Errors of the relations that lie within the trajectory's time.

    Parameters
    ----------
    translation_m, rotation_rad : (U,) float64
        Size of the error of every used relation.
    total : int
        Number of relations in the file.
    part : str
        The part of the robot at which they were evaluated.
    advice : str
        Text naming another point at which they fit clearly better; empty for none.
    """

    translation_m: Floats
    rotation_rad: Floats
    total: int
    part: str
    advice: str = ""


def relation_errors(
    relations: Relations, trajectory: Trajectory, robot_from_laser: Pose2 | None = None
) -> RelationErrors:
    """Compare a trajectory with true relations, at the laser's pose where that is given.

    A relation is used when both its instants lie within the trajectory or at most half a second
    outside; poses are interpolated in between.

    Parameters
    ----------
    relations : Relations
    trajectory : Trajectory
        `map_from_robot`.
    robot_from_laser : Pose2, optional
        Evaluate at this part of the robot [m, m, rad].

    Raises
    ------
    BadInput
        When no relation lies within the trajectory's time.
    """
    path = trajectory if robot_from_laser is None else trajectory.moved_to(robot_from_laser)
    first, last = path.stamps_ns[0] - _HALF_A_SECOND_NS, path.stamps_ns[-1] + _HALF_A_SECOND_NS
    used = ((relations.stamps_ns >= first) & (relations.stamps_ns <= last)).all(axis=1)
    if not used.any():
        raise BadInput(_no_overlap(relations, trajectory))
    stamps = relations.stamps_ns[used]
    estimated = between(path.at(stamps[:, 0]), path.at(stamps[:, 1]))
    true = relations.first_from_second[used]
    error = between(true, estimated)
    return RelationErrors(
        np.hypot(error[:, 0], error[:, 1]),
        np.abs(error[:, 2]),
        len(used),
        "robot" if robot_from_laser is None else "laser",
        point_advice(estimated, true),
    )


def _no_overlap(relations: Relations, trajectory: Trajectory) -> str:
    spans = [
        f"{low * 1e-9:.3f} ... {high * 1e-9:.3f} s"
        for low, high in (
            (relations.stamps_ns.min(), relations.stamps_ns.max()),
            (trajectory.stamps_ns[0], trajectory.stamps_ns[-1]),
        )
    ]
    return (
        f"no relation lies within the trajectory: relations span {spans[0]}, the trajectory"
        f" {spans[1]}; are they of the same recording?"
    )


def relation_metrics(errors: RelationErrors) -> tuple[Metric, ...]:
    """Return mean and standard deviation of the errors as metrics."""
    degrees = np.degrees(errors.rotation_rad)
    used = len(errors.translation_m)
    note = f"at the {errors.part}, {used} of {count_of(errors.total, 'relation')}"
    advised = f"{note}; {errors.advice}" if errors.advice else note
    return (
        Metric("relations_translation_m", float(errors.translation_m.mean()), note=advised),
        Metric("relations_translation_sd_m", float(errors.translation_m.std()), note=note),
        Metric("relations_rotation_deg", float(degrees.mean()), note=note),
        Metric("relations_rotation_sd_deg", float(degrees.std()), note=note),
        Metric("relations_used", float(used), note=note),
        Metric("relations_total", float(errors.total), note=note),
    )
