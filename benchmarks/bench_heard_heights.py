# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Heights that nobody has said, by what is heard: accuracy of maps before and after.

    python benchmarks/bench_heard_heights.py [--worlds A,B] [--seed N] [--drive | --tour]

Six access points whose positions are known are heard in worlds of which no size is known, with
shadowing and fading as in `bench_simulated_radio.py`. The map is recovered with the prior of
heights by class of plan, then heights are told by what was heard. Without `--drive` and `--tour`
the scans are those of true poses half a metre apart and readings are taken every 0.12 m along lanes
0.3 m apart, which is some fifty times quicker than a drive of full coverage.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import bench_simulated_radio as simulated
import numpy as np

from slarm_graph.app.handed_over import with_prior
from slarm_graph.app.world_accuracy import accuracy_on
from slarm_graph.config import MeasuredConfig, RunConfig
from slarm_graph.eval.radio_scores import RadioAccuracy
from slarm_graph.exploration.algorithm_1 import ggmr_path
from slarm_graph.exploration.coverage_grid import known_coverage
from slarm_graph.files.worlds import load_world, shipped_worlds
from slarm_graph.frontends.simulation.receiver import SignalChannel
from slarm_graph.geographic import GeographicMap
from slarm_graph.geometry import Floats
from slarm_graph.grid import GridGeometry
from slarm_graph.radio.measured.height_inference import infer_heights, with_heights
from slarm_graph.radio.measured.readings import RssReadings
from slarm_graph.radio.measured.rss_log import RssLog, place
from slarm_graph.radio.radio_map import radio_map
from slarm_graph.raster.distance import within
from slarm_graph.recovery.recover import recover_scans
from slarm_graph.trajectory import Trajectory
from slarm_graph.truth_map import truth_map
from slarm_graph.world import WorldMap

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from scanned_rooms import toured

EVERY_M, LANE_CELLS = 0.12, 3
"""Between readings: 0.6 m/s at five a second; cells of 0.1 m between lanes, about a robot's
width."""
SCANS_M = 0.5
"""Between poses that scan: a metre leaves a corner of the world paper_room unseen."""
ROBOT_M = 0.2
"""Lanes keep so far from what stands around: a robot's radius and two centimetres."""
PERIOD_NS = 200_000_000
"""Between readings [ns], five a second."""
FIRST_SEED = 1_000
"""Seeds of shadowing and fading begin here, apart from those of drives."""


def walked(
    name: str, seed: int
) -> tuple[WorldMap, RunConfig, dict[str, RssReadings], GeographicMap]:
    """Hear a world along lanes, and recover it from scans of true poses."""
    world = simulated.with_six(load_world(name))
    config = without_sizes(with_prior(world, simulated.settings("ggmr+", seed)))
    lanes_m = lanes(world)
    rng = np.random.default_rng(FIRST_SEED + seed)
    channel = SignalChannel(world, config.simulation.signals, rng)
    heads = np.arctan2(*np.gradient(lanes_m, axis=0).T[::-1])
    stamps = np.arange(len(lanes_m)) * PERIOD_NS
    way = Trajectory(stamps, np.column_stack([lanes_m, heads]))
    scans, poses = toured(world, SCANS_M, 0.01)
    cells = GridGeometry.covering(*world.extent_m(), simulated.CELL_M)
    how = (config.mapping, config.recovery)
    geographic = recover_scans(scans, poses, *how, geometry=cells)
    log = heard_along(world, config, channel, lanes_m, stamps)
    return world, config, place(log, way, 0.02).readings, geographic


def without_sizes(config: RunConfig) -> RunConfig:
    """Return the configuration of a robot that is told no size."""
    recovery = config.recovery.model_copy(update={"known_sizes": ()})
    return config.model_copy(update={"recovery": recovery})


def lanes(world: WorldMap) -> Floats:
    """Points (N, 2) along Algorithm 1's way over all floor that can be reached [m]."""
    truth = truth_map(world, 0.1)
    roomy = truth.reachable & ~within(~truth.reachable, ROBOT_M, 0.1)
    cells = (slice(LANE_CELLS // 2, None, LANE_CELLS),) * 2
    centers, free = truth.geometry.centers()[cells], roomy[cells]
    away_m = np.hypot(*(centers - [world.start.x, world.start.y]).transpose(2, 0, 1))
    start = np.unravel_index(np.where(free, away_m, np.inf).argmin(), free.shape)
    path = ggmr_path(known_coverage(free), (int(start[0]), int(start[1])))
    corners_m = centers[tuple(path.cells.T)]
    along_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(corners_m, axis=0).T))])
    at_m = np.arange(0.0, along_m[-1], EVERY_M)
    return np.column_stack([np.interp(at_m, along_m, corners_m[:, k]) for k in (0, 1)])


def heard_along(
    world: WorldMap, config: RunConfig, channel: SignalChannel, points_m: Floats, stamps: Floats
) -> RssLog:
    """Readings of all access points at points (N, 2)."""
    signals, levels_dbm = config.simulation.signals, channel.levels_dbm(points_m)
    names, rss = [], []
    for index, ap in enumerate(world.access_points):
        clear = channel.passed(index, points_m) == 0.0
        fades = np.array([channel.fade_db(bool(one)) for one in clear])
        level = levels_dbm[index] + fades
        told = np.round(level / signals.quantum_db) * signals.quantum_db
        rss.append(np.where(level >= signals.threshold_dbm, told, np.nan))
        names += [ap.name] * len(points_m)
    every = np.tile(stamps, len(world.access_points)).astype(np.int64)
    return RssLog.of_rows(every, names, np.concatenate(rss), "along lanes")


def driven(
    name: str, seed: int, *, tour: bool
) -> tuple[WorldMap, RunConfig, dict[str, RssReadings], GeographicMap]:
    """Hear a world on a drive that is told no size."""
    go = simulated.tour if tour else simulated.drive
    config = simulated.settings("ggmr+", seed)
    explore = config.explore.model_copy(update={"prior": "extent"})
    heard = go(name, config.model_copy(update={"explore": explore}))
    readings = place(heard.log, heard.path, 0.02).readings
    return heard.world, heard.config, readings, heard.geographic


def accuracy(world: WorldMap, config: RunConfig, geographic: GeographicMap) -> RadioAccuracy:
    """Judge the radio map over a geographic map."""
    radio = radio_map(geographic, world.access_points, config.radio)
    return accuracy_on(world, geographic, radio, config.radio, simulated.CELL_M)


def main() -> None:
    """Print a row per world."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--worlds", default=",".join(shipped_worlds()))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--drive", action="store_true")
    parser.add_argument("--tour", action="store_true")
    given = parser.parse_args()
    for name in given.worlds.split(","):
        if given.drive or given.tour:
            world, config, readings, before = driven(name, given.seed, tour=given.tour)
        else:
            world, config, readings, before = walked(name, given.seed)
        rng = np.random.default_rng(given.seed)
        how = (config.radio, MeasuredConfig(), rng)
        heard = infer_heights(before, readings, world.access_points, *how)
        told = [accuracy(world, config, one) for one in (before, with_heights(before, heard))]
        figures = [f"{one.accuracy:.3f} ({one.los_brier:.4f})" for one in told]
        worst = [f"{one.worst.accuracy:.3f}" for one in told]
        print(
            f"| {name} {given.seed} | {len(heard)} | {figures[0]} | {figures[1]} |"
            f" {worst[0]}, {worst[1]} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
