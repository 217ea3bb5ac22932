# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""A wall's two faces are told apart by who sees them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slarm_graph.config import FrontendConfig, LoopClosureConfig
from slarm_graph.frontends.scans.closures import ClosureCandidates
from slarm_graph.frontends.scans.loop_closure import LoopCloser
from slarm_graph.frontends.scans.submaps import Keyframe, make_submap, view_center
from slarm_graph.frontends.scans.wall_sides import own_surfaces, share_from_behind, wall_sides
from slarm_graph.geometry import Floats, Pose2, between, transform_points

WALL_M = 0.15
ROOM = ((-2.0, -3.0), (2.0, -3.0), (2.0, 0.0), (-2.0, 0.0))
"""Its north side is the south face of a wall; the next room begins behind it."""
NEXT_ROOM = ((-2.0, WALL_M), (2.0, WALL_M), (2.0, 3.15), (-2.0, 3.15))


def seen(room: tuple[tuple[float, float], ...], pose: Floats, beams: int = 720) -> Floats:
    """Points (K, 2) of a convex room that a laser at `pose` sees, in its frame and beam order."""
    corners = transform_points(_inverse(pose), np.array(room))
    following = np.roll(corners, -1, axis=0)
    points = []
    for angle in np.linspace(-math.pi, math.pi, beams, endpoint=False):
        ray = np.array([math.cos(angle), math.sin(angle)])
        for a, b in zip(corners, following, strict=True):
            along = np.array([ray, a - b]).T
            if abs(np.linalg.det(along)) > 1e-9:
                r, s = np.linalg.solve(along, a)
                if r > 0.0 and 0.0 <= s <= 1.0:
                    points.append(r * ray)
                    break
    return np.array(points)


def _inverse(pose: Floats) -> Floats:
    return Pose2.from_array(pose).inverse().as_array()


def _shifted(pose: Floats, y_m: float) -> Floats:
    return np.array([pose[0], pose[1] + y_m, pose[2]])


INSIDE = np.array([[0.0, -1.0, 0.3], [0.5, -1.5, -2.0], [-0.8, -0.7, 1.2]])
BEYOND = np.array([0.3, 1.1, 0.7])


@pytest.fixture(scope="module", params=["counter-clockwise", "clockwise"])
def order(request: pytest.FixtureRequest) -> int:
    return 1 if request.param == "counter-clockwise" else -1


def test_the_same_room_is_seen_from_the_same_side(order: int) -> None:
    sides = wall_sides([seen(ROOM, p)[::order] for p in INSIDE], INSIDE)
    again = np.array([-0.2, -2.0, 2.5])
    assert share_from_behind(sides, own_surfaces(seen(ROOM, again)[::order]), again) == 0.0


def test_the_far_face_of_a_wall_is_seen_from_behind(order: int) -> None:
    sides = wall_sides([seen(ROOM, p)[::order] for p in INSIDE], INSIDE)
    wall_only = seen(NEXT_ROOM, BEYOND)
    wall_only = wall_only[transform_points(BEYOND, wall_only)[:, 1] < WALL_M + 0.01][::order]
    assert share_from_behind(sides, own_surfaces(wall_only), _shifted(BEYOND, -WALL_M)) > 0.95


def test_sides_do_not_depend_on_the_frame() -> None:
    """Turning and shifting everything by a whole octant and whole cells changes nothing."""
    turn = Pose2(0.35, -0.6, 0.25 * math.pi)
    scans = [seen(ROOM, p) for p in INSIDE]
    moved = np.array([(turn @ Pose2.from_array(p)).as_array() for p in INSIDE])
    beyond = (turn @ Pose2.from_array(_shifted(BEYOND, -WALL_M))).as_array()
    points = seen(NEXT_ROOM, BEYOND)
    plain = share_from_behind(
        wall_sides(scans, INSIDE), own_surfaces(points), _shifted(BEYOND, -WALL_M)
    )
    turned = share_from_behind(wall_sides(scans, moved), own_surfaces(points), beyond)
    assert turned == pytest.approx(plain, abs=0.03)


def test_noise_as_of_a_lidar_turns_no_wall_round() -> None:
    rng = np.random.default_rng(0)
    scans = [_noisy(seen(ROOM, p), rng) for p in INSIDE]
    again = np.array([-0.2, -2.0, 2.5])
    sides = wall_sides(scans, INSIDE)
    assert share_from_behind(sides, own_surfaces(_noisy(seen(ROOM, again), rng)), again) < 0.05


def _noisy(points: Floats, rng: np.random.Generator) -> Floats:
    ranges = np.hypot(points[:, 0], points[:, 1])
    return points * ((ranges + rng.normal(0.0, 0.02, len(ranges))) / ranges)[:, None]


def test_nothing_seen_is_seen_from_nowhere() -> None:
    sides = wall_sides([np.zeros((0, 2))], np.zeros((1, 3)))
    assert share_from_behind(sides, own_surfaces(seen(ROOM, INSIDE[0])), INSIDE[0]) == 0.0


def test_the_next_room_closes_no_loop_a_wall_too_near() -> None:
    """Without sides, most of the next room's walls lie on those of this one, a wall off."""
    poses = [*INSIDE, BEYOND]
    rooms = [ROOM] * len(INSIDE) + [NEXT_ROOM]
    # What connects both rooms, seen through a door, would agree; here nothing does.
    keyframes = [
        Keyframe(k, p, Pose2.from_array(pose), np.eye(3) * 1e-4, view_center(p))
        for k, (pose, p) in enumerate(
            zip(poses, [seen(r, p) for r, p in zip(rooms, poses, strict=True)], strict=True)
        )
    ]
    submap = make_submap(keyframes, 0, len(INSIDE), 0)
    closer = LoopCloser(LoopClosureConfig(min_score=0.2), FrontendConfig().matching)
    expected = ClosureCandidates(
        np.array([0]),
        between(INSIDE[0], _shifted(BEYOND, -WALL_M))[None],
        np.array([0.02]),
        np.array([0.01]),
    )
    (closure,) = closer.examine(keyframes, [submap], expected)
    assert closure.reason == "sees the other side of its walls"
