# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Motion prediction, and odometry that fails."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from slarm_graph.frontends.scans.hypotheses import PathHypothesis
from slarm_graph.frontends.scans.odometry_filter import OdometryFilter, Prediction
from slarm_graph.frontends.scans.odometry_fusion import _with_heading_lever, path_motion
from slarm_graph.frontends.scans.pose_candidates import (
    PoseCandidate,
    PosePrior,
    unmatched_candidate,
)
from slarm_graph.frontends.scans.small_pose import squared_mahalanobis
from slarm_graph.frontends.scans.wheel_calibration import WheelCalibration
from slarm_graph.frontends.scans.wheel_motion import WheelMotion, chained
from slarm_graph.geometry import Floats, Pose2, between

SURE = np.diag([1e-6, 1e-6, 1e-6])
FORWARD = Pose2(0.1, 0.0, 0.02)


def test_squared_mahalanobis_is_numpys_and_angles_wrap() -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        miss, root = rng.normal(0.0, 0.3, 3), rng.normal(0.0, 0.1, (3, 3))
        covariance = root @ root.T + 1e-4 * np.eye(3)
        expected = miss @ np.linalg.solve(covariance, miss)
        turned = miss + np.array([0.0, 0.0, 2 * math.pi])
        assert squared_mahalanobis(miss, covariance) == pytest.approx(expected, rel=1e-6)
        assert squared_mahalanobis(turned, covariance) == pytest.approx(expected, rel=1e-6)


def run(steps: int, odom_motion: Pose2 | None, true_motion: Pose2) -> OdometryFilter:
    """Feed a filter equal steps of odometry and of matched motion, 0.1 s apart."""
    odometry = OdometryFilter()
    odom = Pose2(1.0, 2.0, 0.5)
    for _ in range(steps):
        odometry.predict(0.1, None if odom_motion is None else odom)
        odometry.update_reliability(true_motion.as_array(), SURE)
        odometry.calibrate(true_motion.as_array(), np.diag(SURE))
        odometry.correct(0.1, true_motion.as_array(), SURE)
        odom = odom @ (odom_motion or Pose2())
    return odometry


def test_a_step_in_which_odometry_failed_has_room_for_going_on() -> None:
    """Odometry hangs for a step while the robot goes on: alone, it is as unsure as that way.

    A match that leads elsewhere than on may be false: against that one odometry speaks as it is.
    """
    way_m = math.hypot(FORWARD.x, FORWARD.y)
    for aside_m, speaks in ((0.0, False), (0.6, True)):
        odometry = run(100, FORWARD, FORWARD)
        fine = odometry.wheel_motion()
        odometry.predict(0.1, Pose2(1.0, 2.0, 0.5) @ _moved(FORWARD, 99))
        odometry.update_reliability(FORWARD.as_array() + np.array([0.0, aside_m, 0.0]), SURE)
        hung = odometry.wheel_motion()
        assert fine is not None and hung is not None
        assert math.sqrt(fine.covariance[0, 0]) < 0.3 * way_m
        assert (math.sqrt(hung.covariance[0, 0]) > 0.7 * way_m) != speaks
        assert (math.sqrt(hung.covariance_if_working[0, 0]) < 0.3 * way_m) == speaks


def _moved(motion: Pose2, steps: int) -> Pose2:
    total = Pose2()
    for _ in range(steps):
        total = total @ motion
    return total


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
    wheels, steady = odometry.predict(0.1, odom)
    np.testing.assert_allclose(wheels.motion, FORWARD.as_array(), atol=1e-6)
    assert np.all(np.diag(wheels.covariance) < np.diag(steady.covariance))
    assert wheels.probability + steady.probability == pytest.approx(1.0)


def test_odometry_that_jumps_is_kept_apart() -> None:
    odometry = run(5, FORWARD, FORWARD)
    predictions = odometry.predict(0.1, Pose2(9.0, 9.0, 0.0))
    assert len(predictions) == 2
    np.testing.assert_allclose(predictions[1].motion, FORWARD.as_array(), atol=1e-9)


def test_odometry_that_fails_is_told_by_its_probability() -> None:
    odometry = run(40, FORWARD, FORWARD)
    assert odometry.predict(0.1, Pose2(9.0, 9.0, 0.0))[0].probability > 0.9
    odometry.update_reliability(FORWARD.as_array(), SURE)
    odometry.correct(0.1, FORWARD.as_array(), SURE)
    likeliest = odometry.predict(0.1, Pose2(9.0, 9.0, 0.0) @ FORWARD)[0]
    np.testing.assert_allclose(likeliest.motion, FORWARD.as_array(), atol=1e-3)
    assert likeliest.probability == pytest.approx(0.8, abs=0.05)


def hung(found: Pose2, sure: Floats, *, steps: int) -> OdometryFilter:
    """Encoders that worked, hung while scans showed the robot go on, and hang for more steps."""
    odometry = run(40, FORWARD, FORWARD)
    stopped = Pose2(1.0, 2.0, 0.5) @ _moved(FORWARD, 39)
    seen = [(FORWARD, SURE)] * 2 + [(found, sure)] * steps
    for moved, covariance in seen:
        odometry.predict(0.1, stopped)
        odometry.update_reliability(moved.as_array(), covariance)
        odometry.correct(0.1, moved.as_array(), covariance)
    return odometry


ALONG_A_CORRIDOR = np.diag([1.0, 1e-6, 1e-6])


def test_encoders_that_hang_are_not_believed_where_scans_cannot_tell() -> None:
    """A corridor shows neither whether the robot stands nor whether they work again."""
    hanging = hung(Pose2(0.1, 0.0, 0.0), ALONG_A_CORRIDOR, steps=20)
    wheels = min(hanging.predict(0.1, hanging._last_odom), key=lambda p: p.covariance[0, 0])
    assert wheels.probability < 0.25  # of 22 steps each may have been the end, by one in 300


def test_what_encoders_that_hung_read_first_may_be_all_that_they_missed() -> None:
    """Drivers that stall catch up in one reading; those that go on from there do so for good."""
    hanging = hung(Pose2(0.1, 0.0, 0.0), ALONG_A_CORRIDOR, steps=3)
    odom = hanging._last_odom
    assert odom is not None
    odom = odom @ _moved(FORWARD, 6)
    steady, caught_up = hanging.predict(0.1, odom)
    assert caught_up.probability < 0.5 < steady.probability
    for _ in range(20):
        hanging.update_reliability(FORWARD.as_array(), ALONG_A_CORRIDOR)
        hanging.correct(0.1, FORWARD.as_array(), ALONG_A_CORRIDOR)
        odom = odom @ FORWARD
        wheels = hanging.predict(0.1, odom)[0]
    assert wheels.probability > 0.9
    np.testing.assert_allclose(wheels.motion, FORWARD.as_array(), atol=0.01)


def test_a_stand_is_not_taken_for_encoders_that_hang() -> None:
    """Odometry that reads no motion for minutes, as scans do, is as trusted as when it moved."""
    odometry = run(40, FORWARD, FORWARD)
    stopped = Pose2(1.0, 2.0, 0.5) @ _moved(FORWARD, 39)
    for _ in range(600):
        odometry.predict(0.1, stopped)
        odometry.update_reliability(np.zeros(3), SURE)
        odometry.correct(0.1, np.zeros(3), SURE)
    assert odometry.predict(0.1, stopped)[0].probability > 0.98


def test_after_a_long_gap_anything_is_possible() -> None:
    (prediction,) = run(5, None, FORWARD).predict(5.0, None)
    np.testing.assert_array_equal(prediction.motion, 0.0)
    assert np.all(np.sqrt(np.diag(prediction.covariance)) >= 1.0)


@pytest.mark.parametrize("turn", [0.0, 1.2, -2.5])
def test_what_many_steps_turn_wrongly_is_carried_aside(turn: float) -> None:
    """Oracle: drives of 20 straight steps, each turned wrongly after, 20,000 times."""
    rng, steps, of_step = np.random.default_rng(0), 20, 0.01
    heading = np.cumsum(rng.normal(0.0, of_step, (20_000, steps)), axis=1)
    before = np.column_stack([np.zeros(20_000), heading[:, :-1]])
    x, y = 0.25 * np.cos(before).sum(axis=1), 0.25 * np.sin(before).sum(axis=1)
    end = heading[:, -1]
    # Seen from where the robot would have been, turned by what it turned at the end.
    ahead, aside = x - 0.25 * steps, y
    to_the_side = 0.5
    cos, sin = math.cos(turn - to_the_side), math.sin(turn - to_the_side)
    seen = np.stack([cos * ahead + sin * aside, cos * aside - sin * ahead, end])
    way = 0.25 * steps * np.array([math.cos(to_the_side), math.sin(to_the_side)])
    of_turns = np.diag([0.0, 0.0, steps * of_step**2])
    told = _with_heading_lever(of_turns, np.array([*way, turn]), float(steps))
    np.testing.assert_allclose(told, np.cov(seen), rtol=0.1, atol=2e-4)


def test_one_step_carries_nothing_aside() -> None:
    covariance = np.diag([1e-4, 2e-4, 3e-4])
    np.testing.assert_array_equal(
        _with_heading_lever(covariance, np.array([1.0, 0.5, 0.3]), 1.0), covariance
    )


def test_a_gap_lies_where_odometry_says_whether_it_failed_in_it_or_not() -> None:
    odometry = run(40, FORWARD, FORWARD)
    way = Pose2(3.0, -1.0, 0.4)
    both = odometry.predict(5.0, Pose2(1.0, 2.0, 0.5) @ _moved(FORWARD, 39) @ way)
    for prediction in both:
        np.testing.assert_allclose(prediction.motion, way.as_array(), atol=0.1)
    assert both[1].covariance[0, 0] > 0.5
    assert both[0].covariance[1, 1] > odometry.wheels.parameters.source_factors[0, 1] * 1e-3


@pytest.mark.parametrize("jitter_m", [0.0, 0.1])
def test_predictions_know_how_unsteadily_the_robot_moves(jitter_m: float) -> None:
    rng = np.random.default_rng(1)
    odometry, squares = OdometryFilter(), []
    for step in range(400):
        prediction = odometry.predict(0.1, None)[0]
        moved = Pose2(0.1 + jitter_m * rng.standard_normal(), 0.0, 0.0)
        if step >= 100:
            miss = prediction.motion - moved.as_array()
            squares.append(squared_mahalanobis(miss, prediction.covariance + SURE))
        odometry.correct(0.1, moved.as_array(), SURE)
    assert np.mean(squares) < 5.0
    assert np.mean(squares) > 1.0 or jitter_m == 0.0


def test_odometry_is_kept_while_nothing_matches() -> None:
    odometry, told, pose = OdometryFilter(), Pose2(), Pose2()
    rng = np.random.default_rng(1)
    odometry.predict(0.1, pose)
    for _ in range(40):
        pose = pose @ Pose2(0.1 + 0.03 * rng.normal(), 0.0, 0.1 * rng.normal())
        told = told @ Pose2.from_array(odometry.predict(0.1, pose)[0].motion)
        odometry.coast()
    assert np.allclose(told.as_array(), pose.as_array(), atol=0.05)


def test_the_velocity_fades_while_nothing_matches() -> None:
    odometry = run(5, None, FORWARD)
    for _ in range(20):
        odometry.predict(0.1, None)
        odometry.coast()
    (prediction,) = odometry.predict(0.1, None)
    assert np.hypot(*prediction.motion[:2]) < 0.01
    assert np.all(np.isfinite(prediction.covariance))


def test_what_is_not_matched_is_told_with_all_that_may_have_moved_it() -> None:
    """One in ten that odometry failed: its half a metre is in the spread alone."""
    covariance_if_working = Prediction(np.array([0.1, 0.0, 0.0]), 1e-4 * np.eye(3), 0.9)
    failed = Prediction(np.array([0.6, 0.0, 0.0]), 1e-2 * np.eye(3), 0.1)
    prior = PosePrior(np.zeros(3), (covariance_if_working, failed), np.ones(3))
    hypothesis = PathHypothesis()
    for step in (1, 2):
        here = replace(prior, base=hypothesis.pose)
        hypothesis.update(unmatched_candidate(covariance_if_working, here), here, 0.1)
        np.testing.assert_allclose(hypothesis.covariance, covariance_if_working.covariance)
        of_step = 0.9 * 1e-4 + 0.1 * (1e-2 + 0.5**2)
        if step == 1:
            assert hypothesis.mixture_covariance[0, 0] == pytest.approx(of_step)
        else:
            assert hypothesis.mixture_covariance[0, 0] > 1.9 * of_step
    match = PoseCandidate(hypothesis.pose, 1e6 * np.eye(3), 0.9, 99, 1)
    hypothesis.update(match, replace(prior, base=hypothesis.pose), 0.1)
    np.testing.assert_array_equal(hypothesis.mixture_covariance, hypothesis.covariance)


def test_systematic_errors_add_up_along_a_path() -> None:
    """Of a way of many steps their effect is the derivative of the whole way by them."""
    rng = np.random.default_rng(3)
    steps = [np.array([0.2, 0.0, turn]) for turn in rng.normal(0.0, 0.2, 30)]
    ones, nothing = np.ones(3), np.zeros((3, 3))

    def whole(errors: Floats) -> WheelMotion:
        known = WheelCalibration().parameters._replace(
            path_errors=errors, path_variance_factor=ones
        )
        path: WheelMotion | None = None
        for step in steps:
            motion, covariance, covariance_if_working, error_jacobian = path_motion(
                step, known, 1.0, step, nothing, 1.0
            )
            one = WheelMotion(
                motion,
                covariance,
                covariance_if_working,
                np.zeros(3),
                error_jacobian,
                known.covariance,
            )
            path = one if path is None else chained(path, one)
        assert path is not None
        return path

    at = whole(np.zeros(3))
    numeric = [between(at.motion, whole(1e-6 * e).motion) / 1e-6 for e in np.eye(3)]
    assert np.allclose(at.error_jacobian, np.transpose(numeric), atol=1e-4)
    error_covariance = WheelCalibration().covariance
    expected = at.covariance + at.error_jacobian @ error_covariance @ at.error_jacobian.T
    assert np.allclose(at.total_covariance(), expected)
    assert at.total_covariance()[0, 0] > 2.0 * at.covariance[0, 0]


def test_what_may_have_failed_unseen_does_not_widen_a_path() -> None:
    """While nothing is matched odometry is as sure as it was; one that was seen to fail is not."""
    odometry = run(100, FORWARD, FORWARD)
    true_fit = odometry.wheel_motion()
    for k in range(100, 150):
        odometry.predict(0.1, Pose2(1.0, 2.0, 0.5) @ _moved(FORWARD, k + 1))
        odometry.coast()
    unseen = odometry.wheel_motion()
    odometry.predict(0.1, Pose2(1.0, 2.0, 0.5) @ _moved(FORWARD, 150))
    odometry.update_reliability(2.0 * FORWARD.as_array(), SURE)
    odometry.coast()
    odometry.predict(0.1, Pose2(1.0, 2.0, 0.5) @ _moved(FORWARD, 151))
    failed = odometry.wheel_motion()
    assert true_fit is not None and unseen is not None and failed is not None
    np.testing.assert_allclose(unseen.covariance, true_fit.covariance, rtol=1e-2, atol=1e-9)
    assert failed.covariance[2, 2] > 10.0 * true_fit.covariance[2, 2]


def test_a_gap_shorter_than_the_usual_one_is_a_step() -> None:
    """Scans seconds apart: half such a gap carries nothing aside, and covariances stay such."""
    odometry = OdometryFilter()
    odom = Pose2()
    for span_s in (2.4, 2.4, 1.2):
        odom = odom @ Pose2(0.4, 0.0, 0.1)
        for mode in odometry.predict(span_s, odom):
            assert np.linalg.eigvalsh(mode.covariance).min() > 0.0
    true_fit = OdometryFilter()
    true_fit.predict(0.1, Pose2())
    true_fit.predict(0.1, Pose2(0.4, 0.0, 0.1))
    one, other = odometry._odometry_alone, true_fit._odometry_alone
    assert one is not None and other is not None
    np.testing.assert_allclose(one.covariance, other.covariance, atol=1e-12)
