# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Systematic errors of odometry, and telling its noise from that of matches."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slarm_graph.frontends.scans.wheel_calibration import (
    WheelCalibration,
    calibrated_motion,
    correlated_covariance,
)
from slarm_graph.geometry import Floats


def test_odometry_noise_grows_with_the_way() -> None:
    wheels = WheelCalibration()
    still, moved, turned = (
        calibrated_motion(
            np.array(v), wheels.noise.source_factors, np.ones(3), wheels.errors, wheels.covariance
        )[1]
        for v in ([0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [0.0, 0.0, 0.5])
    )
    assert np.all(np.diag(moved) >= np.diag(still))
    assert np.trace(moved) > np.trace(still)
    assert turned[2, 2] > still[2, 2]


@pytest.mark.parametrize("errors", [(0.05, 0.0, 0.0), (0.0, -0.08, 0.0), (0.0, 0.0, 0.02)])
def test_systematic_errors_are_found(errors: tuple[float, float, float]) -> None:
    rng = np.random.default_rng(0)
    wheels = WheelCalibration()
    for _ in range(600):
        told = np.array([0.1, 0.0, rng.normal(0.0, 0.05)])
        way, turn, bend = errors
        true = told * [1 + way, 1 + way, 1 + turn] + [0.0, 0.0, 0.1 * bend]
        wheels.learn(told, true + rng.normal(0.0, 0.001, 3), np.full(3, 1e-6), 1.0)
    np.testing.assert_allclose(wheels.errors, errors, atol=0.01)


def test_one_match_far_off_does_not_turn_what_many_have_told() -> None:
    """A match beside its place in a turn is an event, though the noise so far was small."""
    rng = np.random.default_rng(0)
    wheels = WheelCalibration()
    for _ in range(300):
        told = np.array([0.2, 0.0, rng.normal(0.0, 0.02)])
        wheels.learn(told, told + rng.normal(0.0, 0.001, 3), np.full(3, 1e-6), 1.0)
    before, sigma = wheels.errors[1], math.sqrt(wheels.covariance[1, 1])
    wheels.learn(np.array([0.2, 0.0, 0.2]), np.array([0.2, 0.0, 0.3]), np.full(3, 1e-6), 1.0)
    assert 0.0 < wheels.errors[1] - before < 2.0 * sigma


def variances_of_a_step(wheels: WheelCalibration, distance_m: float) -> Floats:
    """Variances (3,) that are learned of a step ahead, its systematic errors known."""
    step, known = np.array([distance_m, 0.0, 0.0]), np.zeros((3, 3))
    noise = wheels.noise
    return np.diag(calibrated_motion(step, noise.source_factors, np.ones(3), step, known)[1])


def learned(of_step: Floats, of_match: Floats, of_reading: Floats) -> tuple[Floats, ...]:
    """Variances (3,) found of matches, single steps, steps along a path, and readings.

    Of matches of 4 mm and 4 mrad by their points alone, in steps of 0.1 m; the truth are standard
    deviations (3,) of every step, of every match, and of every reading of odometry.
    """
    rng = np.random.default_rng(1)
    wheels, found = WheelCalibration(), []
    match, reading = np.zeros(3), np.zeros(3)
    for _ in range(3000):
        now, read = of_match * rng.standard_normal(3), of_reading * rng.standard_normal(3)
        told = np.array([0.1, 0.0, 0.0]) + read - reading
        moved = np.array([0.1, 0.0, 0.0]) + of_step * rng.standard_normal(3) + now - match
        match, reading = now, read
        wheels.learn(told, moved, np.full(3, 0.004**2), 1.0)
        step = variances_of_a_step(wheels, 0.1)
        one = step, wheels.noise.path_variance_factor * step
        found.append(
            (wheels.noise.match_variance_factor * 0.004**2, *one, wheels.noise.reading_variances)
        )
    return tuple(np.mean(found[500:], axis=0))


def test_noise_of_odometry_and_of_matches_are_told_apart() -> None:
    """Odometry's error stays in the path, a match's is taken back by the next one."""
    matches, steps, _, _ = learned(np.full(3, 0.006), np.full(3, 0.012), np.zeros(3))
    np.testing.assert_allclose(matches, 0.012**2, rtol=0.3)
    assert steps[0] == pytest.approx(0.006**2, rel=0.5)


def test_readings_of_odometry_are_not_held_against_matches() -> None:
    """Stamps that are off shift odometry along the way, and the next reading takes that back."""
    none = np.zeros(3)
    matches, steps, path, reading = learned(np.full(3, 0.001), none, np.array([0.02, 0.0, 0.0]))
    np.testing.assert_allclose(matches, 0.004**2, rtol=0.1)
    # A step is between two readings; along a path they cancel.
    assert steps[0] == pytest.approx(2.0 * 0.02**2, rel=0.3)
    assert path[0] < 0.2 * steps[0]
    assert reading[0] == pytest.approx(0.02**2, rel=0.3)
    assert (reading[1:] < 0.001**2).all()


def test_a_bare_corridor_teaches_nothing_of_how_errors_add_up() -> None:
    """There matches stick along the way and say so; what they miss by is not odometry's."""
    rng = np.random.default_rng(2)
    wheels, step = WheelCalibration(), np.array([0.2, 0.0, 0.0])
    for k in range(6000):
        is_bare = k % 100 < 60 or (k % 100 >= 80 and k % 2 == 0)
        moved = step + rng.normal(0.0, 0.002, 3) - [0.15 * is_bare, 0.0, 0.0]
        wheels.learn(step, moved, np.array([1.0 if is_bare else 1e-6, 1e-6, 1e-6]), 1.0)
    path = wheels.noise.path_variance_factor * variances_of_a_step(wheels, 0.2)
    assert path[0] < 0.1 * 0.014**2  # a tenth of what is supposed at first
    assert wheels.noise.match_variance_factor[0] < 10.0
    assert wheels.noise.reading_variances[0] < 0.003**2
    # Nor does what follows upon such a match, since it takes back what that was off.
    for claimed_m2 in (1e-6, 1.0):
        product = wheels.noise._product[0]
        wheels.learn(step, step - [0.15, 0.0, 0.0], np.array([claimed_m2, 1e-6, 1e-6]), 1.0)
    wheels.learn(step, 1.1 * step, np.full(3, 1e-6), 1.0)
    assert wheels.noise._product[0] == product


def test_headings_that_match_well_do_not_vouch_for_places() -> None:
    """In a crowd matches are pulled to the side, while walls hold the heading."""
    of_match = np.array([0.012, 0.012, 0.002])
    matches, steps, _, _ = learned(np.full(3, 0.001), of_match, np.zeros(3))
    np.testing.assert_allclose(matches[:2], 0.012**2, rtol=0.3)
    assert (steps[:2] < 0.006**2).all()


def test_turns_and_straights_are_both_as_sure_as_predicted() -> None:
    """Of a robot of two wheels that slip at random, by the root of each one's way."""
    rng, wheels, apart_m = np.random.default_rng(4), WheelCalibration(), 0.3
    squared: dict[bool, list[float]] = {True: [], False: []}
    for k in range(4000):
        turns = k // 40 % 2 == 0
        told = np.array([-0.05, 0.05] if turns else [0.1, 0.1])
        ground = told + 0.004 * np.sqrt(np.abs(told)) * rng.standard_normal(2)
        step, moved = (np.array([w.mean(), 0.0, (w[1] - w[0]) / apart_m]) for w in (told, ground))
        moved += rng.normal(0.0, 0.0005, 3)
        motion, covariance = calibrated_motion(
            step, wheels.noise.source_factors, np.ones(3), wheels.errors, wheels.covariance
        )
        if k > 800:
            squared[turns].append((moved[2] - motion[2]) ** 2 / (covariance[2, 2] + 0.0005**2))
        wheels.learn(step, moved, np.full(3, 0.0005**2), 1.0)
    for values in squared.values():
        assert 0.75 < np.mean(values) < 1.25


def test_at_first_noise_is_that_of_three_independent_sources() -> None:
    """4 mm and 4 mrad, 5 % of the way (3 % aside), and 3 mm or a tenth of it per radian."""
    step, nothing, ones = np.array([0.3, 0.4, -0.2]), np.zeros((3, 3)), np.ones((3, 3))
    expected = [
        0.004**2 + (0.05 * 0.5) ** 2 + (0.03 * 0.2) ** 2,
        0.004**2 + (0.03 * 0.5) ** 2 + (0.03 * 0.2) ** 2,
        0.004**2 + (0.05 * 0.5) ** 2 + (0.10 * 0.2) ** 2,
    ]
    motion, covariance = calibrated_motion(step, ones, np.ones(3), np.zeros(3), nothing)
    np.testing.assert_allclose(motion, step)
    np.testing.assert_allclose(covariance, np.diag(expected))
    path = np.array([3.0, 1.0, 0.5])
    adds_up = correlated_covariance(step, 2.0 * ones, path)
    np.testing.assert_allclose(adds_up, np.diag([4.0 * expected[0], 0.0, 0.0]))


def test_perfect_odometry_is_no_surer_than_a_tenth_of_what_is_supposed_at_first() -> None:
    wheels, step = WheelCalibration(), np.array([0.1, 0.0, 0.1])
    for _ in range(3000):
        wheels.learn(step, step, np.full(3, 1e-12), 1.0)
    noise = wheels.noise
    assert noise.source_factors.min() == pytest.approx(0.01)
    given = step, np.ones((3, 3)), np.ones(3), np.zeros(3), np.zeros((3, 3))
    supposed = np.diag(calibrated_motion(*given)[1])
    for path in (np.ones(3), noise.path_variance_factor, np.full(3, 1e-9)):
        known = step, noise.source_factors, path, np.zeros(3), np.zeros((3, 3))
        assert (np.diag(calibrated_motion(*known)[1]) > 0.00999 * supposed).all()


@pytest.mark.parametrize("variance_m2", [1e-3, 1.0])
def test_a_match_says_at_most_what_it_says(variance_m2: float) -> None:
    """However unsure the readings are, the way between them is not beyond the match."""
    wheels = WheelCalibration()
    wheels.noise.reading_variances = np.array([variance_m2, 0.0, 0.0])
    variance = wheels.covariance[0, 0]
    wheels.learn(np.array([0.1, 0.0, 0.0]), np.array([0.11, 0.0, 0.0]), np.full(3, 1e-6), 1.0)
    noise = 0.004**2 + 0.005**2 + 2e-6
    expected = variance * 0.11 / (variance * 0.11**2 + noise) * 0.01
    assert wheels.path_errors[0] == pytest.approx(expected)
    known = variance * 0.1 / (variance * 0.1**2 + noise) * 0.01
    assert wheels.errors[0] == pytest.approx(known)
