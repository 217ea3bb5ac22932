# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""SE(2) against gtsam.Pose2 and the group laws, with headings at +-pi."""

from __future__ import annotations

import math

import gtsam
import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st
from scipy.linalg import expm

from slarm_graph.geometry import (
    Pose2,
    adjoints,
    between,
    compose,
    interpolate_poses,
    invert,
    wrap_angle,
    wrap_angles,
)

lengths = st.floats(-50, 50)
angles = st.one_of(st.floats(-10, 10), st.sampled_from([math.pi, -math.pi, 0.0, 3 * math.pi]))
poses = st.builds(Pose2, lengths, lengths, angles)


def close(a: Pose2, b: Pose2, tolerance: float = 1e-9) -> bool:
    turn = abs(wrap_angle(a.theta - b.theta))
    return math.hypot(a.x - b.x, a.y - b.y) < tolerance and turn < tolerance


@given(poses, poses, poses)
def test_composition_is_associative(a: Pose2, b: Pose2, c: Pose2) -> None:
    assert close((a @ b) @ c, a @ (b @ c))


@given(poses)
def test_the_inverse_undoes(a: Pose2) -> None:
    assert close(a @ a.inverse(), Pose2())
    assert close(a.inverse() @ a, Pose2())


@given(poses, poses)
def test_between_and_compose_match_gtsam(a: Pose2, b: Pose2) -> None:
    theirs = gtsam.Pose2(a.x, a.y, a.theta).between(gtsam.Pose2(b.x, b.y, b.theta))
    assert close(a.between(b), Pose2(theirs.x(), theirs.y(), theirs.theta()))


@given(poses)
def test_log_and_adjoint_match_gtsam(a: Pose2) -> None:
    theirs = gtsam.Pose2(a.x, a.y, a.theta)
    np.testing.assert_allclose(adjoints(a.as_array()), theirs.AdjointMap(), atol=1e-9)
    if abs(a.theta) < math.pi - 1e-6:
        np.testing.assert_allclose(a.log(), gtsam.Pose2.Logmap(theirs), atol=1e-7)


@given(st.tuples(lengths, lengths, st.floats(-3.1, 3.1)))
@example((2.0, 1.0, 1e-9))
def test_exp_is_the_matrix_exponential_and_log_undoes_it(
    tangent: tuple[float, float, float],
) -> None:
    x, y, w = tangent
    matrix = expm(np.array([[0.0, -w, x], [w, 0.0, y], [0.0, 0.0, 0.0]]))
    ours = Pose2.exp(tangent)
    np.testing.assert_allclose([ours.x, ours.y], matrix[:2, 2], rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(ours.log(), tangent, rtol=1e-9, atol=1e-12)


@given(st.tuples(lengths, lengths, st.floats(-3.1, 3.1)))
def test_exp_matches_gtsam(tangent: tuple[float, float, float]) -> None:
    assume(tangent[2] == 0.0 or abs(tangent[2]) > 1e-6)  # below, GTSAM's own 1 - cos(w) cancels
    theirs = gtsam.Pose2.Expmap(np.array(tangent))
    assert close(Pose2.exp(tangent), Pose2(theirs.x(), theirs.y(), theirs.theta()), 1e-7)


@given(st.lists(poses, min_size=1, max_size=5), poses)
def test_arrays_do_as_single_poses_do(many: list[Pose2], one: Pose2) -> None:
    arrays = np.array([p.as_array() for p in many])
    singles = {
        "compose": [one @ p for p in many],
        "invert": [p.inverse() for p in many],
        "between": [one.between(p) for p in many],
    }
    results = {
        "compose": compose(one.as_array(), arrays),
        "invert": invert(arrays),
        "between": between(one.as_array(), arrays),
    }
    for name, expected in singles.items():
        for row, pose in zip(results[name], expected, strict=True):
            assert close(Pose2.from_array(row), pose), name


@pytest.mark.parametrize("angle", [math.pi, -math.pi, 3 * math.pi, -5 * math.pi])
def test_half_turns_wrap_to_plus_pi(angle: float) -> None:
    assert wrap_angle(angle) == math.pi
    assert wrap_angles([angle])[0] == pytest.approx(math.pi)


def test_interpolation_takes_the_shorter_arc() -> None:
    stamps = np.array([0, 1_000_000_000])
    ends = np.array([[0.0, 0.0, math.pi - 0.1], [1.0, 2.0, -math.pi + 0.1]])
    middle = interpolate_poses(stamps, ends, [500_000_000])[0]
    np.testing.assert_allclose(middle, [0.5, 1.0, math.pi], atol=1e-12)


def test_interpolation_is_exact_at_large_stamps_and_holds_the_ends() -> None:
    stamps = 1_700_000_000_000_000_000 + np.array([0, 3, 7])
    path = np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 0.3], [7.0, 0.0, 0.7]])
    query = stamps[0] + np.array([-5, 1, 3, 5, 20])
    np.testing.assert_allclose(
        interpolate_poses(stamps, path, query)[:, 0], [0, 1, 3, 5, 7], atol=1e-12
    )
