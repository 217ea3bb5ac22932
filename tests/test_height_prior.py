# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Heights nobody has said: a prior per class of plan, and what links make of it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scanned_rooms import WORLD, scanned_room

from slarm_graph.access_points import AccessPoint
from slarm_graph.app.explore import with_prior
from slarm_graph.app.world_accuracy import sizes_metrics
from slarm_graph.config import ExploreConfig, MappingConfig, RadioConfig, RecoveryConfig, RunConfig
from slarm_graph.files.world_shapes import rectangle_m
from slarm_graph.geographic import CellState, Coverage, GeographicMap, HeightGroup
from slarm_graph.grid import GridGeometry
from slarm_graph.radio.files import read_radio_npz, write_radio_npz
from slarm_graph.radio.netcdf import read_radio_netcdf, write_radio_netcdf
from slarm_graph.radio.path_loss import path_loss_db
from slarm_graph.radio.radio_map import expected_path_loss_db, radio_map
from slarm_graph.recovery.fine_map import fine_map
from slarm_graph.recovery.height_prior import LEVELS, HeightPrior, height_group, plan_kind
from slarm_graph.recovery.heights import (
    certain_height_m,
    height_source,
    side_obstacles,
    with_medians,
)
from slarm_graph.recovery.obstacles import WallStrip
from slarm_graph.recovery.recover import recover_scans, with_sizes_of
from slarm_graph.recovery.returns import NO_RETURNS
from slarm_graph.recovery.walls import Outline
from slarm_graph.world import Solid

CONFIG = RadioConfig()
GEOMETRY = GridGeometry(0.0, 0.0, 0.1, 40, 60)
AP = AccessPoint("ap", 0.55, 2.05, 2.5)


def box(x_m, y_m, height_m=np.inf):
    corners = np.array([[x_m, y_m], [x_m + 0.5, y_m], [x_m + 0.5, y_m + 1.0], [x_m, y_m + 1.0]])
    return Solid("box", corners, height_m)


def room(solids, groups=()):
    x, y = np.moveaxis(GEOMETRY.centers(), -1, 0)
    inside = np.zeros(GEOMETRY.shape, dtype=bool)
    for solid in solids:
        (left, low), (right, high) = solid.corners_m.min(axis=0), solid.corners_m.max(axis=0)
        inside |= (x > left) & (x < right) & (y > low) & (y < high)
    states = np.where(inside, CellState.OBSTACLE, CellState.ACCESSIBLE).astype(np.uint8)
    heights = np.where(inside, np.inf, 0.0).astype(np.float32)
    layers = Coverage(~inside, ~inside, ~inside)
    return GeographicMap(
        GEOMETRY, states, heights, "prior", layers, solids=tuple(solids), height_groups=groups
    )


def test_expected_loss_is_that_of_the_expected_gain():
    d, p = np.array([2.0, 5.0, 9.0, 9.0]), np.array([0.25, 0.5, 0.0, 1.0])
    clear, blocked = (10 ** (-0.1 * path_loss_db(d, 3.5e9, los, "InF-SH")) for los in (True, False))
    want = -10.0 * np.log10(p * clear + (1 - p) * blocked)
    np.testing.assert_allclose(expected_path_loss_db(d, 3.5e9, p, "InF-SH"), want, rtol=1e-12)
    # Exactly the certain losses at both ends.
    certain = path_loss_db(d[2:], 3.5e9, np.array([False, True]), "InF-SH")
    assert (expected_path_loss_db(d[2:], 3.5e9, p[2:], "InF-SH") == certain).all()


def test_probability_is_the_share_of_drawn_heights_that_leave_the_link_clear():
    """Two obstacles drawn independently, all combinations counted one by one."""
    rng = np.random.default_rng(3)
    solids = [box(2.0, 1.5), box(4.0, 1.2)]
    levels = [np.sort(rng.uniform(0.2, 3.0, (5, 1)), axis=0) for _ in solids]
    groups = tuple(HeightGroup((n,), level) for n, level in enumerate(levels))
    found = radio_map(room(solids, groups), [AP], CONFIG)
    share = np.zeros(GEOMETRY.shape)
    for first in levels[0][:, 0]:
        for second in levels[1][:, 0]:
            drawn = [replace(solids[0], height_m=first), replace(solids[1], height_m=second)]
            share += radio_map(room(drawn), [AP], CONFIG).line_of_sight[0] / 25.0
    free = np.isfinite(found.path_loss_db[0])
    np.testing.assert_allclose(found.sight_probability[0][free], share[free], atol=1e-6)
    assert 0.1 < np.mean((share > 0) & (share < 1)) < 0.9
    assert (found.line_of_sight[0][free] == (share[free] > 0.5 + 1e-9)).all()


def test_sides_of_one_obstacle_are_low_or_high_together():
    """Behind both of two walls of one outline the lower probability counts, not the product."""
    solids = [box(2.0, 1.5), box(2.6, 1.5)]
    level = np.array([[0.3], [2.6]])
    together = (HeightGroup((0, 1), np.repeat(level, 2, axis=1)),)
    apart = tuple(HeightGroup((n,), level) for n in range(2))
    row, col = GEOMETRY.cell_of([3.4, 2.05])
    p = [
        radio_map(room(solids, g), [AP], CONFIG).sight_probability[0, row, col]
        for g in (together, apart)
    ]
    assert p == [0.5, 0.25]


@pytest.mark.parametrize("kind", ["wall", "screen", "column", "rack", "furniture"])
def test_heights_stay_between_laser_and_ceiling(kind):
    prior = HeightPrior(ceiling_m=2.5, laser_height_m=0.3)
    levels = prior.levels_m(kind)
    assert levels.shape == (LEVELS,)
    assert (np.diff(levels) >= 0).all()
    assert levels[0] >= 0.3
    assert levels[-1] <= 2.5
    # A laser that looks from high up has seen that the obstacle is no lower.
    assert HeightPrior(2.5, 1.9).levels_m(kind).min() >= 1.9


def test_furniture_is_as_often_a_surface_as_higher():
    levels = HeightPrior(3.0, 0.2).levels_m("furniture")
    assert np.mean(levels < 1.1) == 0.5
    assert np.mean(levels > 2.1) == 0.1
    assert np.mean(levels < 0.7) == 0.1
    assert HeightPrior(3.0, 0.2).levels_m("wall").tolist() == [3.0] * LEVELS


@pytest.mark.parametrize(
    ("kind", "highest_m", "shares"),
    [
        # Bounds of EN and DIN, and how many of the heights are at or below each.
        ("furniture", (0.70, 1.10, 2.10, 3.0), (0.1, 0.5, 0.9, 1.0)),
        ("column", (0.70, 1.10, 2.10, 2.9, 3.0), (0.05, 0.25, 0.45, 0.45, 1.0)),
        ("rack", (0.70, 2.10, 3.0), (0.0, 0.1, 1.0)),
        ("screen", (1.2, 1.8, 2.9, 3.0), (0.0, 0.5, 0.5, 1.0)),
        ("wall", (2.9, 3.0), (0.0, 1.0)),
    ],
)
def test_heights_are_spread_as_the_standards_have_them(kind, highest_m, shares):
    """Ten equally likely heights tell every share to a tenth, and are even between two bounds."""
    levels = HeightPrior(3.0, 0.2).levels_m(kind)
    for bound_m, share in zip(highest_m, shares, strict=True):
        assert np.mean(levels <= bound_m) == pytest.approx(share, abs=0.051)
    inside = levels[(levels > highest_m[0]) & (levels < highest_m[1])]
    if len(inside) > 2:
        np.testing.assert_allclose(np.diff(inside, 2), 0.0, atol=1e-12)


def test_a_group_has_a_column_for_each_solid():
    prior = HeightPrior(3.0, 0.2)
    group = height_group(prior, [4, 7], ["furniture", "wall"])
    assert group.solids == (4, 7)
    expected = np.column_stack([prior.levels_m("furniture"), prior.levels_m("wall")])
    np.testing.assert_array_equal(group.levels_m, expected)


@pytest.mark.parametrize(
    ("sides", "area", "at_wall", "kind"),
    [
        ((0.12, 4.0), 0.48, True, "wall"),
        ((0.12, 4.0), 0.48, False, "screen"),
        ((7.0, 3.5), 24.5, False, "wall"),
        ((0.4, 0.4), 0.16, False, "column"),
        ((1.1, 9.0), 9.9, False, "rack"),
        ((0.8, 1.6), 1.28, True, "furniture"),
        ((1.6, 0.8), 1.28, False, "furniture"),
        ((0.585, 0.585), 0.269, False, "furniture"),
        ((2.0, 3.0), 1.2, False, "wall"),
        # Just at a bound, and beyond it.
        ((0.5, 0.5), 0.25, False, "column"),
        ((0.5, 0.51), 0.255, False, "furniture"),
        ((0.34, 0.5), 0.17, False, "column"),
        ((0.34, 0.51), 0.1734, False, "screen"),
        ((0.35, 0.51), 0.1785, False, "furniture"),
        ((2.8, 4.0), 11.2, False, "furniture"),
        ((2.81, 4.0), 11.24, False, "wall"),
        ((2.8, 4.01), 11.228, False, "rack"),
        ((1.0, 1.0), 0.7, False, "furniture"),
        ((1.0, 1.0), 0.69, False, "wall"),
    ],
)
def test_plans_tell_classes(sides, area, at_wall, kind):
    assert plan_kind(np.array(sides), area, at_wall=at_wall) == kind


def test_only_what_has_no_known_size_is_uncertain():
    scans, trajectory = scanned_room(0.01, 0.0)
    geometry = GridGeometry.covering(*WORLD.extent_m(), 0.1)

    def recovered(**changes):
        config = RecoveryConfig(**changes)
        return recover_scans(scans, trajectory, MappingConfig(), config, geometry=geometry)

    prior = recovered()
    assert "prior" in prior.height_source
    assert {n for g in prior.height_groups for n in g.solids} == set(range(len(prior.solids)))
    north_west = [
        solid.height_m
        for solid in prior.solids
        if np.abs(solid.corners_m.mean(axis=0) - [-2.31, 2.5]).max() < 0.1
    ]
    assert north_west
    assert all(0.7 < height_m < 2.1 for height_m in north_west)
    radio = radio_map(prior, WORLD.access_points, CONFIG)
    assert radio.los_probability is not None
    for certain in (
        recovered(unknown_heights="infinite"),
        recovered(default_height_m=1.8),
        recovered(known_sizes=with_sizes_of(WORLD, RecoveryConfig()).known_sizes),
    ):
        assert not certain.height_groups
        assert radio_map(certain, WORLD.access_points, CONFIG).los_probability is None


def test_what_is_handed_over_is_what_is_used():
    """By `explore.prior`; sizes that are given stay as they are."""
    only_extent = RunConfig(explore=ExploreConfig(prior="extent"))
    told = with_prior(WORLD, only_extent).recovery
    assert (told.known_sizes, told.ceiling_m, told.laser_height_m) == ((), 3.0, 0.2)
    assert len(with_prior(WORLD, RunConfig()).recovery.known_sizes) >= 2
    given = RunConfig(recovery=RecoveryConfig(known_sizes=((1.0, 1.0, 1.0),)))
    assert with_prior(WORLD, given).recovery.known_sizes == ((1.0, 1.0, 1.0, 1.0),)


def test_one_drive_is_judged_with_and_without_sizes():
    scans, trajectory = scanned_room(0.01, 0.0)
    config = RunConfig(explore=ExploreConfig(resolution_m=0.1))
    drawn = fine_map(scans, trajectory, config.mapping, 0.1)
    known, unknown = sizes_metrics(WORLD, drawn, trajectory, with_prior(WORLD, config))
    assert (known.name, unknown.name) == ("accuracy_with_sizes", "accuracy_without_sizes")
    assert 0.8 < unknown.value < known.value
    assert known.value > 0.985


@pytest.mark.parametrize(
    ("write", "read"),
    [(write_radio_npz, read_radio_npz), (write_radio_netcdf, read_radio_netcdf)],
)
def test_files_keep_probability_unknown_links_and_radius(write, read, tmp_path):
    groups = (HeightGroup((0,), np.array([[0.3], [1.4], [2.6]])),)
    radio = radio_map(room([box(2.0, 1.5)], groups), [AP], CONFIG)
    unknown = np.zeros_like(radio.line_of_sight)
    unknown[0, 3:5, 7:9] = True
    radio = replace(
        radio,
        los_unknown=unknown,
        line_of_sight=radio.line_of_sight & ~unknown,
        expansion_radius_m=0.3,
    )
    write(tmp_path / "map", radio)
    back = read(tmp_path / "map")
    np.testing.assert_array_equal(back.sight_probability, radio.sight_probability)
    np.testing.assert_array_equal(back.sight_unknown, unknown)
    np.testing.assert_array_equal(back.line_of_sight, radio.line_of_sight)
    assert math.isclose(back.expansion_radius_m, 0.3)


def test_sides_of_an_outline_are_of_obstacles_before_walls_or_of_the_wall() -> None:
    """A cupboard and a row of shelves at walls, and three islands, in the outlines' order."""
    room = np.array([[0, 0], [1, 0], [1, 0.7], [2.2, 0.7], [2.2, 0], [12, 0], [12, 1], [11, 1],
                     [11, 6], [12, 6], [12, 9], [0, 9]], dtype=np.float64)  # fmt: skip
    column, desk = rectangle_m((5.0, 4.0), (0.4, 0.4)), rectangle_m((8.0, 4.0), (1.6, 0.8))
    screen = rectangle_m((5.0, 7.0), (1.6, 0.1))
    outlines = [Outline(ring, np.ones(len(ring), dtype=np.bool_))
                for ring in (column[::-1], room, desk[::-1], screen[::-1])]  # fmt: skip
    small, whole, large, thin = side_obstacles(outlines, NO_RETURNS)
    assert small == [(0, "column")] * 4
    assert large == [(0, "furniture")] * 4
    assert thin == [(0, "screen")] * 4
    assert whole == [
        (0, "wall"), *[(2, "furniture")] * 3, *[(0, "wall")] * 2, *[(7, "rack")] * 3,
        *[(0, "wall")] * 3,
    ]  # fmt: skip


def test_the_source_of_heights_is_told() -> None:
    solids = [Solid("a", rectangle_m((0.0, 0.0), (1.0, 1.0)), 1.0)] * 2
    prior, infinite = RecoveryConfig(), RecoveryConfig(unknown_heights="infinite")
    sizes, given = (
        RecoveryConfig(known_sizes=((1.0, 1.0, 1.0),)),
        RecoveryConfig(default_height_m=2.5),
    )
    assert certain_height_m(prior) is None
    assert [certain_height_m(one) for one in (infinite, sizes, given)] == [math.inf, math.inf, 2.5]
    told = "prior (standards, by class of plan)"
    assert height_source([], solids, prior) == told
    assert height_source(solids, solids, prior) == f"matched sizes (2 obstacles), else {told}"
    assert height_source([], [], prior) == "infinite"
    assert height_source([], solids, infinite) == "infinite"
    assert height_source(solids[:1], solids, sizes) == "matched sizes (1 obstacle), else infinite"
    assert height_source([], solids, given) == "default"


def test_a_strip_of_unknown_height_has_the_median_of_its_group() -> None:
    strips = [WallStrip(Solid(f"wall {k}", rectangle_m((k, 0.0), (1.0, 0.1)), math.inf), 0, k)
              for k in range(4)]  # fmt: skip
    groups = (HeightGroup((7, 5), np.array([[1.0, 4.0], [2.0, 6.0], [9.0, 7.0]])),
              HeightGroup((6,), np.array([[0.5], [0.7], [3.0]])))  # fmt: skip
    found = with_medians(strips, groups, 5)
    assert [strip.solid.height_m for strip in found] == [6.0, 0.7, 2.0, math.inf]
    assert [(s.solid.name, s.side) for s in found] == [(s.solid.name, s.side) for s in strips]
    assert with_medians(strips, (), 5) == strips
