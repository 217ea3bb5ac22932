# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Estimation of the clock offset of two trajectories: correlation of motion, then fit."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy

from slarm_graph.errors import BadInput
from slarm_graph.eval.association import Pairs, associate
from slarm_graph.eval.trajectory_accuracy import aligned_rmse_m
from slarm_graph.geometry import Floats, wrap_angles
from slarm_graph.trajectory import Trajectory

_STEP_S = 0.1
"""Time step of the correlated motions; robots turn slower than that. The fit refines it."""
_MAX_STEPS = 200_000
"""Longer recordings (5.5 hours) are compared in longer steps."""
_PEAKS = 3
"""Number of correlation peaks that are tried by fit."""
_LEAST_OVERLAP = 0.3
"""Least overlap, as a share of the shorter trajectory: with less, a chance match of few seconds
wins."""
_FIT_POSES = 2_000
"""Most poses of the estimate in a fit: 2,000 find the offset to a few milliseconds."""
_AS_MUCH = 0.8
"""Another offset is reported when it matches at least this share of the present pairs."""
_MUCH_BETTER = 0.6
"""Another offset is reported when its error is below this share of the present one."""
_WORTH_TELLING_M = 0.005
"""Least reported improvement; below half a centimetre it is within the sensors' error."""

_NO_FIT_M = 1e9
"""Value for no fit; infinity would break the search's parabolas."""
_NO_PAIRS = Pairs(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3)), 0, "", "")
"""The pairs of two trajectories that do not overlap in time."""


@dataclass(frozen=True, slots=True)
class ClockOffset:
    """A clock offset and the error with it.

    Parameters
    ----------
    offset_s : float
        To be added to the stamps of the estimate [s].
    ate_rmse_m : float
        After alignment with it [m].
    """

    offset_s: float
    ate_rmse_m: float


def find_offset(
    reference: Trajectory, estimate: Trajectory, least_pairs: float = 0.0
) -> ClockOffset:
    """Find the clock offset of the least error per share of the estimate that overlaps.

    Parameters
    ----------
    reference, estimate : Trajectory
    least_pairs : float
        Share of the estimate's poses that must lie within the reference's time at least.

    Raises
    ------
    BadInput
        When nothing fits at any offset.
    """
    thin = estimate if len(estimate) <= _FIT_POSES else _thinned(estimate)
    fits = _Fits(reference, thin, max(_LEAST_OVERLAP, least_pairs))
    best_s = min(map(fits.best_near_s, _candidates_s(reference, estimate)), key=fits.misfit)
    if fits.misfit(best_s) >= _NO_FIT_M:
        raise BadInput(
            "no clock offset found with which both trajectories overlap; give --t-offset"
        )
    return ClockOffset(best_s, aligned_rmse_m(associate(reference, thin, offset_s=best_s)))


def offset_advice(
    reference: Trajectory, estimate: Trajectory, pairs: Pairs, offset_s: float = 0.0
) -> str:
    """Return a notice where another clock offset fits much better than the one used; else empty."""
    now_m = aligned_rmse_m(pairs)
    if now_m < _WORTH_TELLING_M:
        return ""
    try:
        # A lucky fit of less of the path proves nothing.
        found = find_offset(reference, estimate, _AS_MUCH * _overlap(reference, estimate, offset_s))
    except BadInput:
        return ""
    if found.ate_rmse_m > min(_MUCH_BETTER * now_m, now_m - _WORTH_TELLING_M):
        return ""
    return (
        f"the clocks seem to be apart: the ATE is {now_m:.3f} m with the offset {offset_s:g} s and"
        f" {found.ate_rmse_m:.3f} m with {found.offset_s:.3f} s (--t-offset {found.offset_s:.3f},"
        " or auto)"
    )


def _overlap(reference: Trajectory, estimate: Trajectory, offset_s: float) -> float:
    """Return the share of the estimate's poses within the reference's time."""
    stamps = estimate.stamps_ns + round(offset_s * 1e9)
    return float(np.mean((stamps >= reference.stamps_ns[0]) & (stamps <= reference.stamps_ns[-1])))


def _thinned(path: Trajectory) -> Trajectory:
    step = -(-len(path) // _FIT_POSES)
    return Trajectory(path.stamps_ns[::step], path.poses[::step])


@dataclass(frozen=True, slots=True)
class _Fits:
    """The error of an estimate as a function of the clock offset."""

    reference: Trajectory
    estimate: Trajectory
    least_pairs: float

    def misfit(self, offset_s: float) -> float:
        """Return the aligned ATE [m] over the share matched; huge where that is too little."""
        # Always at the estimate's own poses: interpolated in between its noise would be averaged,
        # and the fit drawn to where the two are half a period apart.
        stamps = self.estimate.stamps_ns + round(offset_s * 1e9)
        ours = self.reference.stamps_ns
        there = (stamps >= ours[0]) & (stamps <= ours[-1])
        matched = float(there.mean())
        if matched < self.least_pairs or there.sum() < 3:
            return _NO_FIT_M
        estimate = self.estimate.poses[there]
        reference = self.reference.at(stamps[there])
        return aligned_rmse_m(replace(_NO_PAIRS, reference=reference, estimate=estimate)) / matched

    def best_near_s(self, offset_s: float) -> float:
        """Return the best offset within half a second of another [s]."""
        near_s = float(min(np.arange(-10, 11) * _STEP_S / 2.0 + offset_s, key=self.misfit))
        bounds = (near_s - _STEP_S / 2.0, near_s + _STEP_S / 2.0)
        options = {"xatol": 1e-4}
        found = scipy.optimize.minimize_scalar(
            self.misfit, bounds=bounds, method="bounded", options=options
        )
        return float(found.x) if found.fun < self.misfit(near_s) else near_s


def _candidates_s(reference: Trajectory, estimate: Trajectory) -> list[float]:
    """Return the offsets of the highest correlation of speed and turn rate."""
    longest_s = max(float(p.stamps_ns[-1] - p.stamps_ns[0]) * 1e-9 for p in (reference, estimate))
    step_s = max(_STEP_S, longest_s / _MAX_STEPS)
    ours, theirs = _motion(reference, step_s), _motion(estimate, step_s)
    least = max(3, int(_LEAST_OVERLAP * min(len(ours), len(theirs))))
    likeness = np.sum([_correlation(ours[:, k], theirs[:, k], least) for k in range(2)], axis=0)
    starts_apart_s = float(reference.stamps_ns[0] - estimate.stamps_ns[0]) * 1e-9
    found = [0.0]
    for _ in range(_PEAKS):
        peak = int(np.argmax(likeness))
        found.append(starts_apart_s + (peak - len(theirs) + 1) * step_s)
        likeness[max(0, peak - 5) : peak + 6] = -np.inf
    return found


def _motion(path: Trajectory, step_s: float) -> Floats:
    """Return speed and absolute turn rate (T, 2) in equal time steps."""
    stamps = np.arange(path.stamps_ns[0], path.stamps_ns[-1] + 1, round(step_s * 1e9))
    poses = path.at(stamps)
    speed = np.linalg.norm(np.diff(poses[:, :2], axis=0), axis=1) / step_s
    turning = np.abs(wrap_angles(np.diff(poses[:, 2]))) / step_s
    return np.column_stack([speed, turning])


def _correlation(a: Floats, b: Floats, least: int) -> Floats:
    """Return the correlation coefficient of two signals at every shift, with enough overlap."""

    def shifted(x: Floats, y: Floats) -> Floats:
        """Return sum of products at every shift."""
        return np.asarray(scipy.signal.fftconvolve(x, y[::-1], mode="full"))

    ones_a, ones_b = np.ones_like(a), np.ones_like(b)
    count = np.round(shifted(ones_a, ones_b)).clip(1.0)
    sum_a, sum_b = shifted(a, ones_b), shifted(ones_a, b)
    covariance = shifted(a, b) - sum_a * sum_b / count
    spread_a = (shifted(a * a, ones_b) - sum_a**2 / count).clip(1e-12)
    spread_b = (shifted(ones_a, b * b) - sum_b**2 / count).clip(1e-12)
    return np.where(count >= least, covariance / np.sqrt(spread_a * spread_b), -np.inf)
