# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Dynamic objects: people around a robot that sees little else do not drag it along."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slarm_graph.config import FrontendConfig, KeyframeConfig, MatchingConfig
from slarm_graph.frontends.scans.dynamic_objects import with_dynamic_objects
from slarm_graph.frontends.scans.local_map import LocalMap
from slarm_graph.frontends.scans.odometry_filter import Prediction
from slarm_graph.frontends.scans.pose_candidates import (
    PoseCandidate,
    PosePrior,
    unmatched_candidate,
)
from slarm_graph.frontends.scans.small_objects import count_small_objects, gap_per_range, is_wide
from slarm_graph.frontends.scans.tracker import ScanTracker
from slarm_graph.geometry import Floats, Pose2
from slarm_graph.readings import LaserScan, Reading

BEAMS = np.linspace(-math.pi, math.pi, 361)
USUAL = 0.8


def scan_of(discs: Floats, walls: Floats, pose: Floats, noise_m: Floats) -> LaserScan:
    """Scan within 5.6 m of discs (D, 3) of x, y, radius and walls (W, 4), from a pose (3,) [m]."""
    bearings = pose[2] + BEAMS
    ways = np.stack([np.cos(bearings), np.sin(bearings)], axis=1)
    ranges_m = np.full(len(BEAMS), np.inf)
    for x, y, radius in discs:
        to = np.array([x, y]) - pose[:2]
        along = ways @ to
        half = radius**2 - (to @ to - along**2)
        hit = np.where((half > 0) & (along > 0), along - np.sqrt(np.maximum(half, 0)), np.inf)
        ranges_m = np.minimum(ranges_m, hit)
    for x0, y0, x1, y1 in walls:
        d, to = np.array([x1 - x0, y1 - y0]), np.array([x0, y0]) - pose[:2]
        across = ways[:, 0] * d[1] - ways[:, 1] * d[0]
        with np.errstate(divide="ignore"):
            far = (to[0] * d[1] - to[1] * d[0]) / across
            at = (to[0] * ways[:, 1] - to[1] * ways[:, 0]) / across
        ranges_m = np.minimum(ranges_m, np.where((far > 0) & (at >= 0) & (at <= 1), far, np.inf))
    ranges_m = np.where(ranges_m < 5.6, ranges_m + noise_m, np.inf)
    return LaserScan(ranges_m, -math.pi, BEAMS[1] - BEAMS[0], 0.1, 5.6)


def points_of(scan: LaserScan) -> Floats:
    seen = np.isfinite(scan.ranges_m)
    ways = np.stack([np.cos(BEAMS), np.sin(BEAMS)], axis=1)
    return np.ascontiguousarray(ways[seen] * scan.ranges_m[seen, None])


def map_of(points: Floats) -> LocalMap:
    local_map = LocalMap(KeyframeConfig(), MatchingConfig())
    local_map.add(points, Pose2(0.0, 0.0, 0.0))
    return local_map


def placed(x: float, evidence: float, inliers: int = 10) -> PoseCandidate:
    """A candidate whose posterior is two nats below its evidence."""
    at = np.array([x, 0.0, 0.0])
    return PoseCandidate(at, np.eye(3), 0.5, inliers, 5, evidence - 2.0, evidence=evidence)


PILLAR = np.array([[3.0, 0.0, 0.25]])
TWO = np.array([[3.0, 0.0, 0.25], [0.0, 3.0, 0.25]])
NOTHING = np.zeros((0, 4))
HERE, THERE = placed(-0.5, -4.0, inliers=0), placed(0.0, 3.0)


ANOTHER = 0.05 * (0.05 / 0.56) ** 2
NOBODY = (0.0, 0)


def explained(
    discs: Floats, walls: Floats = NOTHING, known: tuple[float, int] = NOBODY
) -> PoseCandidate:
    """The candidate half a metre behind where the scan fits, with what may have moved."""
    points = points_of(scan_of(discs, walls, np.zeros(3), np.zeros(361)))
    found = with_dynamic_objects([[HERE, THERE]], points, map_of(points), USUAL, [known])[0]
    assert found[0].log_posterior >= found[1].log_posterior
    return next(p for p in found if p.pose is HERE.pose)


@pytest.mark.parametrize(
    ("discs", "known", "chance"),
    [
        (PILLAR, NOBODY, 0.05),
        (TWO, NOBODY, 0.05 * ANOTHER),
        (PILLAR, (0.8, 1), 0.8),
        (TWO, (0.8, 1), 0.8 * ANOTHER),
        (TWO, (0.8, 3), 0.8),
        (PILLAR, (0.02, 1), 0.05),
    ],
)
def test_what_fits_at_another_place_may_have_walked(
    discs: Floats, known: tuple[float, int], chance: float
) -> None:
    """Each thing walks by chance, those of the last scan go on, and another must keep step."""
    place = explained(discs, known=known)
    walked = chance * math.exp(3.0)
    assert place.log_posterior == pytest.approx(math.log(math.exp(-4.0) + walked) - 2.0)
    assert place.dynamic_objects == pytest.approx((walked / (math.exp(-4.0) + walked), len(discs)))


@pytest.mark.parametrize("beams_rad", [0.003, 0.02, 0.05])
def test_a_wall_met_at_ten_degrees_has_no_gaps(beams_rad: float) -> None:
    """Where the next beam meets the line that the one along x meets in (1, 0)."""
    slope = np.array([math.cos(math.radians(10.0)), math.sin(math.radians(10.0))])
    beam = np.array([math.cos(beams_rad), math.sin(beams_rad)])
    along, _ = np.linalg.solve(np.column_stack([slope, -beam]), [-1.0, 0.0])
    wall = np.array([[1.0, 0.0], np.array([1.0, 0.0]) + along * slope])
    assert gap_per_range(7.0 * wall) == pytest.approx(along)


@pytest.mark.parametrize(("beams_rad", "count"), [(0.05, 1), (0.0555, 1), (0.0556, 0), (0.1, 0)])
def test_three_beams_have_to_meet_somebody_three_metres_away(beams_rad: float, count: int) -> None:
    """Half a metre across, that is; else there is no telling things apart."""
    bearings = beams_rad * np.arange(-1, 2)
    points = 3.0 * np.stack([np.cos(bearings), np.sin(bearings)], axis=1)
    every = np.ones(3, dtype=np.bool_)
    assert count_small_objects(points, every, every) == count


def test_walls_do_not_walk_nor_pillars_beside_them() -> None:
    wall = np.array([[4.0, -3.0, 4.0, -1.0]])
    for known in (NOBODY, (0.8, 2)):
        place = explained(PILLAR, wall, known)
        assert (place.log_posterior, place.dynamic_objects[0]) == (-6.0, 0.0)


def test_a_wall_that_fits_at_both_places_says_nothing_of_who_walks() -> None:
    along = np.array([[-30.0, 1.0, 30.0, 1.0]])
    assert explained(PILLAR, along).dynamic_objects[0] == pytest.approx(0.98, abs=0.01)


def test_candidates_of_other_hypotheses_are_looked_at_too() -> None:
    points = points_of(scan_of(PILLAR, NOTHING, np.zeros(3), np.zeros(361)))
    known = points, map_of(points), USUAL, [(0.8, 1), NOBODY]
    mine, theirs = with_dynamic_objects([[HERE], [THERE]], *known)
    assert mine[0].dynamic_objects[0] > 0.99
    assert theirs[0].dynamic_objects[0] == 0.0


def test_where_the_robot_may_be_anywhere_nobody_has_to_walk() -> None:
    points = points_of(scan_of(PILLAR, NOTHING, np.zeros(3), np.zeros(361)))
    told = []
    for sigma in (0.05, 0.2):
        prediction = Prediction(HERE.pose, np.diag([sigma, 0.05, 0.05]) ** 2)
        hidden = unmatched_candidate(prediction, PosePrior(np.zeros(3), (prediction,), np.ones(3)))
        assert hidden.log_posterior == pytest.approx(math.log(0.01))
        found = with_dynamic_objects([[hidden, THERE]], points, map_of(points), USUAL, [(0.8, 1)])[
            0
        ]
        told.append(next(p for p in found if p.pose is hidden.pose).dynamic_objects[0])
    assert told == [pytest.approx(1.0, abs=0.01), 0.0]


def test_things_are_counted_by_their_width() -> None:
    bearings = np.radians(np.arange(0.0, 40.0))
    ring = 3.0 * np.stack([np.cos(bearings), np.sin(bearings)], axis=1)
    chosen, sure = np.zeros((2, 40), dtype=bool)
    sure[:] = True
    assert count_small_objects(ring, chosen, sure) == 0
    chosen[[0, 5, 14]] = True
    assert count_small_objects(ring, chosen, sure) == 2  # the last one is 0.47 m from its neighbour
    chosen[:15] = True  # 0.73 m across
    assert count_small_objects(ring, chosen, sure) == 1
    chosen[25:] = True  # 0.73 m as well
    assert count_small_objects(ring, chosen, sure) == 2
    sure[26:] = False
    assert count_small_objects(ring, chosen, sure) == 2
    sure[25] = False
    assert count_small_objects(ring, chosen, sure) == 1
    chosen[:17] = True  # 0.83 m across
    assert count_small_objects(ring, chosen, sure) == 0
    sure[:17] = False
    assert count_small_objects(ring, chosen, sure) == 0
    sure[39] = True
    assert count_small_objects(ring, chosen, sure) == 1


def test_wide_is_what_hangs_together() -> None:
    bearings = np.radians([*range(15), *range(30, 47)])
    ring = 3.0 * np.stack([np.cos(bearings), np.sin(bearings)], axis=1)
    assert is_wide(ring).tolist() == [False] * 15 + [True] * 17


def test_beams_too_far_apart_tell_nothing_of_things() -> None:
    bearings = np.radians(np.arange(0.0, 360.0, 12.0))
    ring = np.stack([np.cos(bearings), np.sin(bearings)], axis=1)
    every = np.ones(30, dtype=bool)
    assert count_small_objects(ring, every, every) == 0


@pytest.mark.parametrize("way_m", [0.16, 0.2])
def test_who_overtakes_drags_no_robot_along(way_m: float) -> None:
    """A robot that sees a pillar or two is overtaken by somebody, in twelve draws of the noise."""
    runs = [overtaken(way_m, seed) for seed in range(12)]
    off_m, ambiguous = np.array(runs).T
    # 0.9 to 2.2 m where whoever comes joins the map and the scan.
    assert np.median(off_m) < 0.2
    assert np.mean(off_m < 0.3) > 0.8
    assert off_m.max() < 0.7
    assert (ambiguous < 30).all()


def overtaken(way_m: float, seed: int) -> tuple[float, int]:
    """Most that the robot was off by [m], and its ambiguous scans."""
    rng = np.random.default_rng(seed)
    pillars = np.array([[x, 2.5, 0.3] for x in np.arange(-4.0, 40.0, 6.0)])
    tracker, truth, off_m, ambiguous = ScanTracker(FrontendConfig()), np.zeros(3), 0.0, 0
    for k in range(100):
        somebody = [-7.0 + way_m * k, -1.2, 0.25]
        noise_m = rng.normal(0.0, 0.03, len(BEAMS))
        scan = scan_of(np.vstack([pillars, somebody]), NOTHING, truth.copy(), noise_m)
        odometry = Pose2(truth[0] * 1.002, 0.0, 0.0)
        tracked = tracker.track(Reading((k + 1) * 200_000_000, scan, odometry))
        off_m = max(off_m, math.hypot(*(tracked.local_from_robot.as_array() - truth)[:2]))
        ambiguous += tracked.is_ambiguous
        truth += [0.06, 0.0, 0.0]
    return off_m, ambiguous


def test_a_log_may_begin_at_zero() -> None:
    walls = np.array([[-2.0, -2.0, -2.0, 4.0], [-2.0, 4.0, 5.0, 4.0], [5.0, 4.0, 5.0, -2.0]])
    tracked = []
    for first_ns in (0, 1):
        tracker = ScanTracker(FrontendConfig())
        for k in range(3):
            noise_m = np.random.default_rng(k).normal(0.0, 0.01, len(BEAMS))
            scan = scan_of(PILLAR, walls, np.array([0.1 * k, 0.0, 0.0]), noise_m)
            last = tracker.track(Reading(first_ns + k * 200_000_000, scan, None))
        tracked.append(last)
    np.testing.assert_allclose(tracked[0].local_covariance, tracked[1].local_covariance, rtol=1e-6)
    assert tracked[0].local_from_robot.as_array() == pytest.approx(
        tracked[1].local_from_robot.as_array(), abs=1e-7
    )
