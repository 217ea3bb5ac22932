# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Vectorised rotations: quaternions (N, 4) in the order x y z w, matrices (N, 3, 3)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from slarm_graph.frontends.recordings.packed import Ints
from slarm_graph.geometry import Floats

_UNIT_TOLERANCE = 1e-3
"""Largest error of the norm: four components of three decimals are off by 0.0005 each, by 0.001
together."""


def usable_quaternions(quaternions: Floats) -> tuple[NDArray[np.bool_], Floats]:
    """Return which quaternions are unit within 1e-3, and those normalised."""
    norms = np.linalg.norm(quaternions, axis=1)
    with np.errstate(invalid="ignore"):
        usable = np.abs(norms - 1.0) < _UNIT_TOLERANCE
    return usable, quaternions / np.where(usable, norms, 1.0)[:, None]


def matrices(quaternions: Floats) -> Floats:
    """Rotation matrices (N, 3, 3) of unit quaternions (N, 4)."""
    return np.asarray(Rotation.from_quat(quaternions).as_matrix())


def yaws(quaternions: Floats) -> Floats:
    """Heading of the x axis seen from above, (N,) [rad]; nan where a quaternion is not usable."""
    x, y, z, w = quaternions.T
    return np.asarray(np.arctan2(2 * (x * y + z * w), 1 - 2 * (y * y + z * z)))


def quaternion_of(yaw: float, pitch: float = 0.0, roll: float = 0.0) -> Floats:
    """Quaternion (4,) of roll about x, then pitch about y, then yaw about z [rad] (REP-103)."""
    return np.asarray(Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_quat())


def invert(rotations: Floats, translations: Floats) -> tuple[Floats, Floats]:
    """Inverse of rigid transforms: rotations (N, 3, 3), translations (N, 3)."""
    back = np.swapaxes(rotations, 1, 2)
    return back, -np.einsum("nij,nj->ni", back, translations)


def slerp(start: Floats, end: Floats, share: Floats) -> Floats:
    """Interpolate quaternions (N, 4) along the shorter arc."""
    begin = Rotation.from_quat(start)
    turn = (begin.inv() * Rotation.from_quat(end)).as_rotvec()
    return np.asarray((begin * Rotation.from_rotvec(share[:, None] * turn)).as_quat())


def bracket(
    stamps: Ints, at_ns: Ints, max_gap_ns: int
) -> tuple[Ints, Ints, Floats, NDArray[np.bool_]]:
    """Find the neighbours of each instant among stamps.

    Parameters
    ----------
    stamps : (N,) int64, strictly increasing
    at_ns : (M,) int64
    max_gap_ns : int
        Longest gap between neighbours that is bridged. Beyond the ends the last value holds for as
        long as updates usually are apart (95 % of them).

    Returns
    -------
    before, after : (M,) indices
    share : (M,) float64
        0 at `before`, 1 at `after`.
    known : (M,) bool
    """
    if len(stamps) == 1:
        zero = np.zeros(len(at_ns), np.int64)
        return zero, zero, np.zeros(len(at_ns)), np.ones(len(at_ns), bool)
    reach = min(int(np.quantile(np.diff(stamps), 0.95)), max_gap_ns)
    known = (at_ns >= stamps[0] - reach) & (at_ns <= stamps[-1] + reach)
    held = np.clip(at_ns, stamps[0], stamps[-1])
    after = np.clip(np.searchsorted(stamps, held, side="left"), 1, len(stamps) - 1)
    before = after - 1
    span = stamps[after] - stamps[before]
    share = (held - stamps[before]) / span
    exact = (held == stamps[before]) | (held == stamps[after])
    return before, after, share, known & ((span <= max_gap_ns) | exact)


def interpolate(
    stamps: Ints, translations: Floats, quaternions: Floats, at_ns: Ints, max_gap_ns: int
) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Interpolate rigid transforms: translations (M, 3), quaternions (M, 4), known (M,)."""
    before, after, share, known = bracket(stamps, at_ns, max_gap_ns)
    step = translations[after] - translations[before]
    moved = translations[before] + share[:, None] * step
    return moved, slerp(quaternions[before], quaternions[after], share), known
