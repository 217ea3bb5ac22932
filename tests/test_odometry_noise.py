# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Noise of odometry, of its readings and of matches is told apart, where all three are known."""

from __future__ import annotations

import numpy as np
import pytest

from slarm_graph.frontends.scans.odometry_noise import OdometryNoise
from slarm_graph.geometry import Floats

GUESS, CLAIM = np.array([4e-4, 1e-4, 2.5e-4]), np.array([1e-4, 4e-4, 2e-4])
ALWAYS = np.ones(3, dtype=np.bool_)


def told(
    driving: Floats, matching: Floats, reading: Floats, steps: int = 4000, lasting: float = 0.0
) -> dict[str, Floats]:
    """What is learned on the whole from noise of known variances (3,)."""
    rng = np.random.default_rng(0)
    noise, known = OdometryNoise(), []
    of_match, of_reading = (
        np.diff(rng.normal(0.0, np.sqrt(v), (steps + 1, 3)), axis=0) for v in (matching, reading)
    )
    drift = rng.normal(0.0, np.sqrt(driving), (steps, 3))
    for k in range(1, steps):
        drift[k] = lasting * drift[k - 1] + np.sqrt(1.0 - lasting**2) * drift[k]
    for miss in of_match + of_reading + drift:
        noise.learn(miss, GUESS, CLAIM, ALWAYS)
        known.append(
            (
                noise.variance_factor,
                noise.match_variance_factor,
                noise.reading_variances,
                noise.path_variance_factor,
            )
        )
    names = ("excess", "match_excess", "reading", "path_excess")
    return {n: np.mean([k[i] for k in known[300:]], axis=0) for i, n in enumerate(names)}


@pytest.mark.parametrize(("more", "worse"), [(1.0, 1.0), (5.0, 1.0), (3.0, 6.0), (2.0, 40.0)])
def test_odometry_and_matches_get_what_they_are_off_by(more: float, worse: float) -> None:
    found = told(more * GUESS, worse * CLAIM, np.zeros(3))
    # What is learned from a hundred steps scatters, and has limits to one side.
    np.testing.assert_allclose(found["match_excess"], worse, rtol=0.25)
    room = 0.35 * worse * CLAIM / GUESS
    assert (np.abs(found["excess"] - more) < 0.25 * more + room).all()
    assert (np.abs(found["path_excess"] - more) < 0.35 * more + room).all()
    assert (found["reading"] < 0.35 * worse * CLAIM + 0.1 * more * GUESS).all()


def test_what_is_taken_back_ahead_but_not_aside_is_the_readings() -> None:
    reading = np.array([30.0, 0.0, 30.0]) * CLAIM
    found = told(GUESS, CLAIM, reading)
    np.testing.assert_allclose(found["match_excess"], 1.0, rtol=0.5)
    np.testing.assert_allclose(found["reading"][[0, 2]], reading[[0, 2]], rtol=0.2)
    assert found["reading"][1] < CLAIM[1]


def test_errors_that_go_on_add_up_along_a_path() -> None:
    """A step's variance stays, that of many is larger per step: (1 + a) / (1 - a) for long ones."""
    found = told(4.0 * GUESS, 0.01 * CLAIM, np.zeros(3), lasting=0.5)
    assert (found["path_excess"] > 1.8 * found["excess"]).all()


def test_axes_that_matches_say_nothing_of_learn_nothing() -> None:
    noise, rng = OdometryNoise(), np.random.default_rng(1)
    tells = np.array([True, False, True])
    noise.learn(np.zeros(3), GUESS, CLAIM, tells)
    for _ in range(200):
        noise.learn(rng.normal(0.0, 0.5, 3), GUESS, CLAIM, tells)
    assert (noise.variance_factor[[0, 2]] > 50.0).all()
    assert noise.variance_factor[1] == pytest.approx(1.0)
    assert (noise.path_variance_factor[[0, 2]] > 50.0).all()
    assert noise.path_variance_factor[1] == pytest.approx(1.0)


def test_a_branch_learns_for_itself_and_nothing_from_over_a_gap() -> None:
    noise = OdometryNoise()
    for sign in (1.0, -1.0, 1.0, -1.0):
        noise.learn(np.full(3, 0.02 * sign), GUESS, CLAIM, ALWAYS)
    before = noise.variance_factor.copy()
    other = noise.branched()
    for _ in range(20):
        other.learn(np.full(3, 0.5), GUESS, CLAIM, ALWAYS)
    np.testing.assert_array_equal(noise.variance_factor, before)
    noise.learn(np.full(3, 0.02), GUESS, CLAIM, ALWAYS)
    alone = OdometryNoise()
    for sign in (1.0, -1.0, 1.0, -1.0, 1.0):
        alone.learn(np.full(3, 0.02 * sign), GUESS, CLAIM, ALWAYS)
    np.testing.assert_array_equal(noise.variance_factor, alone.variance_factor)
    noise.interrupt()
    known = noise.variance_factor.copy()
    noise.learn(np.full(3, 9.0), GUESS, CLAIM, ALWAYS)
    np.testing.assert_array_equal(noise.variance_factor, known)


def by_the_book(
    misses: Floats, guesses: Floats, claims: Floats, tells: Floats
) -> tuple[Floats, Floats, Floats, Floats]:
    """A second implementation: weighted sums over all that was told, axis by axis."""
    first = np.minimum(claims[0], guesses[0])
    averages = np.array([guesses[0] + 2.0 * first, -first, guesses[0], first])
    path, since, sums = 10.0 * guesses[0] + 2.0 * first, 1, 2.0
    path_variance_factor = np.ones(3)
    for k in range(1, len(misses)):
        memory = min(20.0 + k, 100.0)
        new = np.array([misses[k] ** 2, misses[k] * misses[k - 1], guesses[k], claims[k]])
        both = tells[k] * tells[k - 1]
        share = np.array([tells[k], both, tells[k], tells[k]]) / memory
        averages += share * (new - averages)
        square, product, guess, claim = averages
        ratio = np.minimum(-product, 0.5 * square) / claim
        back = np.clip(ratio, 1.0, 1000.0) * claim
        if k + 1 - since == 10:
            sums = min(sums + 1.0, 10.0)
            total, heard = misses[since : k + 1].sum(axis=0), tells[since : k + 1].min(axis=0)
            path = path + heard / sums * (total**2 - path)
            path_variance_factor, since = (
                np.maximum((path - 2.0 * back) / 10.0 / guess, 0.01),
                k + 1,
            )
        alike = (ratio < 2.0 * ratio[1]) & (2.0 * ratio > ratio[1])
        match = min(max(ratio[alike].mean() if alike.any() else 1.0, 1.0), 1000.0)
        variance_factor = np.maximum((square - 2.0 * match * claim) / guess, 0.01)
    reading = np.maximum(back - match * claim, 0.0)
    return variance_factor, np.full(3, match), reading, path_variance_factor


@pytest.mark.parametrize("count", [2, 11, 12, 30, 75, 160, 250])
@pytest.mark.parametrize("seed", range(4))
def test_what_is_learned_is_what_averages_say(seed: int, count: int) -> None:
    """Whatever is told, and about whichever axes, in a drive in which guesses and claims change."""
    rng = np.random.default_rng(seed)
    matches = np.diff(rng.normal(0.0, np.sqrt([9.0, 9.0, 14.0] * CLAIM), (count + 1, 3)), axis=0)
    misses = matches + 0.02 * seed * rng.normal(size=(count, 3))
    guesses, claims = (v * rng.uniform(0.3, 3.0, (count, 3)) for v in (GUESS, CLAIM))
    tells = rng.random((count, 3)) < (0.8 if seed else 1.1)
    noise = OdometryNoise()
    for told_now in zip(misses, guesses, claims, tells, strict=True):
        noise.learn(*told_now)
    found = (
        noise.variance_factor,
        noise.match_variance_factor,
        noise.reading_variances,
        noise.path_variance_factor,
    )
    expected = by_the_book(misses, guesses, claims, tells.astype(np.float64))
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-15)


def test_before_anything_is_learned_noise_is_as_guessed() -> None:
    noise = OdometryNoise()
    for factor in (noise.variance_factor, noise.match_variance_factor, noise.path_variance_factor):
        np.testing.assert_array_equal(factor, [1.0, 1.0, 1.0])
    np.testing.assert_array_equal(noise.reading_variances, [0.0, 0.0, 0.0])
