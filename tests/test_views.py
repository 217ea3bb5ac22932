# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Walls and free space of two places speak for or against how one lies in the other."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from test_consistency import HALL, around, scan_at

from slarm_graph.config import FrontendConfig, PoseGraphConfig
from slarm_graph.consistency.evidence import CELL_M, CLEARANCE_M
from slarm_graph.consistency.views import View, clear_beams, count_known, evidence_against, view_of
from slarm_graph.frontends.scans import submap_matching
from slarm_graph.frontends.scans.submap_matching import SubmapMatcher
from slarm_graph.frontends.scans.submaps import Keyframe, make_submap, view_center
from slarm_graph.frontends.scans.tracker import ScanTracker
from slarm_graph.geometry import Floats, Pose2, between, compose, transform_points
from slarm_graph.readings import LaserScan, Reading

NICHES = [(8.0, 0.0, 8.0, 0.6), (8.0, 0.6, 8.5, 0.6), (8.5, 0.6, 8.5, 0.0), (11.0, 0.0, 11.0, 0.9)]
ENDS = [(0.0, 0.0, 0.0, 3.0), (20.0, 0.0, 20.0, 3.0)]
NARROW = [(0.0, 0.0, 20.0, 0.0), (0.0, 3.0, 20.0, 3.0), *ENDS, *NICHES]
MOUNT = np.array([3.0, 0.0, 1.0])
WIDE = [(0.0, 0.0, 20.0, 0.0), (0.0, 12.0, 20.0, 12.0), *NICHES]
WIDE += [(0.0, 0.0, 0.0, 12.0), (20.0, 0.0, 20.0, 12.0)]


def seen_from(poses: Floats, walls: list[tuple[float, ...]]) -> View:
    """Draw what is seen from poses, in the frame of the first."""
    own = between(poses[0], poses)
    returns = [
        transform_points(at, scan_at(pose, walls).points_m())
        for at, pose in zip(own, poses, strict=True)
    ]
    return view_of(returns, compose(own, np.array([0.2, 0.0, 0.0]))[:, :2])


@pytest.fixture(scope="module")
def views() -> tuple[View, View, Floats]:
    """Two passes of the hall's long side, the second from beside the first, and how they lie."""
    one = around(1.0)[:30]
    other = one + np.array([0.3, 0.4, 0.0])
    return seen_from(one, HALL), seen_from(other, HALL), between(one[0], other[0])


def test_a_place_speaks_for_itself_and_against_where_it_is_not(
    views: tuple[View, View, Floats],
) -> None:
    first, second, first_from_second = views
    right = evidence_against(second, first, first_from_second)
    assert right < -15.0
    for off in ([2.0, 0.0, 0.0], [0.0, -2.0, 0.0], [0.0, 0.0, 0.5]):
        wrong = evidence_against(second, first, compose(first_from_second, np.array(off)))
        assert wrong > 10.0


def test_either_may_be_asked_of_the_other(views: tuple[View, View, Floats]) -> None:
    first, second, first_from_second = views
    back = between(first_from_second, np.zeros(3))
    one, other = (
        evidence_against(second, first, first_from_second),
        evidence_against(first, second, back),
    )
    assert one == pytest.approx(other, abs=0.1)


@pytest.mark.parametrize("seed", range(4))
def test_a_view_has_a_cell_around_all_that_it_saw(seed: int) -> None:
    """Beams are counted without looking at borders: none may end on one."""
    rng = np.random.default_rng(seed)
    lasers = rng.uniform(-3.0, 3.0, (5, 2))
    returns = [at + rng.uniform(-8.0, 8.0, (30, 2)) for at in lasers]
    view = view_of(returns, lasers)
    ends = np.vstack([lasers, *returns])
    np.testing.assert_allclose(view.low, ends.min(axis=0) - CELL_M)
    beyond = view.low + CELL_M * np.array(view.states.shape[::-1]) - ends.max(axis=0)
    assert (beyond >= CELL_M - 1e-9).all()
    assert (beyond < 2.0 * CELL_M).all()


def test_beams_that_meet_nothing_reach_as_far_as_others_see() -> None:
    """To `CLEARANCE_M` before the farthest return; those without a reading say nothing."""
    ranges = np.array([np.inf, 4.0, np.nan, -np.inf, 6.0, np.inf, 20.0, 0.01])
    scan = LaserScan(ranges, -0.5, 0.25, 0.1, 30.0, Pose2.from_array(MOUNT))
    expected = (6.0 - CLEARANCE_M) * np.array([[math.cos(a), math.sin(a)] for a in (-0.5, 0.75)])
    np.testing.assert_allclose(clear_beams(scan).points_m(), transform_points(MOUNT, expected))
    for blind in (np.full(8, np.inf), np.where(np.isinf(ranges), ranges, 0.3)):
        assert clear_beams(replace(scan, ranges_m=blind)).points_m().shape == (0, 2)


def test_what_beams_without_a_return_cross_is_no_wall_and_not_free() -> None:
    """Two walls; the first is looked through by as many as meet it, or by more."""
    lasers = np.zeros((4, 2))
    returns = [np.array([[3.0, 0.01], [0.01, 3.0]])] * 4
    seen = view_of(returns, lasers)
    assert len(seen.walls) == 2
    for through, walls in ((0, 2), (4, 2), (5, 1)):
        clear = [np.tile([6.0, 0.02], (len(range(k, through, 4)), 1)) for k in range(4)]
        view = view_of(returns, lasers, clear)
        assert len(view.walls) == walls, through
        beyond = view.states[:, math.ceil((3.5 - view.low[0]) / CELL_M) :]
        assert not beyond.any()
        assert view.low[0] + CELL_M * view.states.shape[1] > (6.0 if through else 3.0)


def test_what_saw_nothing_says_nothing(views: tuple[View, View, Floats]) -> None:
    nothing = view_of([np.zeros((0, 2))], np.zeros((1, 2)))
    assert (nothing.walls.shape, nothing.states.shape, nothing.low.shape) == ((0, 2), (0, 0), (2,))
    assert evidence_against(nothing, views[0], np.zeros(3)) == 0.0
    assert evidence_against(views[0], views[1], np.array([500.0, 0.0, 0.0])) == 0.0


def test_points_are_known_where_a_view_judged() -> None:
    """Every cell's middle, from any pose; beyond all cells nothing is known."""
    low = np.array([-0.7, 1.2])
    states = np.random.default_rng(4).integers(0, 3, (9, 14)).astype(np.uint8)
    row, col = np.indices(states.shape).reshape(2, -1)
    middles = low + (np.column_stack([col, row]) + 0.5) * CELL_M
    pose = np.array([0.4, -0.3, 0.8])
    points = transform_points(between(pose, np.zeros(3)), middles)
    assert count_known(points, pose, states, low) == np.count_nonzero(states)
    for k in range(0, len(points), 7):
        assert count_known(points[k : k + 1], pose, states, low) == bool(states[row[k], col[k]])
    assert count_known(points + 50.0, pose, states, low) == 0


def test_a_place_is_less_sure_where_less_fits(monkeypatch: pytest.MonkeyPatch) -> None:
    """Half of the returns come from within the walls; nothing is missing where all fit."""
    way = np.column_stack([np.arange(4.0, 14.0, 0.25), np.full(40, 1.5), np.zeros(40)])
    scans = [scan_at(pose, NARROW).points_m() for pose in way]
    at_odds = [np.concatenate([p, p * [1.0, 0.4]]) for p in scans]

    def information(later: list[Floats], misfit: float) -> Floats:
        monkeypatch.setattr(submap_matching, "_MISFIT", misfit)
        poses, all_scans = np.concatenate([way, way]), [*scans, *later]
        keyframes = [
            Keyframe(k, points, Pose2.from_array(pose), np.eye(3) * 1e-6, view_center(points))
            for k, (pose, points) in enumerate(zip(poses, all_scans, strict=True))
        ]
        submaps = [make_submap(keyframes, k, k + 10, k) for k in range(0, 80, 10)]
        loops, matching = PoseGraphConfig().loops, FrontendConfig().matching
        return (
            SubmapMatcher(loops, matching, keyframes, submaps).align(5, 1, np.zeros(3)).information
        )

    def missing(later: list[Floats], misfit: float) -> float:
        share = information(later, misfit) / information(later, 0.0)
        assert np.ptp(share) < 1e-9
        return -math.log(share[0, 0]) / misfit

    assert missing(scans, 4.0) < 0.1
    assert 0.4 < missing(at_odds, 4.0) < 0.5
    assert missing(at_odds, 8.0) == pytest.approx(missing(at_odds, 4.0))


@pytest.mark.parametrize(("other", "is_believed"), [(NARROW, True), (WIDE, False)])
def test_a_corridor_is_not_found_along_the_wall_of_a_hall(
    other: list[tuple[float, ...]], is_believed: bool
) -> None:
    """One wall with all its niches agrees; the other one is looked through."""
    way = np.column_stack([np.arange(4.0, 14.0, 0.25), np.full(40, 1.5), np.zeros(40)])
    keyframes = [
        Keyframe(k, points, Pose2.from_array(pose), np.eye(3) * 1e-6, view_center(points))
        for k, (pose, points) in enumerate(
            (pose, scan_at(pose, walls).points_m()) for walls in (NARROW, other) for pose in way
        )
    ]
    submaps = [make_submap(keyframes, k, k + 10, k) for k in range(0, 80, 10)]
    loops, matching = PoseGraphConfig().loops, FrontendConfig().matching
    found = SubmapMatcher(loops, matching, keyframes, submaps).align(6, 2, np.zeros(3))
    assert found.score > loops.min_submap_score
    assert np.abs(found.submap_from_keyframe).max() < 0.1
    assert ("do not support it" not in found.reason) == is_believed
    assert is_believed == (not found.reason)


def test_a_submap_knows_where_beams_met_nothing() -> None:
    """Four scans meet somebody; from other poses six beams pass there, and meet nothing."""
    poses = np.array([[0.1 * k, 0.0, 0.2 * k] for k in range(10)])
    place, beyond = np.array([[3.05, 0.05]]), np.array([[6.0, 0.1]])
    wall = np.array([[2.05, 3.05]])
    walls = []
    for knows in (False, True):
        keyframes = []
        for k, pose in enumerate(poses):
            ends = [transform_points(between(pose, np.zeros(3)), p) for p in (place, beyond, wall)]
            returns = np.vstack([ends[0], ends[2]]) if k < 4 else ends[2]
            keyframes.append(
                Keyframe(
                    *(k, returns, Pose2.from_array(pose), np.eye(3), view_center(returns)),
                    clear_ends_m=ends[1] if knows and k >= 4 else ends[1][:0],
                )
            )
        submaps = [make_submap(keyframes, 0, 10, 0)]
        loops, matching = PoseGraphConfig().loops, FrontendConfig().matching
        matcher = SubmapMatcher(loops, matching, keyframes, submaps)
        walls.append(matcher._views.of(submaps[0], keyframes).walls)
    assert walls[0] == pytest.approx(np.vstack([place, wall]))
    assert walls[1] == pytest.approx(wall)


@pytest.mark.parametrize("time_increment_s", [0.0, 1e-3])
def test_a_keyframe_tells_how_far_it_looks_where_it_meets_nothing(time_increment_s: float) -> None:
    """In the frame of the first beam, though the robot turns while the laser sweeps."""
    angles = np.linspace(-2.0, 2.0, 201)
    tracker, turn, keyframes = ScanTracker(FrontendConfig()), 0.5, 0
    for k in range(12):
        started = 0.2 * k
        bearings = angles + turn * (started + time_increment_s * np.arange(201))
        ranges = 3.0 + np.sin(3.0 * bearings)
        ranges[np.cos(bearings - 0.8) > 0.9] = np.inf
        scan = LaserScan(ranges, -2.0, 0.02, 0.1, 8.0, time_increment_s=time_increment_s)
        odometry = Pose2(0.0, 0.0, turn * started)
        tracked = tracker.track(Reading(round(started * 1e9) + 1, scan, odometry))
        if not tracked.is_keyframe:
            assert not len(tracked.clear_ends_m)
            continue
        reach_m = ranges[np.isfinite(ranges)].max() - CLEARANCE_M
        ends = tracked.clear_ends_m
        np.testing.assert_allclose(np.hypot(*ends.T), reach_m, atol=0.02)
        towards = np.arctan2(*ends.T[::-1]) + turn * started
        assert (np.cos(towards - 0.8) > 0.9 - (0.02 if k > 2 else 0.2)).all()
        assert np.ptp(towards) > 0.8
        keyframes += 1
    assert keyframes > 2
