# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Anyone's trajectories: evo in space, planes of motion, clocks, drift by loops."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from evo.core import metrics as evo_metrics
from evo.core import sync
from evo.core.trajectory import PoseTrajectory3D
from scipy.spatial.transform import Rotation
from test_cli import run

from slarm_graph.errors import BadInput
from slarm_graph.eval.alignment import AlignmentMethod, align, fit
from slarm_graph.eval.association import AssociationMethod, associate
from slarm_graph.eval.evaluation import EvaluationOptions, evaluate
from slarm_graph.eval.plane_of_motion import level, plane_of
from slarm_graph.eval.trajectory_accuracy import (
    absolute_errors,
    absolute_rotations_rad,
    drift,
    relative_errors,
)
from slarm_graph.files.trajectories import tum_text
from slarm_graph.geometry import Floats
from slarm_graph.spatial import SpatialTrajectory, in_space
from slarm_graph.trajectory import Trajectory

CASES = Path(__file__).parents[1] / ".." / "shared" / "data" / "cases"
START_NS = 1_700_000_000_000_000_000
CAMERA_FROM_ROBOT = Rotation.from_matrix([[0, -1, 0], [0, 0, -1], [1, 0, 0]])
"""x right, y down, z ahead."""


def room_drive(count: int = 400, seed: int = 0) -> Trajectory:
    """A lap with changing speed."""
    rng = np.random.default_rng(seed)
    speed = 0.4 + 0.3 * np.abs(np.sin(np.arange(count) * 0.05)) + rng.normal(0, 0.02, count)
    turning = 0.25 * np.sign(np.sin(np.arange(count) * 0.033)) + rng.normal(0, 0.05, count)
    yaw = np.cumsum(turning) * 0.1
    steps = speed[:, None] * 0.1 * np.column_stack([np.cos(yaw), np.sin(yaw)])
    stamps = START_NS + 100_000_000 * np.arange(count, dtype=np.int64)
    return Trajectory(stamps, np.column_stack([np.cumsum(steps, axis=0), yaw]))


def noisy(path: Trajectory, seed: int = 1, sigma_m: float = 0.02) -> Trajectory:
    rng = np.random.default_rng(seed)
    return replace(path, poses=path.poses + rng.normal(0, [sigma_m, sigma_m, 0.01], (len(path), 3)))


def wild(seed: int, count: int = 300) -> SpatialTrajectory:
    rng = np.random.default_rng(seed)
    places = np.cumsum(rng.normal(0, 0.1, (count, 3)), axis=0)
    turns = Rotation.from_rotvec(np.cumsum(rng.normal(0, 0.05, (count, 3)), axis=0))
    stamps = START_NS + 100_000_000 * np.arange(count, dtype=np.int64)
    return SpatialTrajectory(stamps, np.column_stack([places, turns.as_quat()]))


def shaken(path: SpatialTrajectory, seed: int, scale: float = 1.0) -> SpatialTrajectory:
    rng = np.random.default_rng(seed)
    count = len(path)
    motion = Rotation.from_rotvec([0.3, -0.8, 1.9])
    places = motion.apply(path.poses[:, :3] / scale + rng.normal(0, 0.03, (count, 3)))
    places += np.array([4.0, 5.0, 6.0])
    turns = motion * Rotation.from_quat(path.poses[:, 3:])
    turns = turns * Rotation.from_rotvec(rng.normal(0, 0.02, (count, 3)))
    return replace(path, poses=np.column_stack([places, turns.as_quat()]))


def in_evo(path: SpatialTrajectory) -> PoseTrajectory3D:
    return PoseTrajectory3D(
        positions_xyz=path.poses[:, :3].copy(),
        orientations_quat_wxyz=path.poses[:, [6, 3, 4, 5]].copy(),
        timestamps=path.stamps_ns * 1e-9,
    )


def as_camera(path: Trajectory) -> SpatialTrajectory:
    """The same path in a camera's world: y down, z ahead; the body is the camera, too."""
    spatial = in_space(path)
    turns = CAMERA_FROM_ROBOT * Rotation.from_quat(spatial.poses[:, 3:]) * CAMERA_FROM_ROBOT.inv()
    places = CAMERA_FROM_ROBOT.apply(spatial.poses[:, :3])
    return replace(spatial, poses=np.column_stack([places, turns.as_quat()]))


SPATIAL = [AlignmentMethod.SE3, AlignmentMethod.SIM3, AlignmentMethod.NONE, AlignmentMethod.ORIGIN]


@pytest.mark.parametrize("method", SPATIAL)
@pytest.mark.parametrize("seed", range(3))
def test_ate_in_space_equals_evo(method: AlignmentMethod, seed: int) -> None:
    reference = wild(seed)
    estimate = shaken(reference, seed + 50, 1.3 if method is AlignmentMethod.SIM3 else 1.0)
    pairs = associate(reference, estimate, method=AssociationMethod.NEAREST)
    ref, est = sync.associate_trajectories(in_evo(reference), in_evo(estimate))
    if method is AlignmentMethod.ORIGIN:
        est.align_origin(ref)
    elif method is not AlignmentMethod.NONE:
        est.align(ref, correct_scale=method.scales)
    found = align(pairs, method)
    for relation, ours in (
        (evo_metrics.PoseRelation.translation_part, absolute_errors(pairs, found)),
        (evo_metrics.PoseRelation.rotation_angle_rad, absolute_rotations_rad(pairs, found)),
    ):
        theirs = evo_metrics.APE(relation)
        theirs.process_data((ref, est))
        np.testing.assert_allclose(ours, theirs.error, atol=1e-9)


@pytest.mark.parametrize(("delta", "unit"), [(1, "frames"), (10, "frames"), (2.0, "m")])
@pytest.mark.parametrize("method", [AlignmentMethod.SE3, AlignmentMethod.SIM3])
def test_rpe_in_space_equals_evo(delta: float, unit: str, method: AlignmentMethod) -> None:
    reference = wild(5)
    estimate = shaken(reference, 6, 1.3)
    pairs = associate(reference, estimate, method=AssociationMethod.NEAREST)
    ref, est = sync.associate_trajectories(in_evo(reference), in_evo(estimate))
    est.align(ref, correct_scale=method.scales)
    ours = relative_errors(
        pairs, delta, "m" if unit == "m" else "frames", align(pairs, method).scale
    )
    evo_unit = evo_metrics.Unit.meters if unit == "m" else evo_metrics.Unit.frames
    for relation, mine in (
        (evo_metrics.PoseRelation.translation_part, ours.translation_m),
        (evo_metrics.PoseRelation.rotation_angle_rad, ours.rotation_rad),
    ):
        theirs = evo_metrics.RPE(relation, delta, evo_unit, pairs_from_reference=True)
        theirs.process_data((ref, est))
        np.testing.assert_allclose(mine, theirs.error, atol=1e-9)


def test_yaw_and_position_is_the_best_turn_about_the_vertical() -> None:
    reference = wild(3)
    estimate = shaken(reference, 4)
    pairs = associate(reference, estimate)
    found = align(pairs, AlignmentMethod.YAW)
    assert np.allclose(found.rotation[2], [0, 0, 1])
    best = absolute_errors(pairs, found)
    for off in (-0.02, 0.02):
        turned = Rotation.from_rotvec([0, 0, off]).as_matrix() @ found.rotation
        shift = pairs.reference[:, :3].mean(axis=0) - turned @ pairs.estimate[:, :3].mean(axis=0)
        worse = absolute_errors(pairs, replace(found, rotation=turned, shift_m=shift))
        assert np.mean(worse**2) > np.mean(best**2)


def test_a_known_similarity_is_recovered_in_the_plane() -> None:
    source = np.random.default_rng(0).normal(size=(40, 2))
    turned = np.column_stack([-source[:, 1], source[:, 0]])
    found = fit(source, 0.7 * turned + [3.0, -1.0], scaled=True)
    assert found.scale == pytest.approx(0.7)
    assert found.yaw_rad == pytest.approx(math.pi / 2)
    assert np.allclose(found.shift_m, [3.0, -1.0])


def test_seconds_of_the_rpe_are_seconds() -> None:
    path = room_drive(101)
    errors = relative_errors(associate(path, noisy(path)), 1.0, "s")
    assert len(errors.translation_m) == 10


def kitti_drift(pairs_reference: Floats, pairs_estimate: Floats, lengths: Floats) -> Floats:
    """The devkit's loops, over 4 x 4 matrices."""

    def matrix(pose: Floats) -> Floats:
        x, y, yaw = pose
        c, s = math.cos(yaw), math.sin(yaw)
        return np.array([[c, -s, x], [s, c, y], [0, 0, 1]])

    ref, est = [matrix(p) for p in pairs_reference], [matrix(p) for p in pairs_estimate]
    covered = [0.0]
    for a, b in pairwise(ref):
        covered.append(covered[-1] + float(np.linalg.norm(b[:2, 2] - a[:2, 2])))
    found = []
    for length in lengths:
        for first in range(len(ref)):
            lasts = [i for i in range(len(ref)) if covered[i] >= covered[first] + length]
            if lasts:
                gt = np.linalg.inv(ref[first]) @ ref[lasts[0]]
                result = np.linalg.inv(est[first]) @ est[lasts[0]]
                error = np.linalg.inv(result) @ gt
                found.append(np.linalg.norm(error[:2, 2]) / length)
    return np.array(found)


def test_drift_equals_the_devkits_loops() -> None:
    path = room_drive(120)
    pairs = associate(path, noisy(path))
    ours = np.concatenate([d.translation_share for d in drift(pairs, (1.0, 3.0))])
    np.testing.assert_allclose(ours, kitti_drift(path.poses, pairs.estimate, np.array([1.0, 3.0])))
    way_m = np.hypot(*np.diff(path.poses[:, :2], axis=0).T).sum()
    told = drift(pairs)
    tenths = np.arange(1, 6) / 10 * way_m
    np.testing.assert_allclose([d.length_m for d in told], tenths)
    of_all = np.concatenate([d.translation_share for d in told])
    np.testing.assert_allclose(of_all, kitti_drift(path.poses, pairs.estimate, tenths))


@pytest.mark.parametrize("method", ["se2", "none", "origin", "se3"])
def test_a_camera_s_world_gives_the_figures_of_the_plane(method: str) -> None:
    path, estimate = room_drive(), noisy(room_drive(), sigma_m=0.05)
    options = EvaluationOptions(AlignmentMethod(method))
    flat = evaluate(in_space(path), in_space(estimate), options)
    camera = evaluate(as_camera(path), as_camera(estimate), options)
    for ours, theirs in zip(flat.metrics, camera.metrics, strict=True):
        if "rotation_rmse_unaligned" not in ours.name:
            assert theirs.value == pytest.approx(ours.value, abs=1e-9), ours.name
    assert any("x-z" in notice for notice in camera.notices) == (method != "se3")


def test_two_frames_are_told_apart_and_no_mirror_is_taken_for_the_path() -> None:
    path, estimate = room_drive(), noisy(room_drive(), sigma_m=0.05)
    options = EvaluationOptions()
    flat = evaluate(in_space(path), in_space(estimate), options)
    upside_down = as_camera(estimate)
    turned = Rotation.from_euler("z", 180, degrees=True)
    poses = np.column_stack(
        [
            turned.apply(upside_down.poses[:, :3]),
            (turned * Rotation.from_quat(upside_down.poses[:, 3:])).as_quat(),
        ]
    )
    for other in (as_camera(estimate), replace(upside_down, poses=poses)):
        found = evaluate(in_space(path), other, options)
        assert found.metrics[0].value == pytest.approx(flat.metrics[0].value, abs=1e-9)


def test_a_slanted_plane_is_found() -> None:
    path = in_space(room_drive())
    tilt = Rotation.from_euler("x", 25, degrees=True)
    turns = tilt * Rotation.from_quat(path.poses[:, 3:])
    slanted = replace(path, poses=np.column_stack([tilt.apply(path.poses[:, :3]), turns.as_quat()]))
    assert "slanted by 25 deg" in plane_of(slanted).name
    assert level(slanted).path_length_m() == pytest.approx(level(path).path_length_m())
    assert plane_of(path).is_xy


def test_a_straight_camera_path_is_seen_from_above() -> None:
    count = 50
    stamps = START_NS + 100_000_000 * np.arange(count, dtype=np.int64)
    straight = Trajectory(
        stamps, np.column_stack([np.arange(count) * 0.1, np.zeros(count), np.zeros(count)])
    )
    assert level(as_camera(straight)).path_length_m() == pytest.approx(4.9)
    assert level(in_space(straight)).path_length_m() == pytest.approx(4.9)


def later(path: Trajectory, offset_s: float) -> SpatialTrajectory:
    return in_space(replace(path, stamps_ns=path.stamps_ns + round(offset_s * 1e9)))


@pytest.mark.parametrize("offset_s", [0.5, -0.3, 7.25, 86_400.0])
def test_the_clock_offset_is_found(offset_s: float) -> None:
    path = room_drive()
    late = later(noisy(path), offset_s)
    found = evaluate(in_space(path), late, EvaluationOptions(offset_s=None))
    (said,) = [notice for notice in found.notices if "clock offset found" in notice]
    assert float(said.split()[3]) == pytest.approx(-offset_s, abs=0.02)
    assert found.metrics[0].value < 0.04


def test_a_better_clock_offset_is_named_and_a_right_clock_is_not() -> None:
    path = room_drive()
    late = evaluate(in_space(path), later(noisy(path), 0.5), EvaluationOptions())
    (said,) = late.notices
    assert "the clocks seem to be apart" in said
    offset_s = float(said.partition("--t-offset ")[2].partition(",")[0])
    assert offset_s == pytest.approx(-0.5, abs=0.02)
    assert not evaluate(in_space(path), later(noisy(path), 0.0), EvaluationOptions()).notices


def test_files_without_time_must_be_of_one_length() -> None:
    untimed = replace(in_space(room_drive()), timed=False)
    half = replace(untimed, stamps_ns=untimed.stamps_ns[::2], poses=untimed.poses[::2])
    with pytest.raises(BadInput, match="the reference has 400 and the estimate 200"):
        evaluate(untimed, half, EvaluationOptions())
    timed = replace(untimed, timed=True)
    assert evaluate(timed, untimed, EvaluationOptions()).metrics[0].value < 1e-12


def test_several_estimates_in_one_table_and_figures(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = room_drive()
    for name, estimate in (("ref", path), ("a_$x", noisy(path)), ("b", noisy(path, sigma_m=0.1))):
        (tmp_path / f"{name}.tum").write_text(tum_text(estimate))
    files = [str(tmp_path / f"{name}.tum") for name in ("ref", "a_$x", "b")]
    plots = tmp_path / "plots"
    assert run("eval", "trajectory", *files, "--plot", str(plots)) == 0
    out = capsys.readouterr().out
    assert "a_$x.tum" in out
    assert "ATE, RMSE [m]" in out
    assert len(list(plots.iterdir())) == 12
    assert all(p.stat().st_size > 2_000 for p in plots.iterdir())
    assert run("eval", "trajectory", *files, "--json") == 0
    found = json.loads(capsys.readouterr().out)
    low, high = found["b.tum"]["ate_rmse_m"]["interval_95"]
    assert low < found["b.tum"]["ate_rmse_m"]["value"] < high
    assert found["a_$x.tum"]["ate_rmse_m"]["value"] < low


@pytest.mark.parametrize(
    ("reference", "estimate", "ate_m"),
    [
        ("eval_control/truth.tum", "eval_control/est.tum", 0.02773),
        ("eval_kitti_camera/gt.txt", "eval_kitti_camera/est.txt", 0.3503),
        ("eval_kitti_camera/gt_planar.txt", "eval_kitti_camera/est_planar.txt", 0.3503),
        ("eval_orbslam3_ns/gt_sec.tum", "eval_orbslam3_ns/orb_f.txt", 0.02773),
        ("eval_orbslam3_ns/data.csv", "eval_orbslam3_ns/orb_int.txt", 0.02773),
        ("eval_nan_rows/gt.txt", "eval_nan_rows/est.txt", 0.02783),
        ("eval_csv_columns/truth.tum", "eval_csv_columns/pose_inW.csv", 0.02773),
        ("eval_csv_columns/truth.tum", "eval_csv_columns/head.tum", 0.02773),
    ],
)
def test_files_of_other_tools(
    reference: str, estimate: str, ate_m: float, capsys: pytest.CaptureFixture[str]
) -> None:
    if not CASES.is_dir():
        pytest.skip(f"no {CASES}")
    files = str(CASES / reference), str(CASES / estimate)
    assert run("eval", "trajectory", *files, "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert found["ate_rmse_m"]["value"] == pytest.approx(ate_m, abs=1e-4)
    assert found["rpe_rotation_rmse_deg"]["value"] < 1.0
