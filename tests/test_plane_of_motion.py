# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The plane of a path: whichever way it lies, and what is said where a path has none."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from test_evaluation import START_NS, as_camera, room_drive

from slarm_graph.eval.evaluation import EvaluationOptions, evaluate
from slarm_graph.eval.plane_of_motion import Plane, level, plane_of, planes_of, projected
from slarm_graph.geometry import Floats, wrap_angles
from slarm_graph.spatial import SpatialTrajectory, in_space

NAMES = ("y-z", "x-z", "x-y")


def path_of(places: Floats, turns: Rotation | None = None) -> SpatialTrajectory:
    """A path without turns where none are given."""
    stamps = START_NS + 100_000_000 * np.arange(len(places), dtype=np.int64)
    quaternions = np.tile([0.0, 0.0, 0.0, 1.0], (len(places), 1))
    return SpatialTrajectory(
        stamps, np.column_stack([places, quaternions if turns is None else turns.as_quat()])
    )


def turned(path: SpatialTrajectory, by: Rotation) -> SpatialTrajectory:
    turns = by * Rotation.from_quat(path.poses[:, 3:])
    poses = np.column_stack([by.apply(path.poses[:, :3]), turns.as_quat()])
    return SpatialTrajectory(path.stamps_ns, poses)


def is_rotation(plane: Plane) -> bool:
    rows = plane.plane_from_space
    return bool(np.allclose(rows @ rows.T, np.eye(3)) and np.linalg.det(rows) > 0.0)


@pytest.mark.parametrize("axis", range(3))
def test_a_path_in_space_is_seen_along_its_shortest_extent_but_that_is_not_sure(axis: int) -> None:
    extents = np.roll([0.6, 1.0, 0.9], axis)
    places = np.random.default_rng(axis).uniform(-1.0, 1.0, (200, 3)) * extents
    found = plane_of(path_of(places))
    assert (found.name, found.sure) == (NAMES[axis], False)
    assert abs(found.up[axis]) == 1.0
    assert is_rotation(found)


@pytest.mark.parametrize("axis", range(3))
def test_a_flat_path_tells_its_plane(axis: int) -> None:
    """Up is where cameras and robots have it: y is down."""
    places = np.random.default_rng(0).uniform(-1.0, 1.0, (200, 3))
    places[:, axis] *= 0.05
    found = plane_of(path_of(places))
    assert (found.name, found.sure) == (NAMES[axis], True)
    assert found.up.tolist() == [[1, 0, 0], [0, -1, 0], [0, 0, 1]][axis]
    assert found.is_xy == (axis == 2)
    assert is_rotation(found)
    assert found.flipped().up.tolist() == (-found.up).tolist()
    assert is_rotation(found.flipped())


@pytest.mark.parametrize("deg", [9.6, -9.6, 10.6, -10.6, 40.0])
@pytest.mark.parametrize("axis", ["x", "y"])
def test_planes_within_ten_degrees_of_an_axis_are_taken_to_be_it(axis: str, deg: float) -> None:
    path = in_space(room_drive())
    tilt = Rotation.from_euler(axis, deg, degrees=True)
    found = plane_of(turned(path, tilt))
    assert found.sure
    assert is_rotation(found)
    if abs(deg) < 10.0:
        assert found.is_xy
    else:
        assert found.name == f"x-y slanted by {abs(deg):.0f} deg"
        np.testing.assert_allclose(found.up, tilt.apply([0.0, 0.0, 1.0]), atol=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_a_path_is_the_same_in_whatever_plane_it_lies(seed: int) -> None:
    """Up to a motion in the plane, and seen from below its mirror: distances and turns tell."""
    path = room_drive()
    lain = turned(in_space(path), Rotation.random(rng=seed))
    found = projected(lain, plane_of(lain))
    for gap in (1, 50):
        expected = np.linalg.norm(path.poses[gap:, :2] - path.poses[:-gap, :2], axis=1)
        steps = np.linalg.norm(found.poses[gap:, :2] - found.poses[:-gap, :2], axis=1)
        np.testing.assert_allclose(steps, expected, atol=1e-6)
    since = wrap_angles(path.poses[:, 2] - path.poses[0, 2])
    told = wrap_angles(found.poses[:, 2] - found.poses[0, 2])
    np.testing.assert_allclose(np.abs(told), np.abs(since), atol=1e-6)
    assert found.stamps_ns.tolist() == path.stamps_ns.tolist()


def test_a_camera_heads_where_it_looks() -> None:
    """Its z axis is ahead, which in the plane is the way it moves."""
    path = room_drive()
    found = level(as_camera(path))
    ahead = np.diff(found.poses[:, :2], axis=0)
    heading = np.arctan2(ahead[:, 1], ahead[:, 0])
    np.testing.assert_allclose(wrap_angles(found.poses[1:, 2] - heading), 0.0, atol=1e-6)


def tilting(path: SpatialTrajectory, seed: int) -> SpatialTrajectory:
    """A path whose body tilts by a degree or so."""
    tilts = Rotation.from_rotvec(np.random.default_rng(seed).normal(0.0, 0.02, (len(path), 3)))
    turns = Rotation.from_quat(path.poses[:, 3:]) * tilts
    return SpatialTrajectory(path.stamps_ns, np.column_stack([path.poses[:, :3], turns.as_quat()]))


@pytest.mark.parametrize("body", ["robot", "camera"])
@pytest.mark.parametrize("seed", range(6))
def test_two_bodies_that_tilt_are_not_taken_to_look_a_right_angle_apart(
    body: str, seed: int
) -> None:
    """Two of a body's axes lie in the plane of motion, and tilts decide which lies more in it."""
    path = room_drive()
    whole = in_space(path) if body == "robot" else as_camera(path)
    if body == "robot":
        whole = turned(whole, Rotation.random(rng=seed))
    found = evaluate(tilting(whole, seed), tilting(whole, seed + 50), EvaluationOptions())
    errors = {metric.name: metric.value for metric in found.metrics}
    assert errors["ate_rotation_rmse_deg"] < 4.0
    seen = projected(tilting(whole, seed), plane_of(whole))
    ahead = np.diff(seen.poses[:, :2], axis=0)
    heading = np.arctan2(ahead[:, 1], ahead[:, 0])
    assert np.abs(wrap_angles(seen.poses[1:, 2] - heading)).mean() < math.radians(4.0)


@pytest.mark.parametrize(("share", "name"), [(0.01, "x-y"), (0.04, "x-z")])
def test_a_lines_wobble_makes_no_plane(share: float, name: str) -> None:
    """Below 2 % of its length the body's turns tell; far from the origin as there."""
    turning = np.zeros((200, 3))
    turning[:, 2] = 0.3 * np.sin(np.arange(200) * 0.2)
    places = np.zeros((200, 3))
    places[:, 0] = np.linspace(-5.0, 5.0, 200)
    # A sine has as much of an extent as a line when 0.82 times as long from end to end.
    places[:, 2] = 5.0 * 0.82 * share * np.sin(np.arange(200) * 0.5)
    for origin_m in (0.0, 1000.0):
        found = plane_of(path_of(places + origin_m, Rotation.from_rotvec(turning)))
        assert (found.name, found.sure) == (name, True)


@pytest.mark.parametrize(("along", "name"), [(0, "x-y"), (1, "x-y"), (2, "x-z")])
def test_a_line_without_turns_is_seen_from_above_by_custom(along: int, name: str) -> None:
    places = np.zeros((50, 3))
    places[:, along] = np.linspace(0.0, 5.0, 50)
    found = plane_of(path_of(places))
    assert (found.name, found.sure) == (name, False)


@pytest.mark.parametrize("axis", range(3))
def test_a_line_lies_in_the_plane_in_which_its_body_turns(axis: int) -> None:
    places = np.zeros((50, 3))
    places[:, (axis + 1) % 3] = np.linspace(0.0, 5.0, 50)
    turning = np.zeros((50, 3))
    turning[:, axis] = 0.3 * np.sin(np.arange(50) * 0.2)
    found = plane_of(path_of(places, Rotation.from_rotvec(turning)))
    assert (found.name, found.sure) == (NAMES[axis], True)
    # Where it turns about several axes, none is its plane's.
    turning += 0.3 * np.cos(np.arange(50) * 0.31)[:, None] * np.roll([0.0, 1.0, 1.0], axis)
    assert not plane_of(path_of(places, Rotation.from_rotvec(turning))).sure


def test_what_does_not_move_is_seen_from_above() -> None:
    for places in (np.zeros((20, 3)), np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 2.0]])):
        found = plane_of(path_of(places))
        assert (found.is_xy, found.sure) == (True, False)


def flat(normal: Floats, seed: int = 0) -> SpatialTrajectory:
    """A path in the plane across a normal."""
    axes = np.linalg.svd(np.atleast_2d(normal))[2]
    shares = np.random.default_rng(seed).uniform(-3.0, 3.0, (100, 2))
    return path_of(shares @ axes[1:])


def test_the_references_plane_counts_unless_the_estimates_is_clearly_another() -> None:
    def tilted(deg: float) -> Floats:
        return np.array([0.0, math.sin(math.radians(deg)), math.cos(math.radians(deg))])

    ours = flat(tilted(0.0))
    for deg, own in ((19.0, False), (21.0, True), (-21.0, True), (90.0, True)):
        one, other = planes_of(ours, flat(tilted(deg), 1))
        assert one.is_xy
        assert (other is not one) == own
        assert np.allclose(np.abs(other.up), np.abs(tilted(deg) if own else tilted(0.0)))


def test_a_plane_that_one_of_two_paths_tells_is_that_of_both() -> None:
    line = path_of(np.linspace([0.0, 0.0, 0.0], [5.0, 0.0, 0.0], 50))
    one, other = planes_of(line, flat(np.array([0.0, 1.0, 0.0])))
    assert one is other
    assert (one.name, one.sure) == ("x-z", True)
    one, other = planes_of(flat(np.array([0.0, 1.0, 0.0])), line)
    assert one is other
    assert one.name == "x-z"
    one, other = planes_of(line, path_of(np.zeros((20, 3))))
    assert one is other
    assert not one.sure


def test_a_line_tells_its_plane_by_the_turns_however_the_body_is_mounted() -> None:
    """A camera that looks up or down turns about the axis of the room, not about its own."""
    places = np.column_stack([np.linspace(0.0, 9.0, 60), np.zeros(60), np.zeros(60)])
    yaw = Rotation.from_rotvec(np.outer(0.4 * np.sin(np.arange(60)), [0.0, 0.0, 1.0]))
    for mounted in (Rotation.identity(), Rotation.from_euler("yx", [0.7, 1.1])):
        found = plane_of(path_of(places, yaw * mounted))
        assert (found.name, found.sure) == ("x-y", True)
