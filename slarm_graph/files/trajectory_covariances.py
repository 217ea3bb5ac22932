# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Covariances of a trajectory's poses as `trajectory_covariance.npz`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from slarm_graph.files.arrays import arrays_of
from slarm_graph.files.npz import write_npz
from slarm_graph.geometry import Floats

_FRAME = "robot"
_UNITS = "m^2, m rad, rad^2"


@dataclass(frozen=True, slots=True)
class TrajectoryCovariance:
    """Covariances of the poses of a trajectory.

    Parameters
    ----------
    stamps_ns : (N,) int64
        Stamps of the trajectory.
    covariances : (N, 3, 3) float64
        Of (x, y, theta) in the robot's own frame at each pose [m^2, m rad, rad^2].
    """

    stamps_ns: NDArray[np.int64]
    covariances: Floats


def write_trajectory_covariance(path: Path, known: TrajectoryCovariance) -> None:
    """Write stamps and covariances, with their frame and units as text."""
    write_npz(
        path,
        (
            ("stamps_ns", known.stamps_ns),
            ("covariances", known.covariances),
            ("frame", np.array(_FRAME)),
            ("units", np.array(_UNITS)),
        ),
    )


def read_trajectory_covariance(path: Path) -> TrajectoryCovariance:
    """Read what `write_trajectory_covariance` wrote.

    Raises
    ------
    BadInput
        When the file is missing or not of that kind.
    """
    with arrays_of(path, "a file of covariances") as file:
        stamps_ns = np.asarray(file["stamps_ns"])
        covariances = np.asarray(file["covariances"], np.float64)
        if stamps_ns.dtype != np.int64 or stamps_ns.ndim != 1:
            raise ValueError("stamps are not whole nanoseconds in a row")
        if covariances.shape != (len(stamps_ns), 3, 3):
            raise ValueError(f"{len(stamps_ns)} stamps and covariances {covariances.shape}")
        if (str(file["frame"]), str(file["units"])) != (_FRAME, _UNITS):
            raise ValueError("another frame or other units")
    return TrajectoryCovariance(stamps_ns, covariances)
