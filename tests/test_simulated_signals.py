# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Simulated signal strength: the law, shadowing's statistics, what is not heard, bags."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import digamma, polygamma

from slarm_graph.access_points import AccessPoint
from slarm_graph.config import SignalConfig, SimulationConfig
from slarm_graph.files.worlds import load_world
from slarm_graph.frontends.recordings.convert import convert
from slarm_graph.frontends.signals.rss import open_rss
from slarm_graph.frontends.simulation.receiver import SignalChannel, shadowing
from slarm_graph.frontends.simulation.world_recording import SourceFromWorld, waypoints
from slarm_graph.geometry import Pose2
from slarm_graph.grid import GridGeometry
from slarm_graph.radio.measured.rss_log import rss_with_scans
from slarm_graph.radio.propagation.crossings import wall_crossings
from slarm_graph.radio.propagation.solid_crossings import solid_crossings
from slarm_graph.reading_log import ReadingLog
from slarm_graph.truth_map import truth_map
from slarm_graph.world import Solid, WorldMap

BOX = np.array([[0.0, 0.0], [12.0, 0.0], [12.0, 8.0], [0.0, 8.0]])
WALL = Solid("wall", np.array([[4.0, 0.0], [4.2, 0.0], [4.2, 8.0], [4.0, 8.0]]), 3.0)
LOW = Solid("desk", np.array([[7.0, 0.0], [8.0, 0.0], [8.0, 8.0], [7.0, 8.0]]), 0.7)
AP = AccessPoint("ap", 1.0, 4.0, 2.5, 20.0, 2.4e9)
WORLD = WorldMap("room", (WALL, LOW), BOX, 3.0, (AP,), Pose2(2.0, 4.0, 0.0))
PLAIN = SignalConfig(rate_hz=5.0, shadowing_db=0.0, quantum_db=0.0, threshold_dbm=-200.0)


def test_level_is_the_law_by_hand():
    channel = SignalChannel(WORLD, PLAIN, np.random.default_rng(0))
    near, behind = channel.levels_dbm(np.array([[3.0, 4.0], [6.0, 4.0]]))[0]
    friis = 20.0 * np.log10(4.0 * np.pi * 2.4e9 / 299_792_458.0)
    assert near == pytest.approx(20.0 - friis - 20.0 * np.log10(np.hypot(2.0, 2.0)))
    assert behind == pytest.approx(20.0 - friis - 20.0 * np.log10(np.hypot(5.0, 2.0)) - 5.0)


def test_solids_count_below_their_top_only():
    # The desk's far side is 7 m away: there the link to an antenna at 9 m is 2.5 - 2 * 7 / 8 high.
    points = np.array([[3.0, 4.0], [6.0, 4.0], [9.0, 4.0], [8.6, 4.0], [7.9, 4.0], [20.0, 4.0]])
    counts = solid_crossings((WALL, LOW), AP.position_m(), points, 0.5)
    assert counts.tolist() == [0, 1, 1, 2, 2, 1]
    assert solid_crossings((WALL,), [3.9, 4.0, 2.5], points[1:2], 0.5).tolist() == [1]
    held = solid_crossings((WALL,), [3.9, 4.0, 2.5], points[1:2], 0.5, mount_radius_m=0.4)
    assert held.tolist() == [0]


@pytest.mark.parametrize("name", ["office", "cluttered", "dead_ends"])
def test_solids_passed_agree_with_the_walk_over_cells(name):
    world = load_world(name)
    truth = truth_map(world, 0.02)
    rng = np.random.default_rng(1)
    free = np.argwhere(truth.reachable)
    points = truth.geometry.center_of(free[rng.choice(len(free), 400)])
    ap = world.access_points[0].position_m()
    by_solid = solid_crossings(world.solids, ap, points, 0.5, mount_radius_m=0.25)
    cells = wall_crossings(
        truth.geometry, np.where(truth.blocked, truth.heights_m, 0.0), ap, points, 0.5,
        mount_radius_m=0.25,
    )  # fmt: skip
    # A grazed corner is in one and not in the other.
    assert (by_solid == cells).mean() > 0.97


def test_pieces_of_a_wall_are_one_where_they_touch():
    """A corner of two solids, and one solid with a gap between its arms."""
    along = Solid("a", np.array([[4.0, 0.0], [4.2, 0.0], [4.2, 1.8], [4.0, 2.0]]), 3.0)
    up = Solid("b", np.array([[4.0, 2.0], [4.2, 1.8], [8.0, 1.8], [8.0, 2.0]]), 3.0)
    start = [3.0, 1.0, 2.5]
    points = np.array([[5.0, 2.6], [4.6, 1.0], [5.0, 2.2]])
    # Through the mitre from one piece into the other, through one piece, and through both apart.
    assert solid_crossings((along, up), start, points, 0.5).tolist() == [1, 1, 2]
    arms = [[4, 0], [7, 0], [7, 3], [6, 3], [6, 1], [5, 1], [5, 3], [4, 3]]
    fork = Solid("u", np.array(arms, dtype=float), 3.0)
    behind = np.array([[8.0, 2.0], [8.0, 0.5], [5.5, 2.0]])
    assert solid_crossings((fork,), [3.0, 2.0, 2.5], behind[:1], 0.5).tolist() == [2]
    assert solid_crossings((fork,), [3.0, 0.5, 2.5], behind[1:2], 0.5).tolist() == [1]
    assert solid_crossings((fork,), [3.0, 2.0, 2.5], behind[2:], 0.5).tolist() == [1]


def test_shadowing_has_unit_variance_and_falls_exponentially():
    rng = np.random.default_rng(2)
    fields = np.stack([shadowing(60, 80, 0.1, rng) for _ in range(60)])
    assert fields.std() == pytest.approx(1.0, abs=0.05)
    for steps in (5, 10, 20):
        expected = np.exp(-0.1 * steps)
        along = np.mean(fields[:, :, steps:] * fields[:, :, :-steps])
        up = np.mean(fields[:, steps:] * fields[:, :-steps])
        across = np.mean(fields[:, steps:, steps:] * fields[:, :-steps, :-steps])
        assert along == pytest.approx(expected, abs=0.08)
        assert up == pytest.approx(expected, abs=0.08)
        assert across == pytest.approx(np.exp(-0.1 * steps * np.sqrt(2.0)), abs=0.08)


def test_fading_behind_a_wall_is_the_mean_of_exponentials():
    """The power of K Rayleigh fades is Gamma(K): its log has mean psi(K), variance psi'(K)."""
    channel = SignalChannel(WORLD, PLAIN, np.random.default_rng(3))
    pose = Pose2(6.0, 4.0, 0.0)
    heard = np.array([channel.hear(pose)[0].rss_dbm for _ in range(3000)])
    level = channel.levels_dbm(np.array([[6.0, 4.0]]))[0, 0]
    decibel = 10.0 / np.log(10.0)
    assert heard.mean() - level == pytest.approx(decibel * (digamma(4) - np.log(4)), abs=0.15)
    assert heard.std() == pytest.approx(decibel * np.sqrt(polygamma(1, 4)), rel=0.06)


def test_weak_signals_are_not_heard_and_levels_are_whole():
    config = SignalConfig(rate_hz=5.0, threshold_dbm=-44.0)
    channel = SignalChannel(WORLD, config, np.random.default_rng(4))
    heard = [channel.hear(Pose2(x, 4.0, 0.0))[0].rss_dbm for x in np.linspace(2, 11, 200)]
    heard = np.array(heard)
    assert 0.1 < np.isnan(heard).mean() < 0.9
    assert np.nanmin(heard) >= -44.0
    np.testing.assert_array_equal(heard % 1.0, np.where(np.isnan(heard), np.nan, 0.0))


def drive(config):
    source = SourceFromWorld(
        WORLD, SimulationConfig(signals=config), script=waypoints([[3.0, 4.0], [2.0, 3.0]])
    )
    log = ReadingLog()
    for reading in source:
        log.append(reading)
    return log


def test_hearing_changes_nothing_else_and_keeps_its_rate():
    silent, hearing = drive(SignalConfig()), drive(PLAIN)
    assert rss_with_scans(silent) == ()
    np.testing.assert_array_equal(silent.scans[-1].ranges_m, hearing.scans[-1].ranges_m)
    (log,) = rss_with_scans(hearing)
    assert log.names == ("ap",)
    assert np.diff(log.stamps_ns).min() == 200_000_000


@pytest.mark.parametrize("ending", [".bag", ".mcap"])
def test_bags_of_a_world_bring_what_was_heard(tmp_path, ending):
    world = tmp_path / "room.yaml"
    world.write_text(
        "name: room\nceiling_m: 3.0\nboundary_m: [[0, 0], [5, 0], [5, 4], [0, 4]]\n"
        "start: {x_m: 1.0, y_m: 1.0, heading_deg: 0.0}\n"
        "access_points: [{name: ap, x_m: 0.5, y_m: 0.5, z_m: 2.5}]\n"
    )
    config = SimulationConfig(signals=SignalConfig(rate_hz=10.0, threshold_dbm=-35.0))
    told = convert(world, tmp_path / f"room{ending}", simulation=config)
    assert "--rss /rss:rss_dbm,access_point" in told
    log = open_rss("/rss:rss_dbm,access_point", [tmp_path / f"room{ending}"])
    assert log.names == ("ap",)
    assert len(log) > 20
    assert 0 < np.isnan(log.rss_dbm).sum() < len(log)


def test_geometry_is_that_of_the_extent():
    """A level is asked for anywhere inside the boundary, to its very corners."""
    channel = SignalChannel(WORLD, SignalConfig(rate_hz=1.0), np.random.default_rng(5))
    corners = GridGeometry.covering(0.0, 12.0, 0.0, 8.0, 0.5).centers().reshape(-1, 2)
    assert np.isfinite(channel.levels_dbm(np.concatenate([corners, BOX]))).all()
