# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The motion prediction, and odometry that cannot be believed."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slarm_graph.frontends.scans.odometry_filter import (
    OdometryFilter,
    odometry_covariance,
    squared_sigmas,
)
from slarm_graph.geometry import Pose2

SURE = np.diag([1e-6, 1e-6, 1e-6])
FORWARD = Pose2(0.1, 0.0, 0.02)


def test_squared_sigmas_are_numpys_and_angles_wrap() -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        miss, root = rng.normal(0.0, 0.3, 3), rng.normal(0.0, 0.1, (3, 3))
        covariance = root @ root.T + 1e-4 * np.eye(3)
        expected = miss @ np.linalg.solve(covariance, miss)
        turned = miss + np.array([0.0, 0.0, 2 * math.pi])
        assert squared_sigmas(miss, covariance) == pytest.approx(expected, rel=1e-6)
        assert squared_sigmas(turned, covariance) == pytest.approx(expected, rel=1e-6)


def test_odometry_noise_grows_with_the_way() -> None:
    still, moved, turned = (
        odometry_covariance(np.array(v))
        for v in ([0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [0.0, 0.0, 0.5])
    )
    assert np.all(np.diag(moved) > np.diag(still))
    assert np.all(np.diag(turned) > np.diag(still))


def run(steps: int, odom_motion: Pose2 | None, true_motion: Pose2) -> OdometryFilter:
    """Feed a filter equal steps of odometry and of matched motion, 0.1 s apart."""
    odometry = OdometryFilter()
    odom = Pose2(1.0, 2.0, 0.5)
    for _ in range(steps):
        odometry.predict(0.1, None if odom_motion is None else odom)
        odometry.correct(0.1, true_motion, SURE)
        odom = odom @ (odom_motion or Pose2())
    return odometry


def test_without_odometry_the_velocity_is_kept() -> None:
    predictions = run(5, None, FORWARD).predict(0.1, None)
    assert len(predictions) == 1
    np.testing.assert_allclose(predictions[0].motion, FORWARD.as_array(), atol=1e-9)


def test_odometry_that_never_moves_is_no_odometry() -> None:
    odometry = run(5, Pose2(), FORWARD)
    predictions = odometry.predict(0.1, Pose2(1.0, 2.0, 0.5))
    np.testing.assert_allclose(predictions[0].motion, FORWARD.as_array(), atol=1e-9)


def test_odometry_and_velocity_that_agree_make_one_surer_prediction() -> None:
    odometry = run(5, FORWARD, FORWARD)
    odom = Pose2(1.0, 2.0, 0.5)
    for _ in range(5):
        odom = odom @ FORWARD
    fused, measured, steady = odometry.predict(0.1, odom)
    np.testing.assert_allclose(fused.motion, FORWARD.as_array(), atol=1e-9)
    information = np.linalg.inv(measured.covariance) + np.linalg.inv(steady.covariance)
    np.testing.assert_allclose(np.linalg.inv(fused.covariance), information, rtol=1e-6)


def test_odometry_that_jumps_is_kept_apart() -> None:
    odometry = run(5, FORWARD, FORWARD)
    predictions = odometry.predict(0.1, Pose2(9.0, 9.0, 0.0))
    assert len(predictions) == 2
    np.testing.assert_allclose(predictions[1].motion, FORWARD.as_array(), atol=1e-9)


def test_odometry_that_matches_contradict_is_trusted_less() -> None:
    honest, scaled = run(40, FORWARD, FORWARD), run(40, Pose2(0.2, 0.0, 0.04), FORWARD)
    odom = Pose2(1.0, 2.0, 0.5)
    sigmas = []
    for odometry in (honest, scaled):
        odometry.predict(0.1, odom)
        measured = odometry.predict(0.1, odom @ FORWARD)[-2]
        sigmas.append(math.sqrt(measured.covariance[0, 0]))
    assert sigmas[1] > 2.0 * sigmas[0]


def test_after_a_long_gap_anything_is_possible() -> None:
    (prediction,) = run(5, None, FORWARD).predict(5.0, None)
    np.testing.assert_array_equal(prediction.motion, 0.0)
    assert np.all(np.sqrt(np.diag(prediction.covariance)) >= 1.0)


@pytest.mark.parametrize("jitter_m", [0.0, 0.1])
def test_predictions_know_how_unsteadily_the_robot_moves(jitter_m: float) -> None:
    rng = np.random.default_rng(1)
    odometry, squares = OdometryFilter(), []
    for step in range(400):
        prediction = odometry.predict(0.1, None)[0]
        moved = Pose2(0.1 + jitter_m * rng.standard_normal(), 0.0, 0.0)
        if step >= 100:
            miss = prediction.motion - moved.as_array()
            squares.append(squared_sigmas(miss, prediction.covariance + SURE))
        odometry.correct(0.1, moved, SURE)
    assert np.mean(squares) < 5.0
    assert np.mean(squares) > 1.0 or jitter_m == 0.0


def test_the_velocity_fades_while_nothing_matches() -> None:
    odometry = run(5, None, FORWARD)
    for _ in range(20):
        odometry.predict(0.1, None)
        odometry.coast()
    (prediction,) = odometry.predict(0.1, None)
    assert np.hypot(*prediction.motion[:2]) < 0.01
    assert np.all(np.isfinite(prediction.covariance))
