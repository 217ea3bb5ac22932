# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Information of matches along bare corridors and in crowds, and odometry that overrules them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import gtsam
import numpy as np
import pytest
from numpy.typing import NDArray

from slarm_graph.backends.robust_optimization import (
    contradictory_steps,
    fused_step,
    optimize_robustly,
    step_notices,
)
from slarm_graph.constraint import Constraint, ConstraintKind, PoseGraph
from slarm_graph.frontends.scans.gauss_newton import refine_near
from slarm_graph.frontends.scans.likelihood_grid import LikelihoodGrid, build_likelihood_grid
from slarm_graph.frontends.scans.match_information import discounted_information, misfit_discount
from slarm_graph.frontends.scans.odometry_filter import Prediction
from slarm_graph.frontends.scans.pose_candidates import PosePrior
from slarm_graph.frontends.scans.wall_tangents import wall_tangents
from slarm_graph.frontends.scans.wheel_motion import WheelMotion, chained
from slarm_graph.geometry import Floats, Pose2, compose

SIGMA_M, NOISE_M = 0.05, 0.02
CORRIDOR = ((-20.0, 1.0, 20.0, 1.0), (-20.0, -1.0, 20.0, -1.0))
ROOM = ((-3.0, 2.0, 3.0, 2.0), (3.0, 2.0, 3.0, -2.0), (3.0, -2.0, -3.0, -2.0), (-3.0, -2, -3, 2))


def rough(walls: tuple[tuple[float, ...], ...], seed: int) -> Floats:
    """Segments (S, 4) of walls that are cut into pieces of 10 cm and shaken by 2 cm."""
    rng, pieces = np.random.default_rng(seed), []
    for x0, y0, x1, y1 in walls:
        count = int(math.hypot(x1 - x0, y1 - y0) / 0.1)
        points = np.linspace((x0, y0), (x1, y1), count) + rng.normal(0.0, NOISE_M, (count, 2))
        pieces.append(np.hstack([points[:-1], points[1:]]))
    return np.concatenate(pieces)


def matched(
    walls: tuple[tuple[float, ...], ...], seed: int = 1
) -> tuple[LikelihoodGrid, Floats, Floats, Floats]:
    """Grid, points (K, 2) within 5 m, pose (3,) and information (3, 3) of a match."""
    grid = build_likelihood_grid(rough(walls, 0), resolution_m=0.05, sigma_m=SIGMA_M)
    seen = rough(walls, seed)[:, :2]
    points = np.ascontiguousarray(seen[np.hypot(*seen.T) < 5.0])
    pose, information, *_ = refine_near(grid, points, np.zeros(3), np.eye(3), 6.25, 30)
    return grid, points, pose, information


def expected(pose: Floats, sigma_m: float = 0.5) -> PosePrior:
    """The robot is expected at a pose, known along the corridor to within so much."""
    return PosePrior(
        np.zeros(3), (Prediction(pose, np.diag([sigma_m, 0.5, 0.5]) ** 2),), np.ones(3)
    )


BLOCK_CELLS = 4


def met(grid: LikelihoodGrid, keyframes: int) -> NDArray[np.int32]:
    """Blocks of a grid in which so many keyframes have met something."""
    return np.full([-(-side // BLOCK_CELLS) for side in grid.values.shape], keyframes, np.int32)


def lowered(
    information: Floats,
    grid: LikelihoodGrid,
    points: Floats,
    pose: Floats,
    prior: PosePrior,
    keyframes: int = 0,
) -> Floats:
    """Return what is left of an information (3, 3)."""
    blocks = met(grid, keyframes), BLOCK_CELLS
    seen = points, wall_tangents(points), pose
    return discounted_information(information, grid.lattice, *blocks, *seen, prior.mixture)


def test_a_bare_corridor_says_nothing_along_it_but_by_chance() -> None:
    shares = []
    for seed in range(1, 31):
        grid, points, pose, information = matched(CORRIDOR, seed)
        left = lowered(information, grid, points, pose, expected(pose))
        assert left[1, 1] == pytest.approx(information[1, 1], rel=0.01)
        assert np.linalg.eigvalsh(left).min() > 0.0
        shares.append(left[0, 0] / information[0, 0])
    # One in a hundred by the noise of the points; the walls' own roughness may speak, too.
    assert np.mean(np.array(shares) > 0.01) <= 0.1


def body(ahead_m: float, aside_m: float) -> Floats:
    """Points (15, 2) of who stands so far ahead and to the left [m], on the side that is seen."""
    turn = math.atan2(aside_m, ahead_m) + np.linspace(1.5 * math.pi, 0.5 * math.pi, 15)
    return np.array([ahead_m, aside_m]) + 0.25 * np.stack([np.cos(turn), np.sin(turn)], axis=1)


def with_things(things: Sequence[Floats], seed: int = 1) -> Floats:
    """Points (K, 2) of a bare corridor with small things (M, 2) in it, in beam order."""
    points = rough(CORRIDOR, seed)[:, :2]
    points = points[np.hypot(*points.T) < 5.0]
    for thing in things:
        hidden, bearings = np.arctan2(*thing.T[::-1]), np.arctan2(*points.T[::-1])
        is_behind = (bearings > hidden.min()) & (bearings < hidden.max())
        points = np.concatenate([points[~is_behind], thing])
    return points[np.argsort(np.arctan2(*points.T[::-1]))]


@pytest.mark.parametrize("aside_m", [0.0, 0.8])
@pytest.mark.parametrize(
    ("walked_m", "sigma_m", "least_m", "most_m"),
    [(0.0, 0.01, 0.0, 0.03), (0.15, 0.01, 0.2, 0.6), (0.15, 0.3, 0.05, 0.2)],
)
def test_one_small_thing_is_believed_where_it_agrees_with_the_odometry(
    walked_m: float, sigma_m: float, least_m: float, most_m: float, aside_m: float
) -> None:
    """Who has walked by fifteen standard deviations of the odometry says nothing of the robot.

    In the middle of the corridor or beside its wall, whose returns go on to theirs without a gap.
    """
    stood = body(3.0, aside_m)
    lines = np.concatenate([rough(CORRIDOR, 0), np.hstack([stood[:-1], stood[1:]])])
    grid = build_likelihood_grid(lines, resolution_m=0.05, sigma_m=SIGMA_M)
    points = with_things([body(3.0 + walked_m, aside_m)])
    # What moves along with the robot makes it seem to stand, and has it come on when it stands.
    start = np.array([-walked_m, 0.0, 0.0])
    pose, information, *_ = refine_near(grid, points, start, np.eye(3), 6.25, 30)
    assert pose[0] == pytest.approx(-walked_m, abs=0.02)
    left = lowered(information, grid, points, pose, expected(np.zeros(3), sigma_m))
    assert left[1, 1] == pytest.approx(information[1, 1], rel=0.05)
    assert least_m <= np.linalg.inv(left)[0, 0] ** 0.5 <= most_m


@pytest.mark.parametrize(
    ("keyframes", "least_m", "most_m"), [(0, 0.1, 0.6), (4, 0.1, 0.6), (5, 0.0, 0.03)]
)
def test_small_things_are_believed_against_the_odometry_once_they_were_met_for_long(
    keyframes: int, least_m: float, most_m: float
) -> None:
    """Before, they may be people who walk on together."""
    posts = tuple((x, y, x, y + 0.2) for x, y in ((3.0, 0.3), (-2.0, -0.6), (1.5, -0.7)))
    grid = build_likelihood_grid(
        np.concatenate([rough(CORRIDOR, 0), np.array(posts)]), resolution_m=0.05, sigma_m=SIGMA_M
    )
    rows = [np.linspace(post[:2], post[2:], 10) for post in posts]
    told = []
    for seed in range(1, 8):
        points = with_things(rows, seed)
        pose, information, *_ = refine_near(grid, points, np.zeros(3), np.eye(3), 6.25, 30)
        for off_m in (0.15, 0.0):
            prior = expected(pose + np.array([off_m, 0.0, 0.0]), 0.01)
            left = lowered(information, grid, points, pose, prior, keyframes)
            told.append(np.linalg.inv(left)[0, 0] ** 0.5)
    surprised, agreeing = np.median(np.reshape(told, (-1, 2)), axis=0)
    assert least_m < surprised < most_m
    assert agreeing < 0.03


def test_a_room_keeps_what_it_says() -> None:
    grid, points, pose, information = matched(ROOM)
    left = lowered(information, grid, points, pose, expected(pose))
    assert left[1, 1] == pytest.approx(information[1, 1], rel=0.05)
    assert 0.5 * information[0, 0] < left[0, 0] <= 1.001 * information[0, 0]


def test_the_weakest_direction_turns_with_the_robot() -> None:
    grid, points, pose, information = matched(CORRIDOR)
    turn = np.array([0.0, 0.0, 0.6])
    c = np.array([[math.cos(0.6), math.sin(0.6)], [-math.sin(0.6), math.cos(0.6)]])
    block = np.eye(3)
    block[:2, :2] = c
    elsewhere = compose(pose, turn)
    turned = lowered(
        block @ information @ block.T, grid, points @ c.T, elsewhere, expected(elsewhere)
    )
    straight = lowered(information, grid, points, pose, expected(pose))
    assert np.allclose(turned, block @ straight @ block.T, rtol=1e-3, atol=1.0)


def test_what_fits_worse_says_less() -> None:
    assert misfit_discount(1.0) == misfit_discount(1.3) == 1.0
    assert misfit_discount(0.8) == pytest.approx(math.exp(-2.0))


def test_motions_add_up_as_gtsam_says() -> None:
    a = WheelMotion(np.array([1.0, 0.3, 0.7]), np.diag([1e-4, 4e-4, 9e-4]), 1e-5 * np.eye(3))
    b = WheelMotion(np.array([0.5, -0.2, -1.1]), np.diag([2e-4, 1e-4, 5e-4]), 2e-5 * np.eye(3))
    both = chained(a, b)
    assert both is not None
    second = gtsam.Pose2(*b.motion)
    whole = gtsam.Pose2(*a.motion).compose(second)
    assert np.allclose(both.motion, [whole.x(), whole.y(), whole.theta()])
    adjoint = second.inverse().AdjointMap()
    assert np.allclose(both.covariance, adjoint @ a.covariance @ adjoint.T + b.covariance)
    assert np.allclose(
        both.covariance_if_working,
        adjoint @ a.covariance_if_working @ adjoint.T + b.covariance_if_working,
    )
    assert chained(None, b) is None
    assert chained(a, None) is None


def chain(slide_m: float, lidar_m: float, wheels_m: float, closes: bool = False) -> PoseGraph:
    """Ten metres straight on, of which matches miss some in the sixth step; closed, or not."""
    constraints, at = [], 0.0
    poses = [np.zeros(3)]
    for k in range(10):
        slid = slide_m if k == 5 else 0.0
        sigma_m = lidar_m if k == 5 else 0.02
        told = (
            (1.0 - slid, sigma_m, ConstraintKind.SCAN_MATCH),
            (1.0, wheels_m, ConstraintKind.ODOMETRY),
        )
        for way_m, sd_m, kind in told:
            covariance = np.diag([sd_m, sd_m, 0.01]) ** 2
            constraints.append(
                Constraint(k, k + 1, Pose2(way_m, 0.0, 0.0), covariance, ConstraintKind(kind))
            )
        at += 1.0 - slid
        poses.append(np.array([at, 0.0, 0.0]))
    if closes:
        sure = np.diag([0.02, 0.02, 0.005]) ** 2
        for k in (8, 9, 10):
            seen = Pose2(k - slide_m, 0.0, 0.0)
            constraints.append(Constraint(0, k, seen, sure, ConstraintKind.LOOP_CLOSURE))
    return PoseGraph(np.array(poses), tuple(constraints))


@pytest.mark.parametrize(
    ("lidar_m", "wheels_m", "closes", "expected_m"),
    [(0.2, 0.05, False, 10.0), (0.02, 0.1, False, 8.0), (0.2, 0.05, True, 8.0)],
)
def test_of_odometry_and_matches_the_surer_is_believed_unless_closures_tell(
    lidar_m: float, wheels_m: float, closes: bool, expected_m: float
) -> None:
    graph = chain(2.0, lidar_m, wheels_m, closes)
    settled = optimize_robustly(graph)
    assert settled.graph.poses[10, 0] == pytest.approx(expected_m, abs=0.1)
    assert len(settled.weights) == len(graph.constraints)


def test_a_step_is_contradictory_beyond_999_in_1000() -> None:
    bound = math.sqrt(16.266) * math.hypot(0.03, 0.04)
    assert contradictory_steps(chain(1.01 * bound, 0.03, 0.04).constraints) == [10, 11]
    assert contradictory_steps(chain(0.99 * bound, 0.03, 0.04).constraints) == []


def as_failed(graph: PoseGraph, sigma_m: float) -> PoseGraph:
    """Return the same graph, odometry of the sixth step as one that a match says has failed."""
    wide = np.diag([sigma_m, sigma_m, 0.01]) ** 2
    return replace(
        graph,
        constraints=tuple(
            replace(c, covariance=wide, unfailed=c.covariance)
            if c.i == 5 and c.kind is ConstraintKind.ODOMETRY
            else c
            for c in graph.constraints
        ),
    )


@pytest.mark.parametrize(("closures_say_m", "expected_m"), [(None, 8.0), (10.0, 10.0), (8.0, 8.0)])
def test_a_false_match_does_not_prove_that_odometry_failed(
    closures_say_m: float | None, expected_m: float
) -> None:
    """Odometry as wide as a match has it contradicts nothing; closures must be able to tell."""
    graph = as_failed(chain(2.0, 0.03, 0.04), 2.0)
    assert contradictory_steps(graph.constraints) == [10, 11]
    known = fused_step(graph.constraints[10], graph.constraints[11])
    assert known.covariance[0, 0] > 1.0
    if closures_say_m is not None:
        sure = np.diag([0.02, 0.02, 0.005]) ** 2
        seen = (Pose2(closures_say_m - 10.0 + k) for k in (8, 9, 10))
        closures = tuple(
            Constraint(0, k, told, sure, ConstraintKind.LOOP_CLOSURE)
            for k, told in zip((8, 9, 10), seen, strict=True)
        )
        graph = replace(graph, constraints=graph.constraints + closures)
    settled = optimize_robustly(graph)
    assert settled.graph.poses[10, 0] == pytest.approx(expected_m, abs=0.1)


@pytest.mark.parametrize(
    ("lidar_m", "wheels_m", "believed"),
    [(0.2, 0.05, "the odometry in 1"), (0.02, 0.1, "the matches in 1")],
)
def test_what_was_believed_is_told(lidar_m: float, wheels_m: float, believed: str) -> None:
    graph = chain(2.0, lidar_m, wheels_m)
    (told,) = step_notices(graph.constraints, optimize_robustly(graph).weights)
    assert told.endswith(f"in 1 of 10 steps of the graph: accepted {believed}")
    calm = chain(0.0, lidar_m, wheels_m)
    assert step_notices(calm.constraints, optimize_robustly(calm).weights) == ()
