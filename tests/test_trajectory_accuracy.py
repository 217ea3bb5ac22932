# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""ATE and RPE against evo (the oracle), scikit-image and identities."""

from __future__ import annotations

import numpy as np
import pytest
from evo.core import metrics as evo_metrics
from evo.core import sync
from evo.core.trajectory import PoseTrajectory3D
from skimage.transform import EuclideanTransform

from slarm_graph.errors import BadInput
from slarm_graph.eval.alignment import AlignmentMethod, align, fit
from slarm_graph.eval.association import AssociationMethod, associate
from slarm_graph.eval.trajectory_accuracy import absolute_errors, relative_errors, statistics
from slarm_graph.eval.trajectory_metrics import trajectory_metrics
from slarm_graph.geometry import Pose2, compose
from slarm_graph.trajectory import Trajectory

PERIOD_NS = 100_000_000


def wandering(seed: int, count: int = 400) -> Trajectory:
    rng = np.random.default_rng(seed)
    motions = np.column_stack(
        [rng.normal(0.1, 0.02, count), rng.normal(0, 0.01, count), rng.normal(0, 0.2, count)]
    )
    poses = np.zeros((count, 3))
    for k in range(1, count):
        poses[k] = compose(poses[k - 1], motions[k])
    start_ns = 1_700_000_000_000_000_000
    return Trajectory(start_ns + PERIOD_NS * np.arange(count), poses)


def disturbed(reference: Trajectory, seed: int) -> Trajectory:
    rng = np.random.default_rng(seed)
    keep = rng.random(len(reference)) < 0.7
    stamps = reference.stamps_ns[keep] + rng.integers(-20_000_000, 20_000_000, keep.sum())
    poses = reference.poses[keep] + rng.normal(0, [0.05, 0.05, 0.02], (keep.sum(), 3))
    return Trajectory(stamps, poses).transformed(Pose2(3.0, -2.0, 0.7))


def in_evo(trajectory: Trajectory) -> PoseTrajectory3D:
    count = len(trajectory)
    half = trajectory.poses[:, 2] / 2
    return PoseTrajectory3D(
        positions_xyz=np.column_stack([trajectory.poses[:, :2], np.zeros(count)]),
        orientations_quat_wxyz=np.column_stack([np.cos(half), np.zeros((count, 2)), np.sin(half)]),
        timestamps=trajectory.stamps_ns * 1e-9,
    )


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("method", [m for m in AlignmentMethod if not m.in_space])
def test_ate_equals_evo(seed: int, method: AlignmentMethod) -> None:
    reference = wandering(seed)
    estimate = disturbed(reference, seed + 100)
    ours = associate(reference, estimate, method=AssociationMethod.NEAREST, max_difference_s=0.01)
    ref, est = sync.associate_trajectories(in_evo(reference), in_evo(estimate), max_diff=0.01)
    if method in (AlignmentMethod.SE2, AlignmentMethod.SIM2):
        est.align(ref, correct_scale=method.scales)
    elif method is AlignmentMethod.ORIGIN:
        est.align_origin(ref)
    theirs = evo_metrics.APE(evo_metrics.PoseRelation.translation_part)
    theirs.process_data((ref, est))
    errors = absolute_errors(ours, align(ours, method))
    np.testing.assert_allclose(errors, theirs.error, atol=1e-9)
    for name, value in theirs.get_all_statistics().items():
        assert getattr(statistics(errors), name) == pytest.approx(value, abs=1e-9)


@pytest.mark.parametrize(("delta", "unit"), [(1, "frames"), (7, "frames"), (1.5, "m")])
def test_rpe_equals_evo(delta: float, unit: str) -> None:
    reference = wandering(7)
    estimate = disturbed(reference, 8)
    pairs = associate(reference, estimate, method=AssociationMethod.NEAREST)
    ours = relative_errors(pairs, delta, "m" if unit == "m" else "frames")
    ref, est = sync.associate_trajectories(in_evo(reference), in_evo(estimate), max_diff=0.01)
    evo_unit = evo_metrics.Unit.meters if unit == "m" else evo_metrics.Unit.frames
    for relation, mine in (
        (evo_metrics.PoseRelation.translation_part, ours.translation_m),
        (evo_metrics.PoseRelation.rotation_angle_rad, ours.rotation_rad),
    ):
        theirs = evo_metrics.RPE(
            relation, delta=delta, delta_unit=evo_unit, pairs_from_reference=True
        )
        theirs.process_data((ref, est))
        np.testing.assert_allclose(mine, theirs.error, atol=1e-7)


def test_rigid_fit_equals_scikit_image() -> None:
    rng = np.random.default_rng(3)
    source = rng.normal(size=(50, 2))
    target = Pose2(1.0, 2.0, 2.5).transform(source) + rng.normal(0, 0.1, (50, 2))
    theirs = EuclideanTransform.from_estimate(source, target)
    ours = fit(source, target).reference_from_estimate
    np.testing.assert_allclose([ours.x, ours.y], theirs.translation, atol=1e-12)
    assert ours.theta == pytest.approx(theirs.rotation, abs=1e-12)


def test_moving_the_estimate_rigidly_changes_nothing_once_aligned() -> None:
    reference = wandering(11)
    moved = reference.transformed(Pose2(5.0, -3.0, 2.0))
    errors = absolute_errors(pairs := associate(reference, moved), align(pairs))
    assert errors.max() < 1e-9


def test_interpolation_recovers_a_path_sampled_at_other_instants() -> None:
    stamps = np.arange(0, 20) * PERIOD_NS
    line = Trajectory(stamps, np.column_stack([stamps * 1e-9, stamps * 0, stamps * 0]))
    between_stamps = stamps[:-1] + PERIOD_NS // 3
    shifted = Trajectory(between_stamps, line.at(between_stamps))
    pairs = associate(line, shifted)
    assert absolute_errors(pairs, align(pairs, AlignmentMethod.NONE)).max() < 1e-9


def test_no_overlap_tells_the_offset_to_try() -> None:
    reference = wandering(1)
    late = Trajectory(reference.stamps_ns + 100_000_000_000, reference.poses)
    with pytest.raises(BadInput, match=r"try --t-offset -100\.000"):
        associate(reference, late)
    assert len(associate(reference, late, offset_s=-100.0).stamps_ns) == len(reference)


def test_a_robot_that_stood_still_is_aligned_by_its_origin() -> None:
    stamps = np.arange(10) * PERIOD_NS
    still = Trajectory(stamps, np.tile([1.0, 2.0, 0.3], (10, 1)))
    result = align(pairs := associate(still, still.transformed(Pose2(1, 1, 1))))
    assert "rotation cannot be aligned" in result.note
    assert absolute_errors(pairs, result).max() < 1e-12


def test_a_straight_path_can_be_aligned() -> None:
    stamps = np.arange(10) * PERIOD_NS
    line = Trajectory(stamps, np.column_stack([np.arange(10.0), np.zeros(10), np.zeros(10)]))
    pairs = associate(line, line.transformed(Pose2(1, 2, 3)))
    assert absolute_errors(pairs, align(pairs)).max() < 1e-9


def test_few_matches_are_warned_of() -> None:
    reference = wandering(2)
    half = Trajectory(reference.stamps_ns[:150], reference.poses[:150])
    longer = Trajectory(reference.stamps_ns[100:300], reference.poses[100:300])
    pairs = associate(half, longer)
    assert "only 50 of 150 poses matched" in pairs.warning


def test_metrics_carry_the_alignment_and_both_numbers() -> None:
    reference = wandering(4)
    values = {m.name: m for m in trajectory_metrics(associate(reference, disturbed(reference, 5)))}
    assert "SE(2)-aligned" in values["ate_rmse_m"].note
    assert "not aligned" in values["ate_rmse_unaligned_m"].note
    assert values["ate_mse_m2"].value == pytest.approx(values["ate_rmse_m"].value ** 2)
    assert values["ate_rmse_unaligned_m"].value > values["ate_rmse_m"].value
