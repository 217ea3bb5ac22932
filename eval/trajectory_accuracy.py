# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Absolute trajectory error (ATE, paper eq. (14)), relative pose error (RPE) and drift."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from slarm_graph.counts import count_of
from slarm_graph.errors import BadInput
from slarm_graph.eval.alignment import (
    Alignment,
    align,
    motions,
    positions,
    turned_rad,
)
from slarm_graph.eval.association import Pairs
from slarm_graph.geometry import Floats

StretchUnit = Literal["frames", "m", "s"]

_DRIFT_SHARES = (0.1, 0.2, 0.3, 0.4, 0.5)
"""Lengths over which drift is measured, as shares of the path (Zhang and Scaramuzza 2018)."""
_MAX_STARTS = 2_000
"""Most stretches of a length; more change no third digit."""


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
    moved = positions(alignment.moved(pairs.estimate))
    return np.asarray(np.linalg.norm(moved - positions(pairs.reference), axis=1))


def aligned_rmse_m(pairs: Pairs) -> float:
    """Root mean square distance of matched positions, aligned by SE(2) [m]."""
    return statistics(absolute_errors(pairs, align(pairs))).rmse


def absolute_rotations_rad(pairs: Pairs, alignment: Alignment) -> Floats:
    """Angle between matched orientations after alignment, (M,) [rad]."""
    return turned_rad(motions(pairs.reference, alignment.moved(pairs.estimate)))


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
    pairs: Pairs, delta: float = 1.0, unit: StretchUnit = "frames", scale: float = 1.0
) -> RelativeErrors:
    """Compare relative motions over consecutive stretches (RPE of Sturm et al. 2012).

    Parameters
    ----------
    pairs : Pairs
    delta : float
        Length of a stretch: poses, metres along the reference, or seconds.
    unit : {"frames", "m", "s"}
    scale : float
        Scale of the estimate, where it is fitted.

    Raises
    ------
    BadInput
        When no stretch is that long.
    """
    if unit == "frames":
        ends = np.arange(0, len(pairs.reference), max(1, round(delta)))
    elif unit == "s":
        ends = _every(np.diff(pairs.stamps_ns) * 1e-9, delta)
    else:
        ends = _every(pairs.steps_m, delta)
    if len(ends) < 2:
        raise BadInput(f"no stretch of {delta:g} {unit} in the trajectory; give a smaller delta")
    error = _motion_errors(pairs, ends[:-1], ends[1:], scale)
    stretches = count_of(len(ends) - 1, "consecutive stretch", "consecutive stretches")
    step = count_of(max(1, round(delta)), "frame") if unit == "frames" else f"{delta:g} {unit}"
    words = f"{stretches} of {step}"
    return RelativeErrors(np.linalg.norm(positions(error), axis=1), turned_rad(error), words)


def _motion_errors(
    pairs: Pairs, starts: NDArray[np.int64], ends: NDArray[np.int64], scale: float
) -> Floats:
    estimate = pairs.estimate
    if scale != 1.0:
        size = positions(estimate).shape[1]
        estimate = np.column_stack([positions(estimate) * scale, estimate[:, size:]])
    return motions(
        motions(pairs.reference[starts], pairs.reference[ends]),
        motions(estimate[starts], estimate[ends]),
    )


def _every(steps: Floats, length: float) -> NDArray[np.int64]:
    """Return the indices at which a further length has been covered, starting anew each time."""
    ends, covered = [0], 0.0
    # Stamps are whole nanoseconds: ten steps of 0.1 s are a second.
    enough = length * (1.0 - 1e-9)
    for index, step in enumerate(steps, start=1):
        covered += float(step)
        if covered >= enough:
            ends.append(index)
            covered = 0.0
    return np.array(ends, dtype=np.int64)


@dataclass(frozen=True, slots=True)
class Drift:
    """Errors over stretches of one length.

    Parameters
    ----------
    length_m : float
    translation_share : (P,) float64
        Error of the relative position over the length.
    rotation_rad_m : (P,) float64
        Error of the relative angle over the length [rad/m].
    """

    length_m: float
    translation_share: Floats
    rotation_rad_m: Floats


def drift(pairs: Pairs, lengths_m: tuple[float, ...] = (), scale: float = 1.0) -> tuple[Drift, ...]:
    """Measure the errors of an estimate over given path lengths (Geiger et al. 2012).

    Parameters
    ----------
    pairs : Pairs
    lengths_m : tuple of float
        A tenth to a half of the reference's path when left out; KITTI's are 100, 200 ... 800.
    scale : float
        Of the estimate, where it is fitted.
    """
    covered = pairs.metres
    lengths = lengths_m or tuple(share * float(covered[-1]) for share in _DRIFT_SHARES)
    starts = np.arange(0, len(covered), max(1, len(covered) // _MAX_STARTS))
    found = []
    for length_m in (length for length in lengths if length > 0.0):
        ends = np.searchsorted(covered, covered[starts] + length_m)
        there = ends < len(covered)
        if there.any():
            error = _motion_errors(pairs, starts[there], ends[there], scale)
            off_m = np.linalg.norm(positions(error), axis=1)
            found.append(Drift(length_m, off_m / length_m, turned_rad(error) / length_m))
    return tuple(found)
