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


def alone(variances: Floats) -> Floats:
    """Variances (3,) as those of a single source (3, 3)."""
    return np.array([variances, np.zeros(3), np.zeros(3)])


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
        noise.learn(miss, alone(GUESS), CLAIM, ALWAYS)
        known.append(
            (
                noise.source_factors[0],
                noise.match_variance_factor,
                noise.reading_variances,
                noise.path_variance_factor * noise.source_factors[0],
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
    noise.learn(np.zeros(3), alone(GUESS), CLAIM, tells)
    for _ in range(200):
        noise.learn(rng.normal(0.0, 0.5, 3), alone(GUESS), CLAIM, tells)
    assert (noise.source_factors[0, [0, 2]] > 50.0).all()
    np.testing.assert_array_equal(noise.source_factors[:, 1], 1.0)
    assert noise.path_variance_factor[1] == pytest.approx(1.0)


def test_a_branch_learns_for_itself_and_nothing_from_over_a_gap() -> None:
    noise, sources = OdometryNoise(), np.array([GUESS, 2.0 * GUESS, 0.5 * GUESS])
    for sign in (1.0, -1.0, 1.0, -1.0):
        noise.learn(np.full(3, 0.02 * sign), sources, CLAIM, ALWAYS)
    before = noise.source_factors.copy()
    other = noise.branched()
    for _ in range(20):
        other.learn(np.full(3, 0.5), sources, CLAIM, ALWAYS)
    np.testing.assert_array_equal(noise.source_factors, before)
    noise.learn(np.full(3, 0.02), sources, CLAIM, ALWAYS)
    apart = OdometryNoise()
    for sign in (1.0, -1.0, 1.0, -1.0, 1.0):
        apart.learn(np.full(3, 0.02 * sign), sources, CLAIM, ALWAYS)
    np.testing.assert_array_equal(noise.source_factors, apart.source_factors)
    noise.interrupt()
    known = noise.source_factors.copy()
    noise.learn(np.full(3, 9.0), sources, CLAIM, ALWAYS)
    np.testing.assert_array_equal(noise.source_factors, known)


def by_the_book(
    misses: Floats, sources: Floats, claims: Floats, tells: Floats
) -> tuple[Floats, Floats, Floats, Floats]:
    """A second implementation: weighted sums over all that was told, axis by axis.

    The sources' log variances are found as the maximum of a linearised posterior, by its
    information.
    """
    guesses = sources.sum(axis=1)
    first = np.minimum(claims[0], guesses[0])
    averages = np.array([guesses[0] + 2.0 * first, -first, guesses[0], first])
    path, since, sums = 10.0 * guesses[0] + 2.0 * first, 1, 2.0
    path_variance_factor, logs, spreads = np.ones(3), np.zeros((3, 3)), [0.1 * np.eye(3)] * 3
    for k in range(1, len(misses)):
        memory = min(20.0 + k, 100.0)
        guess_now = (np.exp(logs) * sources[k]).sum(axis=0)
        new = np.array([misses[k] ** 2, misses[k] * misses[k - 1], guess_now, claims[k]])
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
        for axis in np.flatnonzero(tells[k]):
            parts = np.exp(logs[:, axis]) * sources[k, :, axis]
            variance = parts.sum() + 2.0 * match * claims[k, axis]
            shares = parts / variance
            spread = np.linalg.inv(np.linalg.inv(spreads[axis]) + np.outer(shares, shares) / 2.0)
            unsure = 0.25 * (1.0 - shares.sum())
            score = 0.5 * (misses[k, axis] ** 2 / variance - 1.0 - unsure**2) * shares
            logs[:, axis] = np.maximum(logs[:, axis] + spread @ score, np.log(0.01))
            spread = spread + 2e-4 * np.eye(3)
            bound = np.diag(np.minimum(1.0, np.sqrt(0.1 / spread.diagonal())))
            spreads[axis] = bound @ spread @ bound
    reading = np.maximum(back - match * claim, 0.0)
    return np.exp(logs), np.full(3, match), reading, path_variance_factor


@pytest.mark.parametrize("count", [2, 11, 12, 30, 75, 160, 250])
@pytest.mark.parametrize("seed", range(4))
def test_what_is_learned_is_what_averages_say(seed: int, count: int) -> None:
    """Whatever is told, and about whichever axes, in a drive in which guesses and claims change."""
    rng = np.random.default_rng(seed)
    matches = np.diff(rng.normal(0.0, np.sqrt([9.0, 9.0, 14.0] * CLAIM), (count + 1, 3)), axis=0)
    misses = matches + 0.02 * seed * rng.normal(size=(count, 3))
    sources = GUESS * rng.uniform(0.1, 1.0, (count, 3, 3))
    claims = CLAIM * rng.uniform(0.3, 3.0, (count, 3))
    tells = rng.random((count, 3)) < (0.8 if seed else 1.1)
    noise = OdometryNoise()
    for told_now in zip(misses, sources, claims, tells, strict=True):
        noise.learn(*told_now)
    found = (
        noise.source_factors,
        noise.match_variance_factor,
        noise.reading_variances,
        noise.path_variance_factor,
    )
    expected = by_the_book(misses, sources, claims, tells.astype(np.float64))
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-15)


@pytest.mark.parametrize("factors", [(1.0, 1.0, 1.0), (0.2, 9.0, 0.5), (4.0, 0.1, 6.0)])
def test_noise_of_steps_of_distance_and_of_angle_are_told_apart(
    factors: tuple[float, float, float],
) -> None:
    """A robot that stands, drives, turns and does both; the variance of each of these is found."""
    rng, noise = np.random.default_rng(5), OdometryNoise()
    kinds = np.array([[1, 0, 0], [1, 4, 0], [1, 0, 4], [1, 4, 4]]) * 1e-5
    found, true = [], kinds @ np.array(factors)
    for k in range(8000):
        kind = k // 25 % 4
        miss = rng.normal(0.0, np.sqrt(true[kind]), 3)
        noise.learn(miss, np.repeat(kinds[kind][:, None], 3, axis=1), np.full(3, 1e-8), ALWAYS)
        if k > 2000:
            found.append(kinds @ noise.source_factors)
    np.testing.assert_allclose(np.mean(found, axis=(0, 2)), true, rtol=0.15)


def test_before_anything_is_learned_noise_is_as_guessed() -> None:
    noise = OdometryNoise()
    for factor in (noise.source_factors, noise.match_variance_factor, noise.path_variance_factor):
        np.testing.assert_array_equal(factor, np.ones_like(factor))
    np.testing.assert_array_equal(noise.reading_variances, [0.0, 0.0, 0.0])
