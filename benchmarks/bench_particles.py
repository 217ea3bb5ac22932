# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Time of the particle filter against its number of particles, with a fitted exponent.

    pytest benchmarks/bench_particles.py --benchmark-only -m ''

The frontend's part does not depend on the particles and is done once beforehand; what is timed is
the filter: proposal, weights, resampling and particle maps. Processor time, best of several runs.
"""

from __future__ import annotations

import time

import numpy as np

from slarm_graph.backends.gmapping import GmappingBackend
from slarm_graph.config import FrontendConfig, GmappingConfig, SimulationConfig
from slarm_graph.files.worlds import load_world
from slarm_graph.frontends.scans.tracker import ScanTracker, TrackedScan
from slarm_graph.frontends.simulation.world_recording import SourceFromWorld
from slarm_graph.readings import Reading

PARTICLES = (1, 3, 10, 30, 100, 300)
"""Half a decade apart around the 30 of the settings; the exponent is fitted from 10 on."""
ROUNDS = 3
"""The best of so many counts: what else runs on a machine only ever adds time."""


class Replayed:
    """A tracker that has already done its work."""

    def __init__(self, scans: list[TrackedScan]) -> None:
        self._scans = iter(scans)

    def track(self, _reading: Reading) -> TrackedScan:
        """Return the next tracked scan."""
        return next(self._scans)


def filter_seconds(readings: list[Reading], scans: list[TrackedScan], particles: int) -> float:
    """Processor time of one run over tracked scans [s]."""
    settings = GmappingConfig(particles=particles)
    backend = GmappingBackend(settings, FrontendConfig(), np.random.default_rng(0))
    backend._state.tracker = Replayed(scans)
    start = time.process_time()
    for reading in readings:
        backend.update(reading)
    return time.process_time() - start


def test_time_is_linear_in_particles(benchmark) -> None:
    readings = list(SourceFromWorld(load_world("paper_room"), SimulationConfig()))
    tracker = ScanTracker(FrontendConfig())
    scans = [tracker.track(reading) for reading in readings]
    filter_seconds(readings, scans, 2)
    best = [
        min(filter_seconds(readings, scans, count) for _ in range(ROUNDS)) for count in PARTICLES
    ]
    benchmark.pedantic(filter_seconds, args=(readings, scans, 30), rounds=1)
    many = np.array(PARTICLES) >= 10
    exponent = np.polyfit(np.log(np.array(PARTICLES)[many]), np.log(np.array(best)[many]), 1)[0]
    per_particle_ms = 1e3 * (best[-1] - best[0]) / (PARTICLES[-1] - PARTICLES[0])
    for count, seconds in zip(PARTICLES, best, strict=True):
        print(f"{count:5d} particles {seconds:8.3f} s")
    print(f"exponent {exponent:.2f} from 10 to 300; {per_particle_ms:.2f} ms per particle and run")
    benchmark.extra_info["exponent"] = float(exponent)
