# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""How many particles the improved proposal saves, as a table and a figure.

    python benchmarks/particles_needed.py [particles_needed.png]

The paper's room at 0.6 m/s, several seeds per number of particles: once with the improved
proposal, eq. (7)-(10), once drawing from the motion model, eq. (6).
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np

from slarm_graph.backends.gmapping import GmappingBackend
from slarm_graph.config import FrontendConfig, GmappingConfig, ProposalConfig, SimulationConfig
from slarm_graph.eval.alignment import fit
from slarm_graph.files.worlds import load_world
from slarm_graph.frontends.simulation.world_recording import SourceFromWorld
from slarm_graph.geometry import Floats
from slarm_graph.readings import Reading
from slarm_graph.trajectory import Trajectory

PARTICLES = {True: (1, 3, 10, 30, 100), False: (1, 3, 10, 30, 100, 300, 1000)}
NAMES = {True: "improved proposal, eq. (7)-(10)", False: "motion model, eq. (6)"}
SEEDS = 5
"""The figure shows median and span of so many; with more, the span can only grow."""


def recorded(seed: int) -> tuple[list[Reading], Trajectory]:
    """A tour of the room and the truth about it."""
    source = SourceFromWorld(load_world("paper_room"), SimulationConfig(), seed=seed)
    return list(source), source.truth()


def ate_m(readings: list[Reading], truth: Trajectory, improved: bool, particles: int) -> float:
    """RMSE of the positions of one run after SE(2) alignment [m]."""
    settings = GmappingConfig(particles=particles, proposal=ProposalConfig(improved=improved))
    backend = GmappingBackend(settings, FrontendConfig(), np.random.default_rng(0))
    for reading in readings:
        backend.update(reading)
    estimated, true = backend.result().trajectory.poses[:, :2], truth.poses[:, :2]
    errors = fit(estimated, true).reference_from_estimate.transform(estimated) - true
    return float(np.sqrt(np.square(errors).sum(axis=1).mean()))


def draw(path: Path, errors: dict[bool, Floats]) -> None:
    """Plot medians and the span of the seeds over the number of particles."""
    mpl.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(6.4, 4.2), layout="constrained")
    for improved, values in errors.items():
        counts = PARTICLES[improved]
        (line,) = axes.plot(counts, np.median(values, axis=1), "o-", label=NAMES[improved])
        axes.fill_between(
            counts, values.min(axis=1), values.max(axis=1), color=line.get_color(), alpha=0.2
        )
    axes.set(xscale="log", yscale="log", xlabel="particles", ylabel="ATE RMSE [m]")
    axes.set_title(f"Paper's room, 0.6 m/s: median and span of {SEEDS} seeds")
    axes.grid(True, which="both", alpha=0.3)
    axes.legend()
    figure.savefig(path, dpi=150)


def main(path: Path) -> None:
    """Run everything, print the table, save the figure."""
    recordings = [recorded(seed) for seed in range(SEEDS)]
    errors = {}
    for improved, counts in PARTICLES.items():
        rows = [[ate_m(*r, improved, count) for r in recordings] for count in counts]
        errors[improved] = np.array(rows)
        print(NAMES[improved])
        for count, row in zip(counts, errors[improved], strict=True):
            print(f"{count:6d} particles: median {np.median(row):.4f} m, worst {row.max():.4f} m")
    draw(path, errors)
    print(f"figure in {path}")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "particles_needed.png"))
