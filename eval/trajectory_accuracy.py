# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Absolute trajectory error (ATE, paper eq. (14)) and relative pose error (RPE)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from slarm_graph.errors import BadInput
from slarm_graph.eval.association import Pairs
from slarm_graph.eval.metrics import Metric
from slarm_graph.geometry import Floats, Pose2, between, compose, transform_points

_SHORTEST_PATH_M = 1e-6


class AlignmentMethod(StrEnum):
    """How the estimate is laid onto the reference before positions are compared."""

    NONE = "none"
    ORIGIN = "origin"
    """First pose on first pose."""
    SE2 = "se2"
    """Least squares over the positions, without scale (Umeyama 1991)."""


@dataclass(frozen=True, slots=True)
class Alignment:
    """A rigid motion of the estimate.

    Parameters
    ----------
    reference_from_estimate : Pose2
        [m, m, rad]
    note : str
        In words for people, for titles and tables.
    """

    reference_from_estimate: Pose2
    note: str


def align(
    pairs: Pairs, method: AlignmentMethod = AlignmentMethod.SE2, first: int | None = None
) -> Alignment:
    """Lay the estimate onto the reference.

    Parameters
    ----------
    pairs : Pairs
    method : AlignmentMethod
    first : int, optional
        Use only that many pairs from the beginning for the least-squares fit.

    Raises
    ------
    BadInput
        When `first` is less than two.
    """
    if method is AlignmentMethod.NONE:
        return Alignment(Pose2(), "not aligned")
    if method is AlignmentMethod.ORIGIN:
        return Alignment(_origin(pairs), "origin-aligned")
    if first is not None and first < 2:
        raise BadInput(f"alignment needs at least 2 poses, not {first}")
    reference, estimate = pairs.reference[:first, :2], pairs.estimate[:first, :2]
    if max(np.ptp(reference, axis=0).max(), np.ptp(estimate, axis=0).max()) < _SHORTEST_PATH_M:
        return Alignment(
            _origin(pairs), "path length 0.00 m: rotation cannot be aligned, origin-aligned"
        )
    motion = fit_rigid(estimate, reference)
    scope = "" if first is None else f" on the first {first} poses"
    return Alignment(
        motion,
        f"SE(2)-aligned{scope} by ({motion.x:.3f} m, {motion.y:.3f} m,"
        f" {math.degrees(motion.theta):.3f} deg)",
    )


def _origin(pairs: Pairs) -> Pose2:
    first_reference = Pose2.from_array(pairs.reference[0])
    return first_reference @ Pose2.from_array(pairs.estimate[0]).inverse()


def fit_rigid(source: Floats, target: Floats) -> Pose2:
    """Return `target_from_source`, the least-squares rigid motion between points (N, 2) [m]."""
    source_mean, target_mean = source.mean(axis=0), target.mean(axis=0)
    s, t = source - source_mean, target - target_mean
    # The optimal rotation maximises sum t . R s, in the plane an arctangent of two sums.
    theta = math.atan2(float(np.sum(s[:, 0] * t[:, 1] - s[:, 1] * t[:, 0])), float(np.sum(s * t)))
    x, y = target_mean - transform_points(np.array([0.0, 0.0, theta]), source_mean)
    return Pose2(float(x), float(y), theta)


@dataclass(frozen=True, slots=True)
class Statistics:
    """Statistics of errors, in their unit; `std` is the population's."""

    rmse: float
    mean: float
    median: float
    std: float
    min: float
    max: float
    sse: float


def statistics(errors: Floats) -> Statistics:
    """Summarise errors (N,)."""
    squares = errors * errors
    return Statistics(
        rmse=float(np.sqrt(squares.mean())),
        mean=float(errors.mean()),
        median=float(np.median(errors)),
        std=float(errors.std()),
        min=float(errors.min()),
        max=float(errors.max()),
        sse=float(squares.sum()),
    )


def absolute_errors(pairs: Pairs, alignment: Alignment) -> Floats:
    """Distance between matched positions after alignment, (M,) [m]."""
    moved = compose(alignment.reference_from_estimate.as_array(), pairs.estimate)
    return np.asarray(np.linalg.norm(moved[:, :2] - pairs.reference[:, :2], axis=1))


@dataclass(frozen=True, slots=True)
class RelativeErrors:
    """Errors of relative motions.

    Parameters
    ----------
    translation_m, rotation_rad : (P,) float64
    note : str
        Which pairs were compared.
    """

    translation_m: Floats
    rotation_rad: Floats
    note: str


def relative_errors(
    pairs: Pairs, delta: float = 1.0, unit: Literal["frames", "m"] = "frames"
) -> RelativeErrors:
    """Compare relative motions over consecutive stretches (RPE of Sturm et al. 2012).

    Parameters
    ----------
    pairs : Pairs
    delta : float
        Length of a stretch: poses, or metres along the reference.
    unit : {"frames", "m"}

    Raises
    ------
    BadInput
        When no stretch is that long.
    """
    if unit == "frames":
        ends = np.arange(0, len(pairs.reference), max(1, round(delta)))
    else:
        ends = _every_metres(pairs.reference[:, :2], delta)
    if len(ends) < 2:
        raise BadInput(f"no stretch of {delta:g} {unit} in the trajectory; give a smaller delta")
    error = between(
        between(pairs.reference[ends[:-1]], pairs.reference[ends[1:]]),
        between(pairs.estimate[ends[:-1]], pairs.estimate[ends[1:]]),
    )
    return RelativeErrors(
        np.hypot(error[:, 0], error[:, 1]),
        np.abs(error[:, 2]),
        f"{len(error)} consecutive stretches of {delta:g} {unit}",
    )


def _every_metres(positions: Floats, length_m: float) -> NDArray[np.int64]:
    """Indices at which a further `length_m` has been covered, starting anew each time."""
    steps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    ends, covered = [0], 0.0
    for index, step in enumerate(steps, start=1):
        covered += float(step)
        if covered >= length_m:
            ends.append(index)
            covered = 0.0
    return np.array(ends, dtype=np.int64)


def trajectory_metrics(
    pairs: Pairs,
    method: AlignmentMethod = AlignmentMethod.SE2,
    first: int | None = None,
    delta: float = 1.0,
    unit: Literal["frames", "m"] = "frames",
) -> tuple[Metric, ...]:
    """ATE aligned and not aligned, and RPE, as metrics.

    The paper's eq. (14) calls its error MSE and describes the RMSE of the ATE; both are given.
    """
    alignment = align(pairs, method, first)
    ate = statistics(absolute_errors(pairs, alignment))
    raw = statistics(absolute_errors(pairs, Alignment(Pose2(), "not aligned")))
    relative = relative_errors(pairs, delta, unit)
    rpe, rpe_angle = statistics(relative.translation_m), statistics(relative.rotation_rad)
    note, raw_note = f"{alignment.note}, {pairs.note}", f"not aligned, {pairs.note}"
    return (
        Metric("ate_rmse_m", ate.rmse, note=note),
        Metric("ate_mean_m", ate.mean, note=note),
        Metric("ate_median_m", ate.median, note=note),
        Metric("ate_std_m", ate.std, note=note),
        Metric("ate_max_m", ate.max, note=note),
        Metric("ate_mse_m2", ate.rmse**2, note=f"{note}; the paper's eq. (14)"),
        Metric("ate_rmse_unaligned_m", raw.rmse, note=raw_note),
        Metric("rpe_translation_rmse_m", rpe.rmse, note=relative.note),
        Metric("rpe_rotation_rmse_deg", math.degrees(rpe_angle.rmse), note=relative.note),
    )
