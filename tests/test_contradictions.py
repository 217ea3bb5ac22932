# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""What the check of a trajectory says: verdicts, places and steps, against numbers by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from test_consistency import HALL, around, moved_from, scan_at, stamped

from slarm_graph.consistency import build_visits, verdict
from slarm_graph.consistency.conflict_places import ConflictPlace, conflict_places
from slarm_graph.consistency.pairs import MIN_CELLS, VisitPairs, _overlapping, cross_check
from slarm_graph.consistency.tears import Tear, _calibrated, _differences, _nodes
from slarm_graph.consistency.verdict import Contradictions, _expected, _with_verdict, contradictions
from slarm_graph.consistency.visits import Visits, _first_scans, path_lengths_m
from slarm_graph.geometry import Floats, compose, transform_points
from slarm_graph.readings import LaserScan

WORST_PLACE = ConflictPlace((1, 2), (3, 4), (1.26, -2.0), 0.5, 9.0, 70, 50, 3)


@pytest.fixture(scope="module")
def hall_twice() -> tuple[list[LaserScan], Floats]:
    poses = around()
    return [scan_at(pose, HALL) for pose in poses], poses


def tear_of(evidence_nat: float) -> Tear:
    return Tear((0, 1), (0.0, 0.0), (0.5, 0.0, 0.0), evidence_nat)


@pytest.mark.parametrize(
    ("places", "excess", "tears_nat", "checked", "expected"),
    [
        (0, 0.0, (), 0.26, "consistent"),
        (0, 0.5, (), 1.0, "consistent"),
        (0, 0.0, (), 0.24, "doubtful"),
        (1, 0.029, (), 1.0, "doubtful"),
        (1, 0.031, (), 1.0, "inconsistent"),
        (0, 0.0, (3.5, 5.9), 1.0, "doubtful"),
        (0, 0.0, (3.5, 6.1), 1.0, "inconsistent"),
    ],
)
def test_a_verdict_is_that_of_the_worst_finding(
    places: int, excess: float, tears_nat: tuple[float, ...], checked: float, expected: str
) -> None:
    found = _with_verdict(
        Contradictions(0.01 + excess, 0.01, 0.001, checked, 900, (WORST_PLACE,) * places,
                       tuple(map(tear_of, tears_nat)), np.zeros((0, 2)))
    )  # fmt: skip
    assert found.verdict == expected
    assert len(found.reasons) == (places > 0) + (len(tears_nat) > 0) + (checked < 0.25)
    assert found.notices() == (
        () if expected == "consistent" else (f"the trajectory is {found.summary()}",)
    )


def test_a_verdict_names_its_reasons() -> None:
    found = _with_verdict(
        Contradictions(
            0.123,
            0.011,
            0.001,
            0.2,
            900,
            (WORST_PLACE, WORST_PLACE),
            (tear_of(4.0),),
            np.zeros((0, 2)),
        )
    )
    assert found.summary() == (
        "inconsistent (12.3% of shared wall cells in conflict, 1.1% expected; 20% of the way"
        " cross-checked); visits contradict each other at 2 place(s), most at (1.3, -2.0) m: 50 of"
        " 120 wall cells looked through; scans and odometry contradict 1 step(s); only 20% of the"
        " way was seen again, the rest is not judged"
    )
    nothing = Contradictions(math.nan, math.nan, math.nan, 0.3, 0, (), (), np.zeros((0, 2)))
    assert nothing.summary() == (
        "consistent (nothing was seen twice; 30% of the way cross-checked)"
    )


def test_steps_with_little_evidence_are_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    tears = tuple(map(tear_of, (2.9, 3.1, 7.0)))
    monkeypatch.setattr(verdict, "find_tears", lambda *_: tears)
    nowhere = stamped(np.zeros((0, 3)))
    assert contradictions([], nowhere, np.zeros((0, 3))).tears == tears[1:]
    assert contradictions([], nowhere).tears == ()
    with pytest.raises(ValueError, match="0 scans for 2 poses"):
        contradictions([], stamped(np.zeros((2, 3))))


def pairs_of(visits: list[tuple[int, int]], confirmed: list[int], wrong: list[int]) -> VisitPairs:
    return VisitPairs(
        np.array(visits, dtype=np.int64).reshape(-1, 2), np.array(confirmed), np.array(wrong)
    )


def test_the_expected_share_is_that_of_pairs_at_right_poses() -> None:
    """Two with 2 of 100 and 3 of 300, off by 3/4 from the common share; a third is misplaced."""
    pairs = pairs_of([(0, 2), (1, 3), (1, 4)], [98, 297, 10], [2, 3, 90])
    assert _expected(pairs) == pytest.approx((5 / 400, math.sqrt(2 * 0.75**2) / 400))
    assert pairs.conflict_share() == 95 / 500
    share, sigma = _expected(pairs_of([(1, 4)], [10], [90]))
    assert share == 0.03
    assert math.isnan(sigma)
    nothing = pairs_of([], [], [])
    assert np.isnan([*_expected(nothing), nothing.conflict_share()]).all()


def test_pairs_in_conflict_are_put_together_by_place() -> None:
    """Visits with a few walls each, in a square that all of them saw free about them."""
    rng = np.random.default_rng(2)
    count, walls = 20, 5
    places = np.tile(np.repeat([[3.0, -4.0], [20.0, 7.0]], 5, axis=0), (2, 1))
    visits = Visits(
        poses=np.column_stack([places, rng.uniform(-3.0, 3.0, count)]),
        scans=np.column_stack([np.arange(count) * 10, np.arange(count) * 10 + 9]),
        path_m=np.zeros((count, 2)),
        walls=rng.uniform(-0.7, 0.7, (count * walls, 2)),
        wall_start=np.arange(count + 1) * walls,
        states=np.ones(count * 400, dtype=np.uint8),
        state_start=np.arange(count + 1) * 400,
        lows=np.full((count, 2), -1.0),
        shapes=np.full((count, 2), 20),
    )
    # Two visits apart is one place, three are two; a pair in between has no conflict.
    pairs = pairs_of([(0, 12), (2, 14), (3, 15), (5, 17), (6, 19)], [90, 10, 100, 20, 20],
                     [60, 70, 0, 80, 75])  # fmt: skip
    stamps_ns = np.arange(count * 10) * 7
    found, points_m = conflict_places(visits, pairs, stamps_ns, 5.0)
    evidence = pairs.evidence()
    assert [(p.pairs, p.confirmed, p.contradicted) for p in found] == [(2, 20, 80), (2, 10, 70)]
    assert [p.evidence_nat for p in found] == pytest.approx([evidence[3], evidence[1]])
    assert [(p.earlier_ns, p.later_ns) for p in found] == [
        ((50 * 7, 69 * 7), (170 * 7, 199 * 7)), ((0, 29 * 7), (120 * 7, 149 * 7))
    ]  # fmt: skip
    own = np.concatenate([
        transform_points(visits.poses[k], visits.walls[k * walls : (k + 1) * walls])
        for k in (5, 17, 2, 14)
    ])  # fmt: skip
    np.testing.assert_allclose(points_m, own)
    for place, points in zip(found, np.split(own, 2), strict=True):
        middle = np.sort(points, axis=0)[4:6].mean(axis=0)
        assert place.position_m == pytest.approx(tuple(middle))
        apart_m = np.sort(np.hypot(*(points - middle).T))
        assert place.extent_m == pytest.approx(0.9 * apart_m[8] + 0.1 * apart_m[9])
    assert conflict_places(visits, pairs, stamps_ns, 99.0)[0] == ()
    assert conflict_places(visits, pairs, stamps_ns, 99.0)[1].shape == (0, 2)


def walker_ahead(poses: Floats, silence: float) -> list[LaserScan]:
    """Scans in the hall, 2.6 m deep, behind somebody who walks 1.4 m ahead on the first lap."""
    half, scans = len(poses) // 2, []
    box = np.array([(-1, -1, 1, -1), (1, -1, 1, 1), (1, 1, -1, 1), (-1, 1, -1, -1)]) * 0.25
    for k, pose in enumerate(poses):
        body = [tuple(side + np.tile(poses[k + 7, :2], 2)) for side in box] if k < half else []
        scan = scan_at(pose, [*HALL, *body])
        ranges = np.where(scan.ranges_m < 2.6, scan.ranges_m, silence)
        scans.append(replace(scan, ranges_m=ranges))
    return scans


def test_who_walks_where_beams_meet_nothing_leaves_no_wall() -> None:
    """What crosses his trail has no return; where it could not tell, the trail is a wall."""
    poses = around()
    result = contradictions(walker_ahead(poses, np.inf), stamped(poses))
    assert result.verdict == "consistent"
    assert result.share < 0.02
    assert result.compared > 2500
    deaf = contradictions(walker_ahead(poses, np.nan), stamped(poses))
    assert deaf.share > 2.0 * result.share
    shifted = moved_from(poses, len(poses) // 2, (0.0, -0.7, 0.0))
    assert contradictions(walker_ahead(poses, np.inf), stamped(shifted)).verdict == "inconsistent"


@pytest.mark.parametrize("seed", range(3))
def test_visits_are_compared_where_circles_about_their_cells_meet(seed: int) -> None:
    rng = np.random.default_rng(seed)
    poses = rng.uniform(-20.0, 20.0, (30, 3))
    lows, shapes = rng.uniform(-8.0, 1.0, (30, 2)), rng.integers(5, 90, (30, 2))
    middles = [
        transform_points(pose, (low + 0.05 * shape[::-1])[None])[0]
        for pose, low, shape in zip(poses, lows, shapes, strict=True)
    ]
    radii_m = [0.05 * math.hypot(*shape) for shape in shapes]
    expected = [
        [a, b] for a in range(30) for b in range(a + 1, 30)
        if math.dist(middles[a], middles[b]) < radii_m[a] + radii_m[b]
    ]  # fmt: skip
    assert 20 < len(expected) < 400
    assert _overlapping(poses, lows, shapes).tolist() == expected


def test_pairs_share_three_metres_of_wall(hall_twice: tuple[list[LaserScan], Floats]) -> None:
    visits = build_visits(*hall_twice)
    every = cross_check(visits, least_cells=0)
    shared = every.confirmed + every.contradicted
    assert MIN_CELLS == 30
    assert cross_check(visits).visits.tolist() == every.visits[shared >= 30].tolist()
    least = int(np.median(shared))
    some = cross_check(visits, least_cells=least)
    assert some.visits.tolist() == every.visits[shared >= least].tolist()
    result = contradictions(hall_twice[0], stamped(hall_twice[1]), visits=visits)
    assert result.compared == shared[shared >= 30].sum()


def test_visits_are_metres_long_and_their_walls_lie_on_those_of_the_hall(
    hall_twice: tuple[list[LaserScan], Floats],
) -> None:
    """Each in the frame of its middle scan."""
    scans, poses = hall_twice
    visits = build_visits(scans, poses)
    along_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(poses[:, :2], axis=0).T))])
    np.testing.assert_allclose(path_lengths_m(poses), along_m)
    np.testing.assert_allclose(visits.path_m, along_m[visits.scans])
    np.testing.assert_array_equal(visits.poses, poses[visits.scans.sum(axis=1) // 2])
    np.testing.assert_array_equal(visits.at(poses).poses, visits.poses)
    lengths_m = along_m[visits.scans[1:, 0]] - along_m[visits.scans[:-1, 0]]
    assert (lengths_m >= 5.0).all()
    assert (lengths_m < 5.5).all()
    ends = np.array(HALL, dtype=np.float64)
    for k in range(len(visits)):
        walls = visits.walls[visits.wall_start[k] : visits.wall_start[k + 1]]
        at = transform_points(visits.poses[k], walls)[:, None]
        along = ends[:, 2:] - ends[:, :2]
        share = np.clip(((at - ends[:, :2]) * along).sum(-1) / (along**2).sum(-1), 0.0, 1.0)
        off_m = np.linalg.norm(ends[:, :2] + share[..., None] * along - at, axis=-1).min(axis=1)
        assert off_m.max() < 0.08, "half of a cell's diagonal"


def test_a_visit_has_eight_scans_where_they_are_metres_apart() -> None:
    assert _first_scans(np.arange(20) * 3.0, 5.0) == [0, 8, 16, 20]
    assert _first_scans(np.arange(20) * 0.5, 5.0) == [0, 10, 20]
    assert _first_scans(np.zeros(0), 5.0) == [0]
    assert path_lengths_m(np.zeros((0, 3))).tolist() == []
    assert path_lengths_m(np.ones((1, 3))).tolist() == [0.0]


def test_steps_begin_where_the_trajectory_or_odometry_had_moved() -> None:
    """By 0.5 m from the last, at scans with odometry."""
    ahead = np.arange(13)[:, None] * np.eye(3)[0]
    known = np.delete(np.arange(13), 4)
    assert _nodes(0.26 * ahead, 0.17 * ahead, known).tolist() == [0, 2, 3, 5, 6, 7, 9, 11, 12]
    turning = np.arange(13)[:, None] * np.eye(3)[2]
    assert _nodes(0.26 * turning, 0.0 * turning, known).tolist() == [0, 2, 5, 7, 9, 11]


def test_odometry_is_calibrated_but_for_what_jumps() -> None:
    rng = np.random.default_rng(7)
    measured = np.column_stack([rng.uniform(0.3, 0.7, 60), rng.uniform(-0.1, 0.1, 60),
                                rng.uniform(-0.5, 0.5, 60)])  # fmt: skip
    moved = measured * [1.1, 1.1, 0.95]
    moved[:, 2] += 0.04 * np.hypot(measured[:, 0], measured[:, 1])
    np.testing.assert_allclose(_calibrated(moved, measured), moved, atol=1e-9)
    jumped = moved + np.where(np.arange(60) % 20 == 0, 1.0, 0.0)[:, None] * [0.5, 0.5, 1.0]
    np.testing.assert_allclose(_calibrated(jumped, measured)[:, :2], moved[:, :2], atol=1e-9)
    np.testing.assert_allclose(_calibrated(jumped, measured)[:, 2], moved[:, 2], atol=0.01)
    for factor, used in ((3.0, 2.0), (0.3, 0.5)):
        found = _calibrated(measured * [factor, factor, 1.0], measured)
        np.testing.assert_allclose(found[:, :2], used * measured[:, :2])
    few = np.where(np.arange(60) < 7, 1.0, 0.1)[:, None] * measured[:, :2].clip(0.26)
    few = np.column_stack([few, measured[:, 2]])
    np.testing.assert_allclose(_calibrated(few * [1.5, 1.5, 1.0], few)[:, :2], few[:, :2])


@pytest.mark.parametrize(
    ("steps", "jump", "jumps", "found"),
    [
        (40, (0.0, 0.31, 0.0), 2, 2),
        (40, (0.0, 0.29, 0.0), 2, 0),
        (40, (0.0, 0.0, 0.15), 2, 2),
        (40, (0.0, 0.0, -0.15), 2, 2),
        (40, (0.0, 0.0, 0.13), 2, 0),
        (40, (0.0, 0.5, 0.0), 3, 0),  # more than a twentieth
        (10, (0.0, 0.5, 0.0), 2, 2),  # though few
        (8, (0.0, 0.5, 0.0), 1, 1),
        (7, (0.0, 0.5, 0.0), 1, 0),
    ],
)
def test_a_step_off_odometry_is_told_where_others_agree(
    steps: int, jump: tuple[float, float, float], jumps: int, found: int
) -> None:
    odometry = np.column_stack([np.arange(steps + 1.0), np.zeros((steps + 1, 2))])
    poses = [np.zeros(3)]
    for k in range(steps):
        off = np.array(jump) * (k % 3 == 1 and k < 3 * jumps)
        poses.append(compose(poses[-1], compose(np.array([1.0, 0.0, 0.0]), off)))
    told = _differences(np.array(poses), odometry, np.arange(steps + 1), 1)
    assert [(a, b) for _, a, b, _ in told] == [(3 * k + 1, 3 * k + 2) for k in range(found)]
    for size, _, _, off in told:
        np.testing.assert_allclose(off, jump, atol=0.004)
        least = max(math.hypot(*jump[:2]) / 0.01, abs(jump[2]) / 0.005)
        assert size == pytest.approx(least, rel=0.05)
