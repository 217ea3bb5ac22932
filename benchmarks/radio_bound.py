# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""What a part of full coverage's readings can tell at best, wherever they are taken.

    python benchmarks/radio_bound.py [--worlds A,B] [--seed 0]

Readings say of a Gaussian field what kriging with its true law and noise says (`kriging_sd_db`): no
map made of them has less error on average. `on the way` is that of a drive of `ggmr+`; `anywhere`
that of a share of as many readings, spread evenly over the floor by Lloyd's algorithm as no robot
could, for it passes all that lies between. Both are given for the fading of links in sight and out
of sight; the levels' law and the walls are taken for known. Where `anywhere` at 40 % is above `on
the way`, no way of driving is as sure as full coverage after 40 % of its readings.
"""

from __future__ import annotations

import argparse

import numpy as np
from bench_simulated_radio import PROBE_M, Heard, drive, settings
from scipy.cluster.vq import kmeans2
from scipy.linalg import cho_factor, cho_solve

from slarm_graph.files.worlds import shipped_worlds
from slarm_graph.geometry import Floats
from slarm_graph.truth_map import truth_map
from slarm_graph.world import WorldMap

SHARES = (0.4, 0.6, 1.0)
"""Of full coverage's readings; the first is what a drive for certainty was asked to do with."""
MOST, DRAWS, FLOOR_M = 2_500, 4_000, 0.1
"""Readings that are kriged, neighbours in time taken together beyond that; draws of fading; between
points that readings are spread over."""


def kriging_sd_db(
    probes_m: Floats, heard_m: Floats, noise_sd_db: float, field_sd_db: float, range_m: float
) -> float:
    """Root of the mean variance at points (P, 2) after readings at others (N, 2) [dB].

    The field's correlation is exp(-distance / range).
    """

    def covariance(a: Floats, b: Floats) -> Floats:
        """Of the field between points (A, 2) and (B, 2) [dB^2]."""
        away = np.linalg.norm(a[:, None] - b[None], axis=2)
        return np.asarray(field_sd_db**2 * np.exp(-away / range_m))

    among = covariance(heard_m, heard_m) + noise_sd_db**2 * np.eye(len(heard_m))
    across = covariance(heard_m, probes_m)
    told = (across * cho_solve(cho_factor(among), across)).sum(axis=0)
    return float(np.sqrt(np.mean(field_sd_db**2 - told)))


def floor_m(world: WorldMap, apart_m: float) -> Floats:
    """Points (P, 2) of the floor that can be reached [m]."""
    truth = truth_map(world, apart_m)
    return truth.geometry.center_of(np.argwhere(truth.reachable))


def row(name: str, heard: Heard) -> str:
    """Return a world's row."""
    stamps_ns = np.unique(heard.log.stamps_ns)
    way_m = heard.path.at(stamps_ns)[:, :2]
    together = max(1, len(way_m) // MOST)
    probes, floor = floor_m(heard.world, PROBE_M), floor_m(heard.world, FLOOR_M)
    law = heard.config.simulation.signals
    field = law.shadowing_db, law.shadowing_m
    cells = [f"{name}", f"{len(way_m)}"]
    for clear in (True, False):
        fades = [heard.channel.fade_db(clear) for _ in range(DRAWS)]
        noise = float(np.std(fades) / np.sqrt(together))
        cells.append(f"{kriging_sd_db(probes, way_m[::together], noise, *field):.2f}")
        for share in SHARES:
            count = round(share * len(way_m) / together)
            begin = floor[np.random.default_rng(0).choice(len(floor), count, replace=False)]
            even, _ = kmeans2(floor, begin, iter=12, minit="matrix")
            cells.append(f"{kriging_sd_db(probes, even, noise, *field):.2f}")
    return f"| {' | '.join(cells)} |"


def main() -> None:
    """Print a row per world."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worlds", default=",".join(shipped_worlds()))
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    shares = [f"{100 * share:.0f} % anywhere" for share in SHARES]
    kinds = [f"{kind}: {what}" for kind in ("sight", "none") for what in ("on the way", *shares)]
    print(f"| world | readings | {' | '.join(kinds)} |")
    for name in given.worlds.split(","):
        print(row(name, drive(name, settings("ggmr+", given.seed))), flush=True)


if __name__ == "__main__":
    main()
