# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Drive time and footprint coverage of all explorers in all worlds, in one run.

    python benchmarks/bench_exploration.py [--worlds A,B] [--explorers A,B] [--backend NAME]

A line to stderr tells of every drive as soon as it is done; the tables follow world by world.

Everybody drives the same simulated robot with the same follower through a world that it does not
know. Of the truly reachable floor, known is the share that the map knows in the end, and footprint
the share that the body passed over. `both` is the most that the explorer and `ggmr+` both passed
over, which `ggmr+` had done after `ours`, the explorer after `its`; `saved` compares the two times.
`--backend truth` tells the robot where it is, so that only the explorers differ.
"""

from __future__ import annotations

import argparse
import os
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import product
from multiprocessing import get_context

import numpy as np
from known_pose import TruthBackend

from slarm_graph import backends, parts
from slarm_graph.backend import SlamBackend, silent
from slarm_graph.config import ExploreConfig, RunConfig
from slarm_graph.exploration.closed_loop import ClosedLoop, Exploration
from slarm_graph.exploration.live_map import LiveMap, mark_swept
from slarm_graph.files.worlds import load_world, shipped_worlds
from slarm_graph.frontends.simulation.simulator import SimulatedWorld
from slarm_graph.geometry import Floats
from slarm_graph.truth_map import truth_map
from slarm_graph.world import WorldMap

OURS = "ggmr+"
COVERING = tuple(name for name in parts.registered("explorer") if name != "radio-survey")
"""Explorers that drive to know the floor; `bench_simulated_radio.py` judges the other."""
LATTICE_M = ExploreConfig().resolution_m


@dataclass(frozen=True, slots=True)
class Drive:
    """One explorer in one world."""

    world: str
    explorer: str
    time_s: float
    path_m: float
    turns: int
    collisions: int
    reason: str
    known: float
    at_s: Floats
    footprint: Floats


def drive(world_name: str, explorer: str, backend: str, resolution_m: float, seed: int) -> Drive:
    """Explore a world and follow how the footprint grows."""
    world = load_world(world_name)
    config = RunConfig(
        seed=seed, explore=ExploreConfig(explorer=explorer, resolution_m=resolution_m)
    )
    for_world, for_backend = np.random.default_rng(seed).spawn(2)
    simulated = SimulatedWorld(world, config.simulation, for_world)
    slam: SlamBackend = (
        TruthBackend(simulated)
        if backend == "truth"
        else backends.make(backend, config, for_backend, silent)
    )
    chosen = parts.make("explorer", explorer, config, config.explore.driving)
    extent_m, start = world.extent_m(), world.start
    loop = ClosedLoop(simulated, slam, chosen, config.explore, extent_m=extent_m, start=start)
    while loop.step():
        pass
    out = loop.outcome()
    at_s, footprint = footprint_over_time(world, out)
    r = out.report
    done = Drive(
        world_name,
        explorer,
        r.drive_time_s,
        r.path_length_m,
        r.turns,
        r.collisions,
        out.finished.reason,
        known_share(world, loop.live),
        at_s,
        footprint,
    )
    print(f"{world_name} {explorer}: {line_of(done)}", file=sys.stderr)
    return done


def line_of(d: Drive) -> str:
    """Say how a drive went."""
    return (
        f"{d.time_s:10.0f}{d.path_m:10.0f}{d.turns:7d}{d.collisions:6d}"
        f"{100 * d.known:7.2f}{100 * d.footprint[-1]:9.1f} %"
    )


def known_share(world: WorldMap, live: LiveMap) -> float:
    """Share of the floor that can be reached of which the map knows whether it is free."""
    truth = truth_map(world, LATTICE_M, "touched")
    centers_m = truth.geometry.centers()[truth.reachable]
    known = live.occupied | live.free
    return float(np.mean(live.driving_geometry.sample(known, centers_m, False)))


def footprint_over_time(world: WorldMap, out: Exploration) -> tuple[Floats, Floats]:
    """Share of the reachable floor passed over (K,) at times (K,) [s], every five seconds."""
    truth = truth_map(world, LATTICE_M)
    g, swept = truth.geometry, np.zeros(truth.blocked.shape, dtype=np.bool_)
    path = (out.truth.poses[:, :2] - (g.origin_x_m, g.origin_y_m)) / LATTICE_M
    stamps_s = (out.truth.stamps_ns - out.truth.stamps_ns[0]) * 1e-9
    at_s, share = [], []
    for first in range(0, len(path) - 1, 50):
        piece = path[first : first + 51]
        mark_swept(swept, piece, ExploreConfig().driving.robot_radius_m / LATTICE_M)
        at_s.append(stamps_s[first + len(piece) - 1])
        share.append(swept[truth.reachable].mean())
    return np.array(at_s), np.array(share)


def reached_s(ours: Drive, footprint: float) -> float:
    """When a drive had passed over a share of the floor; inf if never."""
    there = np.flatnonzero(ours.footprint >= footprint)
    return float(ours.at_s[there[0]]) if len(there) else float("inf")


def main() -> None:
    """Print one table per world, and the mean saving over the best baseline."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--worlds", default=",".join(shipped_worlds()))
    parser.add_argument("--explorers", default=",".join(COVERING))
    parser.add_argument("--backend", default="pose_graph")
    parser.add_argument("--resolution", type=float, default=0.25)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    given = parser.parse_args()
    settings = list(product(given.worlds.split(","), given.explorers.split(",")))
    savings = []
    with ProcessPoolExecutor(given.jobs, mp_context=get_context("spawn")) as pool:
        rest = (given.backend, given.resolution, given.seed)
        pending = [pool.submit(drive, *setting, *rest) for setting in settings]
        drives: list[Drive] = []
        for done in pending:
            drives.append(done.result())
            if len(drives) == len(given.explorers.split(",")):
                savings.append(show(drives))
                drives = []
    print(f"\nmean saving over the best baseline: {100 * np.mean(savings):.1f} %")


def show(drives: list[Drive]) -> float:
    """Print the explorers of one world; returns our saving over the best of the others."""
    ours = next((d for d in drives if d.explorer == OURS), None)
    print(f"\n{drives[0].world}", flush=True)
    print(
        "explorer       drive [s]  path [m]  turns  hits   known  footprint"
        "   both   ours [s]    its [s]   saved"
    )
    savings = []
    for d in drives:
        both = min(d.footprint[-1], ours.footprint[-1]) if ours else d.footprint[-1]
        ours_s = reached_s(ours, both) if ours else float("nan")
        saved = 1.0 - ours_s / reached_s(d, both)
        if d.explorer != OURS and d.footprint[-1] > 0.5:
            savings.append(saved)
        print(
            f"{d.explorer:14s}{line_of(d)}{100 * both:7.1f}{ours_s:11.0f}{reached_s(d, both):11.0f}"
            f"{100 * saved:7.1f} %   {d.reason}",
            flush=True,
        )
    return min(savings, default=float("nan"))


if __name__ == "__main__":
    main()
