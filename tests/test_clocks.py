# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Clocks apart: each step of the search, where it is known by how much."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

import numpy as np
import pytest
from test_evaluation import noisy, room_drive

from slarm_graph.errors import BadInput
from slarm_graph.eval.association import associate
from slarm_graph.eval.clocks import (
    _NO_FIT_M,
    _candidates_s,
    _correlation,
    _Fits,
    _motion,
    _overlap,
    _thinned,
    find_offset,
    offset_advice,
)
from slarm_graph.eval.trajectory_accuracy import aligned_rmse_m
from slarm_graph.trajectory import Trajectory


def later(path: Trajectory, offset_s: float) -> Trajectory:
    return replace(path, stamps_ns=path.stamps_ns + round(offset_s * 1e9))


@pytest.mark.parametrize("off_s", [-0.49, -0.26, 0.0, 0.12, 0.4])
@pytest.mark.parametrize("apart_s", [0.0, 7.0])
def test_the_best_offset_within_half_a_second_is_found(off_s: float, apart_s: float) -> None:
    path = room_drive()
    fits = _Fits(path, later(path, -apart_s), 0.3)
    found_s = fits.best_near_s(apart_s + off_s)
    assert found_s == pytest.approx(apart_s, abs=2e-3)
    assert fits.misfit(apart_s) < 1e-9


class Valley(_Fits):
    """A misfit of given lowest place [s], that remembers where it was asked for."""

    lowest_s = 0.0
    asked_s: ClassVar[list[float]] = []

    def misfit(self, offset_s: float) -> float:
        self.asked_s.append(offset_s)
        return abs(offset_s - self.lowest_s)


@pytest.mark.parametrize("lowest_s", [6.51, 6.93, 7.0, 7.49, 9.0])
def test_the_search_refines_between_the_neighbours_of_the_best(
    monkeypatch: pytest.MonkeyPatch, lowest_s: float
) -> None:
    """Of every twentieth second up to half a second before and after."""
    path = room_drive(5)
    asked_s: list[float] = []
    monkeypatch.setattr(Valley, "lowest_s", lowest_s)
    monkeypatch.setattr(Valley, "asked_s", asked_s)
    found_s = Valley(path, path, 0.3).best_near_s(7.0)
    grid_s = 7.0 + np.arange(-10, 11) * 0.05
    np.testing.assert_allclose(asked_s[:21], grid_s)
    near_s = grid_s[np.argmin(np.abs(grid_s - lowest_s))]
    assert np.abs(np.array(asked_s[21:]) - near_s).max() <= 0.05 + 1e-9
    assert found_s == pytest.approx(min(lowest_s, 7.55), abs=2e-4)


def test_a_misfit_is_the_error_over_the_share_that_overlaps() -> None:
    path = room_drive()
    estimate = noisy(path)
    fits = _Fits(path, estimate, 0.5)
    whole = fits.misfit(0.0)
    assert whole == pytest.approx(aligned_rmse_m(associate(path, estimate)))
    half = replace(path, stamps_ns=path.stamps_ns[:240], poses=path.poses[:240])
    there = replace(estimate, stamps_ns=estimate.stamps_ns[:240], poses=estimate.poses[:240])
    expected = aligned_rmse_m(associate(half, there)) / 0.6
    assert _Fits(half, estimate, 0.5).misfit(0.0) == pytest.approx(expected)
    assert _Fits(half, estimate, 0.61).misfit(0.0) == _NO_FIT_M
    assert fits.misfit(1e4) == _NO_FIT_M


def test_motion_is_speed_and_turning_of_either_sign_in_equal_steps() -> None:
    stamps = np.arange(0, 3_000_000_000, 50_000_000)
    seconds = stamps * 1e-9
    for sign in (1.0, -1.0):
        poses = np.column_stack([0.4 * seconds, np.zeros(len(seconds)), sign * 3.0 * seconds])
        found = _motion(Trajectory(stamps, poses), 0.1)
        np.testing.assert_allclose(found, np.tile([0.4, 3.0], (29, 1)), atol=1e-9)


def test_likeness_is_the_correlation_coefficient_of_what_overlaps() -> None:
    """At every shift, as numpy has it; none where less than the least overlaps."""
    rng = np.random.default_rng(0)
    a, b, least = 3.0 + rng.normal(size=30), 5.0 + rng.normal(size=20), 6
    found = _correlation(a, b, least)
    assert len(found) == 49
    for index, value in enumerate(found):
        shift = index - 19
        low, high = max(0, shift), min(30, shift + 20)
        if high - low < least:
            assert value == -np.inf
        else:
            expected = np.corrcoef(a[low:high], b[low - shift : high - shift])[0, 1]
            assert value == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("apart_s", [-3.0, 12.5, 1000.0])
def test_what_moves_alike_is_a_candidate(apart_s: float) -> None:
    """To half a step; offset zero is one as well."""
    path = room_drive()
    part = replace(path, stamps_ns=path.stamps_ns[100:300], poses=path.poses[100:300])
    found = _candidates_s(path, later(part, -apart_s))
    assert min(abs(offset_s - apart_s) for offset_s in found) <= 0.05
    assert found[0] == 0.0
    assert len(found) == 4


@pytest.mark.parametrize("seed", range(18))
def test_candidates_are_the_best_likenesses_half_a_second_apart(seed: int) -> None:
    """Against all shifts one by one, coefficients by numpy; where the motion repeats after 0.6 s
    the next best lie just beyond.
    """
    rng = np.random.default_rng(seed)
    paths = []
    noise, loud, period = ((0.1, 0.0, 1.0), (0.005, 0.2, 5.0), (0.005, 0.2, 6.0))[seed % 3]
    beat = loud * (1.0 + np.sin(np.arange(60)[:, None] * 2.0 * np.pi / period))
    for count in rng.integers(15, 60, 2):
        stamps = np.arange(count, dtype=np.int64) * 100_000_000
        steps = rng.normal(2.0 * noise, noise, (count, 3)) + beat[:count]
        paths.append(Trajectory(stamps, np.cumsum(steps, axis=0)))
    ours, theirs = (_motion(path, 0.1) for path in paths)
    least = max(3, int(0.3 * min(len(ours), len(theirs))))
    likeness = {}
    for shift in range(1 - len(theirs), len(ours)):
        low, high = max(0, shift), min(len(ours), shift + len(theirs))
        if high - low >= least:
            both = [(ours[low:high, k], theirs[low - shift : high - shift, k]) for k in range(2)]
            likeness[shift] = sum(np.corrcoef(a, b)[0, 1] for a, b in both)
    expected = []
    for _ in range(3):
        peak = max(likeness, key=lambda shift: likeness[shift])
        expected.append(0.1 * peak)
        likeness = {shift: v for shift, v in likeness.items() if abs(shift - peak) > 5}
    assert _candidates_s(*paths)[1:] == pytest.approx(expected)


def test_overlap_is_the_share_of_the_estimates_poses() -> None:
    path = room_drive(101)
    assert _overlap(path, path, 0.0) == 1.0
    assert _overlap(path, path, 5.0) == pytest.approx(51 / 101)
    assert _overlap(path, path, -2.5) == pytest.approx(76 / 101)
    assert _overlap(path, path, 11.0) == 0.0


def test_a_long_estimate_is_thinned_evenly() -> None:
    stamps = np.arange(4_001, dtype=np.int64) * 10
    found = _thinned(Trajectory(stamps, np.zeros((4_001, 3))))
    assert found.stamps_ns.tolist() == list(range(0, 40_010, 30))


def test_paths_that_share_too_little_have_no_offset() -> None:
    """The estimate is a third as long, and all of it must lie within the reference's time."""
    path = room_drive()
    third = replace(path, stamps_ns=path.stamps_ns[:130], poses=path.poses[:130])
    with pytest.raises(BadInput, match="give --t-offset"):
        find_offset(third, path, least_pairs=0.9)
    assert find_offset(path, later(third, 3.0), least_pairs=0.9).offset_s == pytest.approx(
        -3.0, abs=2e-3
    )


def test_a_gain_too_small_to_tell_is_not_told() -> None:
    """Both clocks are right, or the error is below half a centimetre anyway."""
    path = room_drive()
    assert offset_advice(path, noisy(path), associate(path, noisy(path))) == ""
    late = later(path, 0.01)
    assert aligned_rmse_m(associate(path, late)) < 0.005
    assert offset_advice(path, late, associate(path, late)) == ""
    said = offset_advice(path, later(path, 0.6), associate(path, later(path, 0.6)))
    assert "(--t-offset -0.600, or auto)" in said
    assert "with the offset 0 s and 0.000 m with -0.600 s" in said


@pytest.mark.parametrize(("noise_m", "told"), [(0.01, True), (0.08, False)])
def test_an_offset_that_helps_little_is_not_told(noise_m: float, told: bool) -> None:
    """The clocks are apart by as much, but under more noise the error hardly falls."""
    path = room_drive()
    estimate = later(noisy(path, sigma_m=noise_m), 0.2)
    pairs = associate(path, estimate)
    found_m, now_m = find_offset(path, estimate).ate_rmse_m, aligned_rmse_m(pairs)
    assert now_m - found_m > 0.005
    assert (found_m < 0.6 * now_m) == told
    assert bool(offset_advice(path, estimate, pairs)) == told
