# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Measured radio maps against the truth: six access points in every world that comes along.

    python benchmarks/bench_simulated_radio.py [--worlds A,B] [--explorer NAME | --tour] [--known]

A robot that knows its pose covers a world it does not know and hears six access points: 4 dB of
shadowing with a correlation of 2 m, fading, nothing below -90 dBm. Nobody tells it where they are.
The map that it makes is compared with the level that is true on all floor that can be reached, and
with new readings there. `prediction` is 3GPP's row for the scenario over the recovered map, told
true positions and powers; `multi-wall` the same by that model with its defaults. `--tour` drives
through every part of the world instead of over all of the floor, which is some ten times quicker.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass, replace

import numpy as np
from known_pose import TruthBackend

from slarm_graph import parts
from slarm_graph.access_points import AccessPoint, RadioMap
from slarm_graph.app.explore import with_prior
from slarm_graph.config import (
    ExploreConfig,
    MeasuredConfig,
    RadioConfig,
    RunConfig,
    SignalConfig,
    SimulationConfig,
)
from slarm_graph.exploration.closed_loop import ClosedLoop
from slarm_graph.exploration.radio_survey import RadioSurveyConfig
from slarm_graph.files.worlds import load_world, shipped_worlds
from slarm_graph.frontends.simulation.receiver import SignalChannel
from slarm_graph.frontends.simulation.simulator import SimulatedWorld
from slarm_graph.frontends.simulation.world_recording import tour as tour_script
from slarm_graph.geographic import GeographicMap
from slarm_graph.geometry import Floats
from slarm_graph.grid import GridGeometry
from slarm_graph.radio.measured.build_map import build_measured_map
from slarm_graph.radio.measured.measured_map import MeasuredMap
from slarm_graph.radio.measured.rss_log import RssLog, place, rss_with_scans
from slarm_graph.radio.propagation.over_map import predicted_radio_map
from slarm_graph.reading_log import ReadingLog
from slarm_graph.recovery.recover import recover_scans
from slarm_graph.trajectory import Trajectory
from slarm_graph.truth_map import truth_map
from slarm_graph.world import WorldMap

COUNT, POWER_DBM, FREQUENCY_HZ = 6, -10.0, 2.44e9
"""Access points of a world, and those of Bluetooth beacons (-20 to 4 dBm)."""
CELL_M, PROBE_M, FADES = 0.1, 0.3, 400
"""Of the recovered map; between points that are judged; draws of fading of each kind of link."""
NORMAL_95 = 1.96
"""Quantile 0.975 of the standard normal distribution: 95 % of it lie within plus and minus."""


@dataclass(frozen=True)
class Heard:
    """A drive through a world."""

    world: WorldMap
    config: RunConfig
    channel: SignalChannel
    path: Trajectory
    log: RssLog
    geographic: GeographicMap
    time_s: float


def with_six(world: WorldMap, height_m: float = 2.4) -> WorldMap:
    """Give a world six access points: its own, then each as far from the others as can be."""
    truth = truth_map(world, 0.25)
    floor = truth.geometry.center_of(np.argwhere(truth.reachable))
    places = [ap.position_m() for ap in world.access_points][:COUNT]
    while len(places) < COUNT:
        away = np.min([np.linalg.norm(floor - p[:2], axis=1) for p in places], axis=0)
        places.append(np.array([*floor[away.argmax()], min(height_m, world.ceiling_m - 0.2)]))
    points = [
        AccessPoint(f"ap{n}", *(float(v) for v in p), POWER_DBM, FREQUENCY_HZ)
        for n, p in enumerate(places, start=1)
    ]
    return replace(world, access_points=tuple(points))


def settings(
    explorer: str, seed: int, *, mission_s: float | None = None, certainty_db: float = 2.0
) -> RunConfig:
    """Return the configuration of a drive."""
    explore = ExploreConfig(explorer=explorer, resolution_m=CELL_M, mission_time_s=mission_s)
    survey = {"radio-survey": RadioSurveyConfig(certainty_db=certainty_db)}
    return RunConfig(
        seed=seed,
        explore=explore,
        simulation=SimulationConfig(signals=SignalConfig(rate_hz=5.0)),
        radio=RadioConfig(frequency_hz=FREQUENCY_HZ, power_dbm=POWER_DBM),
        **survey,  # type: ignore[arg-type]
    )


def drive(name: str, config: RunConfig) -> Heard:
    """Let a robot explore a world and listen."""
    world = with_six(load_world(name))
    config = with_prior(world, config)
    simulated = SimulatedWorld(world, config.simulation, np.random.default_rng(config.seed))
    loop = ClosedLoop(
        simulated,
        TruthBackend(simulated),
        parts.make("explorer", config.explore.explorer, config, config.explore.driving),
        config.explore,
        extent_m=world.extent_m(),
        start=world.start,
        mapping=config.mapping,
    )
    while loop.step():
        pass
    out = loop.outcome()
    return heard_of(world, config, simulated, out.log, out.trajectory)


def tour(name: str, config: RunConfig) -> Heard:
    """Let a robot drive through a world that it knows, and listen."""
    world = with_six(load_world(name))
    config = with_prior(world, config)
    simulated = SimulatedWorld(world, config.simulation, np.random.default_rng(config.seed))
    log, poses = ReadingLog(), []
    script = tour_script(world, config.simulation)(simulated)
    while True:
        log.append(simulated.read())
        poses.append(simulated.truth_of_reading().as_array())
        command = next(script, None)
        if command is None:
            break
        simulated.drive(command)
    way = Trajectory(log.stamps_ns, np.array(poses))
    return heard_of(world, config, simulated, log, way)


def heard_of(
    world: WorldMap, config: RunConfig, simulated: SimulatedWorld, log: ReadingLog, way: Trajectory
) -> Heard:
    """Recover the map of a drive."""
    channel = simulated.receiver.channel
    assert channel is not None
    (rss,) = rss_with_scans(log)
    cells = GridGeometry.covering(*world.extent_m(), CELL_M)
    geographic = recover_scans(log.scans, way, config.mapping, config.recovery, geometry=cells)
    return Heard(world, config, channel, way, rss, geographic, log.driven_s)


@dataclass(frozen=True)
class Truth:
    """What is true at P points of the floor: levels with the fading's mean, and new readings."""

    points_m: Floats
    level_dbm: Floats
    reading_dbm: Floats


def truth_of(heard: Heard, rng: np.random.Generator) -> Truth:
    """Levels (A, P) and readings (A, P) on all floor that can be reached."""
    truth = truth_map(heard.world, PROBE_M)
    points = truth.geometry.center_of(np.argwhere(truth.reachable))
    level = heard.channel.levels_dbm(points)
    fades = {
        clear: np.array([heard.channel.fade_db(clear) for _ in range(FADES)])
        for clear in (False, True)
    }
    reading = np.empty_like(level)
    for index in range(len(level)):
        clear = heard.channel.passed(index, points) == 0.0
        drawn = [rng.choice(fades[kind], len(points)) for kind in (False, True)]
        reading[index] = level[index] + np.where(clear, drawn[1], drawn[0])
        level[index] += np.where(clear, fades[True].mean(), fades[False].mean())
    return Truth(points, level, reading)


def measured_of(heard: Heard, until_s: float = np.inf, known: bool = False) -> MeasuredMap:
    """Make the measured map of what was heard until a time."""
    placed = place(heard.log, heard.path, 0.02).readings
    parts = {name: one.only(one.times_s <= until_s) for name, one in placed.items()}
    points = heard.world.access_points if known else ()
    return build_measured_map(heard.geographic, parts, points, heard.config.radio, MeasuredConfig())


def at(layer: Floats, geometry: GridGeometry, points_m: Floats) -> Floats:
    """Values of a layer at points; nan outside."""
    return np.asarray(geometry.sample(layer, points_m, np.nan), dtype=np.float64)


def rmse(error: Floats) -> float:
    """Root of the mean square of what is finite."""
    return float(np.sqrt(np.nanmean(error**2)))


def score(heard: Heard, measured: MeasuredMap, truth: Truth) -> dict[str, float]:
    """Judge a measured map; predictions are told positions and powers, it is not."""
    errors, mean_in, new_in = [], [], []
    for index, ap in enumerate(measured.access_points):
        n = int(ap.name[2:]) - 1
        mean, sd, spread = (
            at(layer[index], measured.geometry, truth.points_m)
            for layer in (measured.mean_dbm, measured.mean_sd_db, measured.reading_sd_db)
        )
        ok = np.isfinite(mean)
        errors.append((mean - truth.level_dbm[n])[ok])
        mean_in.append((np.abs(mean - truth.level_dbm[n]) <= NORMAL_95 * sd)[ok])
        new_in.append((np.abs(mean - truth.reading_dbm[n]) <= NORMAL_95 * spread)[ok])
    return {
        "fused_db": rmse(np.concatenate(errors)),
        "readings_in_95": float(np.concatenate(new_in).mean()),
        "levels_in_95": float(np.concatenate(mean_in).mean()),
    }


def predicted(heard: Heard, truth: Truth) -> dict[str, float]:
    """Judge predictions that are told positions and powers."""
    scores = {}
    for label, model in (("prediction_db", "3gpp"), ("multi_wall_db", "multi-wall")):
        radio = heard.config.radio.model_copy(update={"propagation": model})
        config = heard.config.model_copy(update={"radio": radio})
        made: RadioMap = predicted_radio_map(heard.geographic, heard.world.access_points, config)
        errors = [
            at(layer, made.geometry, truth.points_m) - truth.level_dbm[n]
            for n, layer in enumerate(made.rss_dbm)
        ]
        scores[label] = rmse(np.concatenate(errors))
    return scores


def located(heard: Heard, measured: MeasuredMap) -> dict[str, Floats]:
    """Errors of positions [m] and of the walls' losses [dB]."""
    true = {ap.name: ap.position_m() for ap in heard.world.access_points}
    off = [ap.position_m() - true[ap.name] for ap in measured.access_points]
    wall = [terms.wall_db for terms in measured.fitted]
    return {
        "plan_m": np.array([np.hypot(*o[:2]) for o in off]),
        "sds": np.array([np.hypot(*terms.position_sd_m[:2]) for terms in measured.fitted]),
        "wall_db": np.array(wall) - heard.config.simulation.signals.wall_db,
        "wall_sd": np.array([terms.sd[2] for terms in measured.fitted]),
    }


def surely(found: dict[str, Floats]) -> int:
    """How many losses of walls lie in their 95 % interval."""
    return int((np.abs(found["wall_db"]) < NORMAL_95 * found["wall_sd"]).sum())


def main() -> None:
    """Print a row per world, and all together."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--worlds", default=",".join(shipped_worlds()))
    parser.add_argument("--explorer", default="ggmr+")
    parser.add_argument("--tour", action="store_true")
    parser.add_argument("--known", action="store_true", help="tell it where access points are")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    for name in given.worlds.split(","):
        go = tour if given.tour else drive
        heard = go(name, settings(given.explorer, given.seed))
        print(f"{name}: {len(heard.log)} readings in {heard.time_s:.0f} s", file=sys.stderr)
        print(row(name, heard, given.known), flush=True)


def row(name: str, heard: Heard, known: bool) -> str:
    """Return a row of the table."""
    truth, measured = truth_of(heard, np.random.default_rng(1)), measured_of(heard, known=known)
    scores = score(heard, measured, truth) | predicted(heard, truth)
    found = located(heard, measured)
    silent = np.isnan(heard.log.rss_dbm).mean()
    return (
        f"| {name} | {len(heard.log)} | {100 * silent:.0f} | {scores['fused_db']:.2f} |"
        f" {scores['prediction_db']:.2f} | {scores['multi_wall_db']:.2f} |"
        f" {100 * scores['fused_db'] / scores['prediction_db']:.0f} |"
        f" {100 * scores['readings_in_95']:.1f} | {100 * scores['levels_in_95']:.1f} |"
        f" {np.median(found['plan_m']):.2f} ({found['plan_m'].max():.2f}) |"
        f" {np.median(np.abs(found['wall_db'])):.2f} ({np.abs(found['wall_db']).max():.2f}) |"
        f" {(np.abs(found['wall_db']) < 1.5).sum()} | {surely(found):d} of {len(found['sds'])} |"
    )


if __name__ == "__main__":
    main()
