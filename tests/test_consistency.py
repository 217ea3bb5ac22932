# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""A trajectory judged by itself: kernels against brute force, verdicts in worlds that are known."""

from __future__ import annotations

import math
from types import SimpleNamespace

import gtsam
import numpy as np
import pytest
from scipy.ndimage import binary_dilation, convolve
from scipy.stats import binom

from slarm_graph.consistency import build_visits, contradictions, cross_check
from slarm_graph.consistency import pairs as pairs_module
from slarm_graph.consistency.conflict_places import conflict_points_m
from slarm_graph.consistency.evidence import (
    BLOCKED,
    BLOCKED_SHARE,
    CELL_M,
    FREE,
    MIN_BEAMS,
    MIN_PASSED_AROUND,
    RIGHT_CONFLICT_RATE,
    TOLERANCE_M,
    UNKNOWN,
    WRONG_CONFLICT_RATE,
    classify_cells,
    count_agreement,
    count_beams,
    state_at,
    wrong_place_evidence,
)
from slarm_graph.consistency.tears import _differences
from slarm_graph.consistency.verdict import checked_share
from slarm_graph.consistency.visits import thinned_by_motion
from slarm_graph.geometry import Floats, Pose2, between, compose, transform_points
from slarm_graph.readings import LaserScan
from slarm_graph.trajectory import Trajectory

BEAMS = 181

# A hall of 16 x 12 m about a block of 6 x 4 m, and two pillars.
HALL = [
    *[(0, 0, 16, 0), (16, 0, 16, 12), (16, 12, 0, 12), (0, 12, 0, 0)],
    *[(5, 4, 11, 4), (11, 4, 11, 8), (11, 8, 5, 8), (5, 8, 5, 4)],
    *[(3, 5, 4, 5), (4, 5, 4, 6), (4, 6, 3, 6), (3, 6, 3, 5)],
    *[(13, 9, 14, 9), (14, 9, 14, 10), (14, 10, 13, 10), (13, 10, 13, 9)],
]
CORRIDOR = [(0, 0, 80, 0), (0, 3, 80, 3), (0, 0, 0, 3), (80, 0, 80, 3)]


def scan_at(pose: Floats, walls: list[tuple[float, ...]], laser_x: float = 0.2) -> LaserScan:
    """Cast rays at walls given as x1, y1, x2, y2 [m]."""
    at = compose(pose, [laser_x, 0.0, 0.0])
    angles = at[2] + np.linspace(-math.pi / 2, math.pi / 2, BEAMS)
    d = np.stack([np.cos(angles), np.sin(angles)], axis=1)[:, None]
    w = np.array(walls, dtype=np.float64)
    a, e = w[:, :2] - at[:2], w[:, 2:] - w[:, :2]
    cross = d[..., 0] * e[:, 1] - d[..., 1] * e[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        r = (a[:, 0] * e[:, 1] - a[:, 1] * e[:, 0]) / cross
        t = (a[:, 0] * d[..., 1] - a[:, 1] * d[..., 0]) / cross
    r = np.where((t >= 0) & (t <= 1) & (r > 0), r, np.inf).min(axis=1)
    step = math.pi / (BEAMS - 1)
    return LaserScan(r, -math.pi / 2, step, 0.05, 30.0, Pose2(laser_x, 0.0, 0.0))


def around(laps: float = 2.0, step_m: float = 0.2) -> Floats:
    """Drive around the hall's block in a rectangle with rounded headings, (N, 3) [m, m, rad]."""
    corners = np.array([(2.0, 2.0), (14.0, 2.0), (14.0, 8.5), (2.0, 10.0)])
    corners = np.vstack([corners, corners[:1]])
    sides = np.hypot(*np.diff(corners, axis=0).T)
    at = np.mod(np.arange(0.0, laps * sides.sum(), step_m), sides.sum())
    ends = np.r_[0.0, np.cumsum(sides)]
    x, y = (np.interp(at, ends, corners[:, k]) for k in range(2))
    headings = np.unwrap(np.arctan2(np.gradient(y), np.gradient(x)))
    return np.stack([x, y, headings], axis=1)


def stamped(poses: Floats) -> Trajectory:
    return Trajectory(np.arange(len(poses)) * 200_000_000, poses)


@pytest.fixture(scope="module")
def laps() -> tuple[list[LaserScan], Floats]:
    poses = around()
    return [scan_at(pose, HALL) for pose in poses], poses


def moved_from(poses: Floats, first: int, motion: tuple[float, float, float]) -> Floats:
    """Move everything from a scan on by a motion in the map."""
    out = poses.copy()
    out[first:] = compose(motion, poses[first:])
    return out


def test_noiseless_world_has_no_contradiction(laps: tuple[list[LaserScan], Floats]) -> None:
    scans, poses = laps
    result = contradictions(scans, stamped(poses), poses)
    assert result.verdict == "consistent"
    assert result.share < 0.001  # a dozen cells at corners, where the one who looks along sees past
    assert result.checked_share > 0.9
    assert result.compared > 10_000
    assert not result.places and not result.tears and not len(result.points_m)


@pytest.mark.parametrize("motion", [(0.6, 0.0, 0.0), (0.0, -0.7, 0.0), (-2.0, 1.0, 0.1)])
def test_planted_shift_is_found_where_it_is(
    laps: tuple[list[LaserScan], Floats], motion: tuple[float, float, float]
) -> None:
    scans, poses = laps
    half = len(poses) // 2
    result = contradictions(scans, stamped(moved_from(poses, half, motion)))
    assert result.verdict == "inconsistent"
    assert result.share > result.expected_share + 5 * np.nan_to_num(result.expected_sigma)
    worst = result.places[0]
    tear_ns = half * 200_000_000
    assert worst.earlier_ns[0] < tear_ns < worst.later_ns[1]
    assert worst.contradicted > 50 and worst.pairs > 2
    low, high = result.points_m.min(axis=0), result.points_m.max(axis=0)
    assert (low > -4).all() and (high < 20).all()


@pytest.mark.parametrize("motion", [(0.1, 0.05, 0.0), (0.0, 0.1, 0.003)])
def test_small_errors_of_poses_are_no_contradiction(
    laps: tuple[list[LaserScan], Floats], motion: tuple[float, float, float]
) -> None:
    scans, poses = laps
    result = contradictions(scans, stamped(moved_from(poses, len(poses) // 2, motion)))
    assert result.verdict == "consistent"


def test_a_thing_that_was_moved_is_no_contradiction() -> None:
    poses = around()
    half = len(poses) // 2
    thing = [(7, 1, 8, 1), (8, 1, 8, 3), (8, 3, 7, 3), (7, 3, 7, 1)]
    scans = [scan_at(p, HALL + thing if k < half else HALL) for k, p in enumerate(poses)]
    result = contradictions(scans, stamped(poses))
    assert result.share > 0.0
    assert result.verdict == "consistent"


def test_what_is_seen_once_is_not_judged() -> None:
    poses = np.stack([np.arange(1.0, 79.0, 0.2), np.full(390, 1.5), np.zeros(390)], axis=1)
    result = contradictions([scan_at(p, CORRIDOR) for p in poses], stamped(poses))
    assert result.checked_share == 0.0
    assert result.verdict == "doubtful"
    assert "0% of the way was seen again" in result.reasons[0]


def test_tear_shows_against_odometry_and_slip_does_not(
    laps: tuple[list[LaserScan], Floats],
) -> None:
    scans, poses = laps
    first = 60
    torn = moved_from(poses, first, (0.6, 0.3, 0.2))
    only = slice(0, 150)  # less than a lap: nothing is seen again
    (tear,) = contradictions(scans[only], stamped(torn[only]), poses[only]).tears
    assert tear.stamps_ns[0] < first * 200_000_000 <= tear.stamps_ns[1] + 1
    assert np.hypot(*(poses[first, :2] - tear.position_m)) < 1.0
    assert tear.evidence_nat > 6.0
    before, after = (stamp // 200_000_000 for stamp in tear.stamps_ns)
    assert before < first <= after
    assert tear.position_m == tuple(torn[before, :2])
    planted = between(between(poses[before], poses[after]), between(torn[before], torn[after]))
    np.testing.assert_allclose(tear.off, planted, atol=0.02)
    assert not contradictions(scans[only], stamped(poses[only]), torn[only]).tears


def test_odometry_that_never_agrees_is_no_witness(laps: tuple[list[LaserScan], Floats]) -> None:
    scans, poses = laps
    rng = np.random.default_rng(3)
    steps = between(poses[:-1], poses[1:]) + rng.normal(0, 0.3, (len(poses) - 1, 3))
    odometry = [poses[0]]
    for step in steps:
        odometry.append(compose(odometry[-1], step))
    result = contradictions(scans, stamped(poses), np.array(odometry))
    assert result.verdict == "consistent"


def test_missing_odometry_and_scans_without_returns_are_taken() -> None:
    empty = LaserScan(np.full(BEAMS, np.inf), -1.5, 0.01, 0.05, 30.0)
    poses = around(0.5)
    result = contradictions([empty] * len(poses), stamped(poses), np.full_like(poses, np.nan))
    assert math.isnan(result.share)
    assert result.verdict == "doubtful"
    nothing = contradictions([], stamped(np.zeros((0, 3))))
    assert nothing.compared == 0 and nothing.verdict == "doubtful"


def test_visits_moved_are_as_visits_built_anew(laps: tuple[list[LaserScan], Floats]) -> None:
    scans, poses = laps
    visits = build_visits(scans, poses)
    first = int(visits.scans[len(visits) // 2, 0])
    moved = moved_from(poses, first, (1.0, 0.5, 0.1))
    quick, anew = cross_check(visits.at(moved)), cross_check(build_visits(scans, moved))
    assert quick.conflict_share() > 0.05
    np.testing.assert_allclose(quick.conflict_share(), anew.conflict_share(), rtol=0.1)
    same = cross_check(visits.at(poses))
    np.testing.assert_array_equal(same.contradicted, cross_check(visits).contradicted)


def test_pairs_are_counted_as_by_hand(laps: tuple[list[LaserScan], Floats]) -> None:
    scans, poses = laps
    moved = moved_from(poses, len(poses) // 2, (0.5, 0.5, 0.0))
    visits = build_visits(scans, moved)
    pairs = cross_check(visits)
    k = int(np.argmax(pairs.contradicted))
    counts = np.zeros(3, dtype=int)
    for a, b in (pairs.visits[k], pairs.visits[k][::-1]):
        states = visits.states[visits.state_start[b] : visits.state_start[b + 1]]
        states = states.reshape(visits.shapes[b])
        own = visits.walls[visits.wall_start[a] : visits.wall_start[a + 1]]
        in_b = transform_points(between(visits.poses[b], visits.poses[a]), own)
        for col, row in np.floor((in_b - visits.lows[b]) / CELL_M).astype(int):
            inside = 0 <= row < states.shape[0] and 0 <= col < states.shape[1]
            counts[states[row, col] if inside else UNKNOWN] += 1
    assert pairs.contradicted[k] == counts[FREE]
    assert pairs.confirmed[k] == counts[BLOCKED]
    assert len(conflict_points_m(visits, *pairs.visits[k])) == counts[FREE]


def test_scans_are_kept_by_motion_as_poses_have_it() -> None:
    """Against gtsam's poses one by one, headings going round more than once."""
    rng = np.random.default_rng(8)
    for scale in (0.02, 0.1, 0.5):
        poses = np.cumsum(rng.normal(0.0, [scale, scale, 2.0 * scale], (300, 3)), axis=0)
        kept = [0]
        for i in range(1, len(poses)):
            step = gtsam.Pose2(*poses[kept[-1]]).between(gtsam.Pose2(*poses[i]))
            if np.hypot(step.x(), step.y()) >= 0.4 or abs(step.theta()) >= 0.6:
                kept.append(i)
        assert thinned_by_motion(poses, 0.4, 0.6).tolist() == kept
    assert 10 < len(kept) < 300


@pytest.mark.parametrize("most", [2, 7, 40, 300])
def test_of_too_many_pairs_an_even_selection_is_compared(
    laps: tuple[list[LaserScan], Floats], monkeypatch: pytest.MonkeyPatch, most: int
) -> None:
    """Of all in their order, the first and the last among them, each counted as ever."""
    visits = build_visits(*laps)
    whole = cross_check(visits, least_cells=0)
    monkeypatch.setattr(pairs_module, "MAX_PAIRS", most)
    some = cross_check(visits, least_cells=0)
    assert len(some.visits) == min(most, len(whole.visits))
    rows = {tuple(pair): k for k, pair in enumerate(whole.visits.tolist())}
    at = np.array([rows[tuple(pair)] for pair in some.visits.tolist()])
    assert (at[0], at[-1]) == (0, len(whole.visits) - 1)
    assert np.ptp(np.diff(at)) <= 1
    np.testing.assert_array_equal(some.confirmed, whole.confirmed[at])
    np.testing.assert_array_equal(some.contradicted, whole.contradicted[at])


@pytest.mark.parametrize(("sigmas", "found"), [(5.7, 0), (6.3, 1)])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_steps_are_looked_at_from_six_robust_deviations_on(
    axis: int, sigmas: float, found: int
) -> None:
    """Of a way ahead with noise in one direction and one step planted."""
    steps = np.zeros((400, 3))
    steps[:, axis] = np.random.default_rng(9).normal(0.0, 0.1, 400).clip(-0.3, 0.3)
    steps[200, axis] = sigmas * 1.4826 * np.median(np.abs(steps[:, axis]))
    odometry = np.column_stack([np.arange(401.0), np.zeros(401), np.zeros(401)])
    poses = [np.zeros(3)]
    for step in steps:
        poses.append(compose(poses[-1], compose(np.array([1.0, 0.0, 0.0]), step)))
    told = _differences(np.array(poses), odometry, np.arange(401), 1)
    assert [first for _, first, _, _ in told] == [200] * found


def test_beams_pass_what_lies_before_their_end() -> None:
    rng = np.random.default_rng(5)
    for _ in range(50):
        beam, low = rng.uniform(1.0, 9.0, (1, 4)), rng.uniform(-9.0, 9.0, 2)
        hits, passes = np.zeros((2, 100, 100), dtype=np.int16)
        start, end = beam[0, :2], beam[0, 2:]
        length = np.hypot(*(end - start))
        clear = rng.uniform(0.0, length)
        count_beams(hits, passes, low, np.c_[beam + np.tile(low, 2), clear])
        assert np.argwhere(hits).tolist() == [np.floor(end[::-1] / CELL_M).astype(int).tolist()]
        centres = (np.argwhere(passes)[:, ::-1] + 0.5) * CELL_M - start
        along = centres @ (end - start) / length
        across = np.abs(centres @ np.array([start[1] - end[1], end[0] - start[0]])) / length
        assert (across <= 0.71 * CELL_M).all()
        assert (along > -0.71 * CELL_M).all() and (along < clear + 0.71 * CELL_M).all()
        longer = np.abs(end - start).max() * clear / length
        assert passes.max(initial=0) <= 1
        assert abs(passes.sum() - longer / CELL_M) <= 1.0


def test_cells_are_judged_as_by_dilation() -> None:
    rng = np.random.default_rng(6)
    hits = (rng.integers(0, 8, (40, 50)) * (rng.random((40, 50)) < 0.1)).astype(np.int16)
    passes = rng.integers(0, 9, (40, 50)).astype(np.int16)
    silent = (rng.integers(0, 3, (40, 50)) * (rng.random((40, 50)) < 0.5)).astype(np.int16)
    states, walls = classify_cells(hits, passes, silent)
    blocks = (hits > 0) & (hits >= BLOCKED_SHARE * (hits + passes))
    reach = math.floor(TOLERANCE_M / CELL_M)
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    blocked = binary_dilation(blocks, np.hypot(x, y) * CELL_M <= TOLERANCE_M + 1e-9)
    around = np.pad(convolve((passes > 0).astype(int), np.ones((3, 3), int))[1:-1, 1:-1], 1)
    free = ~blocked & (passes >= MIN_BEAMS) & (around > MIN_PASSED_AROUND)
    np.testing.assert_array_equal(states, np.where(blocked, BLOCKED, np.where(free, FREE, UNKNOWN)))
    wall = blocks & (hits >= MIN_BEAMS) & (hits >= passes + silent)
    np.testing.assert_array_equal(walls, np.argwhere(wall))


def test_count_agreement_looks_cells_up_under_a_pose() -> None:
    states = np.array([[UNKNOWN, FREE], [BLOCKED, FREE]], dtype=np.uint8)
    walls = np.array([[0.05, 0.05], [0.15, 0.05], [0.05, 0.15], [0.15, 0.15], [0.35, 0.05]])
    low = np.zeros(2)
    assert count_agreement(walls, np.zeros(3), states, low) == (1, 2)
    # A quarter turn about the middle carries cell to cell.
    assert count_agreement(walls[:4], np.array([0.2, 0.0, math.pi / 2]), states, low) == (1, 2)
    assert count_agreement(walls, np.array([5.0, 0.0, 0.0]), states, low) == (0, 0)


def test_a_cell_reaches_to_the_next_and_nothing_is_known_beside_all() -> None:
    """Also within a cell's side of the first ones, where numbers are cut to zero."""
    states, low = np.arange(1, 13, dtype=np.uint8).reshape(3, 4), np.array([-2.0, 1.0])
    for x, y in np.random.default_rng(1).uniform([-2.2, 0.8], [-1.4, 1.5], (300, 2)):
        col, row = math.floor((x + 2.0) / CELL_M), math.floor((y - 1.0) / CELL_M)
        inside = 0 <= row < 3 and 0 <= col < 4
        assert state_at(states, low, x, y) == (states[row, col] if inside else UNKNOWN)


def test_counts_of_beams_stay_within_their_type() -> None:
    hits, passes = np.full((2, 3, 30), 32_766, dtype=np.int16)
    count_beams(hits, passes, np.zeros(2), np.array([[0.05, 0.15, 2.75, 0.15, 1.0]] * 3))
    assert (hits.max(), passes.max(), np.argmax(hits)) == (32_767, 32_767, 30 + 27)


def test_evidence_is_a_likelihood_ratio() -> None:
    n = np.full(3, 200)
    right, wrong = (
        np.round(share * n).astype(int) for share in (RIGHT_CONFLICT_RATE, WRONG_CONFLICT_RATE)
    )
    for share in (0.0, 0.1, 0.4, 1.0):
        k = int(share * 200)
        by_rate = [
            binom.logpmf(k, 200, rate) for rate in (WRONG_CONFLICT_RATE, RIGHT_CONFLICT_RATE)
        ]
        found = wrong_place_evidence(np.array([200 - k]), np.array([k]))
        np.testing.assert_allclose(found, (by_rate[0] - by_rate[1]) / 10.0)
    assert (wrong_place_evidence(n - right, right) < -8).all()
    assert (wrong_place_evidence(n - wrong, wrong) > 20).all()
    sum_of_two = 2 * wrong_place_evidence(np.array([7]), np.array([5]))
    np.testing.assert_allclose(wrong_place_evidence(np.array([14]), np.array([10])), sum_of_two)


class SomeVisits(SimpleNamespace):
    """Stretches of the path and where they are."""

    path_m: Floats

    def __len__(self) -> int:
        return len(self.path_m)


@pytest.mark.parametrize(
    ("path_m", "x_m", "pairs", "share"),
    [
        ([(0, 10), (10, 14), (30, 36)], (0, 0, 0), [(0, 2)], 0.8),
        ([(0, 10), (10, 14), (30, 36)], (0, 0, 0), [(0, 2), (1, 2)], 1.0),
        ([(0, 10), (15, 20)], (0, 0), [(0, 1)], 0.0),  # not yet away
        ([(0, 10), (15.1, 20)], (0, 0), [(0, 1)], 1.0),
        ([(0, 10), (20.1, 30)], (0, 5), [(0, 1)], 1.0),
        ([(0, 10), (20, 30)], (0, 5), [(0, 1)], 0.0),  # on its way from there
        ([(0, 0), (0, 0)], (0, 0), [(0, 1)], 0.0),  # it stood all the time
        ([(0, 10), (30, 36)], (0, 0), [], 0.0),
    ],
)
def test_share_of_the_path_seen_again(
    path_m: list[tuple[float, float]],
    x_m: tuple[float, ...],
    pairs: list[tuple[int, int]],
    share: float,
) -> None:
    """By length: what two visits have in common counts when the robot had left and come back."""
    visits = SomeVisits(
        path_m=np.array(path_m, dtype=np.float64), poses=np.array([(x, 0.0, 0.0) for x in x_m])
    )
    both = SimpleNamespace(visits=np.array(pairs, dtype=np.int64).reshape(-1, 2))
    assert checked_share(visits, both) == pytest.approx(share)  # type: ignore[arg-type]
