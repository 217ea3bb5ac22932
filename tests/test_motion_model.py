# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The motion model's density by its draws."""

from __future__ import annotations

import math

import numpy as np

from slarm_graph.backends.motion_model import (
    draw_motion,
    first_drifts,
    motion_covariance,
    next_drifts,
)
from slarm_graph.config import ParticleMotionConfig
from slarm_graph.geometry import between, compose

MOTION = np.array([0.5, -0.1, 0.3])


def test_moments_of_a_hundred_thousand_draws() -> None:
    count = 100_000
    root = np.array([[0.02, 0.0, 0.0], [0.005, 0.03, 0.0], [0.002, -0.004, 0.01]])
    covariance = root @ root.T
    start = np.tile([3.0, -2.0, 3.0], (count, 1))
    normals = np.random.default_rng(0).standard_normal((count, 3))
    drawn = draw_motion(start, MOTION, covariance, normals)
    errors = between(compose(start[0], MOTION), drawn)
    sigma = np.sqrt(np.diag(covariance))
    assert (np.abs(errors.mean(axis=0)) < 4.0 * sigma / np.sqrt(count)).all()
    # The standard error of a covariance is below sigma_a sigma_b sqrt(2 / n).
    bound = 4.0 * np.sqrt(2.0 / count) * np.outer(sigma, sigma)
    assert (np.abs(np.cov(errors.T) - covariance) < bound).all()


def test_without_noise_the_motion_is_exact() -> None:
    start = np.array([[1.0, 2.0, -3.0], [0.0, 0.0, 1.0]])
    drawn = draw_motion(start, MOTION, np.eye(3), np.zeros((2, 3)))
    assert np.allclose(drawn, compose(start, MOTION))


def test_each_sigma_does_what_its_name_says() -> None:
    config = ParticleMotionConfig(srr=0.1, srt=0.2, str=0.3, stt=0.4, least_m=0.01, least_rad=0.02)
    sigma = np.sqrt(np.diag(motion_covariance(config, path_m=2.0, turned_rad=0.5)))
    assert np.allclose(sigma[:2], 0.01 + 0.1 * 2.0 + 0.3 * 0.5)
    assert np.isclose(sigma[2], 0.02 + 0.2 * 2.0 + 0.4 * 0.5)
    assert np.allclose(np.sqrt(np.diag(motion_covariance(config, 0.0, 0.0))), [0.01, 0.01, 0.02])


def test_first_drifts_leave_no_gap() -> None:
    """Between two neighbours lies the same share of a normal distribution everywhere."""
    drifts = first_drifts(ParticleMotionConfig(drift_rad_per_m=0.5), 1001)
    assert np.isclose(drifts.std(), 0.5, rtol=0.01)
    assert np.allclose(drifts, -drifts[::-1])
    shares = np.array([0.5 * (1.0 + math.erf(d / 0.5 / math.sqrt(2.0))) for d in drifts])
    assert np.allclose(np.diff(shares), 1.0 / 1001)


def test_drifts_stay_as_wide_as_they_are_and_forget_over_their_length() -> None:
    config = ParticleMotionConfig(drift_rad_per_m=0.5, drift_length_m=20.0)
    rng, first = np.random.default_rng(0), first_drifts(config, 20_000)
    drifts = first
    for _ in range(40):
        drifts = next_drifts(drifts, config, 0.5, rng)
    assert np.isclose(drifts.std(), 0.5, rtol=0.03)
    assert np.isclose(np.corrcoef(first, drifts)[0, 1], math.exp(-1.0), atol=0.03)
    assert np.array_equal(next_drifts(first, config, 0.0, rng), first)
