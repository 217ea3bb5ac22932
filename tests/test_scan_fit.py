# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The distribution of the scan fit at false matches."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import binom

from slarm_graph.config import KeyframeConfig, MatchingConfig
from slarm_graph.frontends.scans.local_map import LocalMap, _mark_observed
from slarm_graph.frontends.scans.scan_fit import (
    FalseMatchFit,
    LocalOptima,
    false_match_fit,
    local_optima,
    patch_count,
)
from slarm_graph.geometry import Floats, Pose2, transform_points


@pytest.mark.parametrize(("count", "agree"), [(5, 5), (6, 5), (8, 7), (12, 9), (20, 12)])
def test_few_things_are_not_held_for_more_than_they_can_tell(count: int, agree: int) -> None:
    """The oracle is the binomial tail: so many of the pieces agree by chance, or more."""
    chance = FalseMatchFit(0.3, 0.08, float(count))
    tail = math.log(binom.sf(agree - 1, count, 0.3))
    told = chance.log_density(agree / count)
    assert tail <= told + 1e-9  # Chernoff: never rarer than it is
    assert told > 1.6 * tail - 1.0  # nor all too frequent


def test_many_pieces_tell_as_the_spread_of_fits_does() -> None:
    assert FalseMatchFit(0.3, 0.1, 100.0).log_density(0.5) == pytest.approx(-0.5 * 2.0**2)


def test_what_fits_no_better_than_usual_by_chance_tells_nothing() -> None:
    assert FalseMatchFit(0.3, 0.1, 5.0).log_density(0.25) == 0.0
    assert FalseMatchFit(0.0, 0.1, 5.0).log_density(0.0) == 0.0


def wall_at(y: float) -> Floats:
    return np.column_stack([np.linspace(-1.0, 2.0, 61), np.full(61, y)])


def map_of(*walls: Floats) -> LocalMap:
    local_map = LocalMap(KeyframeConfig(), MatchingConfig())
    for wall in walls:
        local_map.add(wall, Pose2())
    return local_map


def test_a_fit_by_chance_knows_how_much_is_seen() -> None:
    wall = wall_at(2.0)
    for found in (
        false_match_fit(wall, map_of(wall), np.zeros(3), 0.9),
        local_optima(wall, map_of(wall), np.zeros(3), 0.9).false_fit_excluding(np.zeros(3)),
    ):
        assert found.count == patch_count(wall) == pytest.approx(4.0)


@pytest.mark.parametrize("seed", range(4))
def test_space_is_known_up_to_a_block_before_where_beams_end(seed: int) -> None:
    """At every block's length of a beam, by stepping along it; outside the map nothing is."""
    rng = np.random.default_rng(seed)
    points, block_m = rng.uniform(-3.0, 3.0, (20, 2)), 0.25
    here, corner = np.array([0.3, -0.2, rng.uniform(-3.0, 3.0)]), np.array([-2.0, -1.5])
    expected = np.zeros((11, 17), dtype=np.bool_)
    for end in transform_points(here, points):
        way = end - here[:2]
        for along_m in np.arange(0.0, np.hypot(*way) - block_m, block_m):
            at = here[:2] + along_m * way / np.hypot(*way) - corner
            col, row = np.floor(at / block_m).astype(int)
            if 0 <= row < 11 and 0 <= col < 17:
                expected[row, col] = True
    observed = np.zeros_like(expected)
    _mark_observed(observed, points, here, *corner, block_m)
    np.testing.assert_array_equal(observed, expected)
    assert 0 < expected.sum() < expected.size


def test_what_looks_alike_nearby_says_little_of_a_place_that_was_searched_for() -> None:
    """One of three parallel walls: a scan of any is drawn to the others, and fits there as well."""
    scan, here = wall_at(2.0), np.zeros(3)
    one, three = (map_of(scan), map_of(scan, wall_at(2.8), wall_at(1.2)))
    single, among = (
        local_optima(scan, m, here, 0.9).false_fit_excluding(here) for m in (one, three)
    )
    assert among.log_density(0.9) > 0.6 * single.log_density(0.9)
    assert among.mean > single.mean
    # At random poses it fits as little as among none.
    assert false_match_fit(scan, three, here, 0.9).mean < among.mean


def test_a_place_itself_is_no_other_place() -> None:
    poses = np.array([[0.0, 0.0, 0.0], [0.2, 0.1, 0.04], [0.4, 0.0, 0.0], [0.0, 0.0, 0.1]])
    drawn = LocalOptima(poses, np.array([0.9, 0.8, 0.3, 0.1]), np.zeros(4), 30.0)
    assert drawn.false_fit_excluding(np.zeros(3)).mean == pytest.approx(0.2)
    assert drawn.false_fit_excluding(np.array([0.0, 0.0, 2.0 * math.pi])).mean == pytest.approx(0.2)


def test_a_scan_that_is_drawn_to_one_place_only_is_judged_by_where_it_began() -> None:
    drawn = LocalOptima(np.zeros((3, 3)), np.full(3, 0.9), np.array([0.1, 0.2, 0.3]), 30.0)
    assert drawn.false_fit_excluding(np.zeros(3)).mean == pytest.approx(0.2)
