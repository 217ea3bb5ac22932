# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Heights by what is heard behind obstacles: against enumeration, dense algebra and known rooms."""

from __future__ import annotations

import csv
import itertools
from dataclasses import replace

import numpy as np
import pytest
from scanned_rooms import WORLD, scanned_room
from scipy import stats

from slarm_graph.access_points import AccessPoint
from slarm_graph.config import MappingConfig, MeasuredConfig, RadioConfig, RecoveryConfig
from slarm_graph.geographic import CellState, Coverage, GeographicMap, HeightGroup
from slarm_graph.grid import GridGeometry
from slarm_graph.radio.measured.fit import Hyperparameters
from slarm_graph.radio.measured.height_evidence import LinkClearances, height_evidence
from slarm_graph.radio.measured.height_inference import (
    STEP_M,
    infer_heights,
    level_probabilities,
    with_heights,
)
from slarm_graph.radio.measured.height_posterior import (
    HeightPosterior,
    height_rows,
    write_heights_csv,
)
from slarm_graph.radio.measured.height_sampler import (
    _LOSS_SPREAD_DB,
    HeightEvidence,
    height_probabilities,
    marginalised,
)
from slarm_graph.radio.measured.mean_function import MeanFunction
from slarm_graph.radio.measured.nodes import make_nodes
from slarm_graph.radio.measured.priors import FloorField
from slarm_graph.radio.measured.readings import RssReadings
from slarm_graph.radio.propagation.solid_crossings import lowest_link_heights, solid_crossings
from slarm_graph.radio.radio_map import radio_map
from slarm_graph.recovery.height_prior import HeightPrior
from slarm_graph.recovery.recover import recover_scans
from slarm_graph.world import Solid

RADIO = RadioConfig()
GRID = GridGeometry(0.0, 0.0, 0.1, 60, 90)
AP = AccessPoint("ap", 0.8, 3.0, 2.4)
LEVEL, EXPONENT, WALL = -42.0, 2.4, 6.0
_IN_NOISE = 0.25
"""A decibel, when the noise of readings has 4 dB."""


def box(x_m, y_m, height_m):
    corners = np.array([[x_m, y_m], [x_m + 0.6, y_m], [x_m + 0.6, y_m + 1.2], [x_m, y_m + 1.2]])
    return Solid("box", corners, height_m)


def test_what_is_higher_than_the_lowest_of_a_link_stops_it():
    rng = np.random.default_rng(4)
    points = rng.uniform([0.0, 0.0], [9.0, 6.0], (400, 2))
    for heights in ((2.4, 0.5), (0.4, 1.5)):
        start = [0.8, 3.0, heights[0]]
        lowest = lowest_link_heights(
            [box(3.0, 2.4, 0.0)], start, points, heights[1], mount_radius_m=0.2
        )
        assert 20 < np.isfinite(lowest).sum() < 380
        for top in (0.6, 0.9, 1.3, 2.0, np.inf):
            solid = [box(3.0, 2.4, top)]
            passed = solid_crossings(solid, start, points, heights[1], mount_radius_m=0.2)
            assert ((lowest < top) == (passed == 1)).all()
        # By points along the links.
        along = np.linspace(0.0, 1.0, 4001)[:, None, None]
        way = np.array(start[:2]) + along * (points[::20] - start[:2])
        over = ((way > [3.0, 2.4]) & (way < [3.6, 3.6])).all(axis=2)
        height = heights[0] + along[:, :, 0] * (heights[1] - heights[0])
        sampled = np.where(over, height, np.inf).min(axis=0)
        seen = np.isfinite(sampled)
        assert (np.isfinite(lowest[::20]) == seen).mean() > 0.9
        np.testing.assert_allclose(lowest[::20][seen], sampled[seen], atol=2e-3)


def test_what_is_linear_is_integrated_out_as_dense_algebra_does():
    rng = np.random.default_rng(0)
    noise = np.diag(rng.uniform(0.5, 2.0, 30))
    values, fixed, others = rng.normal(size=30), rng.normal(size=(30, 2)), rng.normal(size=(30, 3))
    mean, sd = np.array([1.0, -2.0]), np.array([0.7, 3.0])
    columns = np.column_stack([values, fixed, others])
    found, among = marginalised(columns.T @ np.linalg.inv(noise) @ columns, 2, mean, sd)
    total = np.linalg.inv(noise + fixed @ np.diag(sd**2) @ fixed.T)
    np.testing.assert_allclose(among, others.T @ total @ others, atol=1e-9)
    np.testing.assert_allclose(found, others.T @ total @ (values - fixed @ mean), atol=1e-9)


def test_as_many_obstacles_are_expected_as_their_heights_are_likely():
    rng = np.random.default_rng(5)
    levels, lowest = np.array([0.0, 0.5, 1.0]), rng.uniform(0.0, 1.2, (2, 9))
    lowest[0, :3], lowest[1, 4] = np.inf, 0.5
    shares = [np.array([0.2, 0.3, 0.5]), np.array([0.0, 0.9, 0.1])]
    nothing = RssReadings(np.zeros((9, 2)), np.zeros(9), np.zeros(9), np.zeros(9, dtype=np.int64))
    links = LinkClearances(nothing, MeanFunction(room([], levels), AP, 0.5, 0.2), lowest)
    wanted = [
        sum(
            share[k] * (level > low[n])
            for share, low in zip(shares, lowest, strict=True)
            for k, level in enumerate(levels)
        )
        for n in range(9)
    ]
    np.testing.assert_allclose(links.expected_obstructions(levels, shares), wanted, atol=1e-12)


def test_what_is_as_high_as_the_floor_stops_nothing_and_what_is_higher_stops_more():
    solids = [box(2.6, 0.9, 0.8), box(2.6, 3.6, 1.5)]
    levels = STEP_M * np.arange(31)
    geographic = room(solids, levels)
    heard = heard_in(solids, 5)["ap"]
    lowest = [
        lowest_link_heights([one], AP.position_m(), heard.points_m, RADIO.antenna_height_m)
        for one in solids
    ]
    flat = replace(geographic, heights_m=np.zeros(GRID.shape, dtype=np.float32))
    hyper = Hyperparameters(3.0, 1.0, 0.5, 5.0, np.array([2.0]))
    links = LinkClearances(heard, MeanFunction(flat, AP, 0.5, 0.2), np.stack(lowest), hyper)
    free = geographic.states == CellState.ACCESSIBLE
    floor = FloorField(make_nodes(GRID, free, 0.5, 10_000))
    shares = [np.full(31, 1.0 / 31)] * 2
    found = height_evidence(links, floor, levels, shares, np.arange(2))
    squares = found.passed.diagonal()[1:].reshape(2, 31)
    assert (squares[:, 0] == 0.0).all()
    assert (squares[:, 24] > 0.0).all()
    # The readings are weaker where the true height stops links.
    assert (found.readings[[1 + 8, 1 + 31 + 15]] < 0.0).all()


def enumerated(heard, priors, wall_db, wall_sd_db):
    """Probabilities of each obstacle's levels, all combinations one by one."""
    logs = {}
    for levels in itertools.product(*(range(len(p)) for p in priors)):
        logs[levels] = sum(np.log(p[k]) for p, k in zip(priors, levels, strict=True))
        for values, certain, columns in heard:
            own = [c[:, k] for c, k in zip(columns, levels, strict=True)]
            passed = certain + sum(own)
            covariance = np.eye(len(values)) + wall_sd_db**2 * np.outer(passed, passed)
            covariance += _LOSS_SPREAD_DB**2 * sum(np.outer(c, c) for c in own)
            logs[levels] += stats.multivariate_normal(-wall_db * passed, covariance).logpdf(values)
    most = max(logs.values())
    found = [np.zeros(len(p)) for p in priors]
    for levels, log in logs.items():
        for share, k in zip(found, levels, strict=True):
            share[k] += np.exp(log - most)
    return [share / share.sum() for share in found]


def test_heights_are_drawn_as_often_as_enumeration_says():
    rng = np.random.default_rng(3)
    priors = [np.array([0.5, 0.3, 0.2]), np.array([0.2, 0.2, 0.6])]
    heard, evidence = [], []
    for _ in range(2):
        certain = _IN_NOISE * rng.integers(0, 2, 12)
        # The two obstacles stand in the way of some of the same links.
        stops = [np.cumsum(rng.random((12, 3)) < 0.12, axis=1).clip(0, 1) for _ in priors]
        columns = [_IN_NOISE * one for one in stops]
        passed = certain + columns[0][:, 1] + columns[1][:, 2]
        values = -4.0 * passed + rng.normal(size=12)
        heard.append((values, certain, columns))
        every = np.column_stack([certain, *columns])
        evidence.append(HeightEvidence(every.T @ values, every.T @ every, 5.0, 1.5))
    wanted = enumerated(heard, priors, 5.0, 1.5)
    found = height_probabilities(evidence, [np.log(p) for p in priors], np.random.default_rng(1))
    assert np.abs(np.concatenate(wanted) - np.concatenate(priors)).max() > 0.1
    assert max(share.max() for share in wanted) < 0.97
    np.testing.assert_allclose(np.concatenate(found), np.concatenate(wanted), atol=0.04)


def test_prior_is_that_of_the_class_and_a_little_of_anything():
    levels = STEP_M * np.arange(31)
    given = HeightPrior(3.0, 0.2).levels_m("furniture")
    prior = level_probabilities(given, levels)
    assert prior.sum() == pytest.approx(1.0)
    assert prior[levels < given[0] - STEP_M].sum() == 0.0
    assert prior[levels <= 1.15].sum() == pytest.approx(0.5, abs=0.05)
    assert (prior[levels > given[0]] > 0.0).all()


def room(solids, levels_m):
    x, y = np.moveaxis(GRID.centers(), -1, 0)
    inside = np.zeros(GRID.shape, dtype=bool)
    for solid in solids:
        (left, low), (right, high) = solid.corners_m.min(axis=0), solid.corners_m.max(axis=0)
        inside |= (x > left) & (x < right) & (y > low) & (y < high)
    states = np.where(inside, CellState.OBSTACLE, CellState.ACCESSIBLE).astype(np.uint8)
    layers = Coverage(~inside, ~inside, ~inside)
    unsure = [n for n, solid in enumerate(solids) if np.isfinite(solid.height_m)]
    groups = tuple(HeightGroup((n,), levels_m[:, None]) for n in unsure)
    heights = np.where(inside, np.inf, 0.0).astype(np.float32)
    return GeographicMap(
        GRID, states, heights, "prior", layers, solids=tuple(solids), height_groups=groups
    )


def heard_in(solids, seed, noise_db=2.0):
    """Readings all over a room, of a law without shadowing."""
    rng = np.random.default_rng(seed)
    points = rng.uniform([0.2, 0.2], [8.8, 5.8], (1200, 2))
    for solid in solids:
        low, high = solid.corners_m.min(axis=0), solid.corners_m.max(axis=0)
        points = points[~((points > low - 0.1) & (points < high + 0.1)).all(axis=1)]
    points = points[np.argsort(points[:, 0])]
    away = np.hypot(np.hypot(*(points - [AP.x_m, AP.y_m]).T), AP.z_m - RADIO.antenna_height_m)
    passed = solid_crossings(solids, AP.position_m(), points, RADIO.antenna_height_m)
    rss = LEVEL - 10.0 * EXPONENT * np.log10(away) - WALL * passed
    rss += noise_db * rng.normal(size=len(rss))
    times = 0.5 * np.arange(len(rss))
    return {"ap": RssReadings(points, times, rss, np.zeros(len(rss), dtype=np.int64))}


@pytest.fixture(scope="module")
def low_and_high():
    """Nobody has said that one is 0.8 m and the other 1.5 m high, but that a third is a pillar."""
    solids = [box(2.6, 0.9, 0.8), box(2.6, 3.6, 1.5), box(5.5, 2.4, np.inf)]
    geographic = room(solids, HeightPrior(3.0, 0.2).levels_m("furniture"))
    config, rng = MeasuredConfig(node_side_m=0.3), np.random.default_rng(0)
    readings, told = heard_in(solids, 5), []
    heard = infer_heights(geographic, readings, [AP], RADIO, config, rng, told.append)
    assert set(told) == {"heights of 2 obstacles by what is heard behind them"}
    return solids, geographic, heard


def test_heights_are_heard(low_and_high):
    solids, _, heard = low_and_high
    assert len(heard) == 2
    for solid, one in zip(solids, heard, strict=False):
        np.testing.assert_allclose(one.center_m, solid.corners_m.mean(axis=0), atol=1e-9)
        assert one.quantile_m(0.95, prior=True) - one.quantile_m(0.05, prior=True) > 1.0
        assert abs(one.quantile_m(0.5) - solid.height_m) <= STEP_M + 1e-9
        assert one.quantile_m(0.95) - one.quantile_m(0.05) <= 0.4
        assert one.readings > 50


def test_line_of_sight_is_that_of_what_was_heard(low_and_high):
    solids, geographic, heard = low_and_high
    after = with_heights(geographic, heard)
    truth = replace(geographic, solids=tuple(solids), height_groups=())
    right = {}
    for name, one in (("before", geographic), ("after", after), ("truth", truth)):
        right[name] = radio_map(one, [AP], RADIO)
    clear = right["truth"].line_of_sight[0]
    free = np.isfinite(right["truth"].path_loss_db[0])
    brier = {
        name: np.mean((right[name].sight_probability[0] - clear)[free] ** 2)
        for name in ("before", "after")
    }
    assert brier["after"] < 0.2 * brier["before"]
    assert "heard behind 2 obstacles, else prior" in after.height_source
    inside = geographic.states == CellState.OBSTACLE
    medians = {np.inf, *(round(one.quantile_m(0.5), 3) for one in heard)}
    assert {round(float(h), 3) for h in np.unique(after.heights_m[inside])} == medians


def test_nothing_heard_leaves_the_map_alone(low_and_high):
    solids, geographic, _ = low_and_high
    config, rng = MeasuredConfig(), np.random.default_rng(0)
    elsewhere = [replace(AP, name="another")]
    readings = heard_in(solids, 5)
    assert infer_heights(geographic, readings, elsewhere, RADIO, config, rng) == ()
    certain = replace(geographic, height_groups=())
    assert infer_heights(certain, readings, [AP], RADIO, config, rng) == ()
    unchanged = with_heights(geographic, ())
    assert unchanged.height_groups == geographic.height_groups
    assert unchanged.height_source == geographic.height_source


def test_every_obstacle_of_a_room_has_a_height_of_its_own():
    """Two that stand at the room's walls are not low or high together."""
    scans, trajectory = scanned_room(0.01, 0.0)
    geometry = GridGeometry.covering(*WORLD.extent_m(), 0.1)
    found = recover_scans(
        scans, trajectory, MappingConfig(), RecoveryConfig(), geometry=geometry
    ).height_groups
    unsure = [g for g in found if np.ptp(g.levels_m) > 0.0]
    assert len(unsure) >= 2
    for group in unsure:
        assert np.ptp(group.levels_m, axis=1).max() == 0.0
    numbers = [n for group in found for n in group.solids]
    assert len(numbers) == len(set(numbers))


def test_table_has_prior_and_posterior(tmp_path):
    levels = STEP_M * np.arange(4)
    prior, posterior = np.array([0.1, 0.4, 0.4, 0.1]), np.array([0.0, 0.0, 0.2, 0.8])
    one = HeightPosterior(7, np.array([1.0, 2.0]), levels, prior, posterior, 12)
    (row,) = height_rows([one])
    assert (row["obstacle"], row["x_m"], row["y_m"], row["readings"]) == (7, 1.0, 2.0, 12)
    assert [row[f"prior_q{q}_m"] for q in ("05", "50", "95")] == [0.0, 0.1, 0.3]
    assert [row[f"height_q{q}_m"] for q in ("05", "50", "95")] == [0.2, 0.3, 0.3]
    assert row["height_mean_m"] == pytest.approx(0.28)
    write_heights_csv(tmp_path / "heights.csv", [one])
    with (tmp_path / "heights.csv").open(encoding="utf-8") as file:
        (read,) = csv.DictReader(file)
    assert read["height_q50_m"] == "0.3"
