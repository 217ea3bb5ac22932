# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Compiled poses and densities against those of numpy and scipy, and mixtures by their moments."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from slarm_graph.frontends.scans.odometry_filter import Prediction, mixture_covariance
from slarm_graph.frontends.scans.odometry_fusion import (
    _with_heading_lever,
    integrated_velocity,
    propagated_velocity_covariance,
)
from slarm_graph.frontends.scans.small_pose import (
    between3,
    compose3,
    inverse_adjoint,
    log_density,
    moved,
    squared_mahalanobis,
    transported3,
    wrapped,
)
from slarm_graph.geometry import Floats, Pose2, adjoints, between, compose, invert, wrap_angles


def drawn(seed: int) -> tuple[Floats, Floats, Floats]:
    """Two poses with headings of all kinds, and a covariance."""
    rng = np.random.default_rng(seed)
    a, b = rng.uniform([-5.0, -5.0, -9.0], [5.0, 5.0, 9.0], (2, 3))
    root = rng.normal(size=(3, 3))
    return a, b, root @ root.T + 0.1 * np.eye(3)


@pytest.mark.parametrize("seed", range(10))
def test_poses_are_those_of_geometry(seed: int) -> None:
    a, b, covariance = drawn(seed)
    np.testing.assert_allclose(compose3(a, b), compose(a, b), atol=1e-12)
    np.testing.assert_allclose(between3(a, b), between(a, b), atol=1e-12)
    assert moved(a, b)[2] == a[2] + b[2]
    np.testing.assert_allclose(wrap_angles(moved(a, b) - compose(a, b))[2], 0.0, atol=1e-12)
    inverse = adjoints(invert(b))
    np.testing.assert_allclose(inverse_adjoint(b), inverse, atol=1e-12)
    np.testing.assert_allclose(transported3(covariance, b), inverse @ covariance @ inverse.T)


def test_angles_are_wrapped_above_minus_pi() -> None:
    given = np.array([0.0, 3.0, 4.0, -4.0, 10.0, -10.0, math.pi, -math.pi, 3.0 * math.pi])
    found = np.array([wrapped(float(angle)) for angle in given])
    np.testing.assert_allclose(np.cos(found), np.cos(given), atol=1e-12)
    np.testing.assert_allclose(np.sin(found), np.sin(given), atol=1e-12)
    assert (np.abs(found) <= math.pi).all()
    assert wrapped(-math.pi) == wrapped(math.pi) == math.pi


@pytest.mark.parametrize("seed", range(10))
def test_densities_are_those_of_student(seed: int) -> None:
    """Of four degrees of freedom; normal at the peak, where the two are made to agree."""
    miss, _, covariance = drawn(seed)
    away = np.array([miss[0], miss[1], wrap_angles(miss[2])])
    squared = float(away @ np.linalg.solve(covariance, away))
    assert squared_mahalanobis(miss, covariance) == pytest.approx(squared)
    student = stats.multivariate_t(np.zeros(3), covariance, df=4)
    normal = stats.multivariate_normal(np.zeros(3), covariance)
    fall = student.logpdf(away) - student.logpdf(np.zeros(3))
    expected = normal.logpdf(np.zeros(3)) + fall
    assert log_density(miss, covariance) == pytest.approx(expected)


def test_a_velocity_goes_over_into_a_motion() -> None:
    _, velocity, covariance = drawn(0)
    motion, spread = integrated_velocity(velocity, covariance, 0.2)
    np.testing.assert_allclose(motion, 0.2 * velocity)
    np.testing.assert_allclose(spread, 0.04 * covariance)
    gained = propagated_velocity_covariance(covariance, 0.2, 3.0) - covariance
    np.testing.assert_allclose(gained, 3.0 * np.diag([0.2, 0.1, 0.4]) ** 2, atol=1e-12)


@pytest.mark.parametrize("steps", [1, 2, 7, 50])
@pytest.mark.parametrize("motion", [(3.0, 0.0, 0.0), (2.0, -1.0, 0.8), (-1.0, 0.5, -2.5)])
def test_wrong_turns_carry_the_steps_after_them_aside(
    steps: int, motion: tuple[float, float, float]
) -> None:
    """Sum over even steps, each turned wrongly by as much by chance, seen from the end."""
    variance, x, y = 0.09, motion[0], motion[1]
    aside = np.array([-y, x]) / steps
    turn = Pose2(0.0, 0.0, -motion[2])
    expected = np.diag([0.01, 0.02, 0.0])
    for left in range(steps):
        by_turn = np.array([*turn.transform(left * aside), 1.0])
        expected += variance / steps * np.outer(by_turn, by_turn)
    given = np.diag([0.01, 0.02, variance])
    found = _with_heading_lever(given, np.array(motion), float(steps))
    np.testing.assert_allclose(found, expected, atol=1e-12)
    np.testing.assert_array_equal(given, np.diag([0.01, 0.02, variance]))


def test_the_spread_of_predictions_is_that_of_a_mixture() -> None:
    """About one of them, by moments; angles are apart the short way."""
    rng = np.random.default_rng(0)
    about = np.array([0.1, -0.2, 3.1])
    predictions = []
    for probability in (0.2, 0.5, 0.1):
        motion = about + rng.normal(0.0, 0.3, 3)
        predictions.append(Prediction(motion, np.diag(rng.uniform(0.1, 0.4, 3)), probability))
    total = np.zeros((3, 3))
    for p in predictions:
        total += p.probability / 0.8 * (p.covariance + np.outer(p.motion - about, p.motion - about))
    np.testing.assert_allclose(mixture_covariance(about, predictions), total)
    turned = [
        Prediction(p.motion - [0, 0, 2 * math.pi], p.covariance, p.probability) for p in predictions
    ]
    np.testing.assert_allclose(mixture_covariance(about, turned), total)
