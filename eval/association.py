# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Association of the poses of an estimate with those of a reference, by time."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from slarm_graph.counts import count_of
from slarm_graph.errors import BadInput
from slarm_graph.geometry import Floats
from slarm_graph.spatial import SpatialTrajectory
from slarm_graph.trajectory import Trajectory

_MIN_PAIRS = 3
"""Two poses fit any rigid motion; three are the fewest whose residuals say anything."""
_FEW_MATCHED = 0.8
"""Share of matched poses of the sparser path below which there is a warning. Half and double change
that warning only."""
_MAX_INTERPOLATED_GAP_NS = 1_000_000_000
"""A second: motion-capture systems drop out for tenths of one, and a robot of 1 m/s that turns at 1
rad/s strays by about 0.1 m from the chord of a second."""

Stamps = NDArray[np.int64]


class AssociationMethod(StrEnum):
    """How poses of two trajectories are paired; always from the one with fewer poses."""

    INTERPOLATE = "interpolate"
    """The denser trajectory is interpolated at the stamps of the sparser one."""
    NEAREST = "nearest"
    """The pose nearest in time, at most `max_difference_s` away, as evo does by default."""


@dataclass(frozen=True, slots=True)
class Pairs:
    """Poses of a reference and an estimate that belong together.

    Parameters
    ----------
    stamps_ns : (M,) int64
        Of the reference [ns].
    reference, estimate : (M, 3) or (M, 7) float64
        Poses, each in its own map: in the plane [m, m, rad], or in space as in
        `SpatialTrajectory`.
    possible : int
        Poses of the sparser trajectory.
    note : str
        Text: how many poses were matched.
    warning : str
        Why the metrics may be unreliable; empty for nothing.
    """

    stamps_ns: Stamps
    reference: Floats
    estimate: Floats
    possible: int
    note: str
    warning: str

    @property
    def seconds(self) -> Floats:
        """Time since the first pair (M,) [s]."""
        return np.asarray((self.stamps_ns - self.stamps_ns[0]) * 1e-9)

    @property
    def steps_m(self) -> Floats:
        """Length of every step of the reference (M - 1,) [m]."""
        size = 2 if self.reference.shape[1] == 3 else 3
        return np.asarray(np.linalg.norm(np.diff(self.reference[:, :size], axis=0), axis=1))

    @property
    def metres(self) -> Floats:
        """Path length of the reference since the first pair (M,) [m]."""
        return np.concatenate([[0.0], np.cumsum(self.steps_m)])


Path = TypeVar("Path", Trajectory, SpatialTrajectory)


def associate(
    reference: Path,
    estimate: Path,
    *,
    method: AssociationMethod = AssociationMethod.INTERPOLATE,
    max_difference_s: float = 0.01,
    offset_s: float = 0.0,
) -> Pairs:
    """Pair the poses of two trajectories.

    Parameters
    ----------
    reference, estimate : Trajectory or SpatialTrajectory
        Both in the plane, or both in space.
    method : AssociationMethod
    max_difference_s : float
        Largest difference of stamps with `nearest` [s].
    offset_s : float
        Added to the estimate's stamps [s].

    Raises
    ------
    BadInput
        When fewer than three poses match; it names both time spans and an offset to try.
    """
    est_stamps = estimate.stamps_ns + round(offset_s * 1e9)
    ref_stamps = reference.stamps_ns
    swap = len(est_stamps) < len(ref_stamps)
    sparse, dense = (est_stamps, ref_stamps) if swap else (ref_stamps, est_stamps)
    if method is AssociationMethod.NEAREST:
        ours, theirs = _nearest(sparse, dense, round(max_difference_s * 1e9))
        ref_index, est_index = (theirs, ours) if swap else (ours, theirs)
        ref_poses, est_poses = reference.poses[ref_index], estimate.poses[est_index]
        stamps = ref_stamps[ref_index]
    else:
        stamps = sparse[_can_interpolate(sparse, dense)]
        shifted = replace(estimate, stamps_ns=est_stamps)
        ref_poses, est_poses = reference.at(stamps), shifted.at(stamps)
    if len(stamps) < _MIN_PAIRS:
        raise BadInput(_too_few(len(stamps), ref_stamps, est_stamps, offset_s))
    note = f"{len(stamps)} of {count_of(len(sparse), 'pose')} matched"
    few = len(stamps) < _FEW_MATCHED * len(sparse)
    warning = f"only {note}; the figures speak of that part alone" if few else ""
    return Pairs(stamps, ref_poses, est_poses, len(sparse), note, warning)


def by_index(reference: SpatialTrajectory, estimate: SpatialTrajectory) -> SpatialTrajectory:
    """Return the estimate stamped like the reference, pose by pose, where a file carries no time.

    Raises
    ------
    BadInput
        When they are not of one length: which poses belong together cannot be known.
    """
    if reference.timed and estimate.timed:
        return estimate
    if len(reference) != len(estimate):
        raise BadInput(
            f"without stamps (KITTI) poses can only be compared one by one, but the reference has"
            f" {len(reference)} and the estimate {len(estimate)}; give both with stamps (TUM), or"
            " the estimate with a pose for every pose of the reference"
        )
    return replace(estimate, stamps_ns=reference.stamps_ns)


def _nearest(stamps: Stamps, others: Stamps, limit_ns: int) -> tuple[Stamps, Stamps]:
    """Index pairs of stamps and their nearest others; a tie goes to the earlier one."""
    after = np.searchsorted(others, stamps, side="right").clip(0, len(others) - 1)
    before = (after - 1).clip(0)
    to_after, to_before = np.abs(others[after] - stamps), np.abs(others[before] - stamps)
    best = np.where(to_after < to_before, after, before)
    close = np.flatnonzero(np.minimum(to_after, to_before) <= limit_ns)
    return close, best[close]


def _can_interpolate(stamps: Stamps, others: Stamps) -> NDArray[np.bool_]:
    """Which stamps lie on, or within a short gap between, the others."""
    after = np.searchsorted(others, stamps, side="left").clip(1, max(1, len(others) - 1))
    after = after.clip(0, len(others) - 1)
    gap = others[after] - others[(after - 1).clip(0)]
    inside = (stamps >= others[0]) & (stamps <= others[-1])
    usable = inside & ((gap <= _MAX_INTERPOLATED_GAP_NS) | np.isin(stamps, others))
    return np.asarray(usable)


def _too_few(matched: int, reference: Stamps, estimate: Stamps, offset_s: float) -> str:
    spans = [f"{s[0] * 1e-9:.3f} ... {s[-1] * 1e-9:.3f} s" for s in (reference, estimate)]
    overlap_s = (min(reference[-1], estimate[-1]) - max(reference[0], estimate[0])) * 1e-9
    message = (
        f"{count_of(matched, 'pose')} matched, at least {_MIN_PAIRS} are needed: the reference"
        f" spans {spans[0]}, the estimate {spans[1]}, overlap {max(0.0, overlap_s):.3f} s"
    )
    if overlap_s <= 0.0:
        suggestion = offset_s + (int(reference[0]) - int(estimate[0])) * 1e-9
        message += f"; if both start together try --t-offset {suggestion:.3f}"
    return message
