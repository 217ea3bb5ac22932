# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The motion prediction: fusion as filterpy does it, and odometry that cannot be believed."""

from __future__ import annotations

import math

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter

from slarm_graph.frontends.odometry_filter import OdometryFilter, fuse, odometry_covariance
from slarm_graph.geometry import Pose2

SURE = np.diag([1e-6, 1e-6, 1e-6])
FORWARD = Pose2(0.1, 0.0, 0.02)


def test_fusion_is_a_kalman_update() -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        prior, measured = rng.normal(0.0, 0.1, (2, 3))
        roots = rng.normal(0.0, 0.1, (2, 3, 3))
        p, r = (root @ root.T + 1e-4 * np.eye(3) for root in roots)
        oracle = KalmanFilter(dim_x=3, dim_z=3)
        oracle.x, oracle.P, oracle.H, oracle.R = prior.copy(), p.copy(), np.eye(3), r
        oracle.update(measured)
        motion, covariance, surprise = fuse(prior, p, measured, r)
        np.testing.assert_allclose(motion, oracle.x, atol=1e-9)
        np.testing.assert_allclose(covariance, oracle.P, atol=1e-9)
        assert surprise == pytest.approx(oracle.mahalanobis**2, rel=1e-6)


def test_fusion_knows_that_angles_wrap() -> None:
    motion, *_ = fuse(np.array([0.0, 0.0, 3.1]), SURE, np.array([0.0, 0.0, -3.1]), SURE)
    assert abs(math.remainder(motion[2] - math.pi, 2 * math.pi)) < 1e-6


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
    for other in (measured, steady):
        assert np.trace(fused.covariance) < np.trace(other.covariance)


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


def test_the_velocity_fades_while_nothing_matches() -> None:
    odometry = run(5, None, FORWARD)
    for _ in range(20):
        odometry.predict(0.1, None)
        odometry.coast()
    (prediction,) = odometry.predict(0.1, None)
    assert np.hypot(*prediction.motion[:2]) < 0.01
    assert np.all(np.isfinite(prediction.covariance))
